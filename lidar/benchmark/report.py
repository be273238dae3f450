"""Rows of the report, and the report as text. Names of fields carry units, because they become keys of JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .frame import as_json, facts, table


class Case(NamedTuple):
    """candidates, candidates_in_view: surfaces a sensor that brute force tries; those of them that may be in view."""

    scene: str
    view: str
    walls: int
    vehicles: int
    candidates: float
    candidates_in_view: float


class Scans(NamedTuple):
    """Time of a scan. The last two fields compare some scans in float64 with those of the shapely engine.

    difference_m : largest difference of a range that both measure
    differing    : beams that meet something in one of the two only
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
    """ratio: time of a scan to that in the smallest town, or time of the call to that in the row before."""

    scene: str
    view: str
    vehicles: int
    sensors: int
    median_us: float
    best_us: float
    ratio: float | None


class Start(NamedTuple):
    """Time from the start of a process to an event, by the clock and in CPU time."""

    until: str
    clock_s: float
    cpu_s: float
    numba_imported: bool


class Memory(NamedTuple):
    """what: peak memory of a process, or arrays kept for a scene."""

    what: str
    megabytes: float | None


class Bar(NamedTuple):
    """An aim, and the worst measurement of it."""

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
        return as_json(self)


LEGEND = """\
CPU time of one thread for a scan of 720 beams, caches warm: median and best of several samples. lead: +-90 deg, foll:
+-11.5 deg, up to 30 or 60 m. difference: largest difference to the ranges of the shapely engine over 8 scans;
differing: beams that meet something in one of the two only. Engines: the whole call of scan(). brute force: every beam
on every surface near the sensor, which are given to it; in view: near sides in the bounding box of the sector only.
floor: clear, divide and store 720 numbers."""


def text(report: Report, targets: bool = False) -> str:
    """The report as tables; targets: with the project's own, and whether each is met."""
    sections = [facts(report.machine), LEGEND]
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
    }
    if targets:
        titles["bars"] = "Aims, and the worst measurement of each"
    tables = ((title, getattr(report, name)) for name, title in titles.items())
    sections += [f"{title}\n{_table(rows)}" for title, rows in tables if rows]
    return "\n\n".join(sections)


def _table(rows, skip=0):
    names = [name.replace("_", " ") for name in rows[0]._fields[skip:]]
    words = [isinstance(value, str) for value in rows[0][skip:]]
    return table([names, *(map(_cell, row[skip:]) for row in rows)], words)


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
