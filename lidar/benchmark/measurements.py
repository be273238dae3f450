"""Measurements of the benchmark: `platoontraffic bench lidar`.

Times are CPU time of the calling thread, on which other jobs have little effect. Structures that engines keep for a
scene (grid, search tree, physics space) are built before; those built at every call are part of its time. Calls that
are compared take turns, so that a slow moment affects all of them. No time makes the benchmark fail.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..carriers import Carriers
from ..engines import ENGINES
from ..model import PRESETS
from ..scene import Boxes
from ..sense import scan
from .bars import bars
from .frame import load, machine
from .plan import FULL, Plan
from .processes import memory, starts
from .report import Case, Growth, NoiseCost, Report, Scans, Tick
from .timing import cpu, first, scanning
from .towns import VIEWS, Size, town_of
from .yardsticks import YARDSTICKS, candidates, empty_scan, every_beam_on_every_surface

COMPARED = 8  # number of scans that are compared with those of the shapely engine


def run(plan: Plan = FULL, progress: Callable[[str], object] = lambda stage: None) -> Report:
    """Measure everything; `progress` receives the name of each stage before it begins."""
    before = machine("numpy", "numba", "shapely", "pymunk")
    cases, scans, noise, ticks, linear = [], [], [], [], []
    for size in plan.sizes:
        scene, boxes = town_of(size)
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
        started = starts(plan, elsewhere)
        progress("memory")
        filled = memory(plan, elsewhere)
    facts = before | {"load_after": load()}
    judged = bars(plan, scans, ticks, flat, linear)
    return Report(facts, cases, scans, noise, ticks, flat, linear, started, filled, judged)


def _case(plan, size, view, scene, boxes):
    model = VIEWS[view]
    sensors = {name: plan.fewer.get(name, size.sensing) for name in (*ENGINES, *YARDSTICKS)}
    sensor, ends, owner, in_view = candidates(model, scene, boxes, size.sensing)
    every, every_ranges = every_beam_on_every_surface(model, sensor, ends, owner, size.sensing)
    few, few_ranges = every_beam_on_every_surface(
        model, sensor[in_view], ends[..., in_view], owner[in_view], size.sensing
    )
    calls = {name: scanning(model, scene, boxes, sensors[name], name) for name in ENGINES}
    calls |= zip(YARDSTICKS, (every, few, empty_scan(model, size.sensing)), strict=True)
    slow = {name: call for name, call in calls.items() if name in plan.fewer}
    fast = {name: call for name, call in calls.items() if name not in plan.fewer}
    spent = cpu(fast, plan.samples[0]) | cpu(slow, plan.samples[1])

    carriers = first(COMPARED, boxes)
    ranges = {e: scan(model, scene, boxes, carriers, engine=e, dtype=np.float64).ranges for e in ENGINES}
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
    """Largest difference, and number of beams that meet something in only one of the two."""
    met, also = np.isfinite(ranges), np.isfinite(reference)
    both = met & also
    return float(np.abs(ranges[both] - reference[both]).max(initial=0.0)), int((met != also).sum())


def _noise(plan, size, view, scene, boxes):
    exact = VIEWS[view]
    models = {"without": exact, "with": replace(exact, noise=PRESETS["car-leader"].noise)}
    spent = cpu({name: scanning(m, scene, boxes, size.sensing) for name, m in models.items()}, plan.samples[0])
    without, noisy = (1e6 * spent[name].median / size.sensing for name in models)
    return NoiseCost(size.name, view, without, noisy, 1e3 * (noisy - without) / exact.samples, noisy / without - 1)


def _linear(plan, size, scene, boxes):
    spent = cpu({n: scanning(VIEWS["lead30"], scene, boxes, n) for n in plan.linear}, plan.samples[0])
    calls = [1e6 * spent[n].median for n in plan.linear]
    return [
        Growth(size.name, "lead30", len(boxes), n, call / n, 1e6 * spent[n].best / n, call / before)
        for n, call, before in zip(plan.linear, calls, [calls[0], *calls], strict=False)
    ]


def _flat(plan, merged):
    """The same number of sensors in towns that differ in size, with equally many vehicles a road."""
    name = "merged" if merged else "pieces"
    sizes = [Size(f"{n} x {n} {name}", n, round(1000 * n * (n + 1) / (13 * 14)), 0, merged) for n in plan.flat]
    towns = {size.name: town_of(size) for size in sizes}
    sensors = min(500, *(len(boxes) for _, boxes in towns.values()))
    rows = []
    for view in ("lead60", "foll30"):
        spent = cpu({n: scanning(VIEWS[view], *towns[n], sensors) for n in towns}, plan.samples[0])
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
            batches[i] = scan(model, scene, now, Carriers.of(now, rows, ids[i]), out=batches[i])

    median_, best = (1e3 * seconds for seconds in cpu({"tick": tick}, plan.samples[0])["tick"])
    return Tick(size.name, len(boxes), *map(len, ids), median_, best)
