"""On which lane SUMO takes a member to be, inside a junction and where lanes overlap; and in which order on it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic import shipped
from platoontraffic.controllers.native import SumoDriver
from platoontraffic.controllers.path import PathLeader
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.netconvert import build_net
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.simulation import Simulation
from platoontraffic.sumo.placement import BEFORE_END, EXACTLY, ON_ITS_ROUTE, Placement
from platoontraffic.sumo.trips import Trips
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.world.fleet import Fleet
from tests.support.bench import platoon

CAR = CARS["car"]
NODES = """<nodes><node id="a" x="0" y="0"/><node id="b" x="200" y="0"/><node id="c" x="0" y="40"/>
<node id="d" x="200" y="40"/></nodes>"""
EDGES = """<edges><edge id="ab" from="a" to="b"><lane index="0" shape="0,{aside} 200,{aside}"/></edge>
<edge id="ba" from="b" to="a"><lane index="0" shape="200,0 0,0"/></edge><edge id="cd" from="c" to="d"/></edges>"""
CONFIGURATION = """<configuration><input><node-files value="n.nod.xml"/><edge-files value="n.edg.xml"/></input>
<processing><no-turnarounds value="true"/></processing></configuration>"""
SCENARIO = """
[sumo]
net = "n.net.xml"
[run]
step_s = 0.1
duration_s = 20
[[platoon]]
size = 1
vehicle = "car"
start = { edge = "ba", position_m = 10.0 }
route = ["ba"]
leader = { law = "path", lidar = "car-leader" }
"""
LINE = Line(50.0, "M", "", 0, "road_0", "next_0", (":a_0_0", ":a_9_0"), 20.0)
ROUTE = Route.along(("road", "next"), np.array([[0.0, 0.0], [200.0, 0.0]]), np.full(2, 10.0), [LINE])


def link(onto: str, via: str) -> tuple:
    return onto, True, True, False, via, "M", "s", 10.0


def network_of(edges):
    """What `Placement` asks a network, of edges with the lengths of their lanes."""
    return SimpleNamespace(left_hand=False, edges=edges, overlaps_another=lambda _: False)


@pytest.mark.sumo
@pytest.mark.parametrize("aside", [1.4, -1.2, 2.4, 3.2])
def test_a_member_stays_on_its_lane_where_lanes_of_two_directions_overlap(tmp_path, aside):
    """SUMO had it on the other one: cars that came there stopped before it, and none of the two could drive on."""
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    texts = {"n.nod.xml": NODES, "n.edg.xml": EDGES.format(aside=aside), "n.netccfg": CONFIGURATION}
    for name, text in (texts | {"s.toml": SCENARIO}).items():
        (tmp_path / name).write_text(text)
    build_net(tmp_path / "n.netccfg", tmp_path / "n.net.xml")
    network = Network.read(tmp_path / "n.net.xml")
    assert [network.overlaps_another(lane) for lane in ("ab_0", "ba_0")] == [abs(aside) < 2.6] * 2
    with Simulation.load(tmp_path / "s.toml") as simulation:
        lanes = {lane for now in simulation for _, lane in now.roads}
    assert lanes == {"ba_0"}


@pytest.mark.parametrize("name", ["lab_world", "lab_loop", "corridor", "highway"])
def test_lanes_side_by_side_do_not_overlap(name):
    network = Network.read(shipped.networks()[name])
    lanes = [f"{edge}_{k}" for edge, k, _ in network.lanes_for_cars()]
    assert lanes
    assert not any(map(network.overlaps_another, lanes))


@pytest.mark.parametrize(
    ("lanes", "bound", "bound_without_route"),
    [
        (["road_0", ":a_0_0", ":a_9_0", "next_0"], [1, 2], []),
        (["road_0", ":a_0_0", ":a_4_0", ":a_9_0", "next_0"], [1, 2, 3], []),
        (["road_0", ":a_3_0", ":a_9_0", "next_0"], [2], []),  # SUMO has given it a route along the other path first
        (["short_0", ":a_3_0", ":a_0_0", "next_0"], [0, 1, 2], [0]),
    ],
)
@pytest.mark.parametrize(("has_route", "aside"), [(True, 0.8), (False, 0.8), (True, -1.2)])
def test_a_member_on_its_path_inside_a_junction_is_kept_on_it(lanes, bound, bound_without_route, has_route, aside):
    """In Bologna one in 26 was on another one: the car behind did not see it, and drove into its rear."""
    moved, here = [], SimpleNamespace(lane="")
    client = SimpleNamespace(
        vehicle=SimpleNamespace(
            getLaneID=lambda _: here.lane, getRoadID=lambda _: here.lane.rpartition("_")[0],
            moveToXY=lambda *given: moved.append(given[-2:]), getLateralLanePosition=lambda _: aside,
            getVehicleClass=lambda _: "passenger",
        ),
        lane=SimpleNamespace(
            getLength=lambda lane: 3.0 if lane == "short_0" else 20.0, getLinks=lambda _: [link("next_0", ":a_0_0")],
            getAllowed=lambda _: (), getDisallowed=lambda _: (),
        ),
    )  # fmt: skip
    placement = Placement(client, network_of({"road": (3.2,)}), 0.1)
    placement._shadows = SimpleNamespace(observe=lambda *_: None, cast=lambda _: None)
    (member,) = platoon(PathLeader(), model=CAR)
    fleet = Fleet.deployed([replace(member, route=ROUTE if has_route else None)], 0.1)
    for here.lane in lanes:
        placement.locate(fleet)
        placement.place(fleet, None, {})
    assert [k for k, how in enumerate(moved) if how == ON_ITS_ROUTE] == (
        bound if has_route and abs(aside) < 1.0 else bound_without_route
    )
    assert {*moved} <= {ON_ITS_ROUTE, EXACTLY}


@pytest.mark.parametrize(("kind", "edge"), [("passenger", ":a_6"), ("taxi", ":a_4"), ("truck", "")])
def test_on_a_route_sumo_looks_for_a_vehicle_on_the_path_of_the_first_lane_that_leads_there(kind, edge):
    """Beside a bus lane a taxi was moved back to its line in every other step, until SUMO died of it."""
    links = {
        "road_0": [link("turn_0", ":a_5_0"), link("next_0", ":a_4_0")],
        "road_1": [link("next_1", ":a_6_0")],
        "road_2": [link("next_2", ":a_6_1")],
    }
    client = SimpleNamespace(
        vehicle=None,
        lane=SimpleNamespace(
            getLinks=links.__getitem__, getAllowed=lambda lane: ("bus", "taxi") if lane == ":a_4_0" else (),
            getDisallowed=lambda lane: ("truck",),
        ),
    )  # fmt: skip
    placement = Placement(client, network_of({"road": (3.2,) * 3}), 0.1)
    assert placement._edge_inside["road", "next", kind] == edge


def test_a_member_held_a_little_over_its_line_is_before_it_for_sumo():
    moved = []
    client = SimpleNamespace(
        vehicle=SimpleNamespace(moveToXY=lambda *given: moved.append(given), getLateralLanePosition=lambda _: 0.0)
    )
    placement = Placement(client, network_of({}), 0.1)
    placement._shadows = SimpleNamespace(cast=lambda _: None)
    (member,) = platoon(PathLeader(), model=CAR, at=(30.0, 0.0, np.pi / 2))
    fleet = Fleet.deployed([member], 0.1)
    placement._on_route.add(member.id)
    placement.where[member.id] = ":a_0", ":a_0_0"
    for over in ({}, {member.id: 0.4, "gone": 0.3}):
        placement.place(fleet, None, over)
    (_, _, _, x, y, angle, *_), (_, _, _, its_x, its_y, its_angle, *how) = moved
    assert (its_x, its_y, its_angle) == pytest.approx((x, y - 0.4 - BEFORE_END, angle))
    assert tuple(how) == EXACTLY


def test_a_member_that_was_set_back_before_its_line_enters_the_junction_once():
    """At yellow, and again at green: it counted as two, the second as one that failed to yield."""
    here = SimpleNamespace(lane="")
    vehicle = SimpleNamespace(
        getLaneID=lambda _: here.lane, getRoadID=lambda _: here.lane.rpartition("_")[0],
        moveToXY=lambda *_: None, getLateralLanePosition=lambda _: 0.0,
    )  # fmt: skip
    client = SimpleNamespace(vehicle=vehicle, lane=SimpleNamespace(getLength=lambda _: 50.0))
    placement = Placement(client, network_of({}), 0.1)
    placement._shadows = SimpleNamespace(cast=lambda _: None, observe=lambda *_: None)
    (member,) = platoon(PathLeader(), model=CAR)
    fleet, held = Fleet.deployed([member], 0.1), {member.id: 0.4}
    for here.lane, over_line in (
        ("road_0", {}), (":a_0_0", held), ("road_0", held), (":a_1_0", {}), ("next_0", {}),
        (":b_0_0", {}), ("road_0", {}), (":a_0_0", {}),
    ):  # fmt: skip
        placement.locate(fleet)
        placement.place(fleet, None, over_line)
    assert [entry[2] for entry in placement.entries()] == [":a_0_0", ":b_0_0", ":a_0_0"]


def test_a_route_that_comes_to_an_edge_twice_is_not_driven_from_its_first_visit_after_a_change_of_lanes():
    """Another route over the same edges began anew: other drivers then expected the member to turn."""
    told, here = [], SimpleNamespace(edge="A")
    vehicle = SimpleNamespace(
        getRoute=lambda _: (here.edge,), getRouteIndex=lambda _: 0, setRoute=lambda _, route: told.append(route)
    )
    client = SimpleNamespace(vehicle=vehicle, vehicletype=None, TraCIException=KeyError)
    placement = Placement(client, network_of(dict.fromkeys("ABCD", (3.2,))), 0.1)
    route, other = (type("Route", (), {"edges": ("A", "B", "C", "A", "D"), "closed": False}) for _ in range(2))
    for here.edge, driven in [*((edge, route) for edge in "ABCA"), ("A", other)]:
        placement.where["m"] = here.edge, f"{here.edge}_0"
        placement._is_settled(SimpleNamespace(id="m", route=driven))
    assert told[-2:] == [["A", "D"], ["A", "D"]]


def test_a_member_that_comes_to_an_edge_again_gets_its_route_again():
    """Where its path comes near the next edge before the junction, SUMO has it there for a step, and back in the
    junction with a route that ends on that edge. Others did not see it come, and one drove out before it."""
    here, told = SimpleNamespace(lane="", route=("A", "B", "C")), []
    vehicle = SimpleNamespace(
        getLaneID=lambda _: here.lane, getRoadID=lambda _: here.lane.rpartition("_")[0],
        getRoute=lambda _: here.route, getRouteIndex=lambda _: here.route.index(here.lane[0]),
        setRoute=lambda _, route: told.append(route), setPreviousSpeed=lambda *_: None,
    )  # fmt: skip
    client = SimpleNamespace(
        vehicle=vehicle, lane=SimpleNamespace(getLength=lambda _: 50.0), vehicletype=None, TraCIException=KeyError
    )
    placement = Placement(client, network_of(dict.fromkeys("ABC", (3.2,))), 0.1)
    placement._shadows = SimpleNamespace(observe=lambda *_: None)
    (member,) = platoon(PathLeader(), model=CAR)
    route = Route.along(("A", "B", "C"), np.array([(0.0, 0.0), (300.0, 0.0)]), np.full(2, 14.0))
    fleet = Fleet.deployed([replace(member, route=route)], 0.1)
    for here.lane, here.route in (
        ("A_0", ("A", "B", "C")), ("B_0", ("A", "B", "C")), (":a_0_0", ("A", "B")), ("B_0", ("A", "B")),
    ):  # fmt: skip
        placement.locate(fleet)
        placement.settle(fleet)
    assert told == [["A", "B", "C"], ["B", "C"], ["B", "C"]]


@pytest.mark.parametrize(
    ("ahead", "asked"),
    [
        (None, [0.0, 0.5, 1.0]),  # it is alone
        (100.0, [0.0, 0.5, 1.0]),
        (40.0, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),  # 10 m at 50 m/s
        (33.0, [0.1 * k for k in range(11)]),
    ],
)
def test_the_order_on_a_lane_is_looked_at_before_one_can_have_passed_another(ahead, asked):
    placement, here = _on_a_lane({"robot.0": 30.0} | ({"other": ahead} if ahead else {}))
    for k in range(11):
        here.time = 0.1 * k
        placement.put_in_order(here.fleet, here.time)
    assert here.asked == pytest.approx(asked)


def test_the_order_is_looked_at_when_a_member_comes_to_a_lane():
    placement, here = _on_a_lane({"robot.0": 30.0, "other": 100.0})
    for here.time, here.lane in ((0.0, "road_0"), (0.1, "road_0"), (0.2, "road_1"), (0.3, "road_0"), (0.4, "road_0")):
        placement.locate(here.fleet)
        placement.put_in_order(here.fleet, here.time)
    assert here.asked == [0.0, 0.2, 0.3]


def test_a_member_that_has_passed_another_one_enters_its_lane_again():
    placement, here = _on_a_lane({"robot.0": 50.0, "other": 40.0})
    for here.time in (0.0, 0.1, 0.2, 0.3):
        placement.put_in_order(here.fleet, here.time)
    assert here.moves == [("robot.0", "road_1", 0.0), ("robot.0", "road_0", 50.0)]
    assert here.asked == pytest.approx([0.0, 0.1, 0.3])  # 10 m apart at the second look


def _on_a_lane(positions: dict[str, float]) -> tuple[Placement, SimpleNamespace]:
    """A member on a lane, in the order that SUMO has; what is asked and told is noted."""
    (member,) = platoon(PathLeader(), model=CAR)
    fleet = Fleet.deployed([member], 0.1)
    here = SimpleNamespace(time=0.0, lane="road_0", order=list(positions), asked=[], moves=[], fleet=fleet)

    def order(lane: str) -> list[str]:
        here.asked.append(here.time)
        return here.order

    def move(*given) -> None:
        here.moves.append(given)
        here.order.sort(key=positions.__getitem__)

    vehicle = SimpleNamespace(
        getLanePosition=positions.__getitem__, moveTo=move, getLaneID=lambda _: here.lane,
        getRoadID=lambda _: here.lane.rpartition("_")[0],
    )  # fmt: skip
    client = SimpleNamespace(
        vehicle=vehicle, lane=SimpleNamespace(getLastStepVehicleIDs=order, getLength=lambda _: 200.0),
        edge=SimpleNamespace(getLaneNumber=lambda _: 2),
    )  # fmt: skip
    placement = Placement(client, network_of({"road": (3.2, 3.2)}), 0.1)
    placement._shadows = SimpleNamespace(observe=lambda *_: None, lost=lambda _: None)
    placement.locate(fleet)
    return placement, here


def test_only_members_that_sumo_does_not_drive_are_moved_and_given_their_speeds():
    moves, speeds = [], []
    vehicle = SimpleNamespace(
        moveToXY=lambda *given: moves.append(given), setPreviousSpeed=lambda *given: speeds.append(given),
        getLateralLanePosition=lambda _: 0.0,
    )  # fmt: skip
    client = SimpleNamespace(vehicle=vehicle, vehicletype=SimpleNamespace(setAccel=lambda *_: None))
    placement = Placement(client, network_of({"road": (3.2,)}), 0.1)
    members = platoon(SumoDriver(), PathLeader(), 2, model=CAR, speed=5.0)
    fleet = Fleet.deployed(members, 0.1)
    assert fleet.native.tolist() == [True, False, False]
    placement._settled_of = fleet.members
    placement.place(fleet, None, {})
    placement.settle(fleet)
    fronts = (fleet.motion.x + CAR.length / 2)[1:].tolist()
    assert [(name, x, y) for name, _, _, x, y, *_ in moves] == [
        (name, pytest.approx(x), pytest.approx(0.0)) for name, x in zip(fleet.ids[1:], fronts, strict=True)
    ]
    assert {given[1:3] + given[6:] for given in moves} == {("", -1, *EXACTLY)}
    assert speeds == [(name, 5.0) for name in fleet.ids[1:]]


def test_a_step_of_those_from_the_traffic_counts_on_their_own_lanes():
    """Among members that are not from the traffic; off all lanes there is no limit."""
    limit = {"slow_0": 5.0, "road_0": 10.0, "fast_0": 20.0}
    vehicle = SimpleNamespace(
        getDepartDelay=lambda _: 0.0, getCO2Emission=lambda _: 1e6, getFuelConsumption=lambda _: 3e5,
        getLaneID=lambda _: "",
    )  # fmt: skip
    client = SimpleNamespace(vehicle=vehicle, lane=SimpleNamespace(getMaxSpeed=limit.__getitem__))
    placement = SimpleNamespace(lanes=lambda _: ["slow_0", "road_0", "fast_0", ""])
    members = [replace(one, route=ROUTE) for one in platoon(PathLeader(), PathLeader(), 3, model=CAR, speed=5.0)]
    fleet, trips = Fleet.deployed(members, 0.1), Trips(client, placement, 0.1)
    trips.begin(fleet.without({fleet.ids[0]}), ["car"] * 3, {})
    trips.observe(fleet, 0.1)
    assert [one.time_loss for one in trips.rows()] == pytest.approx([0.1 * (1 - 5 / v) for v in (10, 20, np.inf)])
    assert [one.co2 for one in trips.rows()] == pytest.approx([0.1] * 3)
