"""One scan of many sensors: the meaning of `ranges`, whichever engine measures them.

1. A range is the distance from the sensor to the first surface on the beam; both ends of a segment belong to it.
2. Beyond range_max: +inf. Exactly range_max is a hit.
3. Nearer than range_min: −inf, and the beam is blocked; nothing behind is reported.
4. Sensor inside a solid, or within 1 nm of a wall: every beam −inf, and `inside`.
5. A lone segment edge-on, its line within 1 nm of the sensor, is invisible. Solids never are: another face is hit.
6. A vehicle's own boxes are never seen.
7. Then come the errors of the model, in this order: mixed pixels, noise, resolution, limits, loss. Only returns have
   them: a beam that met nothing stays +inf.
8. A scanner whose beams are not of one instant ends its sweep at the instant of the world it is given.
"""

import difflib
import operator
from functools import lru_cache

import numpy as np

from .engines import ENGINES
from .engines.protocol import Sensors
from .laserscan import NO_HIT, ScanBatch
from .model import LidarModel
from .noise import draws
from .pose import compose
from .scene import FARTHEST, Boxes, Scene, owners


def scan(
    model: LidarModel,
    scene: Scene,
    boxes: Boxes,
    x,
    y,
    heading,
    owner,
    *,
    motion=(0.0, 0.0, 0.0),
    ids=None,
    stamp: float = 0.0,
    seed: int = 0,
    number: int = 0,
    engine: str = "raster",
    dtype=np.float32,
    hits: bool = True,
    out: ScanBatch | None = None,
) -> ScanBatch:
    """Scan once from each of n vehicles.

    x, y, heading : centre of each vehicle in the world frame, (n,) [m, rad]; the model's mount is added here
    owner         : owner id of each vehicle, (n,); its own boxes are transparent to it
    motion        : vx, vy, yaw rate of each vehicle in the world frame, (n,) each or one for all [m/s, rad/s]; felt
                    only where the model has sweeps
    ids           : names of the rows, (n,); row numbers if not given. Errors belong to the name, not to the row
    stamp         : time of the world that is given [s]; the last beam is measured then
    seed, number  : of the run, and of the scan in it: the same numbers give the same errors
    engine        : a name of ENGINES
    dtype         : of the ranges; all decisions are taken in float64
    hits          : whether to tell what each beam met
    out           : a batch of the same model and size that is no longer needed, nor any scan taken from it: its arrays
                    are written over and become those of the result
    """
    measure = _engine(engine)
    x, y, heading = (np.array(values, dtype=np.float64, ndmin=1) for values in (x, y, heading))
    owner = owners(owner)
    if not (x.shape == y.shape == heading.shape == owner.shape and x.ndim == 1):
        shapes = ", ".join(str(values.shape) for values in (x, y, heading, owner))
        raise ValueError(f"x, y, heading, owner have shapes {shapes}; must be equal, one value a sensor")
    ids = _numbers(len(x)) if ids is None else tuple(ids)
    if len(ids) != len(x) or _different(ids) != len(ids):
        raise ValueError(f"{len(ids)} ids, {_different(ids)} different, for {len(x)} sensors; must be one name each")
    good = (np.abs(x) <= FARTHEST) & (np.abs(y) <= FARTHEST) & np.isfinite(heading)
    if not good.all():
        row = int(np.flatnonzero(~good)[0])
        pose = f"{x[row]}, {y[row]}, {heading[row]}"
        raise ValueError(f"row {row} ({ids[row]}): pose {pose}; must be finite, within {FARTHEST:g} m of the origin")
    vx, vy, yaw_rate = (np.asarray(values, dtype=np.float64) for values in motion)
    for name, values in (("vx", vx), ("vy", vy), ("yaw_rate", yaw_rate)):
        if values.shape not in ((), x.shape) or not np.isfinite(values).all():
            raise ValueError(f"motion: {name} = {values}; must be finite, one value or one a sensor")
    dtype = np.dtype(dtype)
    if dtype not in (np.float32, np.float64):
        raise ValueError(f"dtype = {dtype}; must be float32 or float64")
    number = operator.index(number)
    if number < 0:
        raise ValueError(f"number = {number}; must be 0 or more")

    keys, bias = draws(model.noise, operator.index(seed), ids, number)
    ranges, met, inside = _buffers(out, model, len(x), dtype, hits)
    inside[:] = False
    for beams, later in model.slices:
        world = boxes.after(later) if later else boxes
        poses = compose(x + later * vx, y + later * vy, heading + later * yaw_rate, model.mount)
        sensors = Sensors(*poses, owner, keys, bias)
        inside |= measure(model, beams, scene, world, sensors, ranges, met) != NO_HIT
    for array in (ranges, met, inside):
        array.setflags(write=False)
    return ScanBatch(model, stamp - model.sweep_time, ids, ranges, met if hits else None, inside)


@lru_cache(maxsize=64)  # the same vehicles scan again and again
def _different(ids):
    return len(set(ids))


@lru_cache(maxsize=64)
def _numbers(n):
    return tuple(str(row) for row in range(n))


def _buffers(out, model, n, dtype, hits):
    """Memory for ranges, hits and inside: that of `out`, or new."""
    shape = n, model.samples
    if out is None:
        return np.empty(shape, dtype), np.empty(shape if hits else (shape[0], 0), np.int32), np.empty(shape[0], bool)
    if out.model != model or out.ranges.shape != shape or out.ranges.dtype != dtype or (out.hits is not None) != hits:
        have = f"{out.ranges.shape} {out.ranges.dtype}, hits {out.hits is not None}"
        raise ValueError(f"out has ranges {have}; must be {shape} {dtype}, hits {hits}, of the same model")
    arrays = (out.ranges, out.hits if hits else np.empty((n, 0), np.int32), out.inside)
    try:
        for array in arrays:
            array.setflags(write=True)
    except ValueError:
        raise ValueError("out holds views of other arrays; must be a batch that scan() returned") from None
    return arrays


def _engine(name):
    if name in ENGINES:
        return ENGINES[name]
    close = difflib.get_close_matches(str(name), ENGINES, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise ValueError(f"engine = {name!r}; {hint}must be one of {', '.join(ENGINES)}")
