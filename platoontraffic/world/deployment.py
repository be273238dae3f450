"""From a scenario and its road to the members of the platoons, each at its start pose."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers.law import Law
from platoontraffic.errors import InputError
from platoontraffic.lidar import LidarModel, Scene
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.road.sumo_files import read_polygons
from platoontraffic.scenario import Platoon, Scenario
from platoontraffic.vehicles.catalogue import VehicleModel
from platoontraffic.vehicles.odometry import OdometryErrors
from platoontraffic.vehicles.sensor import NamedSensor
from platoontraffic.world.fleet import Member

KERB_TOLERANCE = 0.01  # less than scanners resolve; it saves a seventh of the wall segments of a real town [m]
STREET_WIDTH = 2.0  # lanes at least this wide are full size; on narrower ones robots measure to the millimetre [m]


def static_scene(scenario: Scenario, network: Network) -> Scene:
    """Walls and solid obstacles: what stops a beam and does not move."""
    tolerance = KERB_TOLERANCE if network.widest_lane >= STREET_WIDTH else 0.0
    walls = network.outline(tolerance) if scenario.spec.scene.walls == "outline" else []
    solids = []
    for file in scenario.additional:
        for shape in read_polygons(file):
            if shape.kind == "wall":
                walls.append(shapely.LineString(shape.coordinates))
            else:
                solid = shapely.Polygon(shape.coordinates)  # outlines drawn by hand may cross themselves
                solids.append(shapely.make_valid(solid, method="structure", keep_collapsed=False))
    return Scene.from_shapely(walls, solids)


def deploy(scenario: Scenario, network: Network, scene: Scene) -> tuple[Member, ...]:
    """All members, in the order of the file.

    raises: InputError if an edge or lane does not exist, or if a member would start off the road or on something
    """
    members: list[Member] = []
    faults: list[str] = []
    for i in range(len(scenario.spec.platoon)):
        try:
            members += deploy_platoon(scenario, network, i)
        except InputError as error:
            faults += error.faults
    if faults := faults or _misplaced(scenario, members, network, scene):
        raise InputError(*faults)
    return tuple(members)


def deploy_platoon(scenario: Scenario, network: Network, i: int) -> list[Member]:
    """The members of the i-th platoon. raises: InputError with the places of the faults"""
    platoon, faults = scenario.spec.platoon[i], []
    goal = "platoon", i, "to" if platoon.to else "route"
    with _collected(faults), _placed(scenario, ("platoon", i, "start")):
        network.lane_pose(platoon.start.edge, platoon.start.lane, platoon.start.position_m)
    with _collected(faults), _placed(scenario, goal):
        network.check_roads([platoon.to] if platoon.to else platoon.route)
    if faults:
        raise InputError(*faults)
    with _placed(scenario, goal):
        edges = network.fastest_route(platoon.start.edge, platoon.to) if platoon.to else platoon.route
        walls, models = scenario.spec.scene.walls == "outline", [platoon.model(k) for k in range(platoon.size)]
        routes = {model: _route(network, platoon, edges, walls, model) if edges else None for model in set(models)}
    with _placed(scenario, ("platoon", i, "start")):
        roles = ["leader", *(["follower"] * (platoon.size - 1))]
        return [
            _member(network, platoon, place, routes[models[place]], Equipment.of(scenario, i, role, models[place]))
            for place, role in enumerate(roles)
        ]


@contextmanager
def _placed(scenario: Scenario, path: tuple) -> Iterator[None]:
    """Gives the faults that are raised inside the place of a key."""
    try:
        yield
    except InputError as error:
        raise InputError(*(scenario.fault(path, fault) for fault in error.faults)) from error


@contextmanager
def _collected(faults: list[str]) -> Iterator[None]:
    """Adds the faults that are raised inside to a list."""
    try:
        yield
    except InputError as error:
        faults += error.faults


class Equipment(NamedTuple):
    """What drives a member, and by which sensors."""

    role: str  # "leader" or "follower"
    model: VehicleModel
    law: Law
    lidars: tuple[LidarModel, ...]
    odometry: OdometryErrors
    sensors: tuple[NamedSensor, ...]

    @classmethod
    def of(cls, scenario: Scenario, i: int, role: str, model: VehicleModel) -> Equipment:
        """Of a leader or follower, with this vehicle. i: of its table among `Spec.groups`"""
        law, driver = scenario.laws[i, role], getattr(scenario.spec.groups[i], role)
        preset = scenario.default_preset((i, role))
        length = model.length
        further = (table.model(preset, length, name) for name, table in scenario.further_lidars((i, role)).items())
        sensors = tuple(found.sensor for found in scenario.sensors[i, role])
        return cls(role, model, law, (driver.lidar.model(preset, length), *further), driver.odometry.model(), sensors)


def _member(network: Network, platoon: Platoon, place: int, route: Route | None, equipment: Equipment) -> Member:
    """The member at a place of a platoon, 0 the leader."""
    start, model = platoon.start, equipment.model
    law, lidars = equipment.law, equipment.lidars
    fastest = model.top_speed
    if law.native:  # SUMO refuses to insert a vehicle that is faster than its own driver would be
        fastest = min(fastest, law.max_speed, law.speed_factor * network.limit(start.edge, start.lane))
    if start.speed_mps > fastest:
        raise InputError(
            f"speed_mps {start.speed_mps:g}: the {equipment.role} cannot be so fast there; must be up to {fastest:g}"
        )
    behind = platoon.behind_leader(place)
    position = start.position_m - behind
    if law.native and position < 0:
        raise InputError(
            f"position_m {start.position_m:g}: SUMO inserts the {equipment.role} on this edge; must be from {behind:g}"
        )
    front = max(position, 0.0)
    facing = _facing(network, platoon, front, model.length / 2 - model.axle)
    return Member(
        id=f"{platoon.id}.{place}",
        platoon=platoon.id,
        place=place,
        model=model,
        lidar=lidars[0],
        law=law,
        edge=start.edge,
        lane=start.lane,
        position=front,
        pose=_pose(facing, position, start.lateral_m, model.length),
        route=route,
        departs=start.time_s,
        speed=start.speed_mps,
        odometry=equipment.odometry,
        further_lidars=lidars[1:],
        sensors=equipment.sensors,
    )


def _facing(network: Network, platoon: Platoon, front: float, back: float) -> tuple[float, float, float]:
    """x, y of a lane at a position, and the heading of a vehicle with its front and its driven axle on the lane.

    front, back : position of the front bumper, and the axle's distance behind it [m]
    """
    start = platoon.start
    x, y, heading = network.lane_pose(start.edge, start.lane, front)
    if front < back:
        return x, y, heading
    behind_x, behind_y, behind_heading = network.lane_pose(start.edge, start.lane, front - back)
    if behind_heading == heading:
        return x, y, heading
    return x, y, math.atan2(y - behind_y, x - behind_x)


def _pose(
    lane_pose: tuple[float, float, float], position: float, lateral: float, length: float
) -> tuple[float, float, float]:
    """x, y and heading of the centre of a vehicle.

    lane_pose : of the lane's centre line at the position, or at the lane's start if the position is before it
    position  : of the front bumper along the lane [m]; below 0 on the lane's straight prolongation
    lateral   : offset to the left [m]
    length    : of the vehicle [m]
    """
    x, y, heading = lane_pose
    back = length / 2 + max(position, 0.0) - position
    x += -back * math.cos(heading) - lateral * math.sin(heading)
    y += -back * math.sin(heading) + lateral * math.cos(heading)
    return x, y, heading


def _route(network: Network, platoon: Platoon, edges: list[str], walls: bool, model: VehicleModel) -> Route:
    """The route from the edge on where the platoon starts, as a vehicle can drive it.

    walls: walls stand along the outline of the road
    """
    if platoon.start.edge not in edges:
        raise InputError(f"{edges}: does not contain the start edge {platoon.start.edge!r}")
    here, last = edges.index(platoon.start.edge), platoon.size - 1
    onward = [*edges[here:], *(edges[:here] if platoon.loop else [])]
    rear = platoon.start.position_m - platoon.behind_leader(last) - platoon.model(last).length
    start = platoon.start.lane, platoon.start.position_m, rear
    return route_from(network, onward, *start, walls, model, platoon.loop)


def route_from(
    network: Network,
    edges: Sequence[str],
    lane: int,
    position: float,
    rear: float,
    walls: bool,
    model: VehicleModel,
    loop: bool = False,
) -> Route:
    """The route along edges, as a vehicle can drive it.

    lane, position : on the first edge, of the first vehicle's front bumper [m]
    rear           : position of the last vehicle's rear bumper [m]; below 0: on the lane's straight prolongation
    walls          : walls stand along the outline of the road
    raises         : InputError where there is no such route, or where it turns back too tightly
    """
    points, limit, lines = network.route_lanes(edges, lane, loop, position)
    if rear < 0 and not loop:  # members before the lane's start drive its prolongation first
        step = points[1] - points[0]
        more = model.length - rear
        points = np.vstack([points[0] - more * step / np.hypot(*step), points])
        limit = np.append(limit[0], limit)
        lines = [line._replace(station=line.station + more) for line in lines]
    network.check_reversals([*edges, edges[0]] if loop else edges, model.turning_radius)
    walled = walls and not network.leads_on(edges[-1])
    return Route.along(edges, points, limit, lines, loop, walled).drivable_by(model)


def _misplaced(scenario: Scenario, members: list[Member], network: Network, scene: Scene) -> list[str]:
    """Faults of the start poses; the first of each platoon is enough."""
    footprints = np.array([_footprint(m) for m in members], dtype=object)
    faults: dict[str, str] = {}  # by platoon
    off_road = _off_road(footprints, members, network)
    for check in (off_road, _on_obstacles(footprints, scene), _on_members(footprints, members)):
        for i, what in check:
            faults.setdefault(members[i].platoon, f"{members[i].id} would start {what}")
    numbers = {platoon.id: i for i, platoon in enumerate(scenario.spec.platoon)}
    return [scenario.fault(("platoon", numbers[platoon], "start"), what) for platoon, what in faults.items()]


def _off_road(footprints: np.ndarray, members: list[Member], network: Network) -> Iterator[tuple[int, str]]:
    """Footprints (n,) that are not wholly on the road: row, and what is wrong."""
    for i in np.flatnonzero(~shapely.contains(network.drivable, footprints)):
        centre = footprints[i].centroid
        fits = f"; a size of {members[i].place} fits" if members[i].place else ""
        yield i, f"at ({centre.x:.2f}, {centre.y:.2f}) m, not wholly on the road{fits}"


def _on_obstacles(footprints: np.ndarray, scene: Scene) -> Iterator[tuple[int, str]]:
    walls = shapely.linestrings(scene.segments.reshape(-1, 2, 2))
    for wall, i in shapely.STRtree(footprints).query(walls, predicate="intersects").T:
        middle = walls[wall].centroid
        yield i, f"in contact with the wall or obstacle at ({middle.x:.2f}, {middle.y:.2f}) m"
    if scene.solids is not None:
        for i in np.flatnonzero(shapely.contains(scene.solids, footprints)):
            yield i, "inside an obstacle"


def _on_members(footprints: np.ndarray, members: list[Member]) -> Iterator[tuple[int, str]]:
    """Later ones of two members that depart at the same time and overlap."""
    for a, b in shapely.STRtree(footprints).query(footprints, predicate="intersects").T:
        if a < b and members[a].departs == members[b].departs:
            yield b, f"on {members[a].id}"


def _footprint(member: Member) -> shapely.Polygon:
    x, y, heading = member.pose
    along, aside = member.model.length / 2, member.model.width / 2
    box = shapely.box(-along, -aside, along, aside)
    cos, sin = math.cos(heading), math.sin(heading)
    return shapely.affinity.affine_transform(box, [cos, -sin, sin, cos, x, y])
