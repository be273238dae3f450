"""One scan of many sensors: the meaning of `ranges`, whichever engine measures them.

1. A range is the distance from the sensor to the first surface on the beam; both ends of a segment belong to it.
2. Beyond range_max: +inf. Exactly range_max is a hit.
3. Nearer than range_min: −inf, and the beam is blocked; nothing behind is reported.
4. Sensor inside a solid, or within 1 nm of a wall: every beam −inf, and `inside`.
5. A lone segment exactly edge-on is invisible. Solids never are: another face is hit.
6. A vehicle's own boxes are never seen.
7. Then come the errors of the model, in this order: mixed pixels, noise, resolution, limits, loss. Only returns have
   them: a beam that met nothing stays +inf.
8. A scanner whose beams are not of one instant ends its sweep at the instant of the world it is given.
"""

import difflib
from functools import lru_cache
from itertools import pairwise

import numpy as np

from .engines import ENGINES
from .engines.protocol import Sensors
from .laserscan import NO_HIT, ScanBatch
from .model import LidarModel
from .noise import biases, scan_keys, sensor_keys
from .pose import compose
from .scene import Boxes, Scene


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
    out           : a batch that is no longer needed: its arrays are written over and become those of the result
    """
    measure = _engine(engine)
    x, y, heading = (np.array(values, dtype=np.float64, ndmin=1) for values in (x, y, heading))
    owner = np.array(owner, dtype=np.int32, ndmin=1)
    if not x.shape == y.shape == heading.shape == owner.shape:
        shapes = ", ".join(str(values.shape) for values in (x, y, heading, owner))
        raise ValueError(f"x, y, heading, owner have shapes {shapes}; must be equal")
    ids = _numbers(len(x)) if ids is None else tuple(ids)
    if len(ids) != len(x) or _different(ids) != len(ids):
        raise ValueError(f"{len(ids)} ids, {_different(ids)} different, for {len(x)} sensors; must be one name each")
    finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
    if not finite.all():
        row = int(np.flatnonzero(~finite)[0])
        raise ValueError(f"row {row} ({ids[row]}): pose {x[row]}, {y[row]}, {heading[row]}; must be finite")
    vx, vy, yaw_rate = motion
    if not (np.isfinite(vx).all() and np.isfinite(vy).all() and np.isfinite(yaw_rate).all()):
        raise ValueError(f"motion = {motion}; must be finite")

    keys = sensor_keys(seed, ids)
    bias = biases(model.noise, keys)
    keys = scan_keys(keys, number)
    ranges, met, inside = _buffers(out, (len(x), model.samples), np.dtype(dtype), hits)
    inside[:] = False
    ends = np.linspace(0, model.samples, model.sweeps + 1).astype(int)
    for first, end in pairwise(ends.tolist()):
        # Every slice is measured at the time of its middle beam.
        later = model.sweep_time * ((first + end - 1) / 2 / (model.samples - 1) - 1) if model.sweeps > 1 else 0.0
        world = boxes.after(later) if later else boxes
        poses = compose(x + later * vx, y + later * vy, heading + later * yaw_rate, model.mount)
        sensors = Sensors(*poses, owner, keys, bias)
        inside |= measure(model, slice(first, end), scene, world, sensors, ranges, met) != NO_HIT
    for array in (ranges, met, inside):
        array.setflags(write=False)
    return ScanBatch(model, stamp - model.sweep_time, ids, ranges, met if hits else None, inside)


@lru_cache(maxsize=64)  # the same vehicles scan again and again
def _different(ids):
    return len(set(ids))


@lru_cache(maxsize=64)
def _numbers(n):
    return tuple(str(row) for row in range(n))


def _buffers(out, shape, dtype, hits):
    """Memory for ranges, hits and inside: that of `out`, or new."""
    if out is None:
        return np.empty(shape, dtype), np.empty(shape if hits else (shape[0], 0), np.int32), np.empty(shape[0], bool)
    if out.ranges.shape != shape or out.ranges.dtype != dtype or (out.hits is not None) != hits:
        have = f"{out.ranges.shape} {out.ranges.dtype}, hits {out.hits is not None}"
        raise ValueError(f"out has ranges {have}; must be {shape} {dtype}, hits {hits}")
    arrays = (out.ranges, out.hits if hits else np.empty((shape[0], 0), np.int32), out.inside)
    for array in arrays:
        array.setflags(write=True)  # refused for a view: only a batch that scan() made can be written over
    return arrays


def _engine(name):
    if name in ENGINES:
        return ENGINES[name]
    close = difflib.get_close_matches(str(name), ENGINES, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise ValueError(f"engine = {name!r}; {hint}must be one of {', '.join(ENGINES)}")
