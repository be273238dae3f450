"""Plans of obstacles, from the `[[obstacle]]` tables of a scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import shapely

from platoontraffic.errors import InputError
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.scenario import Scenario, obstacle_tables
from platoontraffic.world.fleet import Member
from platoontraffic.world.obstacles.path_line import PathLine, SpeedProfile
from platoontraffic.world.obstacles.plans import (
    Braking,
    Crossing,
    CuttingIn,
    Driving,
    LaneChange,
    Lying,
    MemberNear,
    Patrol,
    Plan,
    Pose,
    TargetGap,
)

ROAD_SEARCH = 60.0  # distance from a lane within which its kerb is looked for [m]
FROM_KERB = 0.5  # distance from the kerb at which a pedestrian waits [m]
ROUTE_LENGTH = 20  # edges that a car without a destination drives straight on
CROSSING_TOLERANCE = 1.0  # by which a route may pass outside the road that a pedestrian crosses [m]


class _Site(NamedTuple):
    """The surroundings of obstacles."""

    network: Network
    members: Sequence[Member]

    def member(self, name: str) -> Member:
        """The member of that id, which must have a route.

        raises : InputError
        """
        member = next(m for m in self.members if m.id == name)
        if member.route is None:
            raise InputError(f"{name!r}: its platoon has no route; must have `route` or `to`")
        return member


class _PlanError(Exception):
    """Faults in one key of an obstacle's table."""

    def __init__(self, key: str, faults: Sequence[str]) -> None:
        super().__init__(key, faults)
        self.key, self.faults = key, faults


@contextmanager
def _in(key: str) -> Iterator[None]:
    """Faults that are raised within belong to a key."""
    try:
        yield
    except InputError as error:
        raise _PlanError(key, error.faults) from error


def plans_of(scenario: Scenario, network: Network, members: Sequence[Member]) -> tuple[Plan, ...]:
    """The plans of a scenario's obstacles.

    raises : InputError where an obstacle is off the road, or would touch a member at the start
    """
    found: list[Plan] = []
    faults: list[str] = []
    site, tables = _Site(network, members), scenario.spec.obstacle
    for i, table in enumerate(tables):
        try:
            plan = BUILDERS[type(table)](table, obstacle_tables.name_of(tables, i), site)
            with _in(_place_key(table)):
                _check_start(plan, members)
            found.append(plan)
        except _PlanError as error:
            faults += [scenario.fault(("obstacle", i, error.key), fault) for fault in error.faults]
    if faults:
        raise InputError(*faults)
    return tuple(found)


def _place_key(table: Any) -> str:
    """The key that says where an obstacle is at first."""
    if isinstance(table, obstacle_tables.Robot):
        return "path_m"
    return "start" if getattr(table, "start", None) else "x_m"


def _check_start(plan: Plan, members: Sequence[Member]) -> None:
    if not isinstance(plan, Lying | Driving | Patrol) or plan.since != 0:
        return
    for member in members:
        if member.departs == 0 and _touch(plan, member):
            raise InputError(f"{plan.id} would be on {member.id} from the start")


def _presence(table: Any) -> dict[str, float]:
    """Fields of a plan that begins at the table's time and lasts as long as it says."""
    until = math.inf if table.lasts_s is None else table.time_s + table.lasts_s
    return {"since": table.time_s, "until": until}


def _or_never(time: float | None) -> float:
    return math.inf if time is None else time


def _car(table: obstacle_tables.Car, name: str, site: _Site) -> Plan:
    start, network = table.start, site.network
    with _in("start"):
        x, y, _ = network.lane_pose(start.edge, start.lane, start.position_m)
    with _in("to" if table.to else "route" if table.route else "start"):
        edges = _edges(table, network)
        path = PathLine(Route.along(edges, *network.route_lanes(edges, start.lane, False, start.position_m)))
        speed = SpeedProfile(table.speed_mps)
        if table.brakes_at_s is not None:
            brakes_at = table.brakes_at_s - table.time_s
            speed = SpeedProfile(table.speed_mps, brakes_at, table.rate_mps2, table.last_speed_mps)
        plan = Driving(
            id=name, kind="car", length=table.length_m, width=table.width_m, **_presence(table), edges=tuple(edges),
            path=path, station=path.project(x, y)[0] - table.length_m / 2, lateral=start.lateral_m, speed=speed,
        )  # fmt: skip
        _check_on_road(plan, network)
    return plan


def _edges(table: obstacle_tables.Car, network: Network) -> list[str]:
    """The edges that a car drives, from the one on which it starts."""
    start = table.start.edge
    if table.to:
        return network.fastest_route(start, table.to)
    if not table.route:
        return list(network.onward(start, ROUTE_LENGTH if table.speed_mps else 1))
    if start not in table.route:
        raise InputError(f"{table.route}: does not contain the start edge {start!r}")
    return table.route[table.route.index(start) :]


def _cut_in(table: obstacle_tables.CutIn, name: str, site: _Site) -> Plan:
    with _in("ahead_of"):
        follower = site.member(table.ahead_of)
        place = follower.platoon, follower.place - 1
        predecessor = next(m.id for m in site.members if (m.platoon, m.place) == place)
        width = site.network.lane_width(follower.edge, follower.lane) if table.from_m is None else table.from_m
        offset = (1.0 if table.side == "left" else -1.0) * width
        return CuttingIn(
            id=name, kind="cut_in", length=table.length_m, width=table.width_m,
            since=max(table.time_s - table.beside_s, 0.0), edges=follower.route.edges, path=PathLine(follower.route),
            gap=TargetGap(table.ahead_of, predecessor, table.share, table.relative_mps),
            lane_change=LaneChange(table.time_s, table.takes_s, offset, _or_never(table.leaves_after_s)),
            braking=Braking(_or_never(table.brakes_after_s), table.rate_mps2, table.last_speed_mps),
        )  # fmt: skip


def _pedestrian(table: obstacle_tables.Pedestrian, name: str, site: _Site) -> Plan:
    network = site.network
    with _in("edge"):
        network.lane_pose(table.edge, table.lane)
    with _in("position_m"):
        x, y, heading = network.lane_pose(table.edge, table.lane, table.position_m)
    left = np.array([-math.sin(heading), math.cos(heading)])
    kerbs = _kerbs(network, x, y, left)
    right_kerb, left_kerb = ((x, y) + s * left for s in (kerbs[0] - FROM_KERB, kerbs[1] + FROM_KERB))
    start, end = (right_kerb, left_kerb) if table.side == "right" else (left_kerb, right_kerb)
    event = None
    if table.when:
        with _in("when"):
            event = _member_near(table, site, (x, y), kerbs)
    return Crossing(
        id=name, kind="pedestrian", length=table.length_m, width=table.width_m, start=tuple(start), end=tuple(end),
        speed=table.speed_mps, sets_out=table.time_s, at_event=event,
    )  # fmt: skip


def _kerbs(network: Network, x: float, y: float, left: np.ndarray) -> tuple[float, float]:
    """Kerbs to the right and left of a point on a lane [m], along the unit vector to its left."""
    line = shapely.LineString([(x, y) - ROAD_SEARCH * left, (x, y) + ROAD_SEARCH * left])
    road = shapely.intersection(line, network.drivable)
    across = min(shapely.get_parts(road), key=lambda part: part.distance(shapely.Point(x, y)))
    along = sorted((np.array(across.coords) - (x, y)) @ left)
    return along[0], along[-1]


def _member_near(
    table: obstacle_tables.Pedestrian, site: _Site, point: tuple[float, float], kerbs: tuple[float, float]
) -> MemberNear:
    """The event at which a pedestrian sets out; point: on the lane that is crossed."""
    member = site.member(table.when.member)
    path = PathLine(member.route)
    station, offset = path.project(*point)
    right, left = min(kerbs[0], 0) - CROSSING_TOLERANCE, max(kerbs[1], 0) + CROSSING_TOLERANCE
    if not right < offset < left or not 0 < station < path.length:
        raise InputError(f"the route of {member.id!r} does not pass edge '{table.edge}' at {table.position_m:g} m")
    return MemberNear(member.id, table.when.within_m, path, station)


def _box(table: obstacle_tables.Box, name: str, site: _Site) -> Plan:
    x, y, heading = table.x_m, table.y_m, 0.0
    with _in(_place_key(table)):
        if place := table.start:
            x, y, heading = site.network.lane_pose(place.edge, place.lane, place.position_m)
            turned, aside = math.radians(table.heading_deg), place.lateral_m
            back = abs(table.length_m * math.cos(turned)) / 2 + abs(table.width_m * math.sin(turned)) / 2
            x, y = (
                x - back * math.cos(heading) - aside * math.sin(heading),
                y - back * math.sin(heading) + aside * math.cos(heading),
            )
        heading = math.remainder(heading + math.radians(table.heading_deg), math.tau)
        plan = Lying(
            id=name, kind="box", length=table.length_m, width=table.width_m, **_presence(table),
            x=x, y=y, heading=heading,
        )  # fmt: skip
        _check_on_road(plan, site.network)
    return plan


def _robot(table: obstacle_tables.Robot, name: str, site: _Site) -> Plan:
    points = np.array(table.path_m, dtype=float)
    with _in("path_m"):
        if not np.isfinite(points).all() or (np.hypot(*np.diff(points, axis=0).T) == 0).any():
            raise InputError("points must be finite, and no two in a row equal")
        for x, y in points:
            if not shapely.contains_xy(site.network.drivable, x, y):
                raise InputError(f"({x:g}, {y:g}) m is not on the road")
    line = Polyline(points if table.loop else np.concatenate([points, points[-2:0:-1]]), closed=True)
    return Patrol(
        id=name, kind="robot", length=table.length_m, width=table.width_m, since=table.time_s,
        line=line, speed=table.speed_mps,
    )  # fmt: skip


BUILDERS = {
    obstacle_tables.Car: _car,
    obstacle_tables.CutIn: _cut_in,
    obstacle_tables.Pedestrian: _pedestrian,
    obstacle_tables.Box: _box,
    obstacle_tables.Robot: _robot,
}


def _check_on_road(plan: Plan, network: Network) -> None:
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
