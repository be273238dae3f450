"""Post-encroachment times of members with bodies of no platoon, or of another one.

The post-encroachment time (Allen, Shin, Cooper, "Analysis of traffic conflicts and collisions", Transportation Research
Record 667, 1978) is that between one vehicle's leaving a conflict area and another's entering it. The area is where the
bodies of both come: a place of it is left with the last part of the one, and entered with the first part of the other.
The least time over its places counts.

Where paths merge there is no end to the area: places count until the second has driven on by its own width from where
it entered the path of the first. One that comes from behind, over the end of the trail of TRAIL that the first draws
and in its direction, follows it: it does not encroach, as long as it stays on that trail. Nor does one that enters the
road on the trail.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from platoontraffic.observation.encroachments_kernel import NO_ROOM, STEPS, STILL, Meetings, Trails, follow, meet
from platoontraffic.observation.step import Step
from platoontraffic.world.events import ENCROACHED, Event
from platoontraffic.world.fleet import Member
from platoontraffic.world.traffic import TrafficSnapshot

TRAIL = ENCROACHED + 1.0  # time for which it is known where bodies were [s]
BODIES = 64  # for which there is room at first
MEETS = 16  # pairs a member for which there is room at first
AT_ONCE = 8  # encroachments a member that can end in one step


class Encroachments:
    """Where all bodies were lately."""

    def __init__(self, members: Sequence[Member]) -> None:
        """members: all of the run, by their number"""
        self._platoons: dict[str, int] = {}  # their numbers
        self._platoon = np.empty(0, dtype=np.intp)  # of each member
        self.number_platoons(members)
        self._time: float | None = None  # one step before [s]
        self._step = 0
        self._trails: Trails | None = None  # from the second step on ...
        self._before: Meetings | None = None  # ... as are the pairs of the last step, and room for those of the next
        self._now: Meetings | None = None
        self._column: dict[str, int] = {}  # of each body in the trails
        self._ids: tuple[str, ...] = ()  # of the bodies of the last step ...
        self._columns = np.empty(0, dtype=np.intp)  # ... and their columns
        self._free: list[int] = []
        self._numbers = np.empty(0, dtype=np.intp)  # of the members of the last step ...
        self._seats = np.empty(0, dtype=np.intp)  # ... and their rows in the meetings
        self._seat: dict[int, int] = {}  # by number
        self._apart: dict[frozenset[str], float] = {}  # bodies lately on two levels, and when last [s]

    def number_platoons(self, members: Sequence[Member]) -> None:
        """Those of further members of the run; a member from the traffic by itself is one of its own."""
        names = (m.id if m.platoon == m.equip else m.platoon for m in members)
        numbers = [self._platoons.setdefault(name, len(self._platoons)) for name in names]
        self._platoon = np.concatenate([self._platoon, np.array(numbers, dtype=np.intp)])

    def observe(self, step: Step) -> Iterator[Event]:
        """encroachment"""
        before, self._time = self._time, step.traffic.time
        if before is None:
            return
        self._step += 1
        traffic, n, dt = step.traffic, step.fleet.number.size, step.traffic.time - before
        if self._trails is None:
            self._begin(round(TRAIL / dt) + 1)
        if traffic.ids != self._ids:
            self._find_columns(traffic.ids)
            trails = self._trails
            trails.half_length[self._columns] = traffic.length / 2
            trails.half_width[self._columns] = traffic.width / 2
        if step.fleet.number is not self._numbers:
            self._find_seats(step.fleet.number)
        head, found = self._step % self._trails.poses.shape[1], np.empty((AT_ONCE * n, 4))
        place = self._columns, traffic.x, traffic.y
        own = self._seats, self._platoon[step.fleet.number]
        kept = tuple(self._trails), tuple(self._before), tuple(self._now)
        self._note_levels(traffic)
        count = follow(*kept, head, dt, *place, *traffic.facing, *own, found)
        while count == NO_ROOM:
            self._make_room_for_meetings(0, 2 * self._now.pair.shape[1])
            kept = tuple(self._trails), tuple(self._before), tuple(self._now)
            count = meet(*kept, head, dt, *place, *own, found)
        self._before, self._now = self._now, self._before
        for i, k, was_first, time in found[:count].tolist():
            if k < n and not was_first:  # whatever their order in the fleet
                i, k, was_first = k, i, True
            pair = frozenset((traffic.ids[int(i)], traffic.ids[int(k)]))
            if time < ENCROACHED and pair not in self._apart:
                what = "first" if was_first else "second"
                yield step.event("encroachment", int(i), traffic.ids[int(k)], time, what=what)

    def _note_levels(self, traffic: TrafficSnapshot) -> None:
        """One that comes to a bridge crosses the trails of those that have left it."""
        now, ids = traffic.time, traffic.ids
        if self._apart:
            self._apart = {pair: last for pair, last in self._apart.items() if last > now - TRAIL}
        for members, bodies in traffic.other_levels:
            for i, k in product(members.tolist(), bodies.tolist()):
                self._apart[frozenset((ids[i], ids[k]))] = now

    def _begin(self, steps: int) -> None:
        self._before, self._now = Meetings.none(0, MEETS), Meetings.none(0, MEETS)
        self._trails = Trails(
            np.zeros((0, steps, STILL + 1)), np.zeros((0, STEPS + 1)), np.zeros(0, dtype=np.intp), *np.zeros((3, 0))
        )
        self._make_room()

    def _make_room(self) -> None:
        """Twice as many columns as before."""
        there = self._trails.count.size
        more = there or BODIES
        trails = (np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)]) for a in self._trails)
        self._trails = type(self._trails)(*trails)
        self._free += range(there + more - 1, there - 1, -1)

    def _find_columns(self, ids: tuple[str, ...]) -> None:
        """Give a column to every body that was not there one step before."""
        column = self._column
        new = [name for name in ids if name not in column]
        if len(column) + len(new) > len(ids):
            self._free += [column.pop(name) for name in column.keys() - set(ids)]
        for name in new:
            if not self._free:
                self._make_room()
            column[name] = one = self._free.pop()
            self._trails.count[one] = 0
        self._ids, self._columns = ids, np.fromiter(map(column.__getitem__, ids), np.intp, len(ids))

    def _find_seats(self, numbers: np.ndarray) -> None:
        """Give a row of the meetings to every member that was not there one step before."""
        here = numbers.tolist()
        for gone in self._seat.keys() - set(here):
            del self._seat[gone]
        taken, there = set(self._seat.values()), len(self._before.count)
        if (more := len(here) - there) > 0:  # some to spare
            self._make_room_for_meetings(more + there, self._before.pair.shape[1])
        free = iter([seat for seat in range(len(self._before.count)) if seat not in taken])
        for number in here:
            if number not in self._seat:
                self._seat[number] = seat = next(free)
                self._before.count[seat] = 0  # it may have been another one's
        self._numbers, self._seats = numbers, np.array([self._seat[number] for number in here], dtype=np.intp)

    def _make_room_for_meetings(self, more: int, pairs: int) -> None:
        """For more members, and so many pairs of each."""
        members, there = self._before.pair.shape
        wider = self._before.none(members + more, pairs)
        for new, old in zip(wider, self._before, strict=True):
            new[(slice(members), slice(there))[: new.ndim]] = old
        self._before, self._now = wider, self._before.none(members + more, pairs)
