"""One step of a run, as every part of the observer receives it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import Signals
from platoontraffic.world.events import Event, Noted
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen


class Cause(NamedTuple):
    """Why something happened; false if `what` is empty."""

    what: str = ""  # a word of the event's kind
    detail: str = ""  # for people to read

    def __bool__(self) -> bool:
        return bool(self.what)


class Step(NamedTuple):
    """One instant after all members have decided. Members are in the fleet's order, (n,)."""

    traffic: TrafficSnapshot
    fleet: Fleet
    roads: list[tuple[str, str]]  # edge and lane of each member
    signals: Signals | None  # state of the next stop lines, (n,); None: no law is given it
    x: np.ndarray  # middle of the driven axle [m]
    y: np.ndarray
    seen: Sequence[Seen | None]  # the world at the instant of the scan of each group; None: it used none

    def event(
        self, kind: str, row: int, other: str = "", duration: float = np.nan, *, what: str = "", detail: str = ""
    ) -> Event:
        """An event of the member in `row`, where it is now."""
        where = self.traffic.x[row], self.traffic.y[row], self.roads[row][0]
        return Event(self.traffic.time, kind, self.traffic.ids[row], other, *where, duration, detail, what)

    def noted(self, one: Noted) -> Event:
        """The event that was noted elsewhere in this step."""
        if one.row < 0:
            nowhere = np.nan, np.nan, "", np.nan
            return Event(self.traffic.time, one.kind, one.vehicle, one.other, *nowhere, one.detail, one.what, one.done)
        event = self.event(one.kind, one.row, one.other, one.duration, what=one.what, detail=one.detail)
        return event._replace(done=one.done)
