"""Metrics that a scenario brings: `record.metrics`.

A metric is a class that is made without arguments, best a frozen dataclass, with

    name    : of the metric, as in metrics.csv
    unit    : "" for counts and shares
    meaning : for the data dictionary
    over    : optional, for platoons and the run: "mean", "max", "min" or "sum" over their members
    __call__(trajectories, events) -> {vehicle_id: value}

where trajectories and events are pandas DataFrames of the files of those names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from platoontraffic.plug_ins import PlugIn, find_class, place_of, plug_in_file
from platoontraffic.scenario.faults import Fault

if TYPE_CHECKING:
    import pandas as pd

GROUP = "platoontraffic.metrics"  # entry point group
OVER = ("", "mean", "max", "min", "sum")


class PlugInMetric(Protocol):
    name: str
    unit: str
    meaning: str

    def __call__(self, trajectories: pd.DataFrame, events: pd.DataFrame) -> dict[str, float]: ...


class MetricPlugIns(NamedTuple):
    metrics: tuple[PlugInMetric, ...] = ()
    written: tuple[tuple[Path | None, str], ...] = ()  # of each: its file beside the scenario, name in the scenario
    sources: tuple[Path, ...] = ()  # files that they consist of

    def names(self, named: Callable[[Path], str]) -> list[str]:
        """As in a scenario, with their files as `named` names them."""
        return [f"{named(file)}:{name.rsplit(':', 1)[1]}" if file else name for file, name in self.written]


def find(names: Sequence[str], folder: Path) -> tuple[MetricPlugIns, list[Fault]]:
    """The metrics of a scenario in `folder`, and what is wrong with their names."""
    metrics: list[PlugInMetric] = []
    faults: list[Fault] = []
    sources: set[Path] = set()
    for i, name in enumerate(names):
        try:
            found = find_class(name, folder, GROUP, "metric")
            metric = _made(found)
        except LookupError as error:
            faults.append(Fault(("record", "metrics", i), str(error)))
            continue
        if metric.name in [one.name for one in metrics]:
            what = f"{name!r}: another metric of this list is named {metric.name!r} too"
            faults.append(Fault(("record", "metrics", i), what))
        metrics.append(metric)
        sources |= set(found.sources)
    written = tuple((plug_in_file(name, folder), name) for name in names)
    return MetricPlugIns(tuple(metrics), written, tuple(sorted(sources))), faults


def _made(found: PlugIn) -> PlugInMetric:
    """raises: LookupError"""
    try:
        metric = found.kind()
    except Exception as error:  # the user's code may raise anything
        raise LookupError(
            f"metric {found.kind.__qualname__}: cannot be made: {type(error).__name__}: {error}"
        ) from error
    for key in ("name", "unit", "meaning"):
        if not isinstance(getattr(metric, key, None), str):
            raise LookupError(
                f"{place_of(metric)}: metric {found.kind.__qualname__} has no text {key!r}; must have one"
            )
    if not re.fullmatch(r"[a-z][a-z0-9_]*", metric.name):
        raise LookupError(f"{place_of(metric)}: name = {metric.name!r}: must be of a-z, 0-9 and _, like gap_mean")
    if (over := getattr(metric, "over", "")) not in OVER:
        raise LookupError(f"{place_of(metric)}: over = {over!r}: must be one of {', '.join(OVER[1:])}, or absent")
    return metric
