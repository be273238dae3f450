"""Measurements that need a new process each: time from its start to the first scan, and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ..carriers import Carriers
from ..scene import Boxes, Scene
from ..sense import scan
from .frame import peak_memory
from .plan import Plan
from .report import Memory, Start
from .timing import first
from .towns import SIZES, VIEWS, Size, town_of

CHILD = """
import sys, time
sys.path[0] = sys.argv[1]
from platoontraffic import lidar
imported = time.time(), time.process_time(), "numba" in sys.modules
from platoontraffic.lidar import benchmark
benchmark.child(imported, *sys.argv[2:])
"""


def in_child(environment, *arguments):
    """The output of `child` in a new process."""
    package = Path(sys.modules[__name__.partition(".")[0]].__file__).parent
    command = [sys.executable, "-c", CHILD, str(package.parent), *arguments]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def child(imported, *arguments: str) -> None:
    """Runs in a new process: scan once and print the time, or fill memory and print its peak."""
    if not arguments:
        scan(VIEWS["lead60"], Scene([(5, -9, 5, 9)]), Boxes.empty(), Carriers(0, 0, 0, 0))
        print(json.dumps([imported, (time.time(), time.process_time(), "numba" in sys.modules)]))
        return
    size, engine = arguments
    scene, boxes = town_of(next(s for s in SIZES if s.name == size))
    if engine:
        scan(VIEWS["lead60"], scene, boxes, first(4, boxes), engine=engine)
    print(json.dumps(peak_memory()))


def starts(plan: Plan, environment: dict[str, str]) -> list[Start]:
    rows = []
    for state in ("cold", "warm") if plan.cold else ("warm",):
        began = time.time()
        imported, scanned = in_child(environment)
        rows.append(Start(f"first scan, {state}", scanned[0] - began, *scanned[1:]))
    return [Start("import lidar", imported[0] - began, *imported[1:]), *rows]


def memory(plan: Plan, environment: dict[str, str]) -> list[Memory]:
    peaks = [Memory(f"process with the town {plan.large}", in_child(environment, plan.large, ""))]
    for engine in plan.memory:
        peaks.append(Memory(f"... and 4 scans by {engine}", in_child(environment, plan.large, engine)))
    large = next(size for size in plan.sizes if size.name == plan.large)
    edges = Size("10200 edges", 50, 100, 1)
    merged = large._replace(merged=True, name=f"{large.name} merged")
    grids = [(size, _grid_of(*town_of(size))) for size in (large, merged, edges)]
    return peaks + [Memory(f"walls and their grid in raster, {size.name}", grid) for size, grid in grids]


def _grid_of(scene, boxes):
    """Arrays of a scene, and those that the raster engine keeps for it [MB]."""

    scan(VIEWS["lead30"], scene, boxes, first(1, boxes))
    kept = [scene.segments, *(part for part in scene.kept["walls"] if isinstance(part, np.ndarray))]
    return sum(array.nbytes for array in kept) / 1e6
