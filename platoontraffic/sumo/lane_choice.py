"""Members that come to a queue on the lane of their route take another lane, on which they lose less time.

A route crosses as few lanes as it can. Where a queue stands on the lane by which it leaves an edge, another lane that
leads on may be the better one, although it costs a lane change, here or beyond. Whoever leads chooses, for those behind
it too: the first member of a platoon, one that has been left behind, or one that is in no platoon. It changes lanes
only where each of them has room beside it now; or it stays on its lane, and changes lanes on an edge beyond.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np

from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.lane_routes import BETWEEN, CHANGING, Line, changes_length
from platoontraffic.road.lane_times import NO_QUEUE, Queue, change_time
from platoontraffic.road.later_change import with_other_lane
from platoontraffic.road.network import Network
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.later_changes import Blocked
from platoontraffic.sumo.reads import Once, Reads
from platoontraffic.sumo.room_to_change import HARDLY_BEGUN, QUEUE_SPEED, RoomToChange
from platoontraffic.vehicles.motion import FULL_SIZE
from platoontraffic.world.fleet import WINDOW, Fleet

EVERY = 1.0  # period of looking [s]
STAYS_FOR = 10.0  # time for which a member does not choose again [s]
PER_VEHICLE = 2.0  # time after which the next vehicle of a queue sets out [s]: 1,800 vehicles an hour
AT_STOP = 15.0  # time that a vehicle stands at a stop, such as a bus [s]
GAIN = 6.0  # least time to be gained [s]
REACH = 200.0  # queues count up to so far beyond the end of the edge [m]
TOGETHER = 50.0  # a member that is farther behind its predecessor leads those behind itself [m]
CHANGE_TIME = 3.0  # that a lane change takes at the present speed [s]


class _Place(NamedTuple):
    """Where a vehicle is on its route, outside junctions and lane changes."""

    edge: int  # number of the edge
    to_end: float  # from the front bumper to the end of the edge [m]
    end: Line  # the line there


class _Chosen(NamedTuple):
    """Another lane for a member that leads, and for those behind it."""

    ids: tuple[str, ...]  # the one that leads first
    lane: int  # index, on their edge
    to_end: float  # from where they change lanes to the end of the edge [m]
    longest: float  # greatest length of the change over one lane [m]
    may_stay: str  # the lane on which they are, if their routes do not leave it; else ""


class LaneChoice:
    """Chooses lanes by the queues that SUMO has on them.

    now : SUMO's values at this instant
    room: judges whether there is room
    """

    def __init__(self, network: Network, now: Reads, room: RoomToChange) -> None:
        self._network, self._now, self._room = network, now, room
        self._times = Once(lambda edges: network.lane_times(edges))  # of routes, by their edges
        self._slow = Once(self._slow_on)  # at this look, by lane
        self._has_others = Once(lambda lane: _has_others(lane, network))  # on its edge, by lane
        self._due = -math.inf
        self._since: dict[str, float] = {}  # when members last chose another lane [s]
        self._chosen: list[_Chosen] = []
        self._may_stay: dict[str, str] = {}  # the lane that members on their way to another one need not leave

    def forget(self) -> None:
        """What was chosen at the last look is done, or counts no more."""
        self._chosen.clear()

    def is_due(self, time: float) -> bool:
        """Whether to look in this step. time: SUMO's clock [s]"""
        return time > self._due - 1e-6

    def look(self, fleet: Fleet, lanes: Iterable[str], egos: Iterable[Ego], time: float) -> None:
        """Find members for which another lane is better.

        lanes: of the members with a law that is given lines
        egos : these members, as they drive; not asked for where no edge has another lane
        """
        self._due = time + EVERY
        if not any(map(self._has_others.__getitem__, lanes)):
            return
        self._slow.clear()
        self._since = {name: since for name, since in self._since.items() if time - since < STAYS_FOR}
        self._may_stay = {name: lane for name, lane in self._may_stay.items() if name in fleet.row_of}
        round_it = {fleet.ids[row] for row in np.flatnonzero(fleet.goes_round)}
        asking = {ego.id: ego for ego in egos if ego.id not in round_it}  # those keep their ways round bodies
        progress = fleet.progress
        front = dict(zip(progress.rows.tolist(), (progress.station + progress.front).tolist(), strict=True))
        for head, behind in _together(fleet, asking.keys()).items():
            first = asking.get(fleet.ids[head])
            if first is None or first.id in self._since or first.length < FULL_SIZE or not self._has_others[first.lane]:
                continue
            rows = [head, *(row for row in behind if fleet.ids[row] in asking)]
            if chosen := self._choose([(asking[fleet.ids[row]], front[row]) for row in rows]):
                self._chosen.append(chosen)
                self._since[first.id] = time

    def chosen(self, fleet: Fleet) -> Fleet:
        """The fleet with other routes for members that have found a better lane."""
        for one in self._chosen:
            rows = [fleet.row_of[name] for name in one.ids if name in fleet.row_of]
            new = Once(lambda key: with_other_lane(*key[:2], one.lane, self._network, key[2], one.longest))  # noqa: B023
            routes = []
            for row in rows:
                member = fleet.members[row]
                end = _next_junction(member.route.lines, _front(fleet, row))
                routes.append(end and new[member.route, end.station - one.to_end, member.model])
            if not all(routes):  # as at the begin of the edge, where it looks again
                del self._since[one.ids[0]]
                continue
            for row, route in zip(rows, routes, strict=True):
                fleet = fleet.with_route(row, route, WINDOW)
                if one.may_stay:
                    self._may_stay[fleet.ids[row]] = one.may_stay
            fleet = fleet.off_trail(rows[:1])
        return fleet

    def given_up(self, fleet: Fleet, blocked: Mapping[str, Blocked]) -> Fleet:
        """The fleet with other routes for slow members without room to leave a lane which they need not leave.

        They stay on it: they would stand there, wait for room beside a queue, and block that lane too.
        """
        for name in [name for name in blocked if name in self._may_stay]:
            change, row = blocked[name].line, fleet.row_of.get(name)
            if row is None or change.lane != self._may_stay[name] or change not in fleet.members[row].route.lines:
                del self._may_stay[name]
            elif blocked[name].over < HARDLY_BEGUN * change.across and fleet.motion.speed[row] < QUEUE_SPEED:
                member, lane = fleet.members[row], index_of(change.lane)
                if route := with_other_lane(member.route, change.station, lane, self._network, member.model):
                    fleet = fleet.with_route(row, route, WINDOW)
                del self._may_stay[name]
        return fleet

    def _choose(self, members: Sequence[tuple[Ego, float]]) -> _Chosen | None:
        """Another lane on which they lose less time; None: there is none, or no room for a change to it.

        members: that which leads, and those behind it, with the station of each one's front bumper [m]
        """
        first, front = members[0]
        end = first.route and _next_junction(first.route.lines, front)
        # There is no queue before most members.
        if not end or self._queue(end.lane, first).time + self._queue(end.onto, first).time < GAIN:
            return None
        place = _place(first, front)
        if place is None:
            return None
        edge, lane, planned = edge_of(first.lane), index_of(first.lane), index_of(place.end.lane)
        times = self._times[first.route.edges].leaving(place.edge, lambda lane: self._queue(lane, first), REACH)
        times = {k: time + change_time(abs(k - lane), place.to_end) for k, time in times.items()}
        best = min(times, key=lambda k: (times[k], abs(k - planned)))
        if best == planned or math.isinf(times[best]) or times[best] > times[planned] - GAIN:
            return None
        along = [ego for ego, station in members if ego.lane == first.lane and _place(ego, station)]
        if len(along) < sum(ego.lane == first.lane for ego, _ in members):  # some are still changing lanes
            return None
        width, lanes = self._now.lane_width[first.lane], abs(best - lane)
        longest = width * math.ceil(CHANGE_TIME * first.speed / width)
        across = changes_length(width, longest, lanes, lanes) if lanes else 0.0
        for ego in along if lanes else ():
            to_end = self._now.lane_length[ego.lane] - self._now.position[ego.id]
            change = Line(0.0, CHANGING, "", 0, ego.lane, f"{edge}_{best}", (), across, to_end)
            if not self._room.has_room_here(change, ego):
                return None
        may_stay = first.lane if planned == lane else ""
        return _Chosen(tuple(ego.id for ego in along), best, place.to_end, longest, may_stay)

    def _queue(self, lane: str, ego: Ego) -> Queue:
        """The vehicles before one on a lane that are slow, or stand at a stop."""
        now, slow = self._now, self._slow[lane]
        if slow and edge_of(lane) == edge_of(ego.lane):
            rear = now.position[ego.id] - ego.length
            slow = [name for name in slow if name != ego.id and now.position[name] > rear]
        if not slow:
            return NO_QUEUE
        ends = min(now.position[name] - now.length[name] for name in slow)
        return Queue(sum(AT_STOP if now.stopped[name] else PER_VEHICLE for name in slow), now.lane_length[lane] - ends)

    def _slow_on(self, lane: str) -> list[str]:
        """The vehicles on a lane that are slow."""
        return [name for name in self._now.on_lane[lane] if self._now.speed[name] < QUEUE_SPEED]


def _has_others(lane: str, network: Network) -> bool:
    """Whether the edge of a lane has other lanes; False in a junction, and off the road."""
    return lane[:1] not in ("", ":") and network.number_of_lanes(edge_of(lane)) > 1


def _together(fleet: Fleet, choose: Set[str]) -> dict[int, list[int]]:
    """Groups that choose a lane together: row of the member that chooses, and rows of those that follow it.

    A member chooses for itself if it leads, is far behind its predecessor, or leaves the edge by another lane.

    choose: ids of the members that may choose their lanes
    """
    x, y, ahead = fleet.motion.x, fleet.motion.y, fleet.predecessor
    near = (ahead >= 0) & (np.hypot(x - x[ahead], y - y[ahead]) < TOGETHER)
    predecessor, found = np.where(near, ahead, -1).tolist(), {}
    for row in np.flatnonzero(near).tolist():
        if fleet.ids[row] in choose and _leaves_elsewhere(fleet, row, predecessor[row]):
            predecessor[row] = -1
    for row in range(len(fleet)):
        head = row
        while predecessor[head] >= 0:
            head = predecessor[head]
        behind = found.setdefault(head, [])
        if row != head:
            behind.append(row)
    return found


def _leaves_elsewhere(fleet: Fleet, row: int, ahead: int) -> bool:
    """Whether a member leaves its edge by another lane than the one ahead of it did or will."""
    own, its = fleet.members[row].route, fleet.members[ahead].route
    if own is its or own is None or its is None:
        return False
    end = _next_junction(own.lines, _front(fleet, row))
    return end is not None and all(line.lane != end.lane for line in its.lines if line.state != CHANGING)


def _place(ego: Ego, front: float) -> _Place | None:
    """None where no lane can be chosen: on a loop, in a junction or a lane change, or beside the own lane.

    front: station of the front bumper [m]
    """
    route = ego.route
    if route is None or route.closed or ego.lane[:1] in ("", ":"):
        return None
    passed, over, ahead = route.lines_about(front, 0.0)
    if not ahead or ahead[0][0].lane != ego.lane:
        return None
    goes_over = passed and passed.state == CHANGING and over < passed.across + BETWEEN * abs(passed.aside)
    end = _next_junction(route.lines, front)
    if goes_over or end is None:
        return None
    edge = sum(line.state != CHANGING for line in route.lines[: route.lines.index(end)])
    return _Place(edge, end.station - front, end)


def _next_junction(lines: Sequence[Line], station: float) -> Line | None:
    """The next line of a junction from a station on [m]; None: there is none."""
    return next((line for line in lines if line.station >= station and line.state != CHANGING), None)


def _front(fleet: Fleet, row: int) -> float:
    """Station of a member's front bumper on its route [m]."""
    progress = fleet.progress
    k = int(progress.rows.searchsorted(row))
    return float(progress.station[k] + progress.front[k])
