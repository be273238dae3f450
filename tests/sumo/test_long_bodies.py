"""Vans and trucks at junctions: their bodies swing over paths that do not meet their own."""

from __future__ import annotations

from collections import defaultdict
from types import SimpleNamespace

import libsumo
import numpy as np
import pytest

from platoontraffic.geometry.polyline import left_of
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.shipped import networks
from platoontraffic.sumo.conflicts import LINK_ONTO, LINK_STATE, LINK_VIA, Conflicts, Crossing
from platoontraffic.sumo.conflicts import SWUNG as BESIDE
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.reads import Once, Reads
from platoontraffic.sumo.right_of_way import BEFORE_PATH, NEARLY_STANDS, SWINGS_OUT_LONGEST, RightOfWay
from platoontraffic.vehicles.bicycle import CARS
from tests.support.generated import generated

LINE = Line(100.0, "m", "", 0, "road_0", "next_0", (":a_0",), 20.0)
# Its body is over the path of others from 6 m before their line on until 2 m beyond it.
SWUNG = Crossing("side_0", (":a_1",), (8.0, 14.0), (-6.0, 2.0), False, False, np.inf, 10.0, 8.0, True)
TRUCK = Ego("m.0", "road_0", 1.0, CARS["truck"].length, kind="truck")


def way(*vehicles: tuple[str, float, float], state: str = "m", swung: Crossing = SWUNG) -> RightOfWay:
    """vehicles: name, distance to its line [m], speed [m/s]; the last one is the next at the line"""
    narrow = (swung,) if swung.swings else ()
    conflicts = Conflicts((), (), (), np.inf, narrow=narrow, swung_over=(swung,))
    found = RightOfWay(SimpleNamespace(simulation=SimpleNamespace(getTime=lambda: 9.0)), Reads(SimpleNamespace()),
                       {LINE: conflicts})  # fmt: skip
    inside = [name for name, to_line, _ in vehicles if to_line < 0]
    outside = [name for name, to_line, _ in vehicles if to_line >= 0]
    position = {name: -to_line if to_line < 0 else 100.0 - to_line for name, to_line, _ in vehicles}
    found._now = SimpleNamespace(
        on_lane=Once({":a_1": inside, "side_0": outside}.__getitem__), lane_length={":a_1": 20.0, "side_0": 100.0},
        max_speed={":a_0": 10.0}, position=position, speed={name: speed for name, _, speed in vehicles},
        acceleration=defaultdict(lambda: 2.6), length=defaultdict(lambda: 5.0), waited=defaultdict(float),
    )  # fmt: skip
    found._links_ahead = lambda *_: ((":a_1",), state)
    found._waited = lambda *_: 0.0
    found.members = frozenset({"m.0", "m.1"})
    return found


@pytest.mark.sumo
@pytest.mark.parametrize(("kind", "turns"), [("car", ""), ("van", "right"), ("truck", "left and right")])
def test_a_long_body_swings_over_the_oncoming_lane_in_turns(generated_nets, kind, turns):
    """In the right one over the queue before the line there, in the left one beyond that line as well.

    Those before the line stop half a length sooner: its front faces them.
    """
    network = Network.read(generated(generated_nets, "grid", "allway_stop"))
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        found = set()
        for link in libsumo.lane.getLinks("B0B1_0"):
            line = Line(0.0, link[LINK_STATE], "", 0, "B0B1_0", link[LINK_ONTO], (link[LINK_VIA],), 10.0, kind=kind)
            conflicts = Conflicts.at(line, network, libsumo)
            for one in (one for one in conflicts.swung_over if one.swings):
                before_line = one.its[0] < -CARS[kind].length / 2, one.its[1] < 0.5
                found.add((link[LINK_ONTO], one.before, *before_line))
    finally:
        libsumo.close()
    expected = {"right": ("B1C1_0", "C1B1_0", True, True), "left": ("B1A1_0", "A1B1_0", True, False)}
    assert found == {place for turn, place in expected.items() if turn in turns}


@pytest.mark.sumo
def test_at_the_exit_of_a_roundabout_a_body_swings_as_far_as_on_its_route_through_it():
    """The lane before the exit is 16 m long: from there on alone a truck was taken to swing 6 m less far."""
    network, truck = Network.read(networks()["corridor"]), CARS["truck"]
    libsumo.start(["sumo", "-n", str(network.path), "--no-step-log", "--no-warnings"])
    try:
        line = Line(0.0, "M", "", 0, "rn_rw_0", "rw_prio_0", (":rw_0_0",), 11.7, kind="truck")
        (crossing,) = Conflicts.at(line, network, libsumo).swung_over
    finally:
        libsumo.close()
    edges = ["re_rn", "rn_rw", "rw_prio"]
    route = Route.along(edges, *network.route_lanes(edges)).drivable_by(truck)
    begin = next(one.station for one in route.lines if one.lane == line.lane)
    axle = route.line.at(np.arange(begin, begin + 30.0, 0.1))
    left, front = left_of(axle), truck.length / 2 - truck.axle
    corner = axle + front * np.column_stack([left[:, 1], -left[:, 0]]) + truck.width / 2 * left
    # The oncoming lane leads east to its end, along y = -1.6 m; a car there is 1.8 m wide.
    near = corner[:, 0][corner[:, 1] < -1.6 + CARS["car"].width / 2 + BESIDE].min()
    end = network.lane_pose("prio_rw", 0, 312.97)[0]
    assert crossing.before == "prio_rw_0"
    assert crossing.its[0] <= near - end - truck.length / 2 + 0.3


@pytest.mark.parametrize(
    ("to_line", "speed", "distance", "stop"),
    [
        (20.0, 8.0, -1.0, 14.0 - BEFORE_PATH),  # the truck has begun to turn
        (20.0, 8.0, 3.0, 14.0 - BEFORE_PATH),  # and where it may enter
        (20.0, 8.0, -13.0, 14.0 - BEFORE_PATH),
        (20.0, 8.0, -15.0, None),  # its rear is past
        (14.0, 11.0, -1.0, None),  # it cannot stop any more
        (5.0, 0.0, -1.0, None),  # it is there
    ],
)
def test_a_car_stops_before_the_place_over_which_a_truck_swings(to_line, speed, distance, stop):
    """SUMO's driver does not see it: cars drove into the sides of trucks that turned."""
    turns = way(("c", to_line, speed))
    assert turns.note_swung_over(LINE, distance, TRUCK) == (distance >= -14.0)
    assert turns.stops == ({} if stop is None else {"c": pytest.approx(stop)})


@pytest.mark.parametrize(("waited", "told"), [(SWINGS_OUT_LONGEST, True), (SWINGS_OUT_LONGEST + 0.1, False)])
def test_one_that_stands_in_the_way_of_a_truck_goes_on_once_that_has_stood_for_long(waited, told):
    """A car stood before a truck that turned, and each waited for the other: for 570 s."""
    turns = way(("c", 9.0, 0.0))
    turns._now.waited[TRUCK.id] = waited
    assert turns.note_swung_over(LINE, -1.0, TRUCK)
    assert ("c" in turns.stops) == told


def test_all_of_a_queue_are_told_and_members_are_not():
    """A member is given its own line; of SUMO's cars behind one that cannot stop the next one must."""
    turns = way(("d", 15.0, 4.0), ("m.1", 9.0, 0.5), ("c", 1.0, 0.0))
    turns.note_swung_over(LINE, -1.0, TRUCK)
    assert turns.stops == {"d": pytest.approx(9.0 - BEFORE_PATH)}


@pytest.mark.parametrize(
    ("distance", "speed", "told"),
    [(3.0, 0.5, False), (-1.0, 0.5, True), (-1.0, 2 * NEARLY_STANDS, False), (-9.0, 2 * NEARLY_STANDS, True)],
)
def test_where_the_paths_meet_as_well_others_stop_once_the_body_is_there_or_they_creep(distance, speed, told):
    """A car that has priority elsewhere goes on, unless it creeps: one closed the way of a truck for good."""
    turns = way(("c", -1.0, speed), swung=SWUNG._replace(its=(4.0, 12.0), swings=False))
    turns.note_swung_over(LINE, distance, TRUCK)
    assert ("c" in turns.stops) == told


@pytest.mark.parametrize(
    ("vehicles", "state", "over", "waited", "stop"),
    [
        ([("c", 4.0, 0.0)], "m", -3.0, 0.0, 3.0),  # it stands there
        ([("c", 4.0, 0.0)], "m", -3.0, SWINGS_OUT_LONGEST + 1.0, np.inf),  # it has waited for long
        ([("c", 20.0, 8.0)], "m", -3.0, 0.0, np.inf),  # it will stop
        ([("c", 4.0, 0.0)], "r", -3.0, 0.0, np.inf),  # at a red light
        ([("c", 9.0, 6.0)], "w", -3.0, 0.0, 3.0),  # it comes to its line, and will stand there
        ([("c", 1.0, 0.0)], "w", 0.3, 0.0, 0.7),  # a little over its line it stops
        ([("c", 1.0, 0.0)], "w", 2.0, 0.0, np.inf),  # from there on it goes by what it sees
        ([("d", 9.0, 0.0), ("c", 1.0, 0.0)], "w", -3.0, 0.0, np.inf),  # both are clear of it
        ([("e", 9.0, 3.0), ("c", 1.0, 0.0)], "w", -3.0, 0.0, 3.0),  # it comes up to the queue
    ],
)
def test_a_truck_waits_at_its_line_for_those_that_are_where_its_body_will_swing(vehicles, state, over, waited, stop):
    """It entered, and stood head on with a car that waited for others, which waited for it."""
    is_queue = len(vehicles) > 1
    place = (-8.9, -6.2) if vehicles[0][0] == "d" else (-14.0, -8.0) if is_queue else SWUNG.its
    turns = way(*vehicles, state=state, swung=SWUNG._replace(its=place))
    turns._waited = lambda *_: waited
    assert turns.stop_before_foes(LINE, over, TRUCK) == pytest.approx(stop)
