"""Members that enter and leave the road."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from platoontraffic.observation.step import Step
from platoontraffic.world.events import Event, Noted
from platoontraffic.world.fleet import Member


class Presence:
    """Which members are on the road, by their number."""

    def __init__(self, members: Sequence[Member]) -> None:
        """members: all of the run, by their number"""
        self.members = members
        self._here = np.zeros(len(members), dtype=bool)
        self._before: Step | None = None
        self._stuck: dict[str, str] = {}  # members that were stuck one step before, with the remedy
        self.new = np.empty(0, dtype=np.intp)  # rows of members that entered the road in this step, (m,)

    def observe(self, step: Step, left_behind: np.ndarray, noted: Sequence[Noted] = ()) -> Iterator[Event]:
        """arrived, stranded, given_up, departed

        left_behind: members of the run that were split off from and far behind their predecessor one step before, (N,)
        """
        before, self._before = self._before, step
        stuck = self._stuck
        self._stuck = {step.fleet.ids[one.row]: one.what for one in noted if one.kind == "stuck"} if noted else {}
        if before and before.fleet.number is step.fleet.number:
            self.new = self.new[:0]
            return
        self.new = (~self._here[step.fleet.number]).nonzero()[0]
        self._here[:] = False
        self._here[step.fleet.number] = True
        for row in (~self._here[before.fleet.number]).nonzero()[0] if before else ():
            event = self._gone(step.traffic.time, before, row, left_behind)
            given_up = stuck.get(event.vehicle, "wait") != "wait"
            yield event._replace(kind="given_up", what=stuck[event.vehicle], detail="") if given_up else event
        for row in self.new:
            yield step.event("departed", row)

    def _gone(self, time: float, before: Step, row: int, left_behind: np.ndarray) -> Event:
        """A member that has left the road, at its last position."""
        member = self.members[before.fleet.number[row]]
        event = before.event("arrived", row)._replace(time=time)
        if member.place == 0 or member.arrives_alone:
            return event._replace(what="own_route")
        head, behind = row, False
        while before.fleet.predecessor[head] >= 0:
            behind |= left_behind[before.fleet.number[head]]
            head = before.fleet.predecessor[head]
        if not behind:
            return event._replace(what="with_leader", detail="with its leader")
        away = np.hypot(before.traffic.x[head] - event.x, before.traffic.y[head] - event.y)
        return event._replace(
            kind="stranded", other=before.traffic.ids[head], detail=f"{away:.0f} m from where its leader arrived"
        )
