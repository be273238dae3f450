"""SUMO's drivers see a member that is between two lanes as they see one of SUMO's own cars that changes lanes.

Each scene is played with members and with cars of SUMO's in their places. Behaviour of SUMO 1.28 that its documentation
does not promise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import libsumo
import numpy as np
import pytest

from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.lidar import PRESETS
from platoontraffic.road.netconvert import build_net
from platoontraffic.road.network import Network
from platoontraffic.shipped import networks
from platoontraffic.sumo.shadows import Mover, Shadows, _Seen, shadow_options
from platoontraffic.sumo.world import World
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Motion
from platoontraffic.world.fleet import Fleet, Member
from tests.support import ODD_NETS

STEP = 0.1
SPEED = 20.0  # of the vehicles that change lanes [m/s]
CAR = VEHICLES["car"]
SIDES = pytest.mark.parametrize(("source", "target"), [(0, 1), (1, 0)], ids=["up", "down"])


class Road(NamedTuple):
    """Edges to drive. The changes begin on the first one; another vehicle stands on `away`."""

    net: Path
    edges: tuple[str, ...]
    away: tuple[str, int]  # edge and lane
    start: float  # of the front bumper of the first vehicle that changes lanes, on the first edge [m]


HIGHWAY = Road(networks()["highway"], ("e0_e1",), ("w0_w1", 0), 300.0)
THREE_LANES = Road(networks()["highway"], ("e1_e2",), ("w0_w1", 0), 90.0)
BEND = Road(networks()["ring"], ("east_north",), ("west_south", 0), 60.0)  # of 160 m
LEFT_HAND = Road(ODD_NETS / "left.net.xml", ("em",), ("me", 1), 45.0)
JUNCTION = Road(ODD_NETS / "cross.net.xml", ("west_in", "east_out"), ("north_in", 0), 470.0)


class Change(NamedTuple):
    """An even change from one lane to another."""

    source: int
    target: int
    duration: float = 3.0  # [s]
    begins: float = 0.0  # [s]
    behind: float = 0.0  # the first vehicle's front bumper [m]


class Driver(NamedTuple):
    """A car that SUMO drives, without imperfection, on a lane that it does not leave."""

    lane: int
    gap: float  # behind the first vehicle that changes lanes, at time 0 [m]
    speed: float  # at time 0, and its greatest [m/s]


class Seen(NamedTuple):
    """Of one driver, arrays (steps,)."""

    gap: np.ndarray  # along the road [m]
    braking: np.ndarray  # deceleration [m/s2]

    @property
    def first_braking(self) -> int:
        """The step in which it first brakes; the number of steps if it never does."""
        brakes = self.braking > 0.1
        return int(np.argmax(brakes)) if brakes.any() else brakes.size


@pytest.fixture
def played(tmp_path):
    """Plays a scene, with members or with SUMO's own cars; what each driver does."""

    def play(
        changes: Sequence[Change],
        drivers: Sequence[Driver],
        members: bool,
        road: Road = HIGHWAY,
        duration: float = 10.0,
    ) -> list[Seen]:
        network, edge = Network.read(road.net), road.edges[0]
        away = _member(network, "away", *road.away, 20.0)
        cars = [f"car {i}" for i in range(len(changes))]
        names = [f"driver {i}" for i in range(len(drivers))]
        own = [
            _member(network, name, edge, c.source, road.start - c.behind) for name, c in zip(cars, changes, strict=True)
        ]
        options = {"lanechange.duration": str(changes[0].duration)}
        with World(network, STEP, 1, tmp_path / "words.log", options) as world:
            fleet = world.deploy(Fleet.deployed(own if members else [away], STEP))
            for name, driver in zip(names, drivers, strict=True):
                _insert(name, road, driver.lane, driver.speed)
            for name, change in zip(cars, changes, strict=True) if not members else ():
                _insert(name, road, change.source, 55.0)
            world.place(fleet)
            fleet = world.advance(fleet)
            for name, driver in zip(names, drivers, strict=True):
                _put(name, edge, driver.lane, road.start - CAR.length - driver.gap, driver.speed)
            for name, change in zip(cars, changes, strict=True) if not members else ():
                _put(name, edge, change.source, road.start - change.behind, SPEED)
                libsumo.vehicle.setSpeedMode(name, 0)
                libsumo.vehicle.setSpeed(name, SPEED)
            speeds = [[driver.speed for driver in drivers]]
            for time in np.arange(round(duration / STEP)) * STEP:
                if members:
                    fleet = _at(fleet, network, road, changes, time + STEP)
                else:
                    for name, change in zip(cars, changes, strict=True):
                        if abs(change.begins - time) < STEP / 2:
                            libsumo.vehicle.changeLane(name, change.target, 1000)
                world.place(fleet)
                fleet = world.advance(fleet)
                speeds.append(list(map(libsumo.vehicle.getSpeed, names)))
        speed = np.array(speeds).T
        gaps = np.array([[d.gap] for d in drivers]) + np.cumsum(SPEED - speed[:, 1:], axis=1) * STEP
        return [Seen(*both) for both in zip(gaps, -np.diff(speed, axis=1) / STEP, strict=True)]

    return play


def _member(network: Network, name: str, edge: str, lane: int, position: float) -> Member:
    x, y, heading = network.lane_pose(edge, lane, position)
    pose = (x - CAR.length / 2 * np.cos(heading), y - CAR.length / 2 * np.sin(heading), heading)
    return Member(name, name, 0, CAR, PRESETS["car-leader"], ReactiveLeader(), edge, lane, position, pose, speed=SPEED)


def _insert(name: str, road: Road, lane: int, limit: float) -> None:
    """A car of SUMO's, somewhere on the lane."""
    types = libsumo.vehicletype
    types.copy("DEFAULT_VEHTYPE", name)
    types.setSpeedDeviation(name, 0)
    types.setImperfection(name, 0)
    types.setSpeedFactor(name, 10)
    types.setMaxSpeed(name, limit)
    types.setLength(name, CAR.length)
    types.setWidth(name, CAR.width)
    libsumo.route.add(name, road.edges)
    libsumo.vehicle.add(name, name, name, departLane=str(lane), departPos="free")
    libsumo.vehicle.setLaneChangeMode(name, 0)


def _put(name: str, edge: str, lane: int, position: float, speed: float) -> None:
    for index in (1 - lane % 2, lane):  # it finds its place in the order of a lane only where it comes from another one
        libsumo.vehicle.moveTo(name, f"{edge}_{index}", position)
    libsumo.vehicle.setPreviousSpeed(name, speed)


def _at(fleet: Fleet, network: Network, road: Road, changes: Sequence[Change], time: float) -> Fleet:
    """The members at a time. Beyond the first edge the road goes straight on."""
    poses, edge, mirror = [], road.edges[0], -1 if network.left_hand else 1
    for change in changes:
        station, end = road.start - change.behind + SPEED * time, network.edges[edge][change.source]
        x, y, heading = network.lane_pose(edge, change.source, min(station, end))
        left = (change.target - change.source) * network.lane_width(edge, change.source) * mirror
        done = np.clip((time - change.begins) / change.duration, 0, 1)
        ahead, left, turn = (
            max(station - end, 0),
            done * left,
            np.arctan2(left / change.duration, SPEED) * (0 < done < 1),
        )
        x += ahead * np.cos(heading) - left * np.sin(heading) - CAR.length / 2 * np.cos(heading + turn)
        y += ahead * np.sin(heading) + left * np.cos(heading) - CAR.length / 2 * np.sin(heading + turn)
        poses.append((x, y, heading + turn))
    return replace(fleet, motion=replace(Motion.at_rest(*np.array(poses).T), speed=np.full(len(poses), SPEED)))


def assert_alike(member: Seen, car: Seen) -> None:
    """The first braking lies within a step, the least gap within 10 % or 0.3 m."""
    assert abs(member.first_braking - car.first_braking) <= 1
    assert member.gap.min() == pytest.approx(car.gap.min(), abs=max(0.3, 0.1 * abs(car.gap.min())))


@pytest.mark.sumo
@pytest.mark.parametrize("duration", [2.0, 3.0, 4.0])
@pytest.mark.parametrize("closing", [2.0, 4.0, 6.0, 8.0])
@pytest.mark.parametrize("gap", [10.0, 15.0, 25.0])
@SIDES
def test_drivers_on_both_lanes_react_as_to_a_car_of_sumo_s(played, source, target, gap, closing, duration):
    for lane in (target, source):
        driver = Driver(lane, gap, SPEED + closing)
        (member,), (car,) = (played([Change(source, target, duration)], [driver], which) for which in (True, False))
        assert_alike(member, car)
        if lane == target:
            assert member.first_braking <= 1
            assert member.gap.min() > 5


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("road", "source", "target"), [(BEND, 0, 1), (BEND, 1, 0), (LEFT_HAND, 1, 2), (LEFT_HAND, 2, 1)]
)
def test_on_a_bend_and_in_left_hand_traffic(played, road, source, target):
    drivers = [Driver(target, 15.0, 26.0), Driver(source, 24.0, 22.0)]
    members, cars = (played([Change(source, target)], drivers, which, road, 6.0) for which in (True, False))
    for member, car in zip(members, cars, strict=True):
        assert_alike(member, car)


@pytest.mark.sumo
@SIDES
def test_two_members_that_change_lanes_one_behind_the_other(played, source, target):
    changes = [Change(source, target, begins=1.0, behind=0.0), Change(source, target, begins=2.0, behind=20.0)]
    drivers = [Driver(target, 45.0, 26.0), Driver(source, 45.0, 22.0)]
    members, cars = (played(changes, drivers, which) for which in (True, False))
    for member, car in zip(members, cars, strict=True):
        assert_alike(member, car)


@pytest.mark.sumo
@pytest.mark.parametrize(("source", "beside"), [(0, 2), (2, 0)])
def test_a_driver_beyond_the_target_lane_is_not_disturbed(played, source, beside):
    driver = Driver(beside, 15.0, 26.0)
    (member,), (car,) = (played([Change(source, 1)], [driver], which, THREE_LANES, 6.0) for which in (True, False))
    assert_alike(member, car)


@pytest.mark.sumo
@SIDES
def test_a_member_that_changes_lanes_on_a_junction_is_seen(played, source, target):
    (driver,) = played([Change(source, target)], [Driver(target, 15.0, 26.0)], True, JUNCTION, 6.0)
    assert driver.first_braking <= 1
    assert driver.gap.min() == pytest.approx(12.4, abs=0.3)  # as on a lane


@pytest.mark.sumo
def test_without_shadows_a_driver_is_too_late_and_the_lane_that_was_left_stays_taken(played, monkeypatch):
    """The bar of the other tests is missed. SUMO leaves a moved vehicle its shadow until it comes to another edge."""
    free = played([Change(1, 0)], [Driver(1, 24.0, 25.0)], True)[0]
    monkeypatch.setattr(Shadows, "cast", lambda *_: None)
    assert played([Change(0, 1)], [Driver(1, 10.0, 28.0)], True)[0].gap.min() < 0
    assert played([Change(1, 0)], [Driver(1, 24.0, 25.0)], True)[0].gap[-1] > free.gap[-1] + 10


@pytest.mark.parametrize(
    ("driven", "speed", "casts"), [(3.0, 1.0, True), (4.9, 1.0, True), (5.1, 1.0, False), (3.0, 8.0, False)]
)
def test_the_rear_of_a_slow_member_is_seen_until_it_has_left_the_lane(driven, speed, casts):
    """A member stood across the border, its front in its lane again: a car of SUMO's struck its rear."""
    now = {"lateral": -1.0, "front": 100.0}
    vehicle = SimpleNamespace(
        getLateralLanePosition=lambda _: now["lateral"], getLanePosition=lambda _: now["front"],
        getLength=lambda _: 5.0, getSpeed=lambda _: speed,
    )  # fmt: skip
    sumo = SimpleNamespace(
        vehicle=vehicle,
        lane=SimpleNamespace(getWidth=lambda _: 3.2),
        edge=SimpleNamespace(getLaneNumber=lambda _: 2),
    )
    shadows = Shadows(sumo, SimpleNamespace(left_hand=False, edges={"a": (100.0,) * 2}), STEP)
    mover, where = Mover("m", "type", 1.8), {"m": ("a", "a_1")}
    shadows.observe([mover], where)
    now |= {"lateral": -0.6, "front": 100.0 + driven}
    shadows.observe([mover], where)
    assert (shadows._wanted(mover, shadows._seen["m"]) == -1) == casts


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("road", "lane", "lanes", "aside"),
    [
        *((road, 1, (1, 1), (aside, aside)) for road in (HIGHWAY, LEFT_HAND) for aside in (1.2, -1.2)),
        *((HIGHWAY, lane, (0, 1), (1.2, -1.2)) for lane in (0, 1)),
        *((HIGHWAY, lane, (1, 0), (-1.2, 1.2)) for lane in (0, 1)),
        *((LEFT_HAND, lane, (1, 2), (1.2, -1.2)) for lane in (1, 2)),
        *((LEFT_HAND, lane, (2, 1), (-1.2, 1.2)) for lane in (1, 2)),
    ],
    ids=lambda value: value.net.name.partition(".")[0] if isinstance(value, Road) else None,
)
def test_a_driver_between_two_members_that_stand_across_stops_behind_the_one_ahead(tmp_path, road, lane, lanes, aside):
    """In left-hand traffic some shadows are cast in every step, and SUMO does not sort them before it.

    aside: towards the lanes with the higher index [m]
    """
    network, edge = Network.read(road.net), road.edges[0]
    places = ("ahead", lanes[0], 80.0), ("behind", lanes[1], 50.0)
    own = [replace(_member(network, name, edge, its, place), speed=0.0) for name, its, place in places]
    with World(network, STEP, 1, tmp_path / "words.log", shadow_options(network, {})) as world:
        fleet = world.deploy(Fleet.deployed(own, STEP))
        _insert("driver", road, lane, 10.0)
        x, y, heading = (getattr(fleet.motion, key) for key in ("x", "y", "heading"))
        aside = np.array(aside) * (-1 if network.left_hand else 1)
        there = Motion.at_rest(x - aside * np.sin(heading), y + aside * np.cos(heading), heading)
        for step in range(80):
            world.place(replace(fleet, motion=there))
            fleet = world.advance(fleet)
            if step == 3:
                _put("driver", edge, lane, 60.0, 5.0)
        place = libsumo.vehicle.getLanePosition
        assert place("ahead") - CAR.length - place("driver") == pytest.approx(2.5, abs=0.5)  # its gap at a stand


def test_of_two_shadows_on_a_lane_the_last_one_is_inserted_first():
    """SUMO does not sort them before its step: a driver between them would not see the one ahead."""
    moved: list[str] = []
    fronts, lateral = {"ahead": 100.0, "behind": 80.0}, {"ahead": 0.0, "behind": 0.0}
    vehicle = SimpleNamespace(
        getLateralLanePosition=lateral.get, getLanePosition=fronts.get, getLength=lambda _: 5.0,
        moveTo=lambda name, *_: moved.append(name), setLateralLanePosition=lambda *_: None,
    )  # fmt: skip
    sumo = SimpleNamespace(
        vehicle=vehicle,
        lane=SimpleNamespace(getWidth=lambda _: 3.2, getLastStepVehicleIDs=lambda _: ()),
        edge=SimpleNamespace(getLaneNumber=lambda _: 2),
        vehicletype=SimpleNamespace(setWidth=lambda *_: None),
    )
    shadows = Shadows(sumo, SimpleNamespace(left_hand=False, edges={"a": (100.0,) * 2}), STEP)
    movers, where = [Mover(name, name, 1.8) for name in fronts], {name: ("a", "a_0") for name in fronts}
    shadows.observe(movers, where)
    lateral |= {"ahead": 1.0, "behind": 1.0}
    shadows.observe(movers, where)
    shadows.cast(movers)
    assert list(dict.fromkeys(moved)) == ["behind", "ahead"]


class Beside(NamedTuple):
    """What happens to a member that moves to the border of its lane, and to another vehicle."""

    casts: bool  # the member gets a shadow
    modes: list[int]  # of lane changes of the other one, as they are set: before the step and after it


def beside(index: int, lateral: float, other: int, its_front: float, lanes: int) -> Beside:
    """The member is at 100 m on lane `index`, the other one on lane `other`."""
    moved: list[str] = []
    modes: list[int] = []
    fronts = {"m": 100.0, "other": its_front}
    vehicle = SimpleNamespace(
        getLateralLanePosition=lambda _: lateral, getLanePosition=fronts.get, getLength=lambda _: 5.0,
        getSpeed=lambda _: 1.0,
        getLaneChangeMode=lambda _: 1621, setLaneChangeMode=lambda _, mode: modes.append(mode),
        moveTo=lambda _, lane, __: moved.append(lane), setLateralLanePosition=lambda *_: None,
    )  # fmt: skip
    there = {f"a_{index}": ("m",), f"a_{other}": ("other",)}
    lane = SimpleNamespace(getLastStepVehicleIDs=lambda name: there.get(name, ()), getWidth=lambda _: 3.2)
    edge, types = SimpleNamespace(getLaneNumber=lambda _: lanes), SimpleNamespace(setWidth=lambda *_: None)
    sumo = SimpleNamespace(vehicle=vehicle, lane=lane, edge=edge, vehicletype=types, TraCIException=KeyError)
    shadows = Shadows(sumo, SimpleNamespace(left_hand=False, edges={"a": (100.0,) * lanes}), STEP)
    mover, where = Mover("m", "type", 1.8), {"m": ("a", f"a_{index}")}
    shadows.observe([mover], where)
    lateral *= 1.5  # it moves on, 1 m/s
    shadows.observe([mover], where)
    shadows.cast([mover])
    casts = bool(moved)
    shadows.observe([mover], where)
    return Beside(casts, modes)


@pytest.mark.parametrize(("index", "lateral", "other"), [(1, -0.2, 0), (0, 0.2, 1)], ids=["right", "left"])
@pytest.mark.parametrize(("its_front", "casts"), [(102.0, True), (100.0, False), (96.0, False), (94.9, True)])
def test_a_vehicle_has_no_shadow_before_the_front_of_another_one_abreast(index, lateral, other, its_front, casts):
    """In a bend in Bologna a car of SUMO's had a shadow beside it, and changed lanes into the member itself."""
    assert beside(index, lateral, other, its_front, lanes=2).casts == casts


@pytest.mark.parametrize(("its_y", "passes"), [(5.0, True), (0.0, False), (-5.0, True)])
def test_a_vehicle_cannot_drive_past_one_that_stands_across_its_path(its_y, passes):
    """A bus of 12 m, 25 degrees askew, its middle at y = 0: its corners are beside the path of the other one."""
    places = {"bus": (0.0, 6.0 * np.sin(np.radians(25.0))), "car": (-3.0, its_y)}
    vehicle = SimpleNamespace(
        getSpeed=lambda _: 0.0, getPosition=places.get, getAngle={"bus": 65.0, "car": 90.0}.get,
        getLength={"bus": 12.0, "car": 4.5}.get, getWidth={"bus": 2.5, "car": 1.8}.get,
        getLanePosition={"bus": 100.0, "car": 97.0}.get,
    )  # fmt: skip
    lane = SimpleNamespace(getLastStepVehicleIDs=lambda _: ("car",))
    sumo = SimpleNamespace(vehicle=vehicle, lane=lane, edge=SimpleNamespace(getLaneNumber=lambda _: 2))
    shadows = Shadows(sumo, SimpleNamespace(left_hand=False, edges={"e": (100.0, 100.0)}), STEP)
    assert shadows._lets_pass(Mover("bus", "type", 2.5), _Seen("e_0", 1.0, 0.0, None), 1) == passes


@pytest.mark.parametrize(
    ("lateral", "its_front", "stays"),
    [(-0.2, 102.0, True), (-0.2, 108.0, True), (-0.2, 92.0, True), (-0.2, 111.0, False), (-0.2, 89.0, False),
     (0.2, 102.0, False)],
)  # fmt: skip
@pytest.mark.parametrize("other", [2, 0])
def test_a_vehicle_beside_one_that_gets_a_shadow_to_the_right_changes_no_lanes_in_that_step(
    lateral, its_front, stays, other
):
    """Only a shadow is on the member's own lane then. In Bologna cars took that lane for free, and drove into it."""
    happens = beside(1, lateral, other, its_front, lanes=3)
    assert happens.casts
    assert happens.modes == ([0, 1621] if stays else [])


@pytest.mark.parametrize(("index", "lateral", "other"), [(0, 0.2, 2), (2, -0.2, 0)], ids=["left", "right"])
@pytest.mark.parametrize(("its_front", "stays"), [(102.0, True), (92.0, True), (111.0, False), (89.0, False)])
def test_a_vehicle_beyond_the_lane_of_a_shadow_changes_no_lanes_beside_it(index, lateral, other, its_front, stays):
    """It and the member went over to the lane between them at the same time."""
    assert beside(index, lateral, other, its_front, lanes=3).modes[:2] == ([0, 1621] if stays else [])


@pytest.mark.sumo
def test_in_left_hand_traffic_the_rear_of_who_has_left_the_lane_does_not_hide_a_member(tmp_path):
    """Cars drove into members between two lanes where a vehicle stood on the junction with its rear on their lane."""
    network, speed = Network.read(LEFT_HAND.net), 3.0
    edge, start = "em", 130.0
    member = _member(network, "car 0", edge, 1, start)
    with World(network, STEP, 1, tmp_path / "words.log", {"lanechange.duration": "5"}) as world:
        fleet = world.deploy(Fleet.deployed([member], STEP))
        road = LEFT_HAND._replace(edges=("em", "mw"))
        _insert("behind", road, 2, 10.0)
        _insert("ahead", road, 2, 0.1)
        world.place(fleet)
        fleet = world.advance(fleet)
        libsumo.vehicletype.setLength("ahead", 40.0)
        _put("ahead", "mw", 2, 2.0, 0.0)  # its rear is on the lane before the junction
        libsumo.vehicle.setSpeed("ahead", 0.0)
        _put("behind", edge, 2, start - CAR.length - 8.0, 6.0)
        gaps = []
        for time in np.arange(40) * STEP:
            x, y, heading = network.lane_pose(edge, 1, start + speed * (time + STEP))
            right = network.lane_width(edge, 1) * np.clip((time + STEP) / 4.0, 0.0, 1.0)
            x, y = x + right * np.sin(heading), y - right * np.cos(heading)
            pose = x - CAR.length / 2 * np.cos(heading), y - CAR.length / 2 * np.sin(heading), heading
            motion = Motion.at_rest(*np.array([pose]).T)
            fleet = replace(fleet, motion=replace(motion, speed=np.full(1, speed)))
            world.place(fleet)
            fleet = world.advance(fleet)
            places = (libsumo.vehicle.getLanePosition(name) for name in ("car 0", "behind"))
            gaps.append(next(places) - CAR.length - next(places))
        assert libsumo.vehicle.getLaneID("car 0") == "em_2"
    assert min(gaps) > 1.0


PLAIN_ROAD = {
    "n.nod.xml": '<nodes><node id="a" x="0" y="0"/><node id="b" x="200" y="0"/></nodes>',
    "n.edg.xml": '<edges><edge id="ab" from="a" to="b" numLanes="2" speed="14"/></edges>',
    "n.netccfg": """<configuration><input><node-files value="n.nod.xml"/><edge-files value="n.edg.xml"/></input>
</configuration>""",
}


@pytest.mark.sumo
def test_who_is_abreast_of_a_member_that_stands_drives_past_where_sumo_has_it_behind(tmp_path):
    """A member stood half over for a car beside it, and that car for the member's shadow: in Bologna, for ever.

    Both lanes have the same length for SUMO. So it has the member 5 m ahead of who is truly abreast.
    """
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    for name, text in PLAIN_ROAD.items():
        (tmp_path / name).write_text(text)
    net = tmp_path / "n.net.xml"
    build_net(tmp_path / "n.netccfg", net)
    net.write_text(net.read_text().replace('"0.00,-4.80', '"10.00,-4.80'))
    road = Road(net, ("ab",), ("ab", 1), 0.0)
    network = Network.read(road.net)
    member = replace(_member(network, "member", "ab", 1, 39.0), speed=0.0)
    with World(network, STEP, 1, tmp_path / "words.log", shadow_options(network, {})) as world:
        fleet = world.deploy(Fleet.deployed([member], STEP))
        _insert("other", road, 0, 10.0)
        x, y, heading = (getattr(fleet.motion, key) for key in ("x", "y", "heading"))
        half_over, fronts = Motion.at_rest(x, y - 1.0, heading), []
        for step in range(100):
            world.place(replace(fleet, motion=half_over))
            fleet = world.advance(fleet)
            if step == 3:
                _put("other", "ab", 0, 10.0, 0.0)
            fronts.append(libsumo.vehicle.getPosition("other")[0])
    assert fronts[4] < x[0] - CAR.length
    assert fronts[-1] > x[0] + 2 * CAR.length
