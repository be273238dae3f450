"""CPU time of calls, and calls that scan."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import NamedTuple

from ..carriers import Carriers
from ..sense import scan

SAMPLE = 2e-3  # CPU time of a sample; a call is repeated until it takes so much [s]


class Spent(NamedTuple):
    """CPU time of a call [s]."""

    median: float
    best: float


def cpu(calls: dict[str, Callable[[], object]], samples: int) -> dict[str, Spent]:
    """CPU time of each warm call: a call before each sample does not count, and the first one builds and compiles."""
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


def first(sensors, boxes):
    """The first vehicles, as carriers of sensors."""
    return Carriers.of(boxes, slice(sensors), tuple(f"veh.{owner}" for owner in boxes.owner[:sensors]))


def scanning(model, scene, boxes, sensors, engine="raster"):
    """A call that scans from the first vehicles, into the same memory every time."""
    carriers = first(sensors, boxes)
    batch = scan(model, scene, boxes, carriers, engine=engine)
    return lambda: scan(model, scene, boxes, carriers, engine=engine, out=batch)
