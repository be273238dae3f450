"""Members without room for their lane change drive on, and change lanes later on their lane, or on an edge beyond; in a
queue they change where they are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import BRAKES_FOR
from platoontraffic.controllers.calls import ask
from platoontraffic.controllers.path_kernel import SETTLING
from platoontraffic.road.lane_routes import CHANGE_AFTER, Line
from platoontraffic.road.later_change import (
    JOIN,
    latest,
    longest_later,
    with_change_beyond,
    with_later_change,
    with_sooner_change,
)
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.reads import Once
from platoontraffic.sumo.room_to_change import FLOWS, RoomToChange, from_here
from platoontraffic.world.fleet import WINDOW, Fleet, Member

BRAKES_FOR_LINE = BRAKES_FOR.index("line")
CHANGE_TIME = 3.0  # that a lane change takes [s], at the speed at which there was no room, or to which it drives on
LOOKS_AFTER = 1.0  # a vehicle looks for room again after this time [s]
BRAKES_BY, GAINS_BY = 3.0, 2.5  # before the end of its lane, and before a change to which it drives on [m/s2]
TOO_LATE = 4.5  # a vehicle does not brake harder for want of room, but drives on [m/s2]
SOONER_BY = 0.5  # a change in a queue is sooner by whole multiples of that [m]
SLOWER, GENTLE = 2.0, 1.5  # beside traffic that flows, it becomes so much slower [m/s], by that braking [m/s2]

KEPT = 200  # routes that are kept for members which ask again; beyond, those that no member drives are forgotten


class Blocked(NamedTuple):
    """A lane change that cannot begin now, or not go on; or one that was missed."""

    line: Line
    over: float  # distance driven since its begin [m]; negative: ahead of it
    further: bool  # there may be room further on
    free: float  # from its begin to the next vehicle in a queue on the lane before [m]; inf: there is none
    drives_on: bool = False  # to where its lane ends: on a fast road beside traffic that flows, or too fast to stop

    @property
    def missed(self) -> bool:
        """The member has driven past the whole change."""
        return self.over > self.line.across


class LaterChanges:
    """Other routes for members whose lane changes are blocked.

    room: judges whether there is room
    """

    def __init__(self, network: Network, sumo: Client, room: RoomToChange) -> None:
        self._sumo, self._room = sumo, room
        self._width = Once(lambda lane: sumo.lane.getWidth(lane))
        self._blocked: dict[str, Blocked] = {}
        self._in_queue: dict[str, tuple[Line, float]] = {}  # changes that may be made sooner, and the distances to them
        # Routes, by route, lane change, by how much it is later, vehicle model, and its greatest length.
        self._later = Once(lambda key: with_later_change(*key[:3], network, *key[3:]))
        self._sooner = Once(lambda key: with_sooner_change(*key[:3], network, key[3]))  # by route, change, by, model
        self._beyond = Once(lambda key: with_change_beyond(*key[:2], network, key[2]))  # by route, change, model

    def forget(self) -> None:
        """What was noted at the last look is done, or counts no more."""
        self._blocked.clear()
        self._in_queue.clear()

    @property
    def blocked(self) -> Mapping[str, Blocked]:
        """The first lane change of each member that has no room for it now."""
        return self._blocked

    def note_in_queue(self, change: Line, distance: float, ego: Ego) -> None:
        """A member in a queue has room for its lane change where it is. distance: to its begin [m]"""
        self._blocked.pop(ego.id, None)
        self._in_queue[ego.id] = change, distance

    def note(self, change: Line, distance: float, ego: Ego, route: Route) -> float:
        """A member has no room for its lane change, or has driven past it. Of several the first one counts.

        distance : to its begin [m]
        returns  : where it stops for want of room [m]: at that begin, or where its lane ends if it drives on. Beside
                   flowing traffic it is nearer, so that the member becomes slower than that traffic
        """
        if ego.id in self._blocked:
            return distance
        missed = self._room.has_missed(change, distance, ego)
        line, ahead = (from_here(change, distance), 0.0) if missed else (change, distance)
        free, slowest = self._room.free_road(line, ahead, ego), self._room.slowest_beside(line, ahead, ego)
        is_fast = self._room.is_fast(change) and not route.closed  # on a loop it cannot be put off
        on_free_lane = is_fast and free == math.inf  # where it would stand in the way of those behind
        flows = on_free_lane and slowest.blocking >= FLOWS
        too_fast = is_fast and 0 < distance < ego.speed**2 / (2 * TOO_LATE)
        goes_back = distance < 0 and not missed and self._room.goes_back(change, ego)
        further = on_free_lane or goes_back or self._room.is_better_later(line, ahead, slowest.blocking, ego)
        if ego.id not in self._in_queue:
            self._blocked[ego.id] = Blocked(change, -distance, further, free, flows or too_fast)
        if not (flows or too_fast):
            return distance
        ends = distance + latest(route, change, self._width[change.lane], ego.length)
        slower = max(slowest.to_fall_back - SLOWER, ego.speed - GENTLE * SETTLING)
        return min(ends, ego.line_at_speed(slower)) if flows else ends

    def put_off(self, fleet: Fleet) -> Fleet:
        """The fleet with other routes for members without room for their lane change here, once they brake for that;
        for those that drive on, shortly before it, and for those that have driven past it, whether they brake or not;
        and for those that have room in a queue before it, where they are.

        Those without room look for it further on, as long as their lane leads on: on this edge, but not beside a queue,
        or on edges beyond, where the members behind them in their platoon do so too. The slower they are, the less road
        their lane change takes.
        """
        if len(self._later) + len(self._sooner) + len(self._beyond) > KEPT:
            self._forget_routes_but_those_of(fleet)
        fleet = self._put_off_all(fleet) if self._blocked else fleet
        for name, (change, distance) in self._in_queue.items():
            row, by = fleet.row_of.get(name), math.floor(distance / SOONER_BY) * SOONER_BY
            if row is None or by <= 0 or change not in fleet.members[row].route.lines:
                continue
            if sooner := self._sooner[fleet.members[row].route, change, by, fleet.members[row].model]:
                # The next member would follow it to the other lane before its own change, and look for no room there.
                in_trail = row, *np.flatnonzero(fleet.predecessor == row).tolist()
                fleet = fleet.with_route(row, sooner, WINDOW).off_trail(in_trail)
        return fleet

    def _put_off_all(self, fleet: Fleet) -> Fleet:
        for group in fleet.groups:
            known = group.memory is not None
            limit = ask(group.law, group.law.braking_for, group.memory) if known else None
            for k, i in enumerate(group.rows.tolist()):
                blocked = self._blocked.get(fleet.ids[i])
                if blocked is None:
                    continue
                brakes = limit is not None and limit.reason[k] == BRAKES_FOR_LINE
                if self._comes_to(fleet, i, blocked) if blocked.drives_on else brakes or blocked.missed:
                    before, fleet = fleet, self._put_off_one(fleet, i)
                    if fleet is not before:  # its predecessor may have gone over, where it has no room itself
                        fleet = fleet.off_trail([i])
        return fleet

    def _comes_to(self, fleet: Fleet, row: int, blocked: Blocked) -> bool:
        """Whether a member is about to begin a lane change, or should change lanes on an edge beyond."""
        member, speed = fleet.members[row], float(fleet.motion.speed[row])
        if blocked.line not in member.route.lines:
            return False
        before = max(JOIN * member.model.length, LOOKS_AFTER * speed)
        return -blocked.over < before or self._should_change_beyond(member, blocked, speed)

    def _should_change_beyond(self, member: Member, blocked: Blocked, speed: float) -> bool:
        """Whether a member that drives on must soon brake for the end of its lane, and can change lanes beyond."""
        line, over = blocked.line, blocked.over
        if over > 0 or blocked.free < math.inf:
            return False
        ends = latest(member.route, line, self._width[line.lane], member.model.length) - over
        must_brake = ends < LOOKS_AFTER * speed + speed**2 / (2 * BRAKES_BY)
        return must_brake and self._beyond[member.route, line, member.model] is not None

    def _forget_routes_but_those_of(self, fleet: Fleet) -> None:
        routes = {member.route for member in fleet.members}
        for kept in (self._later, self._sooner, self._beyond):
            for key in [key for key in kept if key[0] not in routes]:
                del kept[key]

    def _put_off_one(self, fleet: Fleet, row: int) -> Fleet:
        """The fleet with another route for one of these members, and for those behind it where they change beyond."""
        member, blocked = fleet.members[row], self._blocked[fleet.ids[row]]
        speed = float(fleet.motion.speed[row])
        change, over, further, free, drives_on = blocked
        if change not in member.route.lines:  # put off just now, with its leader's
            return fleet
        width = self._width[change.lane]
        step = CHANGE_AFTER * width
        by = step * max(math.ceil((max(over, 0.0) + LOOKS_AFTER * speed) / step), 1)
        beyond_now = drives_on and self._should_change_beyond(member, blocked, speed)
        longest, most = math.inf, latest(member.route, change, width, member.model.length)
        if blocked.missed and (most < over or free < by - over):
            return fleet
        if drives_on or blocked.missed:
            by = min(by, most)
            longest = longest_later(member.route, change, by, width, member.model.length)
        if drives_on:  # it may be faster there, but will be slower near the end of its lane
            fastest = math.sqrt(speed**2 + 2 * GAINS_BY * max(by - over, 0.0))
            speed = min(fastest, math.sqrt(2 * BRAKES_BY * (most - by)))
        longest = min(width * math.ceil(CHANGE_TIME * speed / width), longest)
        moves_on = drives_on or blocked.missed or (further and free > by + change.across)
        here = self._later[member.route, change, by if moves_on else 0.0, member.model, longest]
        if here and moves_on and not beyond_now:
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
