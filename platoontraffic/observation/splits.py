"""When followers are split off from their platoons, why, and when they are back.

A follower is in its platoon while its law takes its true predecessor for it, and the gap is no more than NEAR_TIMES
what the law wants, or NEAR_MORE above that. It is split off when that has not been so for SPLIT_AFTER.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from platoontraffic.controllers import CLOSED_BY, Signals
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.traffic import TrafficSnapshot

SPLIT_AFTER = 2.0  # [s]
NEAR_TIMES, NEAR_MORE = 2.0, 15.0  # [1, m]

HELD = 8.0  # it is held by a closed line this near [m], ...
SLOW = 1.0  # ... if it is slower [m/s], and still told so ...
HELD_FOR = 15.0  # ... this long after [s]


class Splits:
    """Arrays (N,) of all members that the run ever has, at their numbers."""

    def __init__(self, scale: np.ndarray) -> None:
        """scale: of the members beside a car, by which distances shrink"""
        n, self._scale = len(scale), scale
        self._apart_since = np.full(n, np.nan)  # NaN: in its platoon
        self.split = np.zeros(n, dtype=bool)  # who is split off
        self._begun = np.full(n, np.nan)  # the last split
        self._followed, self._here = np.zeros((2, n), dtype=bool)  # in the last step
        self._held = np.zeros(n, dtype=bool)
        self._held_since, self._held_until = np.full((2, n), -np.inf)
        self._held_by = np.zeros(n, dtype=int)
        self.broken: list[set[str]] = [set() for _ in range(n)]  # what of each is broken

    def watch(
        self,
        traffic: TrafficSnapshot,
        fleet: Fleet,
        signals: Signals | None,
        seen: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        event,
    ) -> Iterator:
        """The events of this step.

        seen: of each (n,): whether its law takes its predecessor for it, what that takes instead, beams on the
              predecessor, and the gap less NEAR_TIMES or NEAR_MORE what is wanted [m], NaN where nothing is
        """
        number, time = fleet.number, traffic.time
        if signals is not None:
            yield from self._lines(time, fleet, signals, event)
        locked, target, beams, too_far = seen
        follows = fleet.predecessor >= 0
        joining = follows & ~self._followed[number] & self._here[number]
        self.split[number[joining]], self._begun[number[joining]] = True, time  # until it is with those whom it joins
        self._followed[number], self._here[number] = follows, True
        apart = follows & (~locked | (too_far > 0))
        since = np.where(apart, np.fmin(self._apart_since[number], time), np.nan)
        self._apart_since[number] = since
        for i in np.flatnonzero(apart & ~self.split[number] & (time - since > SPLIT_AFTER - 1e-6)):
            self.split[number[i]], self._begun[number[i]] = True, since[i]
            why = self._why(traffic, fleet, i, locked[i], target[i], beams[i])
            yield event("split", i, traffic.ids[fleet.predecessor[i]], detail=why)
        for i in np.flatnonzero(~apart & self.split[number]):
            self.split[number[i]] = False
            self._held_until[number[i]] = -np.inf  # what held it then is no cause of what comes
            if follows[i]:
                yield event("rejoined", i, traffic.ids[fleet.predecessor[i]], time - self._begun[number[i]])

    def _lines(self, time: float, fleet: Fleet, signals: Signals, event) -> Iterator:
        """Who stands before a line that is closed to it, and who goes on."""
        number = fleet.number
        near, slow = HELD * self._scale[number], SLOW * self._scale[number]
        closed = ~signals.open & (signals.distance < near)
        held = closed & (fleet.motion.speed < slow)
        self._held_by[number] = np.where(held, signals.reason, self._held_by[number])
        self._held_until[number] = np.where(held, time, self._held_until[number])
        for i in np.flatnonzero(held & ~self._held[number]):
            self._held_since[number[i]] = time
            yield event("held", i, detail=CLOSED_BY[signals.reason[i]])
        for i in np.flatnonzero(~closed & self._held[number]):
            yield event("released", i, duration=time - self._held_since[number[i]])
        self._held[number] = held | (self._held[number] & closed)

    def stopped_by(self, number: int) -> str:
        """What it stands for, as far as that is known here."""
        if self.broken[number]:
            what = sorted(self.broken[number])
            return f"its {' and '.join(what)} {'is' if len(what) == 1 else 'are'} broken"
        return f"held by {CLOSED_BY[self._held_by[number]]}" if self._held[number] else ""

    def _why(self, traffic: TrafficSnapshot, fleet: Fleet, i: int, locked: bool, target: str, beams: float) -> str:
        number, ahead = fleet.number[i], fleet.predecessor[i]
        if self.broken[number]:
            return self.stopped_by(number)
        if traffic.time - self._held_until[number] < HELD_FOR:
            lasted = traffic.time - self._held_since[number]
            return f"held by {CLOSED_BY[self._held_by[number]]} {lasted:.1f} s ago"
        between = _between(traffic, i, ahead)
        if between:
            return f"{', '.join(between)} between"
        if locked:
            return "fell behind"
        if target:
            return f"took {target} for it"
        return f"not recognised, though {beams:g} beams hit it" if beams else "out of sight"


def _between(traffic: TrafficSnapshot, i: int, ahead: int) -> list[str]:
    """Vehicles on the straight line from one's front to the other's rear."""
    ends = [
        (traffic.x[k] + side * traffic.length[k] / 2 * np.cos(traffic.heading[k]),
         traffic.y[k] + side * traffic.length[k] / 2 * np.sin(traffic.heading[k]))
        for k, side in ((i, 1), (ahead, -1))
    ]  # fmt: skip
    boxes = shapely.polygons(traffic.boxes().corners())
    met = np.flatnonzero(shapely.intersects(boxes, shapely.LineString(ends)))
    return sorted(traffic.ids[k] for k in met if k not in (i, ahead))
