"""Two vehicles at the ends of their lanes that would have to swap them."""

from __future__ import annotations

import pytest

from platoontraffic.sumo.client import libsumo
from platoontraffic.sumo.lane_swaps import LaneSwaps
from platoontraffic.sumo.room_to_change import Wanted
from tests.support.generated import crossroads

pytestmark = pytest.mark.sumo

ENDS = 1e3  # beyond the ends of the lanes before the junction [m]
BUS, CAR = ("bus", "bus", "left", 0, ENDS), ("car", "DEFAULT_VEHTYPE", "right", 1, ENDS)


@pytest.fixture
def sumo(tmp_path):
    """A bus on the right lane that is to turn left, and a car beside it that is to turn right."""
    options = "--no-step-log", "--no-warnings", "--time-to-teleport", "-1", "--log", str(tmp_path / "log.txt")
    libsumo.start(["sumo", "-n", str(crossroads(tmp_path)), "--step-length", "0.1", *options])
    libsumo.trafficlight.setPhase("c", 2)  # green for both
    for route, onto in (("left", "cn"), ("right", "cs")):
        libsumo.route.add(route, ["wc", onto])
    libsumo.vehicletype.copy("DEFAULT_VEHTYPE", "bus")
    libsumo.vehicletype.setLength("bus", 12.0)
    yield libsumo
    libsumo.close()


def insert(*vehicles: tuple[str, str, str, int, float]) -> None:
    """At rest: id, type, route, lane, and place at most [m] of each. Nobody changes lanes before all are there."""
    for name, kind, route, lane, _ in vehicles:
        libsumo.vehicle.add(name, route, typeID=kind, departLane=str(lane), departPos="100")
        libsumo.vehicle.setLaneChangeMode(name, 0)
    libsumo.simulationStep()
    for name, _, _, lane, place in vehicles:
        libsumo.vehicle.moveTo(name, f"wc_{lane}", min(place, _end(lane)))
        libsumo.vehicle.setLaneChangeMode(name, 1621)


def _end(lane: int) -> float:
    return libsumo.lane.getLength(f"wc_{lane}") - 0.1


def drive(seconds: float, swaps: LaneSwaps | None = None, where=(), wanted=(), obstacles=frozenset()) -> None:
    for _ in range(round(seconds / 0.1)):
        if swaps:
            swaps.observe(dict(where), dict(wanted), libsumo.simulation.getTime(), obstacles)
        libsumo.simulationStep()


def test_the_shorter_one_is_taken_across_when_both_have_stood_for_long(sumo, tmp_path):
    insert(BUS, CAR)
    drive(200.0)
    assert {sumo.vehicle.getLaneID(name) for name in ("bus", "car")} == {"wc_0", "wc_1"}  # they stand for good
    swaps = LaneSwaps(sumo)
    drive(1.0, swaps)
    assert sumo.vehicle.getLaneID("car") == "cs_0"
    assert sumo.vehicle.getLanePosition("car") < 7.0
    drive(60.0, swaps)
    assert sumo.vehicle.getIDCount() == 0
    sumo.close()
    assert "'car' is taken across the junction" in (tmp_path / "log.txt").read_text()
    sumo.start(["sumo", "-n", str(tmp_path / "cross.net.xml")])  # for the fixture to close


def test_nobody_is_taken_before_that_or_onto_a_road_without_room(sumo):
    insert(BUS, CAR)
    sumo.route.add("south", ["cs"])
    for k, lane in enumerate("01"):
        sumo.vehicle.add(f"there{k}", "south", departLane=lane, departPos="10")
    sumo.simulationStep()
    for k in range(2):
        sumo.vehicle.setSpeed(f"there{k}", 0.0)
    swaps = LaneSwaps(sumo)
    drive(29.0, swaps)
    assert sumo.vehicle.getRoadID("bus") == sumo.vehicle.getRoadID("car") == "wc"
    drive(10.0, swaps)
    assert sumo.vehicle.getRoadID("bus") == "cn"  # there was room for the longer one only


@pytest.mark.parametrize(("route", "lane", "place"), [("right", 0, ENDS), ("left", 1, ENDS), ("left", 0, 150.0)])
def test_one_that_need_not_swap_or_is_not_at_the_end_stays(sumo, route, lane, place):
    insert(("bus", "bus", route, lane, place), ("car", "DEFAULT_VEHTYPE", "right", 1 - lane, ENDS))
    for name in ("bus", "car"):
        sumo.vehicle.setSpeed(name, 0.0)
    drive(40.0, LaneSwaps(sumo))
    assert {sumo.vehicle.getRoadID(name) for name in ("bus", "car")} == {"wc"}


def test_an_obstacle_stays(sumo):
    insert(BUS, CAR)
    drive(40.0, LaneSwaps(sumo), obstacles={"bus"})
    assert {sumo.vehicle.getRoadID(name) for name in ("bus", "car")} == {"wc"}


def test_one_that_could_drive_on_stays(sumo, monkeypatch):
    """SUMO may want it on another lane for the sake of a junction farther on."""
    sumo.route.add("straight", ["wc", "ce"])
    insert(("bus", "bus", "straight", 0, ENDS), CAR)
    for name in ("bus", "car"):
        sumo.vehicle.setSpeed(name, 0.0)
    plans = {"bus": ("wc_0", 190.0, 0.0, 1, True, ()), "car": ("wc_1", 190.0, 0.0, -1, True, ())}
    monkeypatch.setattr(sumo.vehicle, "getBestLanes", lambda name: (plans[name],))
    drive(40.0, LaneSwaps(sumo))
    assert {sumo.vehicle.getRoadID(name) for name in ("bus", "car")} == {"wc"}


@pytest.mark.parametrize("wants", ["wc_0", "wc_1", ""])
def test_a_member_beside_stays_and_sumos_one_is_taken(sumo, wants):
    """If the member wants the lane of the other one."""
    insert(BUS, ("member", "DEFAULT_VEHTYPE", "right", 1, ENDS - 10.0))
    for name in ("bus", "member"):
        sumo.vehicle.setSpeed(name, 0.0)
    wanted = {"member": Wanted(wants, 5.0, False)} if wants else {}
    drive(40.0, LaneSwaps(sumo), {"member": ("wc", "wc_1")}, wanted)
    assert (sumo.vehicle.getRoadID("bus") == "wc") == (wants != "wc_0")
    assert sumo.vehicle.getRoadID("member") == "wc"
