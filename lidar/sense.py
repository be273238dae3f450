"""One scan by many sensors. The meaning of `ranges`, which does not depend on the engine:

1. A range is the distance from the sensor to the first surface on the beam; both ends of a segment belong to it.
2. Beyond range_max: +inf. Exactly range_max is a hit.
3. Nearer than range_min: −inf, and the beam is blocked; nothing behind is reported.
4. Sensor inside a solid, or within 1 nm of a wall: every beam −inf, and `inside` is set.
5. A single segment edge-on, its line within 1 nm of the sensor, is invisible. Solids never are: the beam meets another
   face.
6. The vehicle's own boxes are transparent.
7. The errors of the model follow, in this order: mixed pixels, noise, resolution, limits, loss. They apply to returns
   only: a beam that met nothing stays +inf.
8. If the beams are not measured at one instant, the last one is measured at the instant of the given world.
"""

import difflib
import operator
from functools import lru_cache

import numpy as np

from .carriers import Carriers, Occasion
from .engines import ENGINES
from .engines.protocol import Sensors
from .laserscan import NO_HIT, ScanBatch
from .model import LidarModel
from .noise import draws
from .pose import compose
from .scene import Boxes, Scene


def scan(
    model: LidarModel,
    scene: Scene,
    boxes: Boxes,
    carriers: Carriers,
    occasion: Occasion = Occasion(),  # noqa: B008 (it is immutable)
    *,
    engine: str = "raster",
    dtype=np.float32,
    out: ScanBatch | None = None,
) -> ScanBatch:
    """Scan once from each of n vehicles.

    model    : the scanner that each of the vehicles carries
    occasion : time, number of the scan and seed of the run
    engine   : a name in ENGINES
    dtype    : of the ranges, float32 or float64; all computations are in float64
    out      : a batch of the same model and size that is no longer needed, nor any scan taken from it: the result
               overwrites and takes over its arrays

    raises: ValueError
    """
    measure = _engine(engine)
    stamp, number, seed = occasion
    if not (type(number) is int and type(seed) is int):
        number, seed = operator.index(number), operator.index(seed)
    if number < 0:
        raise ValueError(f"number = {number}; must be 0 or more")
    ids = carriers.ids
    drawn = draws(model.noise, seed, ids, number, model.name)
    ranges, hits = _buffers(out, model, carriers.x.size, dtype)
    inside = None
    for beams, later in model.slices:
        world = boxes.after(later) if later else boxes
        sensors = Sensors(*_poses(carriers, later, model.mount), carriers.owner, *drawn)
        now = measure(model, beams, scene, world, sensors, ranges, hits) != NO_HIT
        inside = now if inside is None else inside | now
    for array in (ranges, hits, inside):
        array.flags.writeable = False
    return ScanBatch(model, stamp - model.sweep_time, ids, ranges, hits, inside)


def _poses(carriers, later, mount):
    """Poses of the sensors `later` seconds after the given instant: x, y, yaw, world frame, (n,) each."""
    x, y, heading = carriers.x, carriers.y, carriers.heading
    if later:
        x, y, heading = x + later * carriers.vx, y + later * carriers.vy, heading + later * carriers.yaw_rate
    return compose(x, y, heading, mount)


def _buffers(out, model, n, dtype):
    """Memory for ranges and hits: that of `out`, or new."""
    shape, dtype = (n, model.samples), np.dtype(dtype)
    if dtype not in (np.float32, np.float64):
        raise ValueError(f"dtype = {dtype}; must be float32 or float64")
    if out is None:
        return np.empty(shape, dtype), np.empty(shape, np.int32)
    if out.model != model or out.ranges.shape != shape or out.ranges.dtype != dtype or out.hits is None:
        given = f"{out.ranges.shape} {out.ranges.dtype}, hits {'left out' if out.hits is None else 'kept'}"
        raise ValueError(f"out has ranges {given}; must be {shape} {dtype}, hits kept, of the same model")
    arrays = out.ranges, out.hits
    try:
        for array in arrays:
            array.flags.writeable = True
    except ValueError:
        raise ValueError("out holds views of other arrays; must be a batch that scan() returned") from None
    return arrays


@lru_cache
def _engine(name):
    if name in ENGINES:
        return ENGINES[name].measure()
    close = difflib.get_close_matches(str(name), ENGINES, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise ValueError(f"engine = {name!r}; {hint}must be one of {', '.join(ENGINES)}")
