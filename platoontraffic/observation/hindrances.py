"""Hindrances of members: broken parts, and stop lines that are closed to them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from platoontraffic.controllers import CLOSED_BY
from platoontraffic.observation.step import Cause, Step
from platoontraffic.vehicles.records import some
from platoontraffic.world.events import EVENT_KINDS, HELD_DISTANCE, HELD_SPEED, Event, Noted
from platoontraffic.world.fleet import Fleet

HELD_MEMORY = 15.0  # time after a hold in which it counts as the cause of a split [s]
HELD_BY = ("", *EVENT_KINDS["held"].words)  # in the order of CLOSED_BY


class Hindrances:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, scale: np.ndarray) -> None:
        """scale: size of each member beside a car, (N,); distances and speeds shrink with it"""
        n, self._scale = len(scale), scale
        self._broken: list[set[str]] = [set() for _ in range(n)]  # drive, laser
        self._held, self._any_held = np.zeros(n, dtype=bool), False
        self._reason = np.zeros(n, dtype=int)  # of the last hold, an index of CLOSED_BY
        self._since, self._until = np.full((2, n), -np.inf)  # the last hold [s]

    def note_breakdowns(self, noted: Iterable[Noted], fleet: Fleet) -> None:
        """Remember the breakdowns and repairs among the notes of this step."""
        for one in noted:
            if one.kind == "breaks_down":
                self._broken[fleet.number[one.row]].add(one.what)
            elif one.kind == "repaired":
                self._broken[fleet.number[one.row]].discard(one.what)

    def observe(self, step: Step) -> Iterator[Event]:
        """held, released"""
        signals, number = step.signals, step.fleet.number
        if signals is None:
            return
        closed = ~signals.open & (signals.distance < HELD_DISTANCE * self._scale[number])
        if not self._any_held and not some(closed):
            return
        held = closed & (step.fleet.motion.speed < HELD_SPEED * self._scale[number])
        self._reason[number] = np.where(held, signals.reason, self._reason[number])
        self._until[number] = np.where(held, step.traffic.time, self._until[number])
        for i in (held & ~self._held[number]).nonzero()[0]:
            self._since[number[i]] = step.traffic.time
            reason = signals.reason[i]
            yield step.event("held", i, what=HELD_BY[reason], detail=CLOSED_BY[reason])
        for i in (~closed & self._held[number]).nonzero()[0]:
            yield step.event("released", i, duration=step.traffic.time - self._since[number[i]])
        self._held[number] = held | (self._held[number] & closed)
        self._any_held = bool(some(self._held))

    def laser_is_broken(self, number: int) -> bool:
        return "laser" in self._broken[number]

    def now(self, number: int) -> Cause:
        """Why a member stands, as far as that is known here."""
        if self._broken[number]:
            parts = sorted(self._broken[number])
            return Cause("broken", f"its {' and '.join(parts)} {'is' if len(parts) == 1 else 'are'} broken")
        return Cause("held", self._held_by(number)) if self._held[number] else Cause()

    def after(self, number: int, time: float) -> Cause:
        """Why a member stood after a time, if it was held since then; it may be about to drive."""
        if self._until[number] <= time:
            return Cause()
        return Cause("held", f"{self._held_by(number)} until {self._until[number]:.1f} s")

    def lately(self, number: int, time: float) -> Cause:
        """Why a member has lost its platoon, as far as that is known here."""
        if self._broken[number]:
            return self.now(number)
        if time - self._until[number] < HELD_MEMORY:
            return Cause("held", f"{self._held_by(number)} {time - self._since[number]:.1f} s ago")
        return Cause()

    def forget_hold(self, number: int) -> None:
        """The last hold causes no later split."""
        self._until[number] = -np.inf

    def _held_by(self, number: int) -> str:
        return f"held by {CLOSED_BY[self._reason[number]]}"
