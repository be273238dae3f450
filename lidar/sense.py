"""One scan of many sensors: the meaning of `ranges`, whichever engine measures them.

1. A range is the distance from the sensor to the first surface on the beam; both ends of a segment belong to it.
2. Beyond range_max: +inf. Exactly range_max is a hit.
3. Nearer than range_min: −inf, and the beam is blocked; nothing behind is reported.
4. Sensor inside a solid, or within 1 nm of a wall: every beam −inf, and `inside`.
5. A lone segment exactly edge-on is invisible. Solids never are: another face is hit.
6. A vehicle's own boxes are never seen.
"""

import difflib

import numpy as np
import shapely

from .engines import ENGINES
from .laserscan import NO_HIT, ScanBatch
from .model import LidarModel
from .pose import compose
from .scene import STATIC, Boxes, Scene, blocks, pairs_near

TOUCHING = 1e-9  # [m]
ROUNDING = 1e-12  # relative; so that a wall exactly at a limit counts as in range, however it was computed


def scan(
    model: LidarModel,
    scene: Scene,
    boxes: Boxes,
    x,
    y,
    heading,
    owner,
    *,
    ids=None,
    stamp: float = 0.0,
    engine: str = "numpy",
    dtype=np.float32,
) -> ScanBatch:
    """Scan once from each of n vehicles.

    x, y, heading : centre of each vehicle in the world frame, (n,) [m, rad]; the model's mount is added here
    owner         : owner id of each vehicle, (n,); its own boxes are transparent to it
    ids           : names of the rows, (n,); row numbers if not given
    stamp         : time of the scan [s]
    engine        : a name of ENGINES
    dtype         : of the ranges; all decisions are taken in float64
    """
    cast = _engine(engine)
    x, y, heading = (np.array(values, dtype=np.float64, ndmin=1) for values in (x, y, heading))
    owner = np.array(owner, dtype=np.int32, ndmin=1)
    if not x.shape == y.shape == heading.shape == owner.shape:
        shapes = ", ".join(str(values.shape) for values in (x, y, heading, owner))
        raise ValueError(f"x, y, heading, owner have shapes {shapes}; must be equal")
    ids = tuple(str(row) for row in range(len(x))) if ids is None else tuple(ids)
    if len(ids) != len(x) or len(set(ids)) != len(ids):
        raise ValueError(f"{len(ids)} ids, {len(set(ids))} different, for {len(x)} sensors; must be one name each")
    finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
    if not finite.all():
        row = int(np.flatnonzero(~finite)[0])
        raise ValueError(f"row {row} ({ids[row]}): pose {x[row]}, {y[row]}, {heading[row]}; must be finite")

    x, y, yaw = compose(x, y, heading, model.mount)
    ranges, hits = cast(model, scene, boxes, x, y, yaw, owner)

    too_far = ranges > model.range_max * (1 + ROUNDING)
    too_close = ranges < model.range_min * (1 - ROUNDING)
    np.clip(ranges, model.range_min, model.range_max, out=ranges)
    ranges[too_far], hits[too_far] = np.inf, NO_HIT
    ranges[too_close] = -np.inf

    around = enclosing(scene, boxes, x, y, owner)
    inside = around != NO_HIT
    if inside.any():
        ranges[inside], hits[inside] = -np.inf, around[inside, None]
    ranges = ranges.astype(dtype, copy=False)
    ranges.setflags(write=False)
    return ScanBatch(model, stamp, ids, ranges, hits, inside)


def enclosing(scene, boxes, x, y, owner):
    """Owner of what a sensor is inside of or touches, the smallest if several; NO_HIT if it is free.

    x, y, owner : sensors, world frame, (n,)
    returns     : (n,) int32
    """
    around = np.full(len(x), np.iinfo(np.int32).max, dtype=np.int32)
    for rows in blocks(len(x), max(len(boxes), len(scene.segments))):
        sensor, box = pairs_near(boxes.bounds, x[rows], y[rows], TOUCHING)
        sensor += rows.start
        others = boxes.owner[box] != owner[sensor]
        sensor, box = sensor[others], box[others]
        if len(sensor):
            dx, dy = x[sensor] - boxes.x[box], y[sensor] - boxes.y[box]
            cos, sin = np.cos(boxes.heading[box]), np.sin(boxes.heading[box])
            within = np.abs(cos * dx + sin * dy) <= boxes.length[box] / 2 + TOUCHING
            within &= np.abs(cos * dy - sin * dx) <= boxes.width[box] / 2 + TOUCHING
            np.minimum.at(around, sensor[within], boxes.owner[box[within]])
        sensor, wall = pairs_near(scene.bounds, x[rows], y[rows], TOUCHING)
        sensor += rows.start
        if len(sensor):
            distance = _distance(scene.segments[wall], x[sensor], y[sensor])
            around[sensor[distance <= TOUCHING]] = STATIC
    if scene.solids is not None:
        around[shapely.contains_xy(scene.solids, x, y)] = STATIC
    around[around == np.iinfo(np.int32).max] = NO_HIT
    return around


def _distance(segments, x, y):
    """Distance of point i from segment i, (p,) [m]."""
    x0, y0, x1, y1 = segments.T
    ex, ey, px, py = x1 - x0, y1 - y0, x - x0, y - y0
    along = np.clip((px * ex + py * ey) / (ex * ex + ey * ey), 0.0, 1.0)
    return np.hypot(px - along * ex, py - along * ey)


def _engine(name):
    if name in ENGINES:
        return ENGINES[name]
    close = difflib.get_close_matches(str(name), ENGINES, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise ValueError(f"engine = {name!r}; {hint}must be one of {', '.join(ENGINES)}")
