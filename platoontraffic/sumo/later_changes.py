"""Members without room for their lane change drive on, and change lanes later on their lane, or on an edge beyond."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from platoontraffic.controllers import BRAKES_FOR
from platoontraffic.road.lane_routes import CHANGE_AFTER, SHORTEST_CHANGE, Line
from platoontraffic.road.later_change import JOIN, with_change_beyond, with_later_change
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.ego import LINE_BRAKING, SETTLING, Ego, line_that_keeps
from platoontraffic.sumo.reads import Once
from platoontraffic.sumo.room_to_change import FLOWS, RoomToChange
from platoontraffic.world.fleet import WINDOW, Fleet

BRAKES_FOR_LINE = BRAKES_FOR.index("line")
CHANGE_TIME = 3.0  # that a lane change takes, at the speed at which there was no room for it [s]
LOOKS_AFTER = 1.0  # a vehicle looks for room again after this time [s]
SLOWER, GENTLE = 2.0, 1.5  # beside traffic that flows, it becomes so much slower [m/s], by that braking [m/s2]

KEPT = 200  # routes that are kept for members which ask again; beyond, those that no member drives are forgotten


class Blocked(NamedTuple):
    """A lane change that cannot begin now, or not go on."""

    line: Line
    over: float  # distance driven since its begin [m]; negative: ahead of it
    further: bool  # there may be room further on
    free: float  # from its begin to the next vehicle in a queue on the lane before [m]; inf: there is none
    drives_on: bool = False  # to where its lane ends: on a fast road beside traffic that flows, or too fast to stop


class LaterChanges:
    """Other routes for members whose lane changes are blocked.

    room: judges whether there is room
    """

    def __init__(self, network: Network, sumo: Client, room: RoomToChange) -> None:
        self._sumo, self._room = sumo, room
        self._blocked: dict[str, Blocked] = {}  # the first lane change of each member that has no room for it now
        # Routes, by route, lane change, by how much it is later, vehicle model, and its greatest length.
        self._later = Once(lambda key: with_later_change(*key[:3], network, *key[3:]))
        self._beyond = Once(lambda key: with_change_beyond(*key[:2], network, key[2]))  # by route, change, model

    def begin_look(self) -> None:
        """Before the members of a step are asked about."""
        self._blocked.clear()

    def note(self, change: Line, distance: float, ego: Ego) -> float:
        """A member has no room for its lane change. Of several the first one counts.

        distance: to its begin [m]
        returns : where it stops for want of room [m]: at that begin, or where its lane ends if it drives on; beside
                  traffic that flows so near that it becomes slower than that
        """
        if ego.id in self._blocked:
            return distance
        free = self._room.free_road(change, distance, ego)
        slowest, to_fall_back = self._room.slowest_beside(change, distance, ego)
        is_fast = self._room.is_fast(change)
        flows = is_fast and free == math.inf and slowest >= FLOWS
        drives_on = flows or (is_fast and ego.speed**2 / (2 * LINE_BRAKING) > distance)
        further = flows or self._room.is_better_later(change, distance, slowest, ego)
        self._blocked[ego.id] = Blocked(change, -distance, further, free, drives_on)
        latest = distance + self._latest(change, ego.length) if drives_on else distance
        falls_back_to = max(to_fall_back - SLOWER, ego.speed - GENTLE * SETTLING)
        return min(latest, line_that_keeps(falls_back_to, ego.length)) if flows else latest

    def _latest(self, change: Line, length: float) -> float:
        """Distance by which a lane change may be later, for a vehicle of a length, before its lane ends [m]."""
        return max(change.to_end - SHORTEST_CHANGE * self._sumo.lane.getWidth(change.lane) - length, 0.0)

    def put_off(self, fleet: Fleet) -> Fleet:
        """The fleet with other routes for members without room for their lane change here, once they brake for that.

        Beside traffic that flows they do not brake: they are about to begin it. They look for it further on, as long as
        their lane leads on: on this edge, but not beside a queue, or on edges beyond, where the members behind them in
        their platoon do so too. The slower they are, the less road their lane change takes.
        """
        if len(self._later) + len(self._beyond) > KEPT:
            self._forget_routes_but_those_of(fleet)
        for group in fleet.groups if self._blocked else ():
            limit = group.law.braking_for(group.memory) if group.memory is not None else None
            for i, reason in zip(group.rows.tolist(), limit.reason, strict=True) if limit else ():
                blocked = self._blocked.get(fleet.ids[i])
                if blocked and (self._comes_to(fleet, i, blocked) if blocked.drives_on else reason == BRAKES_FOR_LINE):
                    fleet = self._put_off_one(fleet, i)
        return fleet

    def _comes_to(self, fleet: Fleet, row: int, blocked: Blocked) -> bool:
        """Whether a member is about to begin a lane change."""
        before = max(JOIN * fleet.members[row].model.length, LOOKS_AFTER * float(fleet.motion.speed[row]))
        return -blocked.over < before

    def _forget_routes_but_those_of(self, fleet: Fleet) -> None:
        routes = {member.route for member in fleet.members}
        for kept in (self._later, self._beyond):
            for key in [key for key in kept if key[0] not in routes]:
                del kept[key]

    def _put_off_one(self, fleet: Fleet, row: int) -> Fleet:
        """The fleet with another route for one of these members, and for those behind it where they change beyond."""
        member, speed = fleet.members[row], float(fleet.motion.speed[row])
        change, over, further, free, drives_on = self._blocked[member.id]
        if change not in member.route.lines:  # put off just now, with its leader's
            return fleet
        width = self._sumo.lane.getWidth(change.lane)
        step = CHANGE_AFTER * width
        by = step * max(math.ceil((max(over, 0.0) + LOOKS_AFTER * speed) / step), 1)
        if drives_on:  # it will be slower near the end of its lane
            latest = self._latest(change, member.model.length)
            by = min(by, latest)
            speed = min(speed, math.sqrt(2 * LINE_BRAKING * (latest - by)))
        longest = width * math.ceil(CHANGE_TIME * speed / width)
        moves_on = drives_on or (further and free > by + change.across)
        here = self._later[member.route, change, by if moves_on else 0.0, member.model, longest]
        if here and moves_on:
            return fleet.with_route(row, here, WINDOW)
        if over > 0:
            return fleet
        if free == math.inf and self._beyond[member.route, change, member.model]:
            for i, line in [(row, change), *_behind_before(fleet, row, change)]:
                if beyond := self._beyond[fleet.members[i].route, line, fleet.members[i].model]:
                    fleet = fleet.with_route(i, beyond, WINDOW)
            return fleet
        return fleet.with_route(row, here, WINDOW) if here else fleet


def _behind_before(fleet: Fleet, row: int, change: Line) -> Iterator[tuple[int, Line]]:
    """Rows of members behind one in its platoon that have its lane change ahead of them, and their line there."""
    first, progress = fleet.members[row], fleet.progress
    for k, i in enumerate(progress.rows.tolist()):
        member = fleet.members[i]
        if member.platoon != first.platoon or member.place <= first.place or member.single:
            continue
        front = progress.station[k] + progress.front[k]
        for line in member.route.lines:
            if (line.state, line.lane, line.onto) == (change.state, change.lane, change.onto) and line.station > front:
                yield i, line
