"""From a scenario and its road to the members of the platoons, each at its start pose."""

from __future__ import annotations

import math

import numpy as np
import shapely

from platoontraffic.errors import InputError
from platoontraffic.lidar import Scene
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.road.sumo_files import read_polygons
from platoontraffic.scenario import Platoon, Scenario, default_preset
from platoontraffic.world.fleet import Member


def static_scene(scenario: Scenario, network: Network) -> Scene:
    """What stands still and stops a beam or a robot: walls and obstacles."""
    # A centimetre of a street's kerb is less than scanners resolve, and saves a seventh of the segments of a real town.
    # Robots on lanes of a metre may be measured to the millimetre.
    tolerance = 0.01 if network.widest_lane >= 2 else 0.0
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

    raises: InputError where an edge or lane does not exist, or a start pose is off the road or on another's
    """
    members: list[Member] = []
    faults: list[str] = []
    for i, platoon in enumerate(scenario.spec.platoon):
        key = "start"
        try:
            network.lane_pose(platoon.start.edge, platoon.start.lane, platoon.start.position_m)
            key = "to" if platoon.to else "route"
            edges = network.fastest_route(platoon.start.edge, platoon.to) if platoon.to else platoon.route
            route = _route(network, platoon, edges, scenario.spec.scene.walls == "outline") if edges else None
            key = "start"
            members += _platoon(scenario, network, i, platoon, route)
        except InputError as error:
            faults += [scenario.fault(("platoon", i, key), fault) for fault in error.faults]
    if not faults:
        numbers = {platoon.id: i for i, platoon in enumerate(scenario.spec.platoon)}
        misplaced = _misplaced(members, network, scene)
        faults = [scenario.fault(("platoon", numbers[m.platoon], "start"), what) for m, what in misplaced]
        faults = list({fault.partition(": ")[0]: fault for fault in reversed(faults)}.values())[::-1]  # one a platoon
    if faults:
        raise InputError(*faults)
    return tuple(members)


def _platoon(scenario: Scenario, network: Network, i: int, platoon: Platoon, route: Route | None) -> list[Member]:
    model = platoon.vehicle.model()
    start = platoon.start
    members = []
    for place in range(platoon.size):
        role = "leader" if place == 0 else "follower"
        position = start.position_m - place * (model.length + platoon.gap_m)
        on_lane = max(position, 0.0)
        x, y, heading = network.lane_pose(start.edge, start.lane, on_lane)
        # The position is that of the front bumper, the pose that of the centre; behind the lane's start members stand
        # on its straight prolongation, which must be road too.
        back = model.length / 2 + on_lane - position
        x += -back * math.cos(heading) - start.lateral_m * math.sin(heading)
        y += -back * math.sin(heading) + start.lateral_m * math.cos(heading)
        driver, law = getattr(platoon, role), scenario.laws[i, role]
        fastest = model.top_speed
        if law.native:  # SUMO refuses what is faster than it would drive
            fastest = min(fastest, law.max_speed, law.speed_factor * network.limit(start.edge, start.lane))
        if start.speed_mps > fastest:
            raise InputError(f"speed_mps {start.speed_mps:g}: faster than its {role} drives there; up to {fastest:g}")
        members.append(
            Member(
                id=f"{platoon.id}.{place}",
                platoon=platoon.id,
                place=place,
                model=model,
                lidar=driver.lidar.model(default_preset(role, law), model.length),
                law=law,
                edge=start.edge,
                lane=start.lane,
                position=on_lane,
                pose=(x, y, heading),
                route=route,
                departs=start.time_s,
                speed=start.speed_mps,
                odometry=driver.odometry.model(),
            )
        )
    return members


def _route(network: Network, platoon: Platoon, edges: list[str], walls: bool) -> Route:
    """The route from the edge on where the platoon starts; walls: along the outline of the road."""
    if platoon.start.edge not in edges:
        raise InputError(f"{edges}: does not contain the start edge {platoon.start.edge!r}")
    here = edges.index(platoon.start.edge)
    onward = [*edges[here:], *(edges[:here] if platoon.loop else [])]
    points, limit, lines = network.route_lanes(onward, platoon.start.lane, platoon.loop, platoon.start.position_m)
    model = platoon.vehicle.model()
    rear = platoon.start.position_m - platoon.size * model.length - (platoon.size - 1) * platoon.gap_m
    if rear < 0 and not platoon.loop:  # who stands on the prolongation of the lane drives that first
        step = points[1] - points[0]
        more = model.length - rear
        points = np.vstack([points[0] - more * step / np.hypot(*step), points])
        limit = np.append(limit[0], limit)
        lines = [line._replace(station=line.station + more) for line in lines]
    around = [*onward, onward[0]] if platoon.loop else onward
    network.check_reversals(around, model.turning_radius)
    walled = walls and not network.leads_on(onward[-1])
    return Route.along(onward, points, limit, lines, platoon.loop, walled)


def _misplaced(members: list[Member], network: Network, scene: Scene) -> list[tuple[Member, str]]:
    """Members whose footprint is not wholly on the road, or is on something or someone; and what to say of them."""
    footprints = np.array([_footprint(m) for m in members])
    faults = []
    for member, on_road in zip(members, shapely.contains(network.drivable, footprints), strict=True):
        if not on_road:
            where = f"({member.pose[0]:.2f}, {member.pose[1]:.2f}) m"
            faults.append((member, f"{member.id} would start at {where}, not wholly on the road"))
    walls = shapely.linestrings(scene.segments.reshape(-1, 2, 2))
    for wall, a in shapely.STRtree(footprints).query(walls, predicate="intersects").T:
        where = f"({walls[wall].centroid.x:.2f}, {walls[wall].centroid.y:.2f}) m"
        faults.append((members[a], f"{members[a].id} would start in contact with the wall or obstacle at {where}"))
    if scene.solids is not None:
        for a in np.flatnonzero(shapely.contains(scene.solids, footprints)):
            faults.append((members[a], f"{members[a].id} would start inside an obstacle"))
    for a, b in shapely.STRtree(footprints).query(footprints, predicate="intersects").T:
        if a < b and members[a].departs == members[b].departs:
            faults.append((members[b], f"{members[b].id} would start on {members[a].id}"))
    return faults


def _footprint(member: Member) -> shapely.Polygon:
    x, y, heading = member.pose
    along, aside = member.model.length / 2, member.model.width / 2
    box = shapely.box(-along, -aside, along, aside)
    cos, sin = math.cos(heading), math.sin(heading)
    return shapely.affinity.affine_transform(box, [cos, -sin, sin, cos, x, y])
