"""Whom each member follows and when, and when it is in its platoon, by the events of a run."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.world.events import SPLIT_AFTER

NOBODY = ""  # told to split off


class Stretch(NamedTuple):
    """Of the time of a follower."""

    begin: float
    end: float
    ahead: str  # its predecessor, or NOBODY


def stretches(places: dict[str, tuple[str, int]], events: pd.DataFrame, end: float) -> dict[str, list[Stretch]]:
    """Of each member, while it and its predecessor are on the road; none while it leads or has left.

    places: of each, its platoon and place
    """
    at = {v: f"{platoon}.{place - 1}" if place else None for v, (platoon, place) in places.items()}
    found: dict[str, list[Stretch]] = {v: [] for v in places}
    since = dict.fromkeys(places, -np.inf)

    def turn(vehicle: str, ahead: str | None, time: float) -> None:
        if at[vehicle] is not None:
            found[vehicle].append(Stretch(since[vehicle], time, at[vehicle]))
        at[vehicle], since[vehicle] = ahead, time

    for told in _followed(events).itertuples():
        vehicle = told.vehicle_id
        if told.what == "leave":
            for other in [v for v, ahead in at.items() if ahead == vehicle]:
                turn(other, at[vehicle] or None, told.time_s)
            turn(vehicle, None, told.time_s)
        else:
            turn(vehicle, told.other_id if told.what == "join" else NOBODY, told.time_s)
    for vehicle in places:
        turn(vehicle, None, end)
    came, went = (events[events.kind == kind].groupby("vehicle_id").time_s.min() for kind in ("departed", "arrived"))
    return {
        v: [
            one._replace(
                begin=max(one.begin, came.get(v, -np.inf)), end=min(one.end, went.get(v, end), went.get(one.ahead, end))
            )
            for one in own
        ]
        for v, own in found.items()
    }


def split_off(own: pd.DataFrame, stretches: Sequence[Stretch]) -> list[tuple[float, float]]:
    """When a member is split off from whom it follows, or told to be; own: its events."""
    rejoined = own.loc[own.kind == "rejoined", "time_s"]
    begun = [*(own.loc[own.kind == "split", "time_s"] - SPLIT_AFTER)]
    joins = _followed(own)
    begun += [*joins.time_s[joins.what == "join"]]
    periods = [(begin, min([t for t in rejoined if t >= begin], default=np.inf)) for begin in begun]
    return periods + [(one.begin, one.end) for one in stretches if one.ahead == NOBODY]


def within(times: pd.Series, periods: Sequence[tuple[float, float]]) -> pd.Series:
    """Which times are in one of the periods."""
    found = pd.Series(False, index=times.index)
    for begin, end in periods:
        found |= (times >= begin) & (times < end)
    return found


def lengths(counted: Sequence[tuple[float, float]], off: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """How long `counted` lasts, and how much of that is in `off` too."""
    ends = sorted({t for period in (*counted, *off) for t in period if np.isfinite(t)})
    pieces = pd.Series([(a + b) / 2 for a, b in pairwise(ends)], dtype=float)
    size = pd.Series(np.diff(ends), dtype=float)
    here = within(pieces, counted)
    return float(size[here].sum()), float(size[here & within(pieces, off)].sum())


def _followed(events: pd.DataFrame) -> pd.DataFrame:
    """What was told and done, by time."""
    told = events[events.kind == "told"]
    return told[told.done == 1].sort_values("time_s", kind="stable")
