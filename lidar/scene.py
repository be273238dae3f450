"""What a scanner can meet: a static world of segments, and boxes that move. World frame, SI."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

STATIC = -1
"""Owner id of everything in the static scene."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The static world.

    segments : walls, one row x0, y0, x1, y1 each, (m, 4)
    solids   : geometry whose interior is closed, or None; its boundary is among the segments as well
    """

    segments: np.ndarray
    solids: shapely.Geometry | None = None

    def __post_init__(self):
        segments = np.array(self.segments, dtype=np.float64).reshape(-1, 4)
        if not np.isfinite(segments).all():
            raise ValueError(f"segment {_first_bad(np.isfinite(segments).all(axis=1))}; coordinates must be finite")
        longer_than_zero = (segments[:, :2] != segments[:, 2:]).any(axis=1)
        segments = segments[longer_than_zero]
        segments.setflags(write=False)
        object.__setattr__(self, "segments", segments)
        if self.solids is not None:
            shapely.prepare(self.solids)

    @classmethod
    def from_shapely(cls, walls=(), solids=()) -> Scene:
        """A scene from geometry.

        walls  : lines, rings or polygons (also multi-part); lines and boundaries stop a beam, interiors stay free
        solids : polygons (also multi-part); a sensor inside one sees nothing
        """
        walls, solids = list(walls), list(solids)
        union = shapely.union_all(solids) if solids else None
        lines = [_lines(geometry) for geometry in (walls if union is None else [*walls, union])]
        segments = [_segments(line) for parts in lines for line in parts]
        return cls(np.concatenate(segments) if segments else np.empty((0, 4)), union)

    @cached_property
    def columns(self) -> np.ndarray:
        """The segments as rows x0, y0, x1, y1, (4, m)."""
        return np.ascontiguousarray(self.segments.T)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Bounding box of each segment as rows xmin, ymin, xmax, ymax, (4, m)."""
        return bounds(self.columns)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Oriented rectangles that move, one vehicle or one part of a vehicle each; every field (v,).

    x, y    : centre [m]
    heading : of the length axis, counter-clockwise from east [rad]
    length  : along the heading [m]
    width   : across it [m]
    owner   : id of what the box belongs to, 0 or more; a tractor and its trailer share one
    """

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    length: np.ndarray
    width: np.ndarray
    owner: np.ndarray

    def __post_init__(self):
        owner = np.array(self.owner, dtype=np.int32, ndmin=1)
        for name in ("x", "y", "heading", "length", "width"):
            values = np.array(getattr(self, name), dtype=np.float64, ndmin=1)
            if values.shape != owner.shape:
                raise ValueError(f"boxes: {name} has shape {values.shape}, owner {owner.shape}; must be equal")
            good = np.isfinite(values) & (values > 0) if name in ("length", "width") else np.isfinite(values)
            if not good.all():
                row = _first_bad(good)
                allowed = "positive and finite" if name in ("length", "width") else "finite"
                raise ValueError(f"box {row} of owner {owner[row]}: {name} = {values[row]}; must be {allowed}")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if (owner < 0).any():
            raise ValueError(f"boxes: owner = {owner.min()}; must be 0 or more, negative ids are reserved")
        owner.setflags(write=False)
        object.__setattr__(self, "owner", owner)

    @classmethod
    def empty(cls) -> Boxes:
        return cls(*([()] * 6))

    def __len__(self) -> int:
        return len(self.owner)

    def corners(self) -> np.ndarray:
        """Corners, world frame, counter-clockwise from the rear right, (v, 4, 2)."""
        return self._corners

    @cached_property
    def _corners(self):
        ahead = self.length[:, None] * np.array([-0.5, 0.5, 0.5, -0.5])
        left = self.width[:, None] * np.array([-0.5, -0.5, 0.5, 0.5])
        cos, sin = np.cos(self.heading)[:, None], np.sin(self.heading)[:, None]
        x = self.x[:, None] + (cos * ahead - sin * left)
        y = self.y[:, None] + (sin * ahead + cos * left)
        corners = np.stack([x, y], axis=2)
        corners.setflags(write=False)
        return corners

    @cached_property
    def faces(self) -> np.ndarray:
        """Sides, counter-clockwise, box after box, as rows x0, y0, x1, y1, (4, 4v)."""
        corners = self.corners()
        return np.concatenate([corners, corners[:, [1, 2, 3, 0]]], axis=2).reshape(-1, 4).T

    @cached_property
    def bounds(self) -> np.ndarray:
        """Bounding box of each box as rows xmin, ymin, xmax, ymax, (4, v)."""
        return np.concatenate([self.corners().min(axis=1), self.corners().max(axis=1)], axis=1).T


def bounds(columns):
    """Bounding boxes, rows xmin, ymin, xmax, ymax, of segments given as rows x0, y0, x1, y1; (4, m) both."""
    return np.concatenate([np.minimum(columns[:2], columns[2:]), np.maximum(columns[:2], columns[2:])])


def pairs_near(bounds, x, y, reach):
    """Which bounding boxes come within reach of which points.

    bounds  : rows xmin, ymin, xmax, ymax, (4, m)
    x, y    : points, (n,)
    reach   : along each axis [m]
    returns : row of the point and column of the box, (p,) each
    """
    xmin, ymin, xmax, ymax = bounds
    x, y = x[:, None], y[:, None]
    near = xmin <= x + reach
    near &= xmax >= x - reach
    near &= ymin <= y + reach
    near &= ymax >= y - reach
    # nonzero of a flat array and divmod are much faster than nonzero of a two-dimensional one
    return np.divmod(np.flatnonzero(near), max(near.shape[1], 1))


def blocks(n, width, size=1 << 17):
    """Slices of range(n), so short that a block by width table has about `size` entries: bounds the temporaries."""
    step = max(1, size // max(width, 1))
    return [slice(start, min(start + step, n)) for start in range(0, n, step)]


def _lines(geometry):
    """The lines of which a geometry consists, or of which its boundary does."""
    if geometry.geom_type in ("LineString", "LinearRing"):
        return [geometry]
    if geometry.geom_type == "Polygon":
        return [geometry.exterior, *geometry.interiors]
    if hasattr(geometry, "geoms"):
        return [line for part in geometry.geoms for line in _lines(part)]
    raise ValueError(f"{geometry.geom_type} in a scene; must be made of lines, rings or polygons")


def _segments(line):
    points = shapely.get_coordinates(line)
    return np.hstack([points[:-1], points[1:]])


def _first_bad(good):
    return int(np.flatnonzero(~good)[0])
