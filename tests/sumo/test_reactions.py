"""SUMO's drivers react to a member as to a background vehicle: each scene is played with both.

The networks are a cross of a major road and a minor one, without a light and with one: `nets/cross.net.xml`,
`nets/lights.net.xml`. Behaviour of SUMO 1.28 that its documentation does not promise.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import libsumo
import numpy as np
import pytest
import shapely

from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.lidar import PRESETS
from platoontraffic.road.netconvert import build_net
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.world import World
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Motion
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support import ODD_NETS

NETS = ODD_NETS
STEP = 0.1
LENGTH, WIDTH = VEHICLES["car"].length, VEHICLES["car"].width
LEAST_GAP = 2.5  # that SUMO's cars keep when they stand [m]
MAJOR = ("west_in", "east_out")  # from west to east
MINOR = ("north_in", "south_out")
ALIKE = 1e-6  # tolerance: SUMO computes the same for both [m], [m/s]
LINE = 492.8  # length of the major road's lanes before the junction [m]

Speeds = Callable[[float], float]  # speed [m/s] over time [s]


class Car(NamedTuple):
    """A vehicle with its route and the first position of its front bumper; if it has speeds, it keeps them."""

    name: str
    edges: tuple[str, ...]
    position: float
    speed: float = 0.0
    lane: int = 0
    limit: float = 55.0
    speeds: Speeds | None = None


def steady(speed: float) -> Speeds:
    return lambda time: speed


def braking(speed: float, deceleration: float, at: float) -> Speeds:
    return lambda time: speed if time < at else max(speed - deceleration * (time - at), 0.0)


def between(speed: float, start: float, end: float) -> Speeds:
    """Speeds over time: the speed from start to end, otherwise 0."""
    return lambda time: speed if start <= time < end else 0.0


@pytest.fixture
def scene(tmp_path):
    """Plays a scene on a network: members with prescribed speeds, and background vehicles. Returns a snapshot a step.

    ask: called after every step
    """

    def play(net: str, members: Sequence[Car], others: Sequence[Car], duration: float, ask: Callable = lambda: None):
        network = Network.read(NETS / f"{net}.net.xml")
        lines = [Polyline(network.route_line(car.edges, car.lane)) for car in members]
        fleet = Fleet.deployed([_member(network, car) for car in members], STEP)
        station = np.array([car.position for car in members])
        seen = []
        with World(network, STEP, 1, tmp_path / "words.log") as world:
            fleet = world.deploy(fleet)
            for car in others:
                _insert(car)
            for step in range(round(duration / STEP)):
                speed = np.array([car.speeds(step * STEP) for car in members])
                for car in others:
                    if car.speeds:
                        libsumo.vehicle.setSpeed(car.name, car.speeds(step * STEP))
                station = station + speed * STEP
                fleet = _at(fleet, lines, station, speed)
                world.place(fleet)
                fleet = world.advance(fleet)
                seen.append(world.snapshot(fleet))
                ask()
        return seen

    return play


def _member(network: Network, car: Car) -> Member:
    x, y, heading = network.lane_pose(car.edges[0], car.lane, car.position)
    pose = (x - LENGTH / 2 * np.cos(heading), y - LENGTH / 2 * np.sin(heading), heading)
    route = Route.along(car.edges, *network.route_lanes(car.edges, car.lane))
    law, lidar = ReactiveLeader(), PRESETS["car-leader"]
    return Member(car.name, "m", 0, VEHICLES["car"], lidar, law, car.edges[0], car.lane, car.position, pose, route)


def _at(fleet: Fleet, lines: Sequence[Polyline], station: np.ndarray, speed: np.ndarray) -> Fleet:
    """The members with their front bumpers at these stations of straight routes."""
    ends = [line.at(np.array([s, s - LENGTH])) for line, s in zip(lines, station, strict=True)]
    front, rear = np.array(ends).swapaxes(0, 1)
    heading = np.arctan2(*(front - rear).T[::-1])
    there = Motion.at_rest(*((front + rear) / 2).T, heading)
    return replace(fleet, motion=replace(there, speed=speed))


def _insert(car: Car) -> None:
    kind = f"kind of {car.name}"
    libsumo.vehicletype.copy("DEFAULT_VEHTYPE", kind)
    libsumo.vehicletype.setSpeedDeviation(kind, 0)
    libsumo.vehicletype.setImperfection(kind, 0)
    libsumo.vehicletype.setMaxSpeed(kind, car.limit)
    if car.speeds:  # in a member's place
        libsumo.vehicletype.setLength(kind, LENGTH)
        libsumo.vehicletype.setWidth(kind, WIDTH)
    libsumo.route.add(car.name, car.edges)
    place = {"departLane": str(car.lane), "departPos": str(car.position), "departSpeed": str(car.speed)}
    libsumo.vehicle.add(car.name, car.name, kind, **place)
    if car.speeds:
        libsumo.vehicle.setSpeedMode(car.name, 0)
        libsumo.vehicle.setLaneChangeMode(car.name, 0)


def track(seen: list[TrafficSnapshot], name: str) -> np.ndarray:
    """x, y of a vehicle's centre and its speed, (steps, 3), from its first step on."""
    return np.array([(t.x[i], t.y[i], t.speed[i]) for t in seen if name in t.ids for i in [t.ids.index(name)]])


def clearance(seen: list[TrafficSnapshot], one: str, other: str) -> float:
    """Smallest distance between two vehicles' footprints [m]."""
    both = [t for t in seen if {one, other} <= {*t.ids}]
    corners = np.array([t.boxes().corners()[[t.ids.index(one), t.ids.index(other)]] for t in both])
    return shapely.distance(*shapely.polygons(corners).T).min()


def strongest_braking(seen: list[TrafficSnapshot], name: str) -> float:
    return np.diff(track(seen, name)[:, 2]).min() / STEP


AWAY = Car("m", ("south_in", "north_out"), 100.0, speeds=steady(0.0))  # a member away from all others


def with_member_and_twin(scene, net: str, own: Car, others: Sequence[Car], duration: float):
    """The scene with a member, and with a background vehicle in its place."""
    members = scene(net, [own], others, duration)
    start = own.position + own.speeds(0.0) * STEP  # SUMO inserts background vehicles at the end of the first step
    twin = own._replace(name="twin", position=start, speed=own.speeds(0.0))
    return members, scene(net, [AWAY], [twin, *others], duration)


@pytest.mark.parametrize("name", ["cross", "lights"])
def test_sources_build_the_nets_of_these_tests(name, tmp_path):
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    build_net(NETS / f"{name}.netccfg", tmp_path / "built.net.xml")
    built, kept = tmp_path / "built.net.xml", NETS / f"{name}.net.xml"
    assert ET.canonicalize(from_file=built, strip_text=True) == ET.canonicalize(from_file=kept, strip_text=True)


# ---- drivers behind a member


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("deceleration", "strongest"), [(3.0, 2.2), (8.0, 4.5), (20.0, 5.2), (100.0, 6.45)], ids=lambda v: f"{v:g}"
)
def test_a_driver_stops_behind_a_member_that_brakes(scene, deceleration, strongest):
    own = Car("m", MINOR, 150.0, speeds=braking(10.0, deceleration, at=5.0))
    behind = Car("f", MINOR, 130.0, speed=10.0)
    member, twin = with_member_and_twin(scene, "cross", own, [behind], 20.0)
    assert track(member, "f")[-1, 2] < 1e-3
    assert clearance(member, "m", "f") == pytest.approx(LEAST_GAP, abs=0.02)
    assert strongest_braking(member, "f") == pytest.approx(-strongest, abs=0.05)
    assert track(member, "f") == pytest.approx(track(twin, "f"), abs=ALIKE)


# ---- at junctions


@pytest.mark.sumo
def test_a_driver_on_the_minor_road_waits_for_a_member(scene):
    own = Car("m", MAJOR, LINE - 66.5, speeds=steady(8.0))
    crossing = Car("f", MINOR, 200.0, speed=10.0)
    member, twin = with_member_and_twin(scene, "cross", own, [crossing], 20.0)
    assert clearance(member, "m", "f") > 3
    assert track(member, "f")[:, 2].min() == 0
    assert track(member, "f") == pytest.approx(track(twin, "f"), abs=ALIKE)
    assert track(member, "f")[-1, 1] < -10  # and has crossed behind it


@pytest.mark.sumo
def test_a_driver_that_turns_left_waits_for_an_oncoming_member(scene):
    own = Car("m", MAJOR, LINE - 66.5, speeds=steady(8.0))
    turning = Car("f", ("east_in", "south_out"), LINE - 64.0, speed=8.0, lane=1, limit=8.0)
    member, twin = with_member_and_twin(scene, "cross", own, [turning], 20.0)
    assert clearance(member, "m", "f") == pytest.approx(3.9, abs=0.1)
    assert track(member, "f")[:, 2].min() == 0
    assert track(member, "f") == pytest.approx(track(twin, "f"), abs=ALIKE)
    assert track(member, "f")[-1, 1] < -10


@pytest.mark.sumo
def test_a_driver_that_waits_inside_the_junction_goes_on_when_the_oncoming_member_stops_at_red(scene):
    """It must not expect of the member that it runs the red light, while the own light is still green."""
    own = Car("m", ("east_in", "west_out"), LINE - 60.0, speeds=braking(8.0, 2.0, at=5.0))
    turning = Car("f", ("west_in", "north_out"), LINE - 30.0, speed=8.0, lane=1)

    def red_after_five_seconds() -> None:
        if libsumo.simulation.getTime() > 5:
            libsumo.trafficlight.setRedYellowGreenState("middle", 13 * "r" + "GGGgg")  # green from the west

    seen = scene("lights", [own], [turning], 30.0, red_after_five_seconds)
    x, y, speed = track(seen, "f").T
    assert (np.hypot(x - 500, y)[speed < 0.1] < 10).any()  # it has waited inside
    assert y[-1] > 10
    assert track(seen, "m")[-1, 0] > 507  # behind its line


@pytest.mark.sumo
@pytest.mark.parametrize("net", ["cross", "lights"])
def test_a_driver_with_priority_or_green_stops_for_a_member_that_stands_on_the_crossing(scene, net):
    own = Car("m", MINOR, 280.0, speeds=between(5.0, 0.0, 5.4))  # to the middle of the lane that crosses
    arriving = Car("f", MAJOR, 300.0, speed=13.0)
    member, twin = with_member_and_twin(scene, net, own, [arriving], 20.0)
    assert (member[-1].x[0], member[-1].y[0]) == pytest.approx((498.4, -4.8), abs=0.3)
    assert track(member, "f")[-1, 2] == 0
    assert clearance(member, "m", "f") == pytest.approx(3.2, abs=0.05)
    assert track(member, "f") == pytest.approx(track(twin, "f"), abs=ALIKE)


# ---- lane changes


@pytest.mark.sumo
def test_a_driver_overtakes_only_after_a_member_beside_it_has_passed(scene):
    own = Car("m", MAJOR, 58.0, lane=1, speeds=steady(9.0))
    slow = Car("slow", MAJOR, 100.0, speed=5.0, limit=5.0)
    fast = Car("f", MAJOR, 60.0, speed=9.0)
    member, twin = with_member_and_twin(scene, "cross", own, [slow, fast], 20.0)
    alone = scene("cross", [AWAY], [slow, fast], 20.0)
    left = [int(np.argmax(track(seen, "f")[:, 1] > -3.2)) for seen in (member, twin, alone)]
    assert left[0] == left[1] > left[2] > 0
    assert clearance(member, "m", "f") > 1
    rear = track(member, "m")[left[0], 0] - LENGTH / 2
    front = track(member, "f")[left[0], 0] + 2.5
    assert rear > front


# ---- what SUMO reports of the path ahead of a member


class Link(NamedTuple):
    """The fields of libsumo's getNextLinks, in its order."""

    lane: str  # behind the junction
    priority: bool
    open: bool  # to a vehicle that arrives now at the speed limit, however far off the member is
    foe: bool  # a vehicle with priority is about to arrive
    via: str
    state: str
    direction: str
    length: float  # of `via` [m]


@pytest.fixture
def links(scene):
    """The links ahead of a member at the end of a scene, the rest of its lane [m], and the vehicles in conflict."""

    def ahead(net: str, own: Car, others: Sequence[Car] = (), duration: float = 0.5, signal: str = ""):
        reported = []

        def ask() -> None:
            reported.append(([Link(*link) for link in libsumo.vehicle.getNextLinks("m")], rest(), foes()))
            if signal:
                libsumo.trafficlight.setRedYellowGreenState("middle", 18 * signal)

        def rest() -> float:
            lane = libsumo.vehicle.getLaneID("m")
            return libsumo.lane.getLength(lane) - libsumo.vehicle.getLanePosition("m")

        def foes() -> dict[str, tuple[float, float, bool]]:
            """By vehicle: distance of the member, and of that vehicle, to the conflict; whether the member yields."""
            found = libsumo.vehicle.getJunctionFoes("m", 100.0)
            return {name: (ours, theirs, yields) for name, ours, theirs, _, _, _, _, yields, _ in found}

        scene(net, [own], others, duration, ask)
        return reported[-1]

    return ahead


@pytest.mark.sumo
@pytest.mark.parametrize("distance", [0.5, 5.0, 15.0, 40.0, 250.0])
@pytest.mark.parametrize(
    ("signal", "is_open", "priority"),
    [("r", False, False), ("u", False, False), ("y", True, False), ("g", True, False), ("G", True, True)],
)
def test_sumo_reports_a_signal_at_any_distance_and_yellow_as_open(links, distance, signal, is_open, priority):
    (link,), rest, _ = links("lights", Car("m", MAJOR, LINE - distance, speeds=steady(0.0)), signal=signal)
    assert (link.state, link.open, link.priority) == (signal, is_open, priority)
    assert (link.lane, link.via, link.direction) == ("east_out_0", ":middle_14_0", "s")
    assert rest == pytest.approx(distance, abs=1e-6)


@pytest.mark.sumo
@pytest.mark.parametrize("distance", [1.0, 5.0, 15.0, 40.0])
@pytest.mark.parametrize(("seconds", "is_open"), [(1.0, False), (2.5, False), (3.7, True), (6.0, True)])
def test_sumo_reports_the_minor_road_open_unless_a_foe_arrives_within_three_seconds(links, distance, seconds, is_open):
    own = Car("m", MINOR, 289.6 - distance, speeds=steady(0.0))
    driven = 0.4 * 13.9
    arriving = Car("f", MAJOR, LINE - driven - seconds * 13.9, speed=13.9, limit=13.9)
    (link,), _, foes = links("cross", own, [arriving])
    assert (link.state, link.open) == ("m", is_open)
    assert foes["f"][2]
    assert foes["f"][1] == pytest.approx(seconds * 13.9 + 4.0, abs=0.1)  # they meet 4 m behind the line
    (link,), _, foes = links("cross", own)
    assert (link.open, foes) == (True, {})


@pytest.mark.sumo
def test_sumo_reports_the_major_road_open_although_a_vehicle_waits_beside_it(links):
    waiting = Car("f", MINOR, 280.0)
    (link,), _, foes = links("cross", Car("m", MAJOR, LINE - 15, speeds=steady(0.0)), [waiting], 3.0)
    assert (link.state, link.open, link.priority) == ("M", True, True)
    assert not foes["f"][2]


@pytest.mark.sumo
def test_sumo_reports_a_left_turn_open_although_a_foe_comes_since_it_may_wait_inside(links):
    own = Car("m", ("west_in", "north_out"), LINE - 15, lane=1, speeds=steady(0.0))
    coming = Car("f", ("east_in", "west_out"), LINE - 25, speed=13.0)
    (link,), _, foes = links("cross", own, [coming])
    assert (link.state, link.direction, link.open) == ("m", "l", True)
    ours, theirs, yields = foes["f"]
    assert yields
    assert 15 < ours < 15 + 17
    assert 0 < theirs < 40


@pytest.mark.sumo
def test_sumo_reports_foes_but_no_link_inside_the_junction(links):
    own = Car("m", ("west_in", "north_out"), LINE - 1, lane=1, speeds=between(4.0, 0.0, 1.0))
    coming = Car("f", ("east_in", "west_out"), LINE - 90, speed=13.0)
    none, _, foes = links("cross", own, [coming], 2.0)
    assert none == []
    assert foes["f"][0] < 17
    assert foes["f"][2]


@pytest.mark.sumo
def test_sumo_reports_a_link_open_although_a_vehicle_stands_on_the_crossing(links):
    standing = Car("f", MAJOR, LINE - 5, speed=5.0, speeds=between(5.0, 0.0, 2.5))
    (link,), _, foes = links("cross", Car("m", MINOR, 275.0, speeds=steady(0.0)), [standing], 4.0)
    assert (link.open, link.foe) == (True, True)
    assert foes["f"][1] < 5


# ---- passing another vehicle on one lane


def passing(after: float, until: float) -> Speeds:
    """Stands, passes at 20 m/s, and crawls on."""
    return lambda time: 0.0 if time < after else 20.0 if time < until else 0.5


def orders(lane: str, noted: list) -> Callable[[], None]:
    """Notes after every step the vehicles of a lane in SUMO's order, and their positions on it."""

    def ask() -> None:
        names = libsumo.lane.getLastStepVehicleIDs(lane)
        noted.append((names, [libsumo.vehicle.getLanePosition(name) for name in names]))

    return ask


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("lane", "edges"),
    [("north_in_0", MINOR), ("west_in_0", MAJOR), ("west_in_1", MAJOR)],
    ids=["one lane", "the right one of two", "the left one of two"],
)
def test_a_member_that_passes_on_one_lane_is_ahead_from_then_on(scene, lane, edges):
    index = int(lane[-1])
    own = Car("m", edges, 80.0, lane=index, speeds=passing(2.0, 4.0))
    passed = [Car(name, edges, at, speed=2.0, lane=index, limit=2.0) for name, at in (("g", 95.0), ("f", 88.0))]
    noted = []
    scene("cross", [own], passed, 10.0, orders(lane, noted))
    assert all(positions == sorted(positions) for _, positions in noted)
    assert noted[0][0][-1] == "g"
    assert noted[-1][0][-1] == "m"


@pytest.mark.sumo
def test_a_driver_that_was_passed_stops_behind_the_member(scene):
    own = Car("m", MINOR, 80.0, speeds=lambda time: 20.0 if 2.0 <= time < 4.0 else 0.0)
    seen = scene("cross", [own], [Car("f", MINOR, 90.0, speed=2.0, limit=5.0)], 30.0)
    last = seen[-1]
    gap = (last.y[1] - last.length[1] / 2) - (last.y[0] + last.length[0] / 2)
    assert gap == pytest.approx(LEAST_GAP, abs=0.02)
    assert last.speed[1] == pytest.approx(0, abs=1e-3)


@pytest.mark.sumo
def test_order_is_repaired_inside_junctions_too(scene):
    own = Car("m", MINOR, 270.0, speeds=lambda time: 15.0 if 7.0 <= time < 9.0 else 0.0)
    noted = []
    scene("cross", [own], [Car("f", MINOR, 280.0, speed=2.0, limit=2.0)], 15.0, orders(":middle_1_0", noted))
    assert ("f", "m") in [names for names, _ in noted]
    assert all(positions == sorted(positions) for _, positions in noted)


# ---- the route that SUMO has of a member


@pytest.mark.sumo
def test_a_member_keeps_its_route_where_the_road_is_closed_behind_it(scene):
    """SUMO refuses a route whose first edges, which the member has driven, are not connected. It sets it only where it
    differs: so it is shortened inside the junction, as SUMO does where the member is beside its lane.
    """
    own = Car("m", (*MAJOR, "east_in"), LINE - 5.0, speeds=steady(8.0))
    routes = []

    def close_behind() -> None:
        if libsumo.vehicle.getLaneID("m").startswith(":"):
            libsumo.vehicle.setRoute("m", MAJOR)
            for lane in ("west_in_0", "west_in_1"):
                libsumo.lane.setDisallowed(lane, ["passenger"])
        routes.append(libsumo.vehicle.getRoute("m"))

    seen = scene("cross", [own], [], 6.0, close_behind)
    assert routes[0] == (*MAJOR, "east_in")
    assert routes[-1][-2:] == ("east_out", "east_in")
    assert np.diff(track(seen, "m")[:, 0]) == pytest.approx(0.8, abs=0.01)
