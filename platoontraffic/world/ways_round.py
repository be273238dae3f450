"""Members that stand before a body which covers a part of their path, and go round it.

A driver who cannot go on because another vehicle reaches into the path steers past it, if there is room. A member does
so by its own lasers, its route and the map: after `AFTER` at a stand, if the body has not moved since, its route gets a
way round it (`road.way_round`). A vehicle that it has followed waits, as a rule, for a light or for a gap: behind that
one it stays for `AFTER_FOLLOWING`, unless that one faces it. Where a little to the side is enough, it does not wait,
nor come to a stand: it would hold up a junction. At a closed stop line it does wait: the body may be gone when the line
opens.

The way keeps to the lanes of its own direction and to junctions; a member that has stood for `LONG` leaves them by
`VERGE`, if it must. Nothing may be there, nor come from behind on the side to which it goes. What drives away ahead of
it, or stands behind, does not count. Until it is past, it follows no vehicle: it stops for whatever is in its way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers import BRAKES_FOR, Signals
from platoontraffic.controllers.tracking import AROUND
from platoontraffic.lidar import ScanBatch
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.road.way_round import (
    MOST,
    Body,
    Way,
    blocked_at,
    blocked_return,
    farthest_aside,
    is_free_without,
    way_round,
    with_later_return,
)
from platoontraffic.vehicles.motion import FULL_SIZE
from platoontraffic.vehicles.records import changed, some
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import NOTHING, WINDOW, Fleet, Member, Readings
from platoontraffic.world.sensing import Measurements
from platoontraffic.world.standing import STANDS, before_bodies
from platoontraffic.world.traffic import TrafficSnapshot

AFTER = 5.0  # time that a member has stood before it takes a way [s] ...
AFTER_FOLLOWING = 120.0  # ... round the vehicle that it has followed: longer than that waits at a light ...
LITTLE = 0.8  # greatest shift that it does not wait with [m] ...
ROLLS = 2.5  # ... from this speed down [m/s]
LONG, VERGE = 30.0, 0.3  # after that time at a stand [s] its corners may leave the road by so much [m]
EVERY = 1.0  # least period after which it looks again [s] ...
LATER, LATER_FOLLOWING = 0.1, 0.5  # ... and the least share of its time at a stand: what has stood for long will stand
STILL = 0.3  # by which a body that stands may seem to move between two looks [m]: its place is found to 0.25 m
EVERY_UNDER_WAY, STILL_UNDER_WAY = 0.5, 0.3  # the same two of a member that drives [s], [m]
NEAR = 25.0  # distance of returns that matter [m]; so far behind where it pulls out only what stands may be [m] ...
COMES_WITHIN, LOOKS_BACK = 5.0, 80.0  # ... and nothing that would come within that time [s], as far as that [m]
WITHIN_LANE = 1.5  # greatest shift with which the vehicle is still on its lane [m]
STAYS = 0.6  # by which its side, or its front as it swings out, moves aside at most while all of it is on its lane [m]
AWAY_BY, AWAY_WITHIN = 0.5, math.radians(45)  # what is ahead, faster [m/s] and headed so nearly alike [rad] drives away
# Of a strip behind: from the side of the own body to beside the shifted one, and the front as it swings out [m].
APART, BESIDE = 0.3, 0.8

PREDECESSOR = BRAKES_FOR.index("predecessor")


class _Look(NamedTuple):
    """What a slow member knew when it last looked."""

    since: float = math.inf  # it stands [s]; inf: it rolls
    at: float = -math.inf  # time of that look [s]
    place: float = math.nan  # of the body, along the route [m]; NaN: it has not looked yet


class _UnderWay(NamedTuple):
    """A member on its way round a body."""

    way: Way
    without: Route  # the route as it was before
    body: str  # what it drives round; "": not known
    at: float  # time of its last look at the rest of it [s]
    blocked: float = math.inf  # station where it comes back at which something was in its way then [m]
    since: float = math.inf  # it has stood before something on it [s]; inf: it has not


class WaysRound:
    """The ways round bodies that members drive.

    network: None: no map is known, so there are none
    """

    def __init__(self, network: Network | None) -> None:
        self._network = network
        self._looks: dict[str, _Look] = {}  # of slow members
        self._under_way: dict[str, _UnderWay] = {}

    @property
    def passed(self) -> frozenset[str]:
        """The bodies that members drive round now, without those before which one has come to a stand."""
        under_way = self._under_way.values() if self._under_way else ()
        return frozenset([one.body for one in under_way if one.body and one.since == math.inf])

    def forget(self, names: Iterable[str]) -> None:
        """These members have other routes now."""
        for name in names:
            self._under_way.pop(name, None)

    def followed(
        self,
        fleet: Fleet,
        roads: Sequence[tuple[str, str]],
        sensed: Measurements,
        signals: Signals | None,
        time: float,
    ) -> tuple[list[Noted], Fleet]:
        """Events of members that go round a body from now on, and the fleet with their routes.

        roads   : edge and lane of each member, (n,)
        sensed  : what arrives in this step
        signals : the next stop line of each member; None: there are none
        """
        if self._network is None:
            return [], fleet
        for row in list(self._past(fleet)):
            del self._under_way[fleet.ids[row]]
        if fleet.progress.routes is None:
            return [], fleet
        scans, readings, seen = sensed.scans, sensed.readings, sensed.seen
        routes = self._going_on(fleet, sensed, time)
        events: list[Noted] = []
        for row, group, k, after in self._blocked(fleet, time):
            if row in routes:
                continue
            more = readings[group] if readings else NOTHING
            looks_around = any(one.sensor.name == AROUND for one in fleet.groups[group].further_lidars)
            if scans[group] is None or (looks_around and AROUND not in more.scans):
                continue
            traffic = seen[group].traffic if seen[group] else None
            returns = _returns(fleet, row, k, scans[group], traffic)
            station = float(fleet.progress.station[np.searchsorted(fleet.progress.rows, row)])
            name, member = fleet.ids[row], fleet.members[row]
            body = _body(member)
            last = self._looks[name]
            distance, least, met = blocked_at(member.route, station, body, returns.points)
            if traffic and met >= 0 and _faces(traffic, int(returns.hits[met]), float(fleet.motion.heading[row])):
                after = AFTER
            place = math.nan if traffic and met >= 0 and _moves(traffic, int(returns.hits[met])) else station + distance
            look = last._replace(at=time, place=place)
            self._looks[name] = look
            if signals is not None and not signals.open[row] and signals.distance[row] < distance:
                continue
            if not abs(look.place - last.place) < (STILL if look.since < math.inf else STILL_UNDER_WAY):
                continue
            most = MOST if roads[row][0][:1] == ":" else WITHIN_LANE
            if time - last.since < after - 1e-6:
                most = LITTLE
            if least > most:
                continue
            pose = *(float(axle[row]) for axle in fleet.model.axle_position(fleet.motion)), fleet.motion.heading[row]
            behind = _behind(fleet, row, k, traffic, more)
            verge = VERGE if time - last.since > LONG - 1e-6 else 0.0
            may_use = self._may_use(member.route, station, body, behind, verge)
            way = way_round(member.route, station, pose, body, returns.points, may_use, most)
            if way is None:
                continue
            before = self._under_way.get(name)
            without = before.without if before and member.route is before.way.route else member.route
            other = traffic.surfaces[returns.hits[way.met]] if traffic else ""
            routes[row], self._under_way[name] = way.route, _UnderWay(way, without, other, time)
            del self._looks[name]
            side = "left" if way.shift > 0 else "right"
            events.append(Noted(row, "goes_round", f"{abs(way.shift):.1f} m to the {side}", other=other))
        for row, route in routes.items():
            fleet = fleet.with_route(row, route, WINDOW)
        if self._under_way or some(fleet.goes_round):
            fleet = changed(fleet, goes_round=np.array([name in self._under_way for name in fleet.ids], dtype=bool))
        return events, fleet

    def _going_on(self, fleet: Fleet, sensed: Measurements, time: float) -> dict[int, Route]:
        """Other routes of members under way, by row.

        They come back later where something stands in their way back that was hidden by the body when they set out. A
        way on which they have stood for `AFTER` is given up when nothing is in the way without it.
        """
        routes: dict[int, Route] = {}
        if not self._under_way:
            return routes
        row_of, rows = {name: i for i, name in enumerate(fleet.ids)}, fleet.progress.rows
        for name, one in list(self._under_way.items()):
            row = row_of[name]
            group = next(k for k, group in enumerate(fleet.groups) if row in group.rows)
            scan = sensed.scans[group]
            if scan is None or time < one.at + EVERY_UNDER_WAY - 1e-6:
                continue
            k = int(np.flatnonzero(fleet.groups[group].rows == row)[0])
            traffic = sensed.seen[group].traffic if sensed.seen[group] else None
            returns = _returns(fleet, row, k, scan, traffic)
            station, body = float(fleet.progress.station[np.searchsorted(rows, row)]), _body(fleet.members[row])
            blocked = blocked_return(one.way, station, body, returns.points)
            since = min(one.since, time) if fleet.motion.speed[row] < STANDS else math.inf
            self._under_way[name] = one._replace(at=time, blocked=blocked, since=since)
            stands_long = time - since > AFTER and fleet.members[row].route is one.way.route
            if stands_long and is_free_without(one.way, one.without, station, body, returns.points):
                routes[row] = one.without
                del self._under_way[name]
                continue
            if not abs(blocked - one.blocked) < STILL_UNDER_WAY:
                continue
            may_use = self._may_use(fleet.members[row].route, station, body, np.empty((0, 2)))
            if way := with_later_return(one.way, station, body, returns.points, may_use):
                routes[row], self._under_way[name] = way.route, one._replace(way=way, at=time, blocked=math.inf)
        return routes

    def _past(self, fleet: Fleet) -> Iterator[int]:
        """Rows of members that are past the body and follow again."""
        if not self._under_way:
            return
        place = {fleet.ids[i]: (i, k) for k, i in enumerate(fleet.progress.rows.tolist())}
        self._under_way = {name: one for name, one in self._under_way.items() if name in place}
        for name, one in self._under_way.items():
            row, k = place[name]
            if fleet.progress.station[k] > one.way.ends:
                yield row

    def _blocked(self, fleet: Fleet, time: float) -> Iterator[tuple[int, int, int, float]]:
        """Slow members that look now at the body before them.

        Row, group, row in the group, and the time at a stand before a shift of more than `LITTLE` [s]. The longer it
        stands the less often it looks.
        """
        speed = np.abs(fleet.motion.speed)
        if self._looks:
            for name in self._looks.keys() - {fleet.ids[i] for i in np.flatnonzero(speed < ROLLS)}:
                del self._looks[name]
        for one in before_bodies(fleet, ROLLS):
            member = fleet.members[one.row]
            if member.route is None or "route" not in member.law.needs or one.creeps:
                continue
            if fleet.model.length[one.row] < FULL_SIZE:
                continue  # a robot in a laboratory stays
            if one.reason == PREDECESSOR and fleet.predecessor[one.row] >= 0:
                continue  # its own one, behind which it stays
            look, stands = self._looks.get(member.id, _Look()), speed[one.row] < STANDS
            if stands != (look.since < math.inf):
                look = look._replace(since=time if stands else math.inf)
            self._looks[member.id] = look
            follows = one.reason == PREDECESSOR
            later = LATER_FOLLOWING if follows else LATER
            every = max(EVERY, later * (time - look.since)) if stands else EVERY_UNDER_WAY
            if time - look.at > every - 1e-6:
                yield one.row, one.group, one.k, AFTER_FOLLOWING if follows else AFTER

    def _may_use(
        self, route: Route, station: float, body: Body, behind: np.ndarray, verge: float = 0.0
    ) -> Callable[[float, np.ndarray], bool]:
        """Whether a way is on the road, and nothing comes from behind on its side.

        station: of the driven axle on the route
        behind : returns of what comes from behind, from the centre, x forward, y to the left (k, 2) [m]
        verge  : by which the body's corners may leave the road [m]
        """

        def may_use(shift: float, corners: np.ndarray) -> bool:
            side = math.copysign(1.0, shift)
            ahead, aside = behind.T
            aside = side * aside - body.width / 2
            near = (aside > APART) & (ahead < -body.length / 2)
            if near.any():
                reach = farthest_aside(route, station, corners, side) - body.width / 2
                if reach > STAYS and (aside[near] < max(abs(shift) + BESIDE, reach + APART)).any():
                    return False
            points = shapely.points(corners.reshape(-1, 2))
            on_road = np.zeros(len(points), bool)
            bounds = shapely.box(*shapely.total_bounds(points))
            for edge in route.edges:
                area = self._network.own_side(edge)
                if shapely.dwithin(area, bounds, verge):
                    on_road |= shapely.dwithin(area, points, verge)
            return bool(on_road.all())

        return may_use


def _moves(traffic: TrafficSnapshot, row: int) -> bool:
    """Whether a body drives: one that crosses the path may be met at the same place of it at two looks.

    row: as of `_faces`
    """
    return row >= 0 and abs(traffic.speed[row]) > STANDS


def _faces(traffic: TrafficSnapshot, row: int, heading: float) -> bool:
    """Whether a body is headed against a member, which does not follow it then.

    row: of the traffic; negative: it is none of the traffic
    """
    return row >= 0 and abs(wrap(traffic.heading[row] - heading)) > np.pi / 2


def _body(member: Member) -> Body:
    return Body(*(float(getattr(member.model, key)) for key in Body._fields))


class _Returns(NamedTuple):
    points: np.ndarray  # (k, 2) [m]
    hits: np.ndarray  # row in the traffic that each belongs to, (k,)


def _returns(fleet: Fleet, row: int, k: int, scan: ScanBatch, traffic: TrafficSnapshot | None) -> _Returns:
    """Near returns of a member's laser.

    traffic: what drives away ahead is left out; that is taken as known, as from a further scan
    """
    near, hits = _near(scan, k, NEAR)
    motion = fleet.motion
    x, y, heading = (float(values[row]) for values in (motion.x, motion.y, motion.heading))
    if traffic is not None:
        ahead = (hits >= 0) & (near[:, 0] > fleet.model.length[row] / 2)  # not what is -1, a wall, or -2
        met, stays = hits[ahead], np.ones(len(hits), bool)
        alike = np.abs(wrap(traffic.heading[met] - heading)) < AWAY_WITHIN
        stays[ahead] = ~((traffic.speed[met] > AWAY_BY) & alike)
        near, hits = near[stays], hits[stays]
    cos, sin = math.cos(heading), math.sin(heading)
    return _Returns(np.array([x, y]) + near @ np.array([[cos, sin], [-sin, cos]]), hits)


def _behind(fleet: Fleet, row: int, k: int, traffic: TrafficSnapshot | None, readings: Readings) -> np.ndarray:
    """Returns of what stands behind a member or comes from there, from its centre, x forward, y to the left (k, 2) [m].

    traffic: how fast that comes; taken as known, as from a further scan
    """
    if AROUND not in readings.scans:
        return np.empty((0, 2))
    behind, hits = _near(readings.scans[AROUND], k, LOOKS_BACK)
    if AROUND in readings.seen:  # that laser may have measured at another instant
        traffic = readings.seen[AROUND].traffic
    reach: float | np.ndarray = NEAR
    if traffic is not None:
        comes = COMES_WITHIN * traffic.speed * np.cos(traffic.heading - float(fleet.motion.heading[row]))
        reach = np.where(np.abs(traffic.speed) > STANDS, np.maximum(NEAR, comes), 0.0)
        reach = np.append(reach, [NEAR, NEAR])[hits]  # the last two: of what is not known, and of walls
    return behind[-behind[:, 0] - fleet.model.length[row] / 2 < reach]


def _near(scan: ScanBatch, k: int, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns of the k-th laser within a reach, from the centre of its vehicle (m, 2) [m], and what they belong to."""
    model, ranges = scan.model, scan.ranges[k]
    beams = np.flatnonzero(ranges < reach)  # lost ones, NaN, are not
    places = model.body_directions.T[beams] * np.maximum(ranges[beams], model.range_min)[:, None]
    hits = np.full(len(beams), -2) if scan.hits is None else scan.hits[k, beams]
    return places + np.array([model.mount.x, model.mount.y]), hits
