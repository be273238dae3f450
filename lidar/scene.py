"""The world of a scanner: static segments, and boxes that move. World frame, SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

STATIC = -1
"""Owner id of everything in the static scene."""

FARTHEST = 1e12
"""Largest coordinate allowed [m]. Ranges are exact to the rounding of coordinates: a nanometre at 1e6 m."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The static world.

    segments : walls, one row x0, y0, x1, y1 each, (m, 4)
    solids   : geometry with a closed interior, or None; its boundary is among the segments as well
    """

    segments: np.ndarray
    solids: shapely.Geometry | None = None

    def __post_init__(self):
        segments = np.array(self.segments, dtype=np.float64)
        if segments.size == 0:
            segments = segments.reshape(0, 4)
        if segments.ndim != 2 or segments.shape[1] != 4:
            raise ValueError(f"segments have shape {segments.shape}; must be (m, 4), rows x0, y0, x1, y1")
        good = (np.abs(segments) <= FARTHEST).all(axis=1)
        if not good.all():
            row = _first_bad(good)
            raise ValueError(f"segment {row}: {segments[row]}; must be finite, and within {FARTHEST:g} m of the origin")
        longer_than_zero = (segments[:, :2] != segments[:, 2:]).any(axis=1)
        segments = segments[longer_than_zero]
        segments.setflags(write=False)
        object.__setattr__(self, "segments", segments)
        if self.solids is not None:
            if not isinstance(self.solids, shapely.Geometry):
                raise ValueError(f"solids = {self.solids!r:.60}; must be one shapely geometry: see Scene.from_shapely")
            _check("solids", self.solids, area=True, valid=False)
            shapely.prepare(self.solids)

    def __reduce__(self):  # copies and pickles are made anew from the fields, so they are read-only as well
        return type(self), (self.segments, self.solids)

    @classmethod
    def from_shapely(cls, walls=(), solids=(), tolerance: float = 1e-6) -> Scene:
        """A scene from geometry, in few segments: the pieces of a straight wall become one.

        walls     : lines, rings or polygons (also multi-part); lines and boundaries stop a beam, interiors stay free
        solids    : polygons (also multi-part); a sensor inside one sees nothing
        tolerance : largest displacement of a wall [m]; points where three or more pieces meet stay, and rings that are
                    smaller vanish
        """
        if not (math.isfinite(tolerance) and tolerance >= 0):
            raise ValueError(f"tolerance = {tolerance}; must be finite and not negative")
        walls, solids = ([g] if isinstance(g, shapely.Geometry) else list(g) for g in (walls, solids))
        for kind, shapes in (("walls", walls), ("solids", solids)):
            for i, shape in enumerate(shapes):
                _check(f"{kind}[{i}]", shape, area=kind == "solids")
        union = _union(solids) if solids else None
        lines = [_lines(geometry) for geometry in (walls if union is None else [*walls, union])]
        segments = [_segments(line) for parts in lines for line in parts]
        if not segments:
            return cls((), union)
        return cls(_straightened(cls(np.concatenate(segments)).segments, tolerance), union)

    def enclosed(self, x, y) -> np.ndarray:
        """Which points are inside a solid, (n,) bool: the result of shapely.contains_xy in less time.

        A grid answers for points that are not near the border of a solid. shapely answers for the others; it compares a
        point with all sides as far north or south.
        """
        if not self.has_solids:
            return np.zeros(np.size(x), dtype=bool)
        x, y = np.array(x, dtype=np.float64, ndmin=1), np.array(y, dtype=np.float64, ndmin=1)
        kind = self._cells.at(x, y)
        inside = kind == _INSIDE
        near = np.flatnonzero(kind == _BORDER)
        if len(near):
            inside[near] = shapely.contains_xy(self.solids, x[near], y[near])
        return inside

    @cached_property
    def has_solids(self) -> bool:
        return self.solids is not None and not self.solids.is_empty

    @cached_property
    def kept(self) -> dict:
        """What engines derive from the scene, by keys of their own."""
        return {}

    @cached_property
    def _cells(self) -> _Cells:
        return _Cells.of(self.solids)

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
    """Oriented rectangles that move; each is a vehicle or a part of one. Every field is (v,); all but owner may be one
    value for all.

    x, y    : centre [m]
    heading : of the length axis, counter-clockwise from east [rad]
    length  : along the heading [m]
    width   : across it [m]
    owner   : id of the vehicle that the box belongs to, 0 or more; a tractor and its trailer share one
    vx, vy, yaw_rate : motion in the world frame [m/s, rad/s], 0 if not given; has an effect on scanners with sweeps
    """

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    length: np.ndarray
    width: np.ndarray
    owner: np.ndarray
    vx: np.ndarray = 0.0
    vy: np.ndarray = 0.0
    yaw_rate: np.ndarray = 0.0

    def __post_init__(self):
        owner = owners(self.owner)
        if owner.ndim != 1:
            raise ValueError(f"boxes: owner has shape {owner.shape}; must be (v,)")
        for name in ("x", "y", "heading", "length", "width", "vx", "vy", "yaw_rate"):
            values = np.array(getattr(self, name), dtype=np.float64, ndmin=1)
            if values.shape == (1,):
                values = np.full(owner.shape, values[0])
            if values.shape != owner.shape:
                raise ValueError(f"boxes: {name} has shape {values.shape}, owner {owner.shape}; must be equal")
            good = np.abs(values) <= FARTHEST
            if name in ("length", "width"):
                good &= values > 0
            if not good.all():
                row = _first_bad(good)
                allowed = "positive and finite" if name in ("length", "width") else "finite"
                raise ValueError(f"box {row} of owner {owner[row]}: {name} = {values[row]}; must be {allowed}")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        owner.setflags(write=False)
        object.__setattr__(self, "owner", owner)

    @classmethod
    def unchecked(cls, **arrays: np.ndarray) -> Boxes:
        """Boxes of arrays (v,) that the caller knows to be sound and does not change: float64, owner int32."""
        boxes = object.__new__(cls)
        boxes.__dict__.update(arrays, kept={})
        return boxes

    @classmethod
    def empty(cls) -> Boxes:
        return cls(*([()] * 6))

    def __len__(self) -> int:
        return len(self.owner)

    def __reduce__(self):
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def after(self, time: float) -> Boxes:
        """The boxes after some time at constant motion [s]; a negative time gives earlier poses."""
        return replace(
            self,
            x=self.x + time * self.vx,
            y=self.y + time * self.vy,
            heading=self.heading + time * self.yaw_rate,
        )

    def corners(self) -> np.ndarray:
        """Corners, world frame, counter-clockwise from the rear right, (v, 4, 2)."""
        return self._corners

    @cached_property
    def kept(self) -> dict:
        """What engines derive from the boxes, by keys of their own."""
        return {}

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


def owners(ids) -> np.ndarray:
    """Owner ids as whole numbers, (n,) int32. raises: ValueError"""
    ids = np.array(ids, ndmin=1)
    whole = ids.astype(np.int32) if ids.dtype.kind in "iuf" else np.full(ids.shape, -1, dtype=np.int32)
    good = (whole == ids) & (whole >= 0) & (whole < np.iinfo(np.int32).max)
    if not good.all():
        what = f"owner = {ids[~good][0]}"
        raise ValueError(f"{what}; must be a whole number, 0 to 2^31 - 2; negative ones are reserved")
    return whole


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
    """Slices of range(n), so short that a table of slice by width has about `size` entries: bounds the temporaries."""
    step = max(1, size // max(width, 1))
    return [slice(start, min(start + step, n)) for start in range(0, n, step)]


_FREE, _INSIDE, _BORDER = range(3)


class _Cells(NamedTuple):
    """Squares around solids; each is wholly free, wholly inside or contains a border. The outermost ones are free.

    x, y : where the first one begins [m]
    size : of their sides [m]
    kind : one of the above, (columns, rows) uint8
    """

    x: float
    y: float
    size: float
    kind: np.ndarray

    @classmethod
    def of(cls, solids) -> _Cells:
        sides = np.array(_lines(solids))
        low, high = shapely.bounds(solids).reshape(2, 2)
        # Some 60 squares for each side of a solid: few points on a street share one with a wall. At most 4 MB.
        wanted = min(64 * shapely.get_num_coordinates(solids), 1 << 22)
        size = max(np.sqrt(np.prod(high - low) / wanted), 2 * (high - low).max() / wanted)  # the latter if slender
        low = low - 1.5 * size
        kind = np.full(np.ceil((high - low) / size).astype(int) + 2, _FREE, dtype=np.uint8)

        # A piece shorter than a side lies only in the cells of the corners of its bounding box. The margin makes
        # rounding harmless, here and in `at`.
        pieces = [_segments(line) for line in shapely.segmentize(sides, 0.9 * size)]
        xmin, ymin, xmax, ymax = bounds((np.concatenate(pieces).T - np.tile(low, 2)[:, None]) / size)
        for column in (xmin - 0.01, xmax + 0.01):
            for row in (ymin - 0.01, ymax + 0.01):
                kind[column.astype(int), row.astype(int)] = _BORDER

        # All cells of a column between two borders are alike: the first one decides.
        clear = kind != _BORDER
        first = clear.copy()
        first[:, 1:] &= ~clear[:, :-1]
        column, row = np.nonzero(first)
        inside = shapely.contains_xy(solids, low[0] + (column + 0.5) * size, low[1] + (row + 0.5) * size)
        kind[clear] = np.where(inside, _INSIDE, _FREE)[np.cumsum(first)[clear.ravel()] - 1]
        return cls(*low, size, kind)

    def at(self, x, y):
        columns, rows = self.kind.shape
        # fmax and fmin ignore NaN, which thus lands in a free cell
        column = np.fmin(np.fmax((x - self.x) / self.size, 0), columns - 1).astype(np.intp)
        row = np.fmin(np.fmax((y - self.y) / self.size, 0), rows - 1).astype(np.intp)
        return self.kind[column, row]


def _union(solids):
    """Union of polygons. In floating point GEOS may lose a whole one (libgeos/geos issues 965, 1344); on a grid not."""
    union = shapely.union_all(solids)
    shapely.prepare(union)
    amid = shapely.point_on_surface(solids)
    whole = (shapely.covers(union, amid) | shapely.is_empty(solids)).all()
    return union if whole else shapely.union_all(solids, grid_size=1e-6)


def _straightened(segments, tolerance):
    """The same walls in fewer segments: each once, and in one piece from corner to corner; (m, 4) both."""
    points, ends = np.unique(segments.view(complex).ravel(), return_inverse=True)
    ends = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0)
    meeting = np.bincount(ends.ravel())  # how many segments at each point
    pieces = shapely.linestrings(points[ends].view(float).reshape(-1, 2, 2))
    lines = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(pieces)))  # where two meet and no more
    for i in np.flatnonzero(shapely.is_closed(lines)):
        ring = shapely.get_coordinates(lines[i])[:-1]
        if meeting[np.searchsorted(points, ring.view(complex)[0, 0])] == 2:
            # The ring begins anywhere; let it begin at a corner. The vertex farthest from any point is one.
            ring = np.roll(ring, -np.argmax(np.hypot(*(ring - ring[0]).T)), axis=0)
            lines[i] = shapely.LineString([*ring, ring[0]])
    lines = shapely.simplify(lines, tolerance / 2, preserve_topology=False)
    # simplify keeps any of several vertices that are equally far from a chord, even one within a straight wall parallel
    # to the chord; a second comparison of each vertex with its neighbours finds it. Only one of two in a row is
    # removed, or errors would add up.
    vertices, line = shapely.get_coordinates(lines, return_index=True)
    inner = np.flatnonzero(line[2:] == line[:-2]) + 1
    chords = shapely.linestrings(np.stack([vertices[inner - 1], vertices[inner + 1]], axis=1))
    flat = inner[shapely.distance(shapely.points(vertices[inner]), chords) <= tolerance / 2]
    flat = flat[~np.isin(flat - 1, flat)]
    vertices, line = np.delete(vertices, flat, axis=0), np.delete(line, flat)
    fewer = np.hstack([vertices[:-1], vertices[1:]])[line[1:] == line[:-1]]
    return fewer if len(fewer) < len(segments) else segments  # in their own order


def _check(name, geometry, area, valid=True):
    """Raise ValueError unless the geometry is of a kind that a scene is made of, and valid where that is asked for."""
    allowed = ("Polygon", "MultiPolygon") if area else _WALLS
    kind = getattr(geometry, "geom_type", type(geometry).__name__)
    if kind == "GeometryCollection":
        for part in geometry.geoms:
            _check(name, part, area, valid)
    elif kind not in allowed:
        raise ValueError(f"{name} is a {kind}; must be one of {', '.join(allowed)}")
    elif area and valid and not geometry.is_valid:
        raise ValueError(f"{name}: {shapely.is_valid_reason(geometry)}; must be valid, shapely.make_valid may help")


_WALLS = ("LineString", "LinearRing", "Polygon", "MultiLineString", "MultiPolygon")


def _lines(geometry):
    """The lines of which a geometry consists, or of which its boundary does."""
    if geometry.geom_type in ("LineString", "LinearRing"):
        return [geometry]
    if geometry.geom_type == "Polygon":
        return [geometry.exterior, *geometry.interiors]
    return [line for part in geometry.geoms for line in _lines(part)]


def _segments(line):
    points = shapely.get_coordinates(line)
    return np.hstack([points[:-1], points[1:]])


def _first_bad(good):
    return int(np.flatnonzero(~good)[0])
