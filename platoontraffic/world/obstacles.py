"""What gets in the way: cars, humans who cut in, pedestrians, boxes, other robots; where each is at each instant.

They are other vehicles to everybody: to lidars, to contacts, to SUMO's drivers. What they do is prescribed, a function
of time or, of one who cuts in, integrated over the run's steps; nothing is random. World frame, SI and radians.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers import idm
from platoontraffic.errors import InputError
from platoontraffic.road.network import Network
from platoontraffic.road.polyline import Polyline
from platoontraffic.road.route import Route
from platoontraffic.scenario import Scenario, obstacle_tables
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot

BEFORE = 200.0  # a way goes on so far straight before its begin, where the last of a platoon may stand [m]
ACROSS = 60.0  # so far aside of a lane its kerb is looked for [m]
BESIDE_KERB = 0.5  # so far from it a pedestrian stands [m]
CLEAR = 0.5  # that who cuts in leaves to who is ahead, whatever its share of the gap [m]
AWAY_AFTER = 1.0  # one who has cut in and left again is gone then [s]

# A human's driving, by the Intelligent Driver Model (Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805).
HEADWAY, STANDING_GAP = 1.0, 2.0  # [s], [m]
ACCELERATION, COMFORTABLE_BRAKING, HARDEST_BRAKING = 1.5, 2.0, 8.0  # [m/s2]
LOOKS_AHEAD, BESIDE = 80.0, 0.2  # so far, and so much aside of its own sides [m]


class Pose(NamedTuple):
    x: float  # centre of the footprint
    y: float
    heading: float
    speed: float  # forward


@dataclass(frozen=True)
class Speed:
    """A speed over time that is `first` until `brakes_at`, and then falls at `rate` to `last`."""

    first: float  # [m/s]
    brakes_at: float = math.inf  # [s]
    rate: float = 4.0  # [m/s2]
    last: float = 0.0  # not above the first [m/s]

    @property
    def ends(self) -> float:
        """When it is `last` [s]."""
        return self.brakes_at + (self.first - self.last) / self.rate

    def at(self, time: float) -> float:
        return max(self.first - self.rate * max(time - self.brakes_at, 0.0), min(self.last, self.first))

    def way(self, time: float) -> float:
        """Driven since 0 [m]."""
        steady = self.first * min(time, self.brakes_at)
        if time <= self.brakes_at:
            return steady
        braking = min(time, self.ends) - self.brakes_at
        return steady + (self.first - self.rate * braking / 2) * braking + self.last * max(time - self.ends, 0.0)


class Way:
    """The lanes that a platoon drives, with stations on them; straight before their begin and beyond their end."""

    def __init__(self, route: Route) -> None:
        self.closed, self.length = route.closed, route.length
        points = route.line.points
        self._back = 0.0 if route.closed else BEFORE
        if route.closed:
            self._line = route.line
        else:
            ahead = (points[1] - points[0]) / np.hypot(*(points[1] - points[0]))
            self._line = Polyline(np.vstack([points[0] - BEFORE * ahead, points]))
        self._from, self._limit = route.line.stations, route.limit

    def project(self, x: float, y: float, near: float | None = None) -> tuple[float, float]:
        """Station of the nearest point, within 50 m of `near`, and how far to the left of it one is."""
        window = np.inf if near is None else 50.0
        station, offset = self._line.project(x, y, (near or 0.0) + self._back, window)
        return station - self._back, offset

    def ahead(self, station: float, other: float) -> float:
        """From one station to another [m]; behind is negative."""
        way = other - station
        return way if not self.closed else (way + self.length / 2) % self.length - self.length / 2

    def pose(self, station: float, offset: float, length: float) -> tuple[float, float, float]:
        """x, y and heading of a vehicle of some length with its centre there."""
        here, behind, before = self._line.at(self._back + station + length * np.array([0.0, -0.3, 0.3]))
        heading = math.atan2(*(before - behind)[::-1])
        return here[0] - offset * math.sin(heading), here[1] + offset * math.cos(heading), heading

    def limit(self, station: float) -> float:
        """Of speed there [m/s]."""
        here = station % self.length if self.closed else station
        k = np.searchsorted(self._from, here, side="right") - 1
        return float(self._limit[np.clip(k, 0, len(self._limit) - 1)])


@dataclass(frozen=True, eq=False)
class Plan(ABC):
    """What one of them does. `moved` takes its state to the next instant, `pose` tells where it is; None: not there."""

    id: str
    kind: str
    length: float
    width: float
    since: float  # [s]
    until: float
    edges: tuple[str, ...]  # that it means to drive, for SUMO's drivers to know

    @property
    def seen_by_sumo(self) -> bool:
        """Robots are in labs, where SUMO drives nobody."""
        return self.kind != "robot"

    def moved(self, state: Any, time: float, before: TrafficSnapshot | None, fleet: Fleet, dt: float) -> Any:
        """State at `time`, from that dt before.

        before : all that was on the road then; None at the first instant
        fleet  : the members at `time`
        """
        return state

    @abstractmethod
    def pose(self, state: Any, time: float) -> Pose | None:
        """Where it is at `time`, in that state."""


@dataclass(frozen=True, eq=False)
class Lying(Plan):
    """It stays where it is."""

    x: float
    y: float
    heading: float

    def pose(self, state: Any, time: float) -> Pose | None:
        return Pose(self.x, self.y, self.heading, 0.0)


@dataclass(frozen=True, eq=False)
class Driving(Plan):
    """Along a way, as fast as it is told."""

    way: Way
    station: float  # of its centre at first [m]
    lateral: float
    speed: Speed  # since it is there

    def pose(self, state: Any, time: float) -> Pose | None:
        driven = self.station + self.speed.way(time - self.since)
        if not self.way.closed and driven > self.way.length:
            return None
        return Pose(*self.way.pose(driven, self.lateral, self.length), self.speed.at(time - self.since))


@dataclass(frozen=True, eq=False)
class Patrol(Plan):
    """Round a closed line, which may lead to and fro; at its corners it turns on the spot, at once."""

    line: Polyline
    speed: float

    def pose(self, state: Any, time: float) -> Pose | None:
        station = self.speed * (time - self.since) % self.line.length
        k = int(np.searchsorted(self.line.stations, station, side="right")) - 1
        (x, y), step = self.line.at(np.array([station]))[0], self.line.points[k + 1] - self.line.points[k]
        return Pose(float(x), float(y), math.atan2(step[1], step[0]), self.speed)


@dataclass(frozen=True, eq=False)
class Crossing(Plan):
    """A pedestrian who stands at a kerb until it is time, and walks straight across. Its state is when it sets out."""

    start: tuple[float, float]
    end: tuple[float, float]
    speed: float
    sets_out: float | None = None  # [s]; None: when the member is near
    member: str = ""
    within: float = 0.0  # from its front bumper, along its way [m]
    way: Way | None = None  # of the member
    station: float = 0.0  # on it, where it is crossed [m]

    def moved(self, state: Any, time: float, before: TrafficSnapshot | None, fleet: Fleet, dt: float) -> float:
        if state is None:
            state = math.inf if self.sets_out is None else self.sets_out
        if state == math.inf and (row := row_of(fleet, self.member)) is not None:
            here, _ = self.way.project(fleet.motion.x[row], fleet.motion.y[row])
            ahead = self.way.ahead(here, self.station) - fleet.model.length[row] / 2
            if 0 <= ahead <= self.within:
                return time
        return state

    def pose(self, state: Any, time: float) -> Pose | None:
        (x0, y0), (x1, y1) = self.start, self.end
        whole, walked = math.hypot(x1 - x0, y1 - y0), self.speed * max(time - state, 0.0)
        if walked >= whole:
            return None
        share, heading = walked / whole, math.atan2(y1 - y0, x1 - x0)
        return Pose(x0 + share * (x1 - x0), y0 + share * (y1 - y0), heading, self.speed if time >= state else 0.0)


class Between(NamedTuple):
    """Of one who cuts in."""

    station: float  # of its centre [m]
    speed: float
    follower: float | None  # their stations; None: not looked for yet
    predecessor: float | None
    given_up: str = ""  # why it does not come over


@dataclass(frozen=True, eq=False)
class CuttingIn(Plan):
    """A human who drives beside a gap, comes over into it, and then keeps behind whoever is ahead.

    Beside the gap its middle nears a share of it by `relative` m/s, and is there at `comes`. It comes over along
    s(q) = 10 q^3 - 15 q^4 + 6 q^5, which has no speed and no acceleration aside at either end, and keeps its speed
    unless it has to brake. Then it drives by the Intelligent Driver Model, told the truth, and brakes no harder than in
    comfort unless that would not do. To who is ahead it leaves CLEAR, whatever its share; into a gap shorter than
    itself it does not come, and is gone.
    """

    way: Way
    ahead_of: str  # the follower
    behind: str
    comes: float  # [s]
    share: float
    relative: float
    aside: float  # where it comes from, to the left of the members' line [m]
    takes: float
    brakes_after: float
    rate: float
    last_speed: float
    leaves_after: float

    def moved(self, state: Any, time: float, before: TrafficSnapshot | None, fleet: Fleet, dt: float) -> Between | None:
        if time < self.since - 1e-9 or (state and state.given_up):
            return state
        if state is None or time < self.comes + dt - 1e-9:
            return self._beside(state, time, fleet)
        return self._drives(state, time - dt, before, dt)

    def pose(self, state: Between | None, time: float) -> Pose | None:
        if state is None or state.given_up or time > self.comes + self.leaves_after + self.takes + AWAY_AFTER:
            return None
        if not self.way.closed and state.station > self.way.length:
            return None
        offset, drift = self._offset(time)
        x, y, heading = self.way.pose(state.station, offset, self.length)
        return Pose(x, y, heading + math.atan2(drift, max(state.speed, abs(drift), 1.0)), state.speed)

    def _offset(self, time: float) -> tuple[float, float]:
        """To the left of the members' line [m], and its rate [m/s]."""
        since = time - self.comes
        if since > self.leaves_after:
            q, sign = min((since - self.leaves_after) / self.takes, 1.0), 1.0
        else:
            q, sign = min(max(since / self.takes, 0.0), 1.0), -1.0
        moved, rate = q * q * q * (10 + q * (6 * q - 15)), 30 * (q * (1 - q)) ** 2 / self.takes
        return self.aside * (moved if sign > 0 else 1 - moved), sign * self.aside * rate

    def _beside(self, state: Between | None, time: float, fleet: Fleet) -> Between:
        rows = row_of(fleet, self.ahead_of), row_of(fleet, self.behind)
        if None in rows:
            return Between(0.0, 0.0, None, None, f"{self.ahead_of} or {self.behind} is not on the road")
        near = (state.follower, state.predecessor) if state else (None, None)
        follower, predecessor = (
            self.way.project(fleet.motion.x[row], fleet.motion.y[row], station)[0]
            for row, station in zip(rows, near, strict=True)
        )
        speed, length = fleet.motion.speed[list(rows)], fleet.model.length[list(rows)]
        gap = self.way.ahead(follower, predecessor) - length.mean()
        if time > self.comes - 1e-9 and gap < self.length:
            return Between(0.0, 0.0, None, None, f"the gap is {gap:.2f} m, it is {self.length:g} m long")
        place = min(self.share * gap, gap - self.length / 2 - CLEAR)
        middle = follower + length[0] / 2 + place + self.relative * min(time - self.comes, 0.0)
        return Between(
            middle, max(speed[0] + self.share * (speed[1] - speed[0]) + self.relative, 0.0), follower, predecessor
        )

    def _drives(self, state: Between, time: float, before: TrafficSnapshot, dt: float) -> Between:
        gap, ahead = self._ahead(state, before)
        own, since = state.speed, time - self.comes
        closing = max(own - ahead, 0.0)
        needed = closing**2 / (2 * max(gap - STANDING_GAP / 2, 0.1))
        wanted = float(idm.desired_gap(own, own - ahead, STANDING_GAP, HEADWAY, ACCELERATION, COMFORTABLE_BRAKING))
        free = idm.free_road(own, max(self.way.limit(state.station), 0.1))
        acceleration = idm.acceleration(wanted, max(gap, 0.1), ACCELERATION, free)
        acceleration = max(acceleration, -COMFORTABLE_BRAKING)
        if since < self.takes - 1e-9:
            acceleration = 0.0
        if needed > COMFORTABLE_BRAKING:
            acceleration = -min(needed, HARDEST_BRAKING)
        speed = max(own + acceleration * dt, 0.0)
        if since > self.brakes_after - 1e-9:
            speed = min(speed, max(own - self.rate * dt, min(self.last_speed, own)))
        return state._replace(station=state.station + (own + speed) / 2 * dt, speed=speed)

    def _ahead(self, state: Between, before: TrafficSnapshot) -> tuple[float, float]:
        """Gap to who is next ahead in its way, and that one's speed; inf and 0 if nobody is."""
        offset, _ = self._offset(before.time)
        x, y, _ = self.way.pose(state.station, offset, self.length)
        near = np.hypot(before.x - x, before.y - y) < LOOKS_AHEAD
        gap, speed = math.inf, 0.0
        for i in np.flatnonzero(near):
            if before.ids[i] == self.id:
                continue
            station, aside = self.way.project(before.x[i], before.y[i], state.station + 30.0)
            ahead = self.way.ahead(state.station, station)
            # Before it is over, who is in the line that it comes into is in its way too.
            beside = min(abs(aside), abs(aside - offset)) if before.ids[i] == self.behind else abs(aside - offset)
            if ahead > 0 and beside < (self.width + before.width[i]) / 2 + BESIDE:
                between = ahead - (self.length + before.length[i]) / 2
                if between < gap:
                    gap, speed = between, float(before.speed[i])
        return gap, speed


class Obstacles:
    """All of them, from instant to instant: `move` in every step."""

    def __init__(self, plans: Sequence[Plan], fleet: Fleet, time: float = 0.0) -> None:
        self.plans = tuple(plans)
        self._states = [plan.moved(None, time, None, fleet, 0.0) for plan in plans]
        self.bodies = self._bodies(time)

    def move(self, before: TrafficSnapshot, fleet: Fleet, dt: float) -> None:
        """To the next instant.

        before : all that is on the road now, these too
        fleet  : the members at the next instant
        """
        time = round(before.time + dt, 6)
        steps = zip(self.plans, self._states, strict=True)
        self._states = [plan.moved(state, time, before, fleet, dt) for plan, state in steps]
        self.bodies = self._bodies(time)

    def given_up(self) -> dict[str, str]:
        """Those who meant to cut in and do not, and why."""
        steps = zip(self.plans, self._states, strict=True)
        return {plan.id: state.given_up for plan, state in steps if isinstance(state, Between) and state.given_up}

    def _bodies(self, time: float) -> TrafficSnapshot:
        there = []
        for plan, state in zip(self.plans, self._states, strict=True):
            if plan.since - 1e-9 <= time < plan.until - 1e-9 and (pose := plan.pose(state, time)):
                there.append((plan, pose))
        poses = np.array([pose for _, pose in there], dtype=float).reshape(-1, 4).T
        sizes = np.array([(plan.length, plan.width) for plan, _ in there], dtype=float).reshape(-1, 2).T
        return TrafficSnapshot(time, tuple(plan.id for plan, _ in there), *poses, *sizes)


def row_of(fleet: Fleet, name: str) -> int | None:
    return next((i for i, member in enumerate(fleet.members) if member.id == name), None)


# ---- from the tables of a scenario


def plans(scenario: Scenario, network: Network, members: Sequence[Member]) -> tuple[Plan, ...]:
    """What the scenario's obstacles do.

    raises: InputError where one is off the road, or would be on a member from the start
    """
    found: list[Plan] = []
    faults: list[str] = []
    tables = scenario.spec.obstacle
    for i, table in enumerate(tables):
        key, name = "kind", obstacle_tables.name_of(tables, i)
        try:
            if isinstance(table, obstacle_tables.Car):
                key = "start"
                network.lane_pose(table.start.edge, table.start.lane, table.start.position_m)
                key = "to" if table.to else "route" if table.route else "start"
                found.append(_car(table, name, network))
            elif isinstance(table, obstacle_tables.CutIn):
                key = "ahead_of"
                found.append(_cut_in(table, name, network, members))
            elif isinstance(table, obstacle_tables.Pedestrian):
                key = "edge"
                network.lane_pose(table.edge, table.lane)
                key = "position_m"
                network.lane_pose(table.edge, table.lane, table.position_m)
                key = "when" if table.when else "edge"
                found.append(_pedestrian(table, name, network, members))
            elif isinstance(table, obstacle_tables.Box):
                key = "start" if table.start else "x_m"
                found.append(_box(table, name, network))
            else:
                key = "path_m"
                found.append(_robot(table, name, network))
        except InputError as error:
            faults += [scenario.fault(("obstacle", i, key), fault) for fault in error.faults]
            continue
        if isinstance(found[-1], Lying | Driving | Patrol) and found[-1].since == 0:
            for member in members:
                if member.departs == 0 and _touch(found[-1], member):
                    what = f"{name} would be on {member.id} from the start"
                    faults.append(scenario.fault(("obstacle", i, key), what))
                    break
    if faults:
        raise InputError(*faults)
    return tuple(found)


def _until(table: Any) -> float:
    return math.inf if table.lasts_s is None else table.time_s + table.lasts_s


def _car(table: obstacle_tables.Car, name: str, network: Network) -> Plan:
    start = table.start
    if table.to:
        edges = network.fastest_way(start.edge, table.to)
    elif table.route:
        if start.edge not in table.route:
            raise InputError(f"{table.route}: does not contain the start edge {start.edge!r}")
        edges = table.route[table.route.index(start.edge) :]
    else:
        edges = list(network.onward(start.edge, 20 if table.speed_mps else 1))
    route = Route.along(edges, *network.route_lanes(edges, start.lane, False, start.position_m))
    speed = Speed(table.speed_mps)
    if table.brakes_at_s is not None:
        speed = Speed(table.speed_mps, table.brakes_at_s - table.time_s, table.rate_mps2, table.last_speed_mps)
    way = Way(route)
    x, y, _ = network.lane_pose(start.edge, start.lane, start.position_m)
    station = way.project(x, y)[0] - table.length_m / 2
    plan = Driving(
        name, "car", table.length_m, table.width_m, table.time_s, _until(table), tuple(edges), way, station,
        start.lateral_m, speed,
    )  # fmt: skip
    _on_road(plan, network)
    return plan


def _cut_in(table: obstacle_tables.CutIn, name: str, network: Network, members: Sequence[Member]) -> Plan:
    follower = next(m for m in members if m.id == table.ahead_of)
    if follower.route is None:
        raise InputError(f"{table.ahead_of!r}: its platoon has no route; must have `route` or `to`")
    behind = next(m.id for m in members if (m.platoon, m.place) == (follower.platoon, follower.place - 1))
    sign = 1.0 if table.side == "left" else -1.0
    aside = network.lane_width(follower.edge, follower.lane) if table.from_m is None else table.from_m
    return CuttingIn(
        name, "cut_in", table.length_m, table.width_m, max(table.time_s - table.beside_s, 0.0), math.inf,
        follower.route.edges, Way(follower.route), table.ahead_of, behind, table.time_s, table.share,
        table.relative_mps, sign * aside, table.takes_s, _or_never(table.brakes_after_s), table.rate_mps2,
        table.last_speed_mps, _or_never(table.leaves_after_s),
    )  # fmt: skip


def _or_never(time: float | None) -> float:
    return math.inf if time is None else time


def _pedestrian(table: obstacle_tables.Pedestrian, name: str, network: Network, members: Sequence[Member]) -> Plan:
    x, y, heading = network.lane_pose(table.edge, table.lane, table.position_m)
    left = np.array([-math.sin(heading), math.cos(heading)])
    road = shapely.intersection(shapely.LineString([(x, y) - ACROSS * left, (x, y) + ACROSS * left]), network.drivable)
    across = min(shapely.get_parts(road), key=lambda part: part.distance(shapely.Point(x, y)))
    along = sorted((np.array(across.coords) - (x, y)) @ left)
    right_kerb, left_kerb = ((x, y) + s * left for s in (along[0] - BESIDE_KERB, along[-1] + BESIDE_KERB))
    start, end = (right_kerb, left_kerb) if table.side == "right" else (left_kerb, right_kerb)
    more: tuple = ()
    if table.when:
        member = next(m for m in members if m.id == table.when.member)
        if member.route is None:
            raise InputError(f"{member.id!r}: its platoon has no route; must have `route` or `to`")
        way = Way(member.route)
        station, offset = way.project(x, y)
        if not min(along[0], 0) - 1 < offset < max(along[-1], 0) + 1 or not 0 < station < way.length:
            raise InputError(f"the route of {member.id!r} does not pass edge '{table.edge}' at {table.position_m:g} m")
        more = member.id, table.when.within_m, way, station
    return Crossing(
        name, "pedestrian", table.length_m, table.width_m, 0.0, math.inf, (), tuple(start), tuple(end),
        table.speed_mps, table.time_s, *more,
    )  # fmt: skip


def _box(table: obstacle_tables.Box, name: str, network: Network) -> Plan:
    x, y, heading = table.x_m, table.y_m, 0.0
    if table.start:
        place = table.start
        x, y, heading = network.lane_pose(place.edge, place.lane, place.position_m)
        back, aside = table.length_m / 2, place.lateral_m
        x, y = (
            x - back * math.cos(heading) - aside * math.sin(heading),
            y - back * math.sin(heading) + aside * math.cos(heading),
        )
    heading = math.remainder(heading + math.radians(table.heading_deg), math.tau)
    plan = Lying(
        name, "box", table.length_m, table.width_m, table.time_s, _until(table), (), x, y, heading
    )  # fmt: skip
    _on_road(plan, network)
    return plan


def _robot(table: obstacle_tables.Robot, name: str, network: Network) -> Plan:
    points = np.array(table.path_m, dtype=float)
    if not np.isfinite(points).all() or (np.hypot(*np.diff(points, axis=0).T) == 0).any():
        raise InputError("points must be numbers, and each another than the one before")
    for x, y in points:
        if not shapely.contains_xy(network.drivable, x, y):
            raise InputError(f"({x:g}, {y:g}) m is not on the road")
    line = Polyline(points if table.loop else np.concatenate([points, points[-2:0:-1]]), closed=True)
    size = table.length_m, table.width_m
    return Patrol(name, "robot", *size, table.time_s, math.inf, (), line, table.speed_mps)


def _on_road(plan: Plan, network: Network) -> None:
    pose = plan.pose(None, plan.since)
    if pose is None or not shapely.intersects(network.drivable, _polygon(pose, plan.length, plan.width)):
        where = f" at ({pose.x:.2f}, {pose.y:.2f}) m" if pose else ""
        raise InputError(f"{plan.id} would be{where} off the road; must touch it")


def _touch(plan: Plan, member: Member) -> bool:
    own = Pose(*member.pose, 0.0)
    one = _polygon(plan.pose(None, 0.0), plan.length, plan.width)
    return bool(shapely.intersects(one, _polygon(own, member.model.length, member.model.width)))


def _polygon(pose: Pose, length: float, width: float) -> shapely.Polygon:
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    return shapely.affinity.affine_transform(box, [cos, -sin, sin, cos, pose.x, pose.y])
