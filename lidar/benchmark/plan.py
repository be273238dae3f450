"""Extent of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass

from ..engines import ENGINES
from .towns import SIZES, Size


@dataclass(frozen=True)
class Plan:
    """The extent of a measurement.

    sizes   : towns that are scanned in all views by all engines
    fewer   : number of sensors of each slow engine
    samples : of each call of a fast engine, of a slow engine
    large   : name of the town for noise, number of sensors and memory
    ticks   : names of the towns for whole ticks
    flat    : blocks of each town in a series of towns of one density
    linear  : numbers of sensors in one town
    memory  : engines of which the memory is measured
    cold    : whether to measure a start for which everything is compiled, with a cache of its own
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
    sizes=SIZES,
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
    sizes=SIZES[:2],
    fewer={"numpy": 20, "pymunk": 1, "shapely": 1},
    samples=(5, 2),
    large="M",
    ticks=("M",),
    flat=(4, 13),
    linear=(250, 500, 1000),
    memory=("raster",),
    cold=False,
)
