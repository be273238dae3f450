"""Members in SUMO's world: behaviour of SUMO 1.28 that its documentation does not promise."""

from __future__ import annotations

from dataclasses import replace

import libsumo
import numpy as np
import pytest

from platoontraffic import shipped
from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.errors import InputError, RunError
from platoontraffic.lidar import PRESETS
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.frame import front_of, sumo_angle
from platoontraffic.sumo.world import World
from platoontraffic.vehicles.differential import DifferentialDrive
from platoontraffic.vehicles.motion import Motion
from platoontraffic.world.fleet import Fleet, Member

STEP = 0.025


def network(name: str = "lab_loop") -> Network:
    return Network.read(shipped.networks()[name])


def fleet_of(*positions: float, route: tuple[str, ...] = (), closed: bool = False) -> Fleet:
    """Robots on the first edge of the loop, leader first; front bumpers at these positions."""
    model = DifferentialDrive()
    path = Route.along(route, [(2, 0.5), (4, 0.5)], [1.0, 1.0], closed=closed) if route else None
    members = [
        Member(f"r.{i}", "r", i, model, PRESETS["paper-leader"], ReactiveLeader(), "sw_se", 0, position,
               (2 + position - model.length / 2, 0.5, 0.0), path)
        for i, position in enumerate(positions)
    ]  # fmt: skip
    return Fleet.deployed(members, STEP)


def at(fleet: Fleet, x, y, heading, speed=0.0) -> Fleet:
    """The fleet at another pose."""
    n = len(fleet)
    there = Motion.at_rest(*(np.broadcast_to(v, n) for v in (x, y, heading)))
    return replace(fleet, motion=replace(there, speed=np.full(n, float(speed))))


@pytest.fixture
def world(tmp_path):
    with World(network(), STEP, 1, tmp_path / "words.log") as world:
        yield world


@pytest.mark.sumo
def test_members_are_inserted_at_their_start_poses(world):
    fleet = fleet_of(1.9, 1.2, 0.5)
    world.deploy(fleet)
    fronts = [libsumo.vehicle.getPosition(m.id) for m in fleet.members]
    assert np.allclose(fronts, [(3.9, 0.5), (3.2, 0.5), (2.5, 0.5)], atol=1e-9)
    assert world.roads(fleet) == [("sw_se", "sw_se_0")] * 3
    assert world.snapshot(fleet).time == 0.0


@pytest.mark.sumo
def test_members_that_start_behind_their_lane_stand_there_even_off_the_road(world):
    model = DifferentialDrive()
    fleet = fleet_of(1.0, 0.0, 0.0)
    members = [replace(m, pose=(x, 0.5, 0.0)) for m, x in zip(fleet.members, (2.9, 0.9, 0.2), strict=True)]
    fleet = Fleet.deployed(members, STEP)
    world.deploy(fleet)
    fronts = [libsumo.vehicle.getPosition(m.id)[0] for m in fleet.members]
    assert fronts == pytest.approx([x + model.length / 2 for x in (2.9, 0.9, 0.2)])
    assert [lane for _, lane in world.roads(fleet)][2] == ""
    for _ in range(3):
        world.place(fleet)
        world.advance(fleet)


@pytest.mark.sumo
@pytest.mark.parametrize("heading", np.radians([0, 45, 90, 135, 180, -45, -90, -135]))
def test_a_placed_vehicle_is_exactly_there(world, heading):
    fleet = fleet_of(1.0)
    world.deploy(fleet)
    world.place(at(fleet, 5.4, 2.5, heading))  # any heading, on the road
    world.advance(fleet)
    assert libsumo.vehicle.getPosition("r.0") == pytest.approx(front_of(5.4, 2.5, heading, 0.2), abs=1e-9)
    assert libsumo.vehicle.getAngle("r.0") == pytest.approx(sumo_angle(heading), abs=1e-9)


@pytest.mark.sumo
@pytest.mark.parametrize("heading", np.radians([0, 45, 90, 135, 180, -45, -90, -135]))
def test_boxes_stand_where_sumo_has_the_vehicles(world, heading):
    fleet = fleet_of(1.0)
    world.deploy(fleet)
    libsumo.route.add("back", ["ne_nw"])
    libsumo.vehicle.add("other", "back")
    there = at(fleet, 5.4, 2.5, heading)
    world.place(there)
    libsumo.vehicle.moveToXY("other", "", -1, 3.0, 4.5, sumo_angle(heading), 2)
    world.advance(there)
    traffic = world.snapshot(there)
    for name, corners in zip(traffic.ids, traffic.boxes().corners(), strict=True):
        angle = np.radians(libsumo.vehicle.getAngle(name))  # clockwise from north
        ahead, right = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
        front = np.array(libsumo.vehicle.getPosition(name))
        rear = front - libsumo.vehicle.getLength(name) * ahead
        side = libsumo.vehicle.getWidth(name) / 2 * right
        assert corners == pytest.approx(np.array([rear + side, front + side, front - side, rear - side]), abs=1e-9)
    assert traffic.ids == ("r.0", "other")


@pytest.mark.sumo
def test_a_vehicle_off_the_road_is_not_lost(world):
    fleet = fleet_of(1.0)
    world.deploy(fleet)
    for x in (3.0, 30.0, -5.0, 3.0):
        there = at(fleet, x, -8.0 if x != 3.0 else 0.5, 0.0)
        world.place(there)
        world.advance(there)
        assert libsumo.vehicle.getPosition("r.0")[0] == pytest.approx(x + 0.1)
    assert world.roads(fleet) == [("sw_se", "sw_se_0")]


@pytest.mark.sumo
def test_sumo_takes_the_members_own_speed(world):
    fleet = fleet_of(1.0)
    world.deploy(fleet)
    for step, speed in enumerate([0.1, 1.2, 0.0, 0.5]):
        there = at(fleet, 3.0 + 0.01 * step, 0.5, 0.0, speed)
        world.place(there)
        world.advance(there)
        assert libsumo.vehicle.getSpeed("r.0") == speed


@pytest.mark.sumo
def test_sumo_has_the_intended_route_on_every_edge(world):
    lap = ("sw_se", "se_ne", "ne_nw", "nw_sw")
    fleet = fleet_of(1.0, route=lap)
    world.deploy(fleet)
    assert libsumo.vehicle.getRoute("r.0") == lap
    poses = [(x, 0.5, 0.0) for x in np.arange(3, 5.5, 0.05)] + [(5.5, y, np.pi / 2) for y in np.arange(0.5, 2.8, 0.05)]
    for pose in poses:
        there = at(fleet, *pose, speed=2.0)
        world.place(there)
        world.advance(there)
    assert world.roads(fleet)[0][0] == "se_ne"
    assert libsumo.vehicle.getRoute("r.0")[libsumo.vehicle.getRouteIndex("r.0") :] == lap[1:]


@pytest.mark.sumo
def test_sumo_has_the_straightest_route_for_a_member_without_one(world):
    fleet = fleet_of(1.0)
    world.deploy(fleet)
    assert libsumo.vehicle.getRoute("r.0") == ("sw_se", "se_ne")


@pytest.mark.sumo
def test_a_pose_that_is_not_finite_is_an_error(world):
    fleet = fleet_of(1.0)
    world.deploy(fleet)
    with pytest.raises(RunError, match="not finite"):
        world.place(at(fleet, np.nan, 0.5, 0.0))


@pytest.mark.sumo
def test_a_second_simulation_in_libsumo_is_an_error(world, tmp_path):
    with pytest.raises(RunError, match="one simulation a process"):
        World(network("lab_world"), STEP, 1, tmp_path / "second.log").__enter__()


@pytest.mark.sumo
def test_a_network_that_sumo_refuses_is_an_error_in_its_words(tmp_path):
    broken = tmp_path / "broken.net.xml"
    text = shipped.networks()["lab_loop"].read_text().replace('type="priority"', 'type="no_such_type"')
    broken.write_text(text)
    with pytest.raises(InputError, match="SUMO refuses it: Attribute 'type' in definition of junction"):
        World(Network.read(broken), STEP, 1, tmp_path / "words.log").__enter__()
    with World(network(), STEP, 1, tmp_path / "words.log") as world:  # the process goes on
        world.deploy(fleet_of(1.0))


@pytest.mark.sumo
def test_a_vehicle_that_sumo_dropped_is_an_error_with_its_name_and_time(tmp_path):
    def drop(fleet: Fleet) -> None:
        with World(network(), STEP, 1, tmp_path / "words.log") as world:
            world.deploy(fleet)
            libsumo.vehicle.remove("r.0")
            world.place(fleet)
            world.advance(fleet)

    with pytest.raises(RunError, match=r"SUMO failed at .* s: .*'r.0' is not known"):
        drop(fleet_of(1.0))


@pytest.mark.sumo
def test_background_vehicles_are_in_the_snapshot_by_their_centres(world):
    fleet = fleet_of(1.9)
    world.deploy(fleet)
    libsumo.vehicletype.copy("DEFAULT_VEHTYPE", "small")
    libsumo.vehicletype.setLength("small", 0.3)
    libsumo.route.add("back", ["ne_nw"])
    libsumo.vehicle.add("other", "back", typeID="small", departPos="1.0")
    world.place(fleet)
    world.advance(fleet)
    traffic = world.snapshot(fleet)
    assert traffic.ids == ("r.0", "other")
    assert (traffic.x[1], traffic.y[1]) == pytest.approx((4 - 1.0 + 0.15, 4.5), abs=1e-9)
    assert (abs(traffic.heading[1]), traffic.length[1]) == pytest.approx((np.pi, 0.3))
