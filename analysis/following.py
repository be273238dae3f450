"""The predecessor of each member over time, and the time in which it is in its platoon, by the events of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

SPLIT_AFTER = 2.0  # time after its begin at which a split is an event [s]
TIMES = 6  # places of times in seconds
GONE = ("arrived", "stranded", "given_up")  # kinds of events by which a member leaves the road
NOBODY = ""  # predecessor of a follower after an order to split off

Predecessor = str | None  # NOBODY after a split; None for a leader, and after an order to leave


class Stretch(NamedTuple):
    """A period in which a member is a follower."""

    begin: float  # [s]
    end: float  # [s]
    ahead: str  # its predecessor, or NOBODY


def stretches(places: Mapping[str, tuple[str, int]], events: pd.DataFrame, end: float) -> dict[str, list[Stretch]]:
    """Periods of each member as a follower, while it and its predecessor are on the road.

    places : platoon and place of each member
    end    : of the run [s]
    """
    at = {place: vehicle for vehicle, place in places.items()}
    ahead: dict[str, Predecessor] = {v: at.get((p, place - 1)) if place else None for v, (p, place) in places.items()}
    since = dict.fromkeys(places, -np.inf)
    found: dict[str, list[Stretch]] = {v: [] for v in places}
    ends = [(end, vehicle, None) for vehicle in places]
    for time, vehicle, predecessor in (*_changes(dict(ahead), events), *ends):
        if vehicle not in places:
            continue
        if ahead[vehicle] is not None:
            found[vehicle].append(Stretch(since[vehicle], time, ahead[vehicle]))
        ahead[vehicle], since[vehicle] = predecessor, time
    came, went = (events[events.kind.isin(kinds)].groupby("vehicle_id").time_s.min() for kinds in (("departed",), GONE))

    def on_road(vehicle: str, one: Stretch) -> Stretch:
        begin = max(one.begin, came.get(vehicle, -np.inf))
        return one._replace(begin=begin, end=min(one.end, went.get(vehicle, end), went.get(one.ahead, end)))

    return {vehicle: [on_road(vehicle, one) for one in own] for vehicle, own in found.items()}


def _changes(ahead: dict[str, Predecessor], events: pd.DataFrame) -> Iterator[tuple[float, str, Predecessor]]:
    """(time, vehicle, its new predecessor) of every order that was carried out, and of routes that part.

    ahead: before the first of them
    """
    for order in pd.concat([_carried_out(events), events[events.kind == "parted"]]).sort_values("time_s").itertuples():
        if order.kind == "parted":
            ahead[order.vehicle_id] = None
            yield order.time_s, order.vehicle_id, None
            continue
        changed: dict[str, Predecessor] = {}
        if order.what == "leave":  # its followers close up to its own predecessor
            behind = [v for v, predecessor in ahead.items() if predecessor == order.vehicle_id]
            changed = dict.fromkeys(behind, ahead.get(order.vehicle_id) or None)
        changed[order.vehicle_id] = {"join": order.other_id, "split": NOBODY, "leave": None}[order.what]
        for vehicle, predecessor in changed.items():
            yield order.time_s, vehicle, predecessor
        ahead |= changed


def split_off(own: pd.DataFrame, stretches: Sequence[Stretch]) -> list[tuple[float, float]]:
    """Periods in which a member is split off from its predecessor, by an event or by an order; own: its events."""
    kind, time = own.kind.to_numpy(object), own.time_s.to_numpy()
    rejoined = time[kind == "rejoined"]
    begun = [round(t - SPLIT_AFTER, TIMES) for t in time[kind == "split"]]  # 16.1 - 2.0 is no instant
    if (kind == "told").any():
        orders = _carried_out(own)
        begun += [*orders.time_s[orders.what == "join"]]
    periods = [(begin, min([t for t in rejoined if t >= begin], default=np.inf)) for begin in begun]
    return periods + [(one.begin, one.end) for one in stretches if one.ahead == NOBODY]


def within(times: pd.Series | np.ndarray, periods: Sequence[tuple[float, float]]) -> np.ndarray:
    """Which times are in one of the periods, (n,) bool; the end of a period is not."""
    times = np.asarray(times)
    found = np.zeros(len(times), dtype=bool)
    for begin, end in periods:
        found |= (times >= begin) & (times < end)
    return found


def lengths(counted: Sequence[tuple[float, float]], off: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Total length of the periods `counted`, and of the part of them that is in `off` too [s]."""
    ends = sorted({t for period in (*counted, *off) for t in period if np.isfinite(t)})
    middles, size = np.array([(a + b) / 2 for a, b in pairwise(ends)]), np.diff(ends)
    here = within(middles, counted)
    return float(size[here].sum()), float(size[here & within(middles, off)].sum())


def _carried_out(events: pd.DataFrame) -> pd.DataFrame:
    """Events of the orders that were carried out, by time; none in files of version 0.1, which do not tell them."""
    if not {"what", "done"} <= set(events.columns):
        return events[:0].assign(what="")
    orders = events[(events.kind == "told") & (events.done == 1)]
    return orders.sort_values("time_s", kind="stable")
