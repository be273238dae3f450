"""Vehicles of SUMO's that stand first on their lanes, and must go over to a lane of members."""

from __future__ import annotations

from types import SimpleNamespace

import libsumo
import pytest

from platoontraffic.sumo.first_on_lanes import EVERY, FirstOnLanes
from platoontraffic.sumo.letting_in import AFTER, LettingIn
from platoontraffic.sumo.reads import PLAN_LANE, PLAN_LEADS_ON, PLAN_OFFSET
from tests.support.generated import lane_that_ends

MEMBERS = {"m": ("road", "road_1"), "inside": (":j_0", ":j_0_0"), "off the road": ("road", "")}


class Road:
    """Three lanes of 100 m; a bus on the right lane, members on the middle one."""

    def __init__(
        self,
        speed: float = 0.0,
        to_end: float = 5.0,
        to_left: int = 1,
        waited: float = 10.0,
        stopped: bool = False,
        leads_on: bool = False,
        urgent: bool = True,
    ) -> None:
        place, self.time = {"bus": 100.0 - to_end, "m": 40.0, "m2": 70.0}, 0.0
        lanes = {"road_0": ["bus"], "road_1": ["m", "m2"], "road_2": []}
        self.lane_of = {name: lane for lane, names in lanes.items() for name in names}
        length = {"bus": 12.0}
        self.client = SimpleNamespace(
            TraCIException=KeyError,
            simulation=SimpleNamespace(getTime=lambda: self.time),
            edge=SimpleNamespace(getLaneNumber=lambda _: 3),
            lane=SimpleNamespace(getLength=lambda _: 100.0, getLastStepVehicleIDs=lanes.__getitem__),
            vehicle=SimpleNamespace(
                getSpeed=lambda name: speed if name == "bus" else 8.0, isStopped=lambda _: stopped,
                getLanePosition=place.__getitem__, getLength=lambda name: length.get(name, 5.0),
                getBestLanes=lambda _: [("road_0", 100.0, 0.0, to_left, leads_on, ())],
                getLaneChangeState=lambda name, side: (256 if urgent and side == 1 else 0, 0),
                getWaitingTime=lambda _: waited, getRoadID=lambda name: "road" if name in self.lane_of else "",
                getLaneID=self.lane_of.__getitem__, getNextTLS=lambda _: (),
            ),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("road", "wants"),
    [
        (Road(), True),
        (Road(speed=2.0), False),
        (Road(to_end=54.0), True),
        (Road(stopped=True), False),
        (Road(to_left=0), False),
        (Road(to_left=-1), False),
        (Road(leads_on=True, urgent=False), False),  # it waits for its light, and goes on from this lane
        (Road(leads_on=True), True),
    ],
)
def test_a_vehicle_that_stands_first_on_its_lane_and_not_at_a_stop_wants_over(road, wants):
    found = FirstOnLanes(road.client).room_wanted((*MEMBERS, "not there yet"), MEMBERS, 0.0)
    assert list(found) == (["bus"] if wants else [])
    if wants:
        assert found["bus"].lane == "road_1"
        assert found["bus"].behind > 12.0
        assert not found["bus"].begun


@pytest.mark.sumo
@pytest.mark.parametrize(("length", "wants"), [(10.0, True), (1500.0, False)])
def test_sumo_says_whether_a_vehicle_whose_lane_leads_on_must_go_over_all_the_same(tmp_path, length, wants):
    """Its lane leads on for 10 m only: SUMO's driver may stop before that to get in."""
    libsumo.start(["sumo", "-n", str(lane_that_ends(tmp_path, length)), "--no-step-log", "--no-warnings"])
    try:
        vehicle = libsumo.vehicle
        libsumo.route.add("route", ["A", "B", "C"])
        vehicle.add("v", "route", departLane="0", departPos="-1", departSpeed="0")
        vehicle.add("m", "route", departLane="1", departPos="-3", departSpeed="0")
        for _ in range(3):
            libsumo.simulationStep()
            for name in "vm":
                vehicle.setSpeed(name, 0.0)
        plan = next(plan for plan in vehicle.getBestLanes("v") if plan[PLAN_LANE] == "A_0")
        assert (plan[PLAN_OFFSET], plan[PLAN_LEADS_ON]) == (1, True)
        found = FirstOnLanes(libsumo).room_wanted(["m"], {"m": ("A", "A_1")}, 0.0)
        assert list(found) == (["v"] if wants else [])
    finally:
        libsumo.close()


def test_a_member_at_the_end_of_its_lane_asks_by_itself():
    """By `StopLines.room_wanted`."""
    assert not FirstOnLanes(Road().client).room_wanted(MEMBERS, {**MEMBERS, "bus": ("road", "road_0")}, 0.0)


def test_ends_of_lanes_are_looked_at_once_a_second():
    road = Road()
    first = FirstOnLanes(road.client)
    assert first.room_wanted(MEMBERS, MEMBERS, 0.0)
    road.client.vehicle.getSpeed = lambda _: 3.0
    assert first.room_wanted(MEMBERS, MEMBERS, EVERY / 2)
    assert not first.room_wanted(MEMBERS, MEMBERS, EVERY)


@pytest.mark.parametrize("waited", [AFTER - 1.0, AFTER])
def test_the_first_member_that_can_stop_behind_it_lets_it_in(waited):
    """The one before it, 25 m from the front at 8 m/s, cannot. SUMO's own are left to SUMO."""
    road = Road(waited=waited)
    where = {"m": ("road", "road_1"), "m2": ("road", "road_1")}
    letting_in, first = LettingIn(road.client, 0.1), FirstOnLanes(road.client)
    wanted = first.room_wanted(where, where, 0.0)
    letting_in.observe(wanted, where)
    rear = 95.0 - (wanted["bus"].behind + 1.0)
    assert letting_in.stops == ({"m": ("road_1", pytest.approx(rear), 0.0)} if waited >= AFTER else {})
    only = {"m2": where["m2"]}  # the other one is SUMO's
    letting_in = LettingIn(road.client, 0.1)
    letting_in.observe(first.room_wanted(only, only, 0.0), only)
    assert not letting_in.waiting


@pytest.mark.parametrize("gone", [True, False])
def test_a_member_drives_on_once_the_vehicle_is_on_its_lane_or_gone(gone):
    road, where = Road(), {"m": ("road", "road_1")}
    letting_in, first = LettingIn(road.client, 0.1), FirstOnLanes(road.client)
    letting_in.observe(first.room_wanted(where, where, 0.0), where)
    assert letting_in.stops
    if gone:
        del road.lane_of["bus"]
    else:
        road.lane_of["bus"] = "road_1"
    letting_in.observe({}, where)
    assert not letting_in.stops
    assert not letting_in.waiting
