"""What scans cost on this machine, in towns from a seed: `platoontraffic bench lidar`.

Times are CPU time of the calling thread, so that other jobs disturb little. What engines keep for a scene (grid, search
tree, physics space) is built before; what they make anew at every call counts. Calls that are compared take turns, so
that a slow moment meets all of them. Nothing here fails on a slow day.
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
import shapely

from ..engines import ENGINES
from ..model import PRESETS, LidarModel, Mount
from ..pose import compose
from ..scene import STATIC, Boxes, Scene, blocks, bounds, pairs_near
from ..sense import scan

BLOCK, ROAD = 150.0, 7.0  # from road to road, and width of a road of two lanes [m]
LENGTH, WIDTH = 4.5, 1.8  # of a vehicle [m]
SLOTS = 18  # places for a vehicle on a lane between two junctions
MOUNT = Mount(x=LENGTH / 2 + 0.05)  # just ahead of the bumper
SAMPLE = 2e-3  # [s]; a call is repeated until so much is spent
COMPARED = 8  # scans to be judged by the shapely engine
YARDSTICKS = ("brute force", "brute force in view", "floor")


def _view(half_angle_deg, range_max):
    half = math.radians(half_angle_deg)
    return LidarModel(720, -half, half, 0.3, range_max, mount=MOUNT)


VIEWS = {
    "lead30": _view(90, 30.0),
    "lead60": _view(90, 60.0),
    "foll30": _view(11.5, 30.0),
    "foll60": _view(11.5, 60.0),
}


class Size(NamedTuple):
    """A town of blocks by blocks, its vehicles, and how many of them sense; its kerbs in pieces, or merged."""

    name: str
    blocks: int
    vehicles: int
    sensing: int
    merged: bool = False


@dataclass(frozen=True)
class Plan:
    """How much to measure.

    sizes   : towns for all views and engines
    fewer   : sensors of slow engines
    samples : of each call, and of slow engines
    large   : the size for noise, linear and memory
    ticks   : the sizes for whole ticks
    flat    : blocks of towns of one density
    linear  : numbers of sensors
    memory  : engines
    cold    : compile everything anew, elsewhere
    """

    sizes: tuple[Size, ...]
    fewer: dict[str, int]
    samples: tuple[int, int]
    large: str
    ticks: tuple[str, ...]
    flat: tuple[int, ...]
    linear: tuple[int, ...]
    memory: tuple[str, ...]
    cold: bool


FULL = Plan(
    sizes=(
        Size("S", 4, 100, 10),
        Size("M", 13, 1000, 100),
        Size("L", 29, 5000, 500),
        Size("L merged", 29, 5000, 500, merged=True),
        Size("D", 13, 5000, 500),
    ),
    fewer={"numpy": 50, "pymunk": 4, "shapely": 4},
    samples=(15, 5),
    large="L",
    ticks=("L", "D"),
    flat=(13, 29, 41),
    linear=(250, 500, 1000),
    memory=tuple(ENGINES),
    cold=True,
)
QUICK = Plan(
    sizes=FULL.sizes[:2],
    fewer={"numpy": 20, "pymunk": 1, "shapely": 1},
    samples=(5, 2),
    large="M",
    ticks=("M",),
    flat=(4, 13),
    linear=(250, 500, 1000),
    memory=("raster",),
    cold=False,
)


# ---- rows of the report; names carry units, for they become JSON


class Case(NamedTuple):
    """candidates: surfaces a sensor that brute force looks at, and those of them that may be in view."""

    scene: str
    view: str
    walls: int
    vehicles: int
    candidates: float
    candidates_in_view: float


class Scans(NamedTuple):
    """Time of a scan; the last two are against the shapely engine, over some scans in float64.

    difference_m : largest of the ranges that both measured
    differing    : beams that met something in one and nothing in the other
    """

    scene: str
    view: str
    engine: str
    sensors: int
    median_us: float
    best_us: float
    beams_per_us: float
    to_raster: float
    difference_m: float | None
    differing: int | None


class NoiseCost(NamedTuple):
    scene: str
    view: str
    without_us: float
    with_us: float
    ns_a_beam: float
    share: float


class Tick(NamedTuple):
    scene: str
    vehicles: int
    leaders: int
    followers: int
    median_ms: float
    best_ms: float


class Growth(NamedTuple):
    """ratio: to the row before, of the time of a scan where the town grows, of the call where the sensors do."""

    scene: str
    view: str
    vehicles: int
    sensors: int
    median_us: float
    best_us: float
    ratio: float | None


class Start(NamedTuple):
    """A new process until something is done, by the clock and in CPU time."""

    until: str
    clock_s: float
    cpu_s: float
    numba_imported: bool


class Memory(NamedTuple):
    """what: peak of a process, or arrays kept for a scene."""

    what: str
    megabytes: float | None


class Bar(NamedTuple):
    """What is wanted, and the worst that was measured."""

    wanted: str
    worst: float
    where: str
    met: bool


@dataclass(frozen=True)
class Report:
    machine: dict[str, str]
    cases: list[Case]
    scans: list[Scans]
    noise: list[NoiseCost]
    ticks: list[Tick]
    flat: list[Growth]
    linear: list[Growth]
    starts: list[Start]
    memory: list[Memory]
    bars: list[Bar]

    def json(self) -> str:
        return json.dumps({name: _plain(value) for name, value in vars(self).items()}, indent=1, allow_nan=False)


def _plain(value):
    return [row._asdict() for row in value] if isinstance(value, list) else value


# ---- towns


def town(blocks: int, vehicles: int, seed: int = 1) -> tuple[Scene, Boxes]:
    """A grid of two-lane roads with kerbs in pieces of 5 m, six buildings a block, and vehicles on the right.

    No two vehicles overlap, and none is on a junction: a lane between two junctions has places for 18, and each vehicle
    has one by lot. Their order is random.
    """
    rng = np.random.default_rng(seed)
    line = BLOCK * np.arange(blocks + 1)

    cut = np.linspace(ROAD / 2, BLOCK - ROAD / 2, 30)  # kerbs end at junctions
    side = np.sort([line - ROAD / 2, line + ROAD / 2], axis=None)
    begin, end = np.add.outer(line[:-1], cut[:-1]).ravel(), np.add.outer(line[:-1], cut[1:]).ravel()
    across, begin, end = np.repeat(side, len(begin)), np.tile(begin, len(side)), np.tile(end, len(side))
    kerbs = [np.stack([begin, across, end, across]), np.stack([across, begin, across, end])]

    east, north = (values.ravel() for values in np.meshgrid(line[:-1], line[:-1]))
    column, row = np.divmod(np.arange(6), 2)
    plot = (BLOCK - ROAD) / np.array([[[3]], [[2]]])  # width and depth
    middle = np.stack([np.add.outer(east, column * plot[0, 0]), np.add.outer(north, row * plot[1, 0])])
    half = rng.uniform(12, 20, middle.shape)
    middle += ROAD / 2 + plot / 2 + rng.uniform(-1, 1, middle.shape) * (plot / 2 - 2 - half)
    (x0, y0), (x1, y1) = (middle - half).reshape(2, -1), (middle + half).reshape(2, -1)
    faces = [np.stack(ends) for ends in ((x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0))]
    scene = Scene(np.concatenate([*kerbs, *faces], axis=1).T)

    shape = (2, blocks + 1, 2, blocks, SLOTS)
    north_south, road, back, block, slot = np.unravel_index(
        rng.choice(math.prod(shape), vehicles, replace=False), shape
    )
    lane = north_south * math.pi / 2 + back * math.pi
    room = (BLOCK - ROAD) / SLOTS
    along = BLOCK * block + ROAD / 2 + room * (slot + 0.5) + rng.uniform(-1.5, 1.5, vehicles)
    right = ROAD / 4 + np.clip(rng.normal(0, 0.2, vehicles), -0.5, 0.5)
    x = np.where(north_south, line[road], along) + right * np.sin(lane)
    y = np.where(north_south, along, line[road]) - right * np.cos(lane)
    heading = lane + np.clip(rng.normal(0, 0.03, vehicles), -0.1, 0.1)
    size = np.full(vehicles, LENGTH), np.full(vehicles, WIDTH)
    return scene, Boxes(x, y, heading, *size, owner=np.arange(vehicles))


def _town(size):
    scene, boxes = town(size.blocks, size.vehicles)
    if size.merged:
        scene = Scene.from_shapely(shapely.linestrings(scene.segments.reshape(-1, 2, 2)))
    return scene, boxes


# ---- times


class Spent(NamedTuple):
    """CPU time of a call [s]."""

    median: float
    best: float


def cpu(calls: dict[str, Callable[[], object]], samples: int) -> dict[str, Spent]:
    """CPU time of each call, warm: one before each sample does not count, the first of which builds and compiles."""
    often = {}
    for name, call in calls.items():
        call()
        often[name] = 1
        while _cpu(call, often[name]) < SAMPLE:
            often[name] *= 2
    times = {name: [] for name in calls}
    for _ in range(samples):
        for name, call in calls.items():
            call()
            times[name].append(_cpu(call, often[name]) / often[name])
    return {name: Spent(median(spent), min(spent)) for name, spent in times.items()}


def _cpu(call, often):
    began = time.thread_time()
    for _ in range(often):
        call()
    return max(time.thread_time() - began, 1e-9)  # a coarse clock may show nothing


def _first(sensors, boxes):
    """Poses and owners of the first vehicles."""
    return boxes.x[:sensors], boxes.y[:sensors], boxes.heading[:sensors], boxes.owner[:sensors]


def _scanning(model, scene, boxes, sensors, engine="raster"):
    """A call that scans from the first vehicles, into the same memory every time."""
    poses = _first(sensors, boxes)
    ids = tuple(f"veh.{owner}" for owner in poses[3])
    batch = scan(model, scene, boxes, *poses, ids=ids, engine=engine)
    return lambda: scan(model, scene, boxes, *poses, ids=ids, engine=engine, out=batch)


# ---- yardsticks


def _floor(model, sensors):
    """A call that clears, divides and stores as many numbers as a scan has."""
    from . import kernels  # here, for it imports numba

    ranges = np.empty((sensors, model.samples))
    return lambda: kernels.floor(model.directions, 0.1, ranges)


def _brute_force(model, sensor, ends, owner, sensors):
    """A call that tries every beam on every candidate, and the ranges it fills.

    Finding and turning the candidates, checks and errors are not in its time: it is slower than it seems.
    """
    from . import kernels

    first = np.searchsorted(sensor, np.arange(sensors + 1))
    faces = np.ascontiguousarray(ends.transpose(1, 0, 2).reshape(4, -1))
    ranges, hits = np.empty((sensors, model.samples)), np.empty((sensors, model.samples), np.int32)
    # Side by side: anywhere, two of them now and then lie a multiple of 4 KiB apart, which the processor takes for the
    # same place at first; of twenty layouts one took two to four times as long.
    room = np.concatenate([model.directions, np.empty((2, model.samples))])
    arguments = first, faces, owner.astype(float), *room, model.range_min, model.range_max, ranges, hits
    return lambda: kernels.brute_force(*arguments), ranges


def _candidates(model, scene, boxes, sensors):
    """Surfaces that the first vehicles could see: all whose bounding box comes within reach of the sensor's x and y.

    returns: row of the sensor, rising, (c,); the ends as x and y in its frame, counter-clockwise, (2, 2, c); owner,
             (c,); whether it is a wall or the near side of a box, and in the bounding box of the sector in view, (c,)
    """
    x, y, heading, own = _first(sensors, boxes)
    x, y, yaw = compose(x, y, heading, model.mount)
    edges = np.concatenate([scene.columns, boxes.faces], axis=1)
    edge_owner = np.concatenate([np.full(len(scene.segments), STATIC), np.repeat(boxes.owner, 4)])
    edge_bounds = bounds(edges)
    near = []
    for rows in blocks(sensors, edges.shape[1]):
        sensor, edge = pairs_near(edge_bounds, x[rows], y[rows], model.reach)
        near.append((sensor + rows.start, edge))
    sensor, edge = (np.concatenate(parts) for parts in zip(*near, strict=True))
    others = edge_owner[edge] != own[sensor]
    sensor, edge = sensor[others], edge[others]
    owner = edge_owner[edge]

    east, north = edges[0::2, edge] - x[sensor], edges[1::2, edge] - y[sensor]
    cos, sin = np.cos(yaw[sensor]), np.sin(yaw[sensor])
    ends = np.stack([cos * east + sin * north, cos * north - sin * east])
    area = ends[0, 0] * ends[1, 1] - ends[1, 0] * ends[0, 1]
    # The sector's box: the beams' ends, the sensor, and straight ahead, where the arc of all views passes an axis.
    corners = model.reach * np.hstack([model.directions, [[0.0, 1.0], [0.0, 0.0]]])
    low, high = corners.min(axis=1)[:, None], corners.max(axis=1)[:, None]
    in_view = ((ends.min(axis=1) <= high) & (ends.max(axis=1) >= low)).all(axis=0)
    in_view &= (owner == STATIC) | (area < 0)
    return sensor, np.where(area < 0, ends[:, ::-1], ends), owner, in_view


# ---- what is measured


def run(plan: Plan = FULL, progress: Callable[[str], object] = lambda stage: None) -> Report:
    """Measure everything; `progress` is told what comes next."""
    machine = _machine()
    cases, scans, noise, ticks, linear = [], [], [], [], []
    for size in plan.sizes:
        scene, boxes = _town(size)
        for view in VIEWS:
            progress(f"scene {size.name}, {view}")
            case, rows = _case(plan, size, view, scene, boxes)
            cases.append(case)
            scans += rows
        if size.name == plan.large:
            progress("noise and number of sensors")
            noise = [_noise(plan, size, view, scene, boxes) for view in ("lead60", "foll30")]
            linear = _linear(plan, size, scene, boxes)
        if size.name in plan.ticks:
            progress("a whole tick")
            ticks.append(_tick(plan, size, scene, boxes))
    progress("size of the town")
    flat = _flat(plan, merged=False) + _flat(plan, merged=True)
    with tempfile.TemporaryDirectory() as cache:
        elsewhere = {"NUMBA_CACHE_DIR": cache} if plan.cold else {}
        progress("start of a process")
        starts = _starts(plan, elsewhere)
        progress("memory")
        memory = _memory(plan, elsewhere)
    machine["load_after"] = _load()
    return Report(
        machine, cases, scans, noise, ticks, flat, linear, starts, memory, bars(plan, scans, ticks, flat, linear)
    )


def _case(plan, size, view, scene, boxes):
    model = VIEWS[view]
    sensors = {name: plan.fewer.get(name, size.sensing) for name in (*ENGINES, *YARDSTICKS)}
    sensor, ends, owner, in_view = _candidates(model, scene, boxes, size.sensing)
    every, every_ranges = _brute_force(model, sensor, ends, owner, size.sensing)
    few, few_ranges = _brute_force(model, sensor[in_view], ends[..., in_view], owner[in_view], size.sensing)
    calls = {name: _scanning(model, scene, boxes, sensors[name], name) for name in ENGINES}
    calls |= zip(YARDSTICKS, (every, few, _floor(model, size.sensing)), strict=True)
    slow = {name: call for name, call in calls.items() if name in plan.fewer}
    fast = {name: call for name, call in calls.items() if name not in plan.fewer}
    spent = cpu(fast, plan.samples[0]) | cpu(slow, plan.samples[1])

    poses = _first(COMPARED, boxes)
    ranges = {e: scan(model, scene, boxes, *poses, engine=e, dtype=np.float64, hits=False).ranges for e in ENGINES}
    ranges |= zip(YARDSTICKS, (every_ranges[:COMPARED], few_ranges[:COMPARED]), strict=False)
    rows = []
    for name, number in sensors.items():
        each, best = (1e6 * seconds / number for seconds in spent[name])
        ratio = each / (1e6 * spent["raster"].median / sensors["raster"])
        agreement = _agreement(ranges[name], ranges["shapely"]) if name in ranges else (None, None)
        rows.append(Scans(size.name, view, name, number, each, best, model.samples / each, ratio, *agreement))
    found = len(owner) / size.sensing, in_view.sum() / size.sensing
    return Case(size.name, view, len(scene.segments), len(boxes), *map(float, found)), rows


def _agreement(ranges, reference):
    """Largest difference, and how many beams met something in only one of both."""
    met, also = np.isfinite(ranges), np.isfinite(reference)
    both = met & also
    return float(np.abs(ranges[both] - reference[both]).max(initial=0.0)), int((met != also).sum())


def _noise(plan, size, view, scene, boxes):
    exact = VIEWS[view]
    models = {"without": exact, "with": replace(exact, noise=PRESETS["car-leader"].noise)}
    spent = cpu({name: _scanning(m, scene, boxes, size.sensing) for name, m in models.items()}, plan.samples[0])
    without, noisy = (1e6 * spent[name].median / size.sensing for name in models)
    return NoiseCost(size.name, view, without, noisy, 1e3 * (noisy - without) / exact.samples, noisy / without - 1)


def _linear(plan, size, scene, boxes):
    spent = cpu({n: _scanning(VIEWS["lead30"], scene, boxes, n) for n in plan.linear}, plan.samples[0])
    calls = [1e6 * spent[n].median for n in plan.linear]
    return [
        Growth(size.name, "lead30", len(boxes), n, call / n, 1e6 * spent[n].best / n, call / before)
        for n, call, before in zip(plan.linear, calls, [calls[0], *calls], strict=False)
    ]


def _flat(plan, merged):
    """The same number of sensors in towns with as many vehicles a road."""
    name = "merged" if merged else "pieces"
    sizes = [Size(f"{n} x {n} {name}", n, round(1000 * n * (n + 1) / (13 * 14)), 0, merged) for n in plan.flat]
    towns = {size.name: _town(size) for size in sizes}
    sensors = min(500, *(len(boxes) for _, boxes in towns.values()))
    rows = []
    for view in ("lead60", "foll30"):
        spent = cpu({n: _scanning(VIEWS[view], *towns[n], sensors) for n in towns}, plan.samples[0])
        least = spent[sizes[0].name].median
        for n, (_, boxes) in towns.items():
            each, best = (1e6 * seconds / sensors for seconds in spent[n])
            rows.append(Growth(n, view, len(boxes), sensors, each, best, spent[n].median / least))
    return rows


def _tick(plan, size, scene, boxes):
    """As in platoontraffic.world.sensing: vehicles from arrays, then a scan for each model."""
    parts = [(VIEWS["lead60"], slice(0, 200)), (VIEWS["foll30"], slice(200, 1000))]
    ids = [tuple(f"veh.{owner}" for owner in boxes.owner[rows]) for _, rows in parts]
    batches = [None, None]
    speed = np.full(len(boxes), 10.0)

    def tick():
        vx, vy, yaw_rate = speed * np.cos(boxes.heading), speed * np.sin(boxes.heading), np.zeros(len(speed))
        now = Boxes(boxes.x, boxes.y, boxes.heading, boxes.length, boxes.width, boxes.owner, vx, vy, yaw_rate)
        for i, (model, rows) in enumerate(parts):
            poses = now.x[rows], now.y[rows], now.heading[rows], now.owner[rows]
            motion = now.vx[rows], now.vy[rows], now.yaw_rate[rows]
            batches[i] = scan(model, scene, now, *poses, motion=motion, ids=ids[i], out=batches[i])

    median_, best = (1e3 * seconds for seconds in cpu({"tick": tick}, plan.samples[0])["tick"])
    return Tick(size.name, len(boxes), *map(len, ids), median_, best)


# ---- new processes

CHILD = """
import sys, time
sys.path[0] = sys.argv[1]
from platoontraffic import lidar
imported = time.time(), time.process_time(), "numba" in sys.modules
from platoontraffic.lidar import benchmark
benchmark.child(imported, *sys.argv[2:])
"""


def _in_child(environment, *arguments):
    """What `child` prints in a new process."""
    package = Path(sys.modules[__name__.partition(".")[0]].__file__).parent
    command = [sys.executable, "-c", CHILD, str(package.parent), *arguments]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def child(imported, *arguments: str) -> None:
    """In a process of its own: scan once and tell when that was, or fill memory and tell how much it was."""
    if not arguments:
        scan(VIEWS["lead60"], Scene([(5, -9, 5, 9)]), Boxes.empty(), 0, 0, 0, 0)
        print(json.dumps([imported, (time.time(), time.process_time(), "numba" in sys.modules)]))
        return
    size, engine = arguments
    scene, boxes = _town(next(s for s in FULL.sizes if s.name == size))
    if engine:
        scan(VIEWS["lead60"], scene, boxes, *_first(4, boxes), engine=engine)
    print(json.dumps(_peak()))


def _starts(plan, environment):
    rows = []
    for state in ("cold", "warm") if plan.cold else ("warm",):
        began = time.time()
        imported, scanned = _in_child(environment)
        rows.append(Start(f"first scan, {state}", scanned[0] - began, *scanned[1:]))
    return [Start("import lidar", imported[0] - began, *imported[1:]), *rows]


def _memory(plan, environment):
    peaks = [Memory(f"process with the town {plan.large}", _in_child(environment, plan.large, ""))]
    for engine in plan.memory:
        peaks.append(Memory(f"... and 4 scans by {engine}", _in_child(environment, plan.large, engine)))
    large = next(size for size in plan.sizes if size.name == plan.large)
    edges = Size("10200 edges", 50, 100, 1)
    grids = [(s, _grid_of(*_town(s))) for s in (large, large._replace(merged=True, name=f"{large.name} merged"), edges)]
    return peaks + [Memory(f"walls and their grid in raster, {size.name}", grid) for size, grid in grids]


def _grid_of(scene, boxes):
    """Arrays that the raster engine keeps for a scene, and the scene's own [MB]."""
    from ..engines.raster_engine import _walls

    scan(VIEWS["lead30"], scene, boxes, *_first(1, boxes))
    kept = [scene.segments, *(part for part in _walls[scene] if isinstance(part, np.ndarray))]
    return sum(array.nbytes for array in kept) / 1e6


def _peak():
    """Most memory this process has had [MB], or None.

    Linux keeps the peak of the process that started this one in ru_maxrss; VmHWM is our own.
    """
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / 1e6
    except (OSError, IndexError):
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6


def _machine():
    processor = platform.processor() or platform.machine()
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        processor = info.partition("model name")[2].partition(":")[2].partition("\n")[0].strip() or processor
    except OSError:
        pass
    versions = {name: version(name) for name in ("numpy", "numba", "shapely", "pymunk")}
    return {
        "processor": processor,
        "cores": str(os.cpu_count()),
        "system": platform.platform(),
        "python": platform.python_version(),
        **versions,
        "load_before": _load(),
    }


def _load():
    return " ".join(f"{load:.2f}" for load in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown"


# ---- what is wanted


def bars(plan: Plan, scans: list[Scans], ticks: list[Tick], flat: list[Growth], linear: list[Growth]) -> list[Bar]:
    """What the engine is to keep to, to be read, not enforced: much of it shakes with what else the machine does."""
    times = {(row.scene, row.view, row.engine): row.median_us for row in scans}
    rows = []
    for view, most in {"lead30": 12, "foll30": 12, "lead60": 25}.items():
        ratio = times[plan.large, view, "raster"] / times[plan.large, view, "floor"]
        rows.append(Bar(f"raster at most {most} times the floor", ratio, f"{plan.large} {view}", ratio <= most))
    for engine, least in {"brute force": 2.5, "numpy": 5, "pymunk": 300}.items():
        for size in plan.sizes:
            row = min((r for r in scans if (r.scene, r.engine) == (size.name, engine)), key=lambda r: r.to_raster)
            wanted = f"{engine} at least {least} times raster"
            rows.append(Bar(wanted, row.to_raster, f"{row.scene} {row.view}", row.to_raster >= least))
    tick = max(ticks, key=lambda row: row.median_ms)
    rows.append(Bar("tick of 1000 sensors at most 6 ms", tick.median_ms, tick.scene, tick.median_ms <= 6))
    for kerbs in ("pieces", "merged"):
        far = max((r for r in flat if r.scene.endswith(kerbs)), key=lambda row: abs(math.log(row.ratio)))
        level = 1 / 1.2 <= far.ratio <= 1.2
        rows.append(Bar("a scan within 20 % however large the town", far.ratio, f"{far.scene} {far.view}", level))
    steep = max(linear, key=lambda row: row.ratio)
    twice = "twice the sensors, at most 2.3 times the call"
    rows.append(Bar(twice, steep.ratio, f"{steep.sensors} sensors", steep.ratio <= 2.3))
    return rows


# ---- in print


LEGEND = """\
CPU time of one thread for a scan of 720 beams, caches warm, median and best of several samples; lead: +-90 deg, foll:
+-11.5 deg, up to 30 or 60 m. difference: largest, from ranges of the shapely engine over 8 scans; differing: beams that
met something in one and nothing in the other. Engines: the whole call of scan(). Brute force: every beam on every
surface near the sensor, which are given to it; in view: only near sides, in the bounding box of the sector. floor:
clear, divide and store 720 numbers."""


def text(report: Report) -> str:
    """The report as tables."""
    sections = ["\n".join(f"{name:12} {value}" for name, value in report.machine.items()), LEGEND]
    for case in report.cases:
        near = f"{case.candidates:.0f} surfaces near a sensor, {case.candidates_in_view:.0f} maybe in view"
        title = f"{case.scene}, {case.view}: {case.walls} walls, {case.vehicles} vehicles; {near}"
        rows = [row for row in report.scans if (row.scene, row.view) == (case.scene, case.view)]
        sections.append(f"{title}\n{_table(rows, skip=2)}")
    titles = {
        "noise": "Noise of car-leader, without sub-beams",
        "ticks": "A whole tick: boxes from arrays, two calls",
        "flat": "Towns of one density; ratio to the smallest",
        "linear": "Number of sensors; ratio of the call to the row before",
        "starts": "From the start of a process",
        "memory": "Memory",
        "bars": "Wanted, and the worst there is",
    }
    tables = ((title, getattr(report, name)) for name, title in titles.items())
    sections += [f"{title}\n{_table(rows)}" for title, rows in tables if rows]
    return "\n\n".join(sections)


def _table(rows, skip=0):
    cells = [[name.replace("_", " ") for name in rows[0]._fields[skip:]]]
    cells += [[_cell(value) for value in row[skip:]] for row in rows]
    words = [isinstance(value, str) for value in rows[0][skip:]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if word else cell.rjust(width)
            for cell, width, word in zip(row, widths, words, strict=True)
        ).rstrip()
        for row in cells
    )


def _cell(value):
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return str(value)
    if 0 < abs(value) < 1e-3:
        return f"{value:.0e}"
    digits = 2 - math.floor(math.log10(abs(value))) if value else 0
    return f"{value:.{min(max(digits, 0), 3)}f}"
