"""Metrics of plug-ins: their rows in metrics.csv, and what is wrong with what they give."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Real

import pandas as pd

from platoontraffic.errors import InputError
from platoontraffic.plug_ins import place_of
from platoontraffic.results import metrics
from platoontraffic.results.metrics import Value
from platoontraffic.scenario.metric_plug_ins import PlugInMetric


def check(plug_ins: Iterable[PlugInMetric]) -> None:
    """raises: InputError if a plug-in's metric is named like one of the tool's"""
    taken = {name for scope in metrics.meanings().values() for name in scope}
    faults = [
        f"{place_of(one)}: name = {name!r}: is a metric of platoontraffic; must be another"
        for one in plug_ins
        for name in dict.fromkeys((one.name, metrics.name_over(one.name, _over(one) or "sum")))
        if name in taken
    ]
    if faults:
        raise InputError(*faults)


def compute(plug_in: PlugInMetric, trajectories: pd.DataFrame, events: pd.DataFrame) -> list[Value]:
    """Values of the members that the metric names, and over them those of platoons and the run.

    raises: InputError naming file and line where the plug-in failed, or gave something else than numbers by member
    """
    of_vehicle = _asked(plug_in, trajectories, events)
    platoon_of = dict(zip(trajectories.vehicle_id, trajectories.platoon_id, strict=True))
    _check_values(plug_in, of_vehicle, platoon_of)
    named = plug_in.name, plug_in.unit
    members = [
        Value("vehicle", platoon, vehicle, named[0], float(of_vehicle[vehicle]), named[1])
        for vehicle, platoon in platoon_of.items()
        if vehicle in of_vehicle
    ]
    return members + (_aggregated(plug_in, members) if _over(plug_in) else [])


def meanings(plug_ins: Iterable[PlugInMetric]) -> dict[str, dict[str, str]]:
    """Scope -> metric -> meaning."""
    plug_ins = list(plug_ins)
    group = {
        metrics.name_over(one.name, _over(one)): f"{metrics.AGGREGATES[_over(one)][1]} over the members: {one.meaning}"
        for one in plug_ins
        if _over(one)
    }
    return {"vehicle": {one.name: one.meaning for one in plug_ins}, "platoon": group, "run": group}


def _asked(plug_in: PlugInMetric, trajectories: pd.DataFrame, events: pd.DataFrame) -> dict[str, float]:
    try:
        return plug_in(trajectories.copy(), events.copy())
    except (Exception, SystemExit) as error:  # the user's code may raise anything
        what = f"failed: {type(error).__name__}: {error}"
        raise InputError(f"{place_of(plug_in, error)}: metric {plug_in.name} {what}") from error


def _check_values(plug_in: PlugInMetric, given: object, members: Iterable[str]) -> None:
    if not isinstance(given, dict):
        what = f"gave a {type(given).__name__}; must be a dict of numbers by vehicle_id"
        raise InputError(f"{place_of(plug_in)}: metric {plug_in.name} {what}")
    if strange := [vehicle for vehicle in given if vehicle not in members]:
        raise InputError(f"{place_of(plug_in)}: metric {plug_in.name} gave a value for {strange[0]!r}, no member")
    for vehicle, value in given.items():
        if not isinstance(value, Real):
            what = f"gave {value!r:.60} for {vehicle}; must be a number, or NaN"
            raise InputError(f"{place_of(plug_in)}: metric {plug_in.name} {what}")


def _aggregated(plug_in: PlugInMetric, members: Sequence[Value]) -> list[Value]:
    over, unit = _over(plug_in), plug_in.unit
    name = metrics.name_over(plug_in.name, over)
    values = []
    for platoon in dict.fromkeys(one.platoon for one in members):
        mine = [one for one in members if one.platoon == platoon]
        values.append(Value("platoon", platoon, "", name, metrics.aggregate(mine, plug_in.name, over), unit))
    return [*values, Value("run", "", "", name, metrics.aggregate(members, plug_in.name, over), unit)]


def _over(plug_in: PlugInMetric) -> str:
    return getattr(plug_in, "over", "")
