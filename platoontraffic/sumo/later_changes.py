"""Members without room for their lane change drive on, and change lanes later on their lane, or on an edge beyond."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from platoontraffic.controllers import BRAKES_FOR
from platoontraffic.road.lane_routes import CHANGE_AFTER, Line
from platoontraffic.road.later_change import with_change_beyond, with_later_change
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.reads import Once
from platoontraffic.sumo.room_to_change import RoomToChange
from platoontraffic.world.fleet import WINDOW, Fleet

BRAKES_FOR_LINE = BRAKES_FOR.index("line")
CHANGE_TIME = 3.0  # that a lane change takes, at the speed at which there was no room for it [s]
LOOKS_AFTER = 1.0  # a vehicle looks for room again after this time [s]

KEPT = 200  # routes that are kept for members which ask again; beyond, those that no member drives are forgotten


class Blocked(NamedTuple):
    """A lane change that cannot begin now, or not go on."""

    line: Line
    over: float  # distance driven since its begin [m]; negative: ahead of it
    further: bool  # there may be room further on
    free: float  # from its begin to the next vehicle in a queue on the lane before [m]; inf: there is none


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

    def note(self, change: Line, distance: float, ego: Ego) -> None:
        """A member has no room for its lane change; distance: to its begin [m]. Of several the first one counts."""
        if ego.id not in self._blocked:
            further = self._room.is_better_later(change, distance, ego)
            free = self._room.free_road(change, distance, ego)
            self._blocked[ego.id] = Blocked(change, -distance, further, free)

    def put_off(self, fleet: Fleet) -> Fleet:
        """The fleet with other routes for members that brake because there is no room for their lane change here.

        They look for it further on, as long as their lane leads on: on this edge, but not beside a queue, or on edges
        beyond, where the members behind them in their platoon do so too. The slower they are, the less road their lane
        change takes.
        """
        if len(self._later) + len(self._beyond) > KEPT:
            self._forget_routes_but_those_of(fleet)
        for group in fleet.groups if self._blocked else ():
            limit = group.law.braking_for(group.memory) if group.memory is not None else None
            rows = group.rows[limit.reason == BRAKES_FOR_LINE] if limit else ()
            for row in (int(i) for i in rows if fleet.ids[i] in self._blocked):
                fleet = self._put_off_one(fleet, row)
        return fleet

    def _forget_routes_but_those_of(self, fleet: Fleet) -> None:
        routes = {member.route for member in fleet.members}
        for kept in (self._later, self._beyond):
            for key in [key for key in kept if key[0] not in routes]:
                del kept[key]

    def _put_off_one(self, fleet: Fleet, row: int) -> Fleet:
        """The fleet with another route for one of these members, and for those behind it where they change beyond."""
        member, speed = fleet.members[row], float(fleet.motion.speed[row])
        change, over, further, free = self._blocked[member.id]
        if change not in member.route.lines:  # put off just now, with its leader's
            return fleet
        width = self._sumo.lane.getWidth(change.lane)
        longest, step = width * math.ceil(CHANGE_TIME * speed / width), CHANGE_AFTER * width
        by = step * max(math.ceil((max(over, 0.0) + LOOKS_AFTER * speed) / step), 1)
        moves_on = further and free > by + change.across
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
