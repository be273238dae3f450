"""Routes with a lane change later on its lane, compared with the routes that they are made of."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString

from platoontraffic import shipped
from platoontraffic.road.lane_routes import BETWEEN, CHANGING, Change, Line
from platoontraffic.road.later_change import (
    latest,
    longest_later,
    with_change_beyond,
    with_later_change,
    with_other_lane,
    with_sooner_change,
)
from platoontraffic.road.netconvert import build_net
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.vehicles.catalogue import VEHICLES
from tests.support import ODD_NETS

CAR = VEHICLES["car"]
CASES = {
    "first edge": ("highway", ("e1_e2", "e2_e_exit"), 1),
    "after a junction": ("highway", ("e0_e1", "e1_e2", "e2_e_exit"), 0),
    "on two edges": ("highway", ("e0_e1", "e1_e2", "e2_e_exit"), 1),
    "over two lanes": ("highway", ("e1_e2", "e2_e_exit"), 2),
    "towards a crossing": ("cross", ("west_in", "north_out"), 0),
}


def network_of(name: str) -> Network:
    return Network.read(shipped.networks().get(name, ODD_NETS / f"{name}.net.xml"))


def given(name: str) -> tuple[Network, Route, Line]:
    net, edges, lane = CASES[name]
    network = network_of(net)
    route = Route.along(edges, *network.route_lanes(edges, lane)).drivable_by(CAR)
    return network, route, next(line for line in route.lines if line.state == CHANGING)


def built(
    folder: Path, nodes: dict[str, tuple[int, int]], edges: dict[str, tuple[str, int]], links: list[tuple[str, str]]
) -> Network:
    """nodes: places [m]; edges: ends and number of lanes; links: from and to, an edge and an index each"""
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    texts = {
        "nod": ("nodes", [f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in nodes.items()]),
        "edg": ("edges", [f'<edge id="{name}" from="{one}" to="{two}" numLanes="{lanes}"/>'
                          for name, ((one, two), lanes) in edges.items()]),
        "con": ("connections", [f'<connection from="{one[0]}" to="{two[0]}" fromLane="{one[1]}" toLane="{two[1]}"/>'
                                for one, two in links]),
    }  # fmt: skip
    for kind, (name, lines) in texts.items():
        (folder / f"n.{kind}.xml").write_text(f"<{name}>{''.join(lines)}</{name}>")
    sources = '<node-files value="n.nod.xml"/><edge-files value="n.edg.xml"/><connection-files value="n.con.xml"/>'
    (folder / "n.netccfg").write_text(f"<configuration><input>{sources}</input></configuration>")
    build_net(folder / "n.netccfg", folder / "n.net.xml")
    return Network.read(folder / "n.net.xml")


def changes_of(route: Route, change: Line) -> list[Line]:
    """A lane change and those behind it on its edge."""
    return [one for one in route.lines if one.lane[:-2] == change.lane[:-2] and one.state == CHANGING]


@pytest.mark.parametrize("by", [10.0, 37.0])
@pytest.mark.parametrize("name", CASES)
def test_a_change_is_later_and_the_rest_of_the_route_stays(name, by):
    network, route, change = given(name)
    later = with_later_change(route, change, by, network, CAR)
    i = route.lines.index(change)
    moved = [new.station - old.station for new, old in zip(later.lines, route.lines, strict=True)]
    count, over = len(changes_of(route, change)), changes_of(route, change)[-1]
    assert moved == pytest.approx([0.0] * i + [by] * count + [0.0] * (len(moved) - i - count), abs=0.3)
    assert later.length == pytest.approx(route.length, abs=0.3)
    stations = np.concatenate(
        [np.linspace(0, change.station - 2 * CAR.length, 50),
         np.linspace(over.station + over.across + by + 6 * CAR.length, route.length, 50)]
    )  # fmt: skip
    there = later.line.at(np.minimum(stations, later.length))
    off = [abs(route.line.project(x, y, s, 5.0)[1]) for (x, y), s in zip(there, stations, strict=True)]
    assert max(off) < 0.05
    onto = [(line.lane, line.onto, line.state) for line in route.lines]
    assert [(line.lane, line.onto, line.state) for line in later.lines] == onto
    assert set(later.limit) == set(route.limit)


def test_the_line_is_made_anew_only_up_to_the_straight_beyond_the_change():
    network, route, change = given("towards a crossing")
    later = with_later_change(route, change, 10.0, network, CAR)
    in_the_turn = slice(-20, -1)
    np.testing.assert_array_equal(later.line.points[in_the_turn], route.line.points[in_the_turn])


def test_a_change_is_later_also_where_the_edge_before_has_more_room_for_it():
    """No later change was found there, so members stopped where theirs began, while others drove by for ever."""
    network, edges = network_of("highway"), ("e0_e1", "e1_e2", "e2_e_exit")
    late = LineString(network.route_line(edges[:1])).length - 20.0
    route = Route.along(edges, *network.route_lanes(edges, 1, position=late)).drivable_by(CAR)
    i, change = next((i, line) for i, line in enumerate(route.lines) if line.state == CHANGING)
    assert change.lane.startswith("e1_e2")
    for by in (16.0, change.to_end - 100.0):
        later = with_later_change(route, change, by, network, CAR)
        assert later.lines[i].station == pytest.approx(change.station + by, abs=0.3)
        assert later.lines[i][4:6] == change[4:6]


@pytest.mark.parametrize("by", [5.0, 16.0, 20.0])
@pytest.mark.parametrize("name", CASES)
def test_the_line_has_no_kink_where_it_is_joined_again_and_again(name, by):
    network, route, change = given(name)
    i = route.lines.index(change)
    sharpest = np.abs(route.curvature(1.0)[1]).max()
    for _ in range(3):
        route = with_later_change(route, route.lines[i], by, network, CAR)
        assert np.abs(route.curvature(1.0)[1]).max() < 1.1 * sharpest + 0.01


@pytest.mark.parametrize("name", CASES)
def test_a_change_is_over_before_its_lane_ends_and_is_then_made_no_later(name):
    network, route, change = given(name)
    last = with_later_change(route, change, 1e4, network, CAR)
    i, count = route.lines.index(change), len(changes_of(route, change))
    first, begun, junction = last.lines[i], last.lines[i + count - 1], last.lines[i + count]
    assert first.station > change.station
    assert begun.station + begun.across < junction.station - 5.0
    assert with_later_change(last, first, 10.0, network, CAR) is None


@pytest.mark.parametrize("left", [0.0, 7.0, 15.0])
@pytest.mark.parametrize("name", ["first edge", "over two lanes"])
def test_the_longest_change_that_fits_begins_where_it_is_to(name, left):
    """A longer one would begin earlier, and with it a member did not get another one."""
    network, route, change = given(name)
    width = network.lane_width("e1_e2", 0)
    by = latest(route, change, width, CAR.length) - left
    longest = longest_later(route, change, by, width, CAR.length)
    later = with_later_change(route, change, by, network, CAR, longest)
    new = changes_of(later, change)
    assert new[0].station - change.station == pytest.approx(by, abs=0.3)
    assert new[-1].station + new[-1].across - change.station < change.to_end - CAR.length + 0.5
    longer = with_later_change(route, change, by, network, CAR, longest + 2 * width)
    assert changes_of(longer, change)[0].station < new[0].station - width


def test_a_change_made_later_in_two_steps_is_where_one_step_brings_it():
    network, route, change = given("after a junction")
    once = with_later_change(route, change, 30.0, network, CAR)
    first = with_later_change(route, change, 15.0, network, CAR)
    twice = with_later_change(first, first.lines[route.lines.index(change)], 15.0, network, CAR)
    stations = np.linspace(0, once.length, 300)
    np.testing.assert_allclose(once.line.at(stations), twice.line.at(stations), atol=0.1)


@pytest.mark.parametrize("name", CASES)
def test_a_slow_vehicle_changes_lanes_in_less_road_and_later(name):
    network, route, change = given(name)
    i, lanes = route.lines.index(change), len(changes_of(route, change))
    shorter = with_later_change(route, change, 0.0, network, CAR, 20.0)
    assert shorter.lines[i].across == pytest.approx(20.0, rel=0.05)
    assert shorter.lines[i].station == pytest.approx(change.station, abs=0.3)
    assert with_later_change(route, change, 0.0, network, CAR, 35.0) is None  # not worth another route
    last = with_later_change(route, change, 1e4, network, CAR)
    later = with_later_change(route, change, 1e4, network, CAR, 1.0)
    assert later.lines[i].across == pytest.approx(16.0, rel=0.05)  # no change is shorter
    assert later.lines[i].station - last.lines[i].station == pytest.approx(22.4 * lanes, rel=0.05)
    last_one, junction = later.lines[i + lanes - 1 : i + lanes + 1]
    assert last_one.station + last_one.across < junction.station


@pytest.mark.parametrize("by", [0.5, 10.0])
@pytest.mark.parametrize("name", CASES)
def test_in_a_queue_a_change_is_made_sooner_and_in_the_least_road(name, by):
    network, route, change = given(name)
    i, changes = route.lines.index(change), changes_of(route, change)
    sooner = with_sooner_change(route, change, by, network, CAR)
    assert sooner.lines[i].station == pytest.approx(change.station - by, abs=0.4)
    found = changes_of(sooner, sooner.lines[i])
    assert [line.across for line in found] == pytest.approx([16.0] * len(changes), rel=0.05)
    stations = np.linspace(0, change.station - by - 2 * CAR.length, 50)
    assert sooner.line.at(stations) == pytest.approx(route.line.at(stations), abs=0.05)
    assert [line[4:6] for line in sooner.lines] == [line[4:6] for line in route.lines]


@pytest.mark.parametrize("by", [0.1, 11.0, 16.0, 1e3])
def test_a_change_is_not_made_near_the_begin_of_its_edge(by):
    """Nor where it begins only a little sooner."""
    network, route, change = given("after a junction")
    assert (with_sooner_change(route, change, by, network, CAR) is None) == (by > 10.5)


def test_a_second_change_is_not_made_before_the_car_is_straight_between_the_two():
    """Its line would begin on the lane between, where the car is still going over to it."""
    network, route, first = given("over two lanes")
    second = next(line for line in route.lines if line.state == CHANGING and line.lane == "e1_e2_1")
    straight = second.station - first.station - first.across - BETWEEN * network.lane_width("e1_e2", 1)
    assert with_sooner_change(route, second, straight + 1.0, network, CAR) is None
    assert with_sooner_change(route, first, 5.0, network, CAR) is not None


@pytest.mark.parametrize("longest", [np.inf, 1.0])
def test_a_car_that_waits_between_two_changes_stands_within_its_lane(longest):
    """Askew on the lane between, with its rear on the one before, it was touched by those that passed there."""
    network, route, first = given("over two lanes")
    route = with_later_change(route, first, 0.0, network, CAR, longest) or route
    second = next(line for line in route.lines if line.state == CHANGING and line.lane == "e1_e2_1")
    lane = LineString(network.route_line(("e1_e2",), 1))
    body = route.line.at(np.linspace(second.station - 1.0 - CAR.length, second.station - 1.0, 9))
    off = max(lane.distance(point) for point in shapely.points(body))
    assert off + CAR.width / 2 < network.lane_width("e1_e2", 1) / 2


def test_a_lane_between_that_is_not_for_cars_is_crossed_in_one_change(tmp_path):
    """It was a change onto that lane, and the run ended where there was no room beyond it."""
    text = shipped.networks()["highway"].read_text(encoding="utf-8")
    file = tmp_path / "bus.net.xml"
    file.write_text(re.sub('(<lane id="e1_e2_1" [^>]*?)(disallow="[^"]*" )?', r'\1allow="bus" ', text, count=1))
    network, edges = Network.read(file), ("e1_e2", "e2_e_exit")
    route = Route.along(edges, *network.route_lanes(edges, 2)).drivable_by(CAR)
    (change, _) = route.lines
    assert (change.lane, change.onto) == ("e1_e2_2", "e1_e2_0")
    *_, first = given("over two lanes")
    assert change.across == pytest.approx(2 * first.across)
    assert change.aside == pytest.approx(2 * first.aside)
    later = with_later_change(route, change, 30.0, network, CAR)
    assert later.lines[0].station == pytest.approx(change.station + 30.0, abs=0.3)
    assert later.lines[0][4:6] == change[4:6]


@pytest.mark.parametrize("edges", [("e1_e2", "e2_e_exit"), ("e0_e1", "e1_e2", "e2_e_exit")])
def test_the_second_of_two_changes_is_made_later_on_the_lane_between(edges):
    network = network_of("highway")
    late = LineString(network.route_line(edges[:1])).length - 20.0 if len(edges) > 2 else 0.0
    route = Route.along(edges, *network.route_lanes(edges, len(edges) % 2 or 2, position=late)).drivable_by(CAR)
    i = next(i for i, line in enumerate(route.lines) if line.lane == "e1_e2_1" and line.state == CHANGING)
    first, second = route.lines[i - 1 : i + 1]
    later = with_later_change(route, second, 30.0, network, CAR)
    assert later.lines[:i] == route.lines[:i]
    assert first.state == CHANGING
    assert later.lines[i].station == pytest.approx(second.station + 30.0, abs=0.3)
    lane = LineString(network.route_line(("e1_e2",), 1))
    between = later.line.at(np.linspace(second.station + 3 * CAR.length, later.lines[i].station - 10.0, 5))
    assert max(lane.distance(point) for point in shapely.points(between)) < 0.3
    assert len(later.lines) == len(route.lines)


def test_a_change_is_put_off_to_the_next_edge_where_the_lane_leads_on():
    network, edges = network_of("highway"), ("e0_e1", "e1_e2", "e2_e_exit")
    route = Route.along(edges, *network.route_lanes(edges, 1)).drivable_by(CAR)
    change = route.lines[0]
    beyond = with_change_beyond(route, change, network, CAR)
    lanes = [(line.lane, line.onto) for line in beyond.lines]
    assert lanes == [("e0_e1_1", "e1_e2_2"), ("e1_e2_2", "e1_e2_1"), ("e1_e2_1", "e1_e2_0"), ("e1_e2_0", "e2_e_exit_0")]
    assert beyond.length == pytest.approx(route.length, abs=0.3)
    before, after = np.linspace(0, change.station - 2 * CAR.length, 9), np.linspace(1500.0, route.length, 9)
    for stations in (before, after):
        np.testing.assert_allclose(beyond.line.at(stations), route.line.at(stations), atol=0.1)
    assert np.abs(beyond.curvature(1.0)[1]).max() < np.abs(route.curvature(1.0)[1]).max() + 0.01
    assert beyond.edges == route.edges


def test_a_route_with_its_change_beyond_may_end_on_another_lane(tmp_path):
    """It led along the end of the given route all the same, two lanes aside, where no line of it is the same."""
    nodes = {"a": (0, 0), "b": (300, 0), "c": (600, 0), "d": (900, 0), "e": (900, 300)}
    edges = {"A": ("ab", 2), "B": ("bc", 3), "C": ("cd", 3), "D": ("ce", 1)}
    network = built(tmp_path, nodes, edges, [("A0", "B1"), ("A1", "B2"), ("B0", "C0"), ("B2", "C2"), ("B1", "D0")])
    route = Route.along("ABC", *network.route_lanes("ABC", 0)).drivable_by(CAR)
    beyond = with_change_beyond(route, route.lines[0], network, CAR)
    assert route.lines[-1].onto != beyond.lines[-1].onto
    end = LineString(network.route_line(("C",), int(beyond.lines[-1].onto[-1])))
    assert shapely.Point(beyond.line.at(np.array([beyond.length]))[0]).distance(end) < 0.1
    assert np.abs(beyond.curvature(CAR.length)[1]).max() < 0.05


@pytest.mark.parametrize("length", [80, 90, 105])
def test_with_the_second_of_two_changes_beyond_the_line_can_be_driven_as_fast(tmp_path, length):
    """It began on the lane between, as if the first change had not been: with a kink, good for 4 to 7 m/s."""
    nodes = {"o": (-200, 0), "a": (0, 0), "b": (length, 0), "c": (500, 0), "d": (500, 300)}
    edges = {"O": ("oa", 3), "A": ("ab", 3), "B": ("bc", 3), "C": ("cd", 1)}
    straight = [(f"{one}{k}", f"{two}{k}") for one, two in ("OA", "AB") for k in range(3)]
    network = built(tmp_path, nodes, edges, [*straight, ("B2", "C0")])
    route = Route.along("OABC", *network.route_lanes("OABC", 0, position=190.0)).drivable_by(CAR)
    first, second = (line for line in route.lines if line.state == CHANGING)
    beyond = with_change_beyond(route, second, network, CAR)
    assert [line.lane for line in beyond.lines if line.state == CHANGING] == [first.lane, "B_1"]
    stations, curvature = beyond.curvature(1.0)
    on_edge = (stations > 200.0) & (stations < 200.0 + length)
    fastest = CAR.curvature_rate / np.abs(np.gradient(curvature, stations)[on_edge]).max()
    assert fastest > 10.0


def test_on_an_edge_shorter_than_its_changes_one_is_put_off_as_well(tmp_path):
    """The run ended with an unexpected ValueError: the second change seemed to begin before the edge."""
    nodes = {"a": (0, 0), "b": (5, 0), "c": (500, 0), "d": (500, 300)}
    edges = {"A": ("ab", 4), "B": ("bc", 4), "C": ("cd", 1)}
    network = built(tmp_path, nodes, edges, [*((f"A{k}", f"B{k}") for k in range(4)), ("B3", "C0")])
    route = Route.along("ABC", *network.route_lanes("ABC", 0, change=Change(0, 0, 3))).drivable_by(CAR)
    changes = [line for line in route.lines if line.state == CHANGING]
    assert changes[-1].to_end > LineString(network.route_line(("A",), 2)).length
    for k, change in enumerate(changes):
        beyond = with_change_beyond(route, change, network, CAR)
        assert [line.lane for line in beyond.lines if line.state == CHANGING][k] == f"B_{k}"
        assert np.isfinite(beyond.line.points).all()


@pytest.mark.parametrize("name", ["first edge", "after a junction", "towards a crossing"])
def test_a_change_stays_where_its_lane_does_not_lead_on(name):
    network, route, change = given(name)
    assert with_change_beyond(route, change, network, CAR) is None


def test_a_change_is_put_off_to_an_edge_with_enough_room_only(monkeypatch):
    network, edges = network_of("highway"), ("e0_e1", "e1_e2", "e2_e_exit")
    route = Route.along(edges, *network.route_lanes(edges, 1)).drivable_by(CAR)
    monkeypatch.setattr("platoontraffic.road.later_change.ENOUGH_ROOM", 300.0)  # there are 229 m
    assert with_change_beyond(route, route.lines[0], network, CAR) is None


@pytest.mark.parametrize(("length", "is_put_off"), [(70, True), (50, False)])
def test_a_change_is_put_off_to_an_edge_with_as_much_room_for_each_lane_that_is_crossed(tmp_path, length, is_put_off):
    """In a city one put a change off to 24 m before a queue, with two lanes to cross there: it stood for 93 s."""
    nodes = {"o": (-200, 0), "a": (0, 0), "b": (30, 0), "c": (30 + length, 0), "d": (500, 0)}
    edges = {"O": ("oa", 2), "A": ("ab", 2), "B": ("bc", 3), "C": ("cd", 1)}
    network = built(tmp_path, nodes, edges, [("O0", "A0"), ("O1", "A1"), ("A0", "B0"), ("A1", "B2"), ("B2", "C0")])
    route = Route.along("OABC", *network.route_lanes("OABC", 0, change=Change(1, 0, 1))).drivable_by(CAR)
    (change,) = (line for line in route.lines if line.state == CHANGING)
    assert (change.lane, change.onto) == ("A_0", "A_1")
    assert (with_change_beyond(route, change, network, CAR) is not None) is is_put_off


@pytest.mark.parametrize(("lane", "onto", "side"), [(0, 1, 1), (1, 0, -1)])
def test_another_lane_is_taken_at_once_and_kept_until_the_end_of_the_edge(lane, onto, side):
    network, edges = network_of("highway"), ("e0_e1", "e1_e2", "e2_e3")
    route = Route.along(edges, *network.route_lanes(edges, lane)).drivable_by(CAR)
    other = with_other_lane(route, 60.0, onto, network, CAR, 40.0)
    change, end = other.lines[:2]
    assert (change.state, change.lane, change.onto) == (CHANGING, f"e0_e1_{lane}", f"e0_e1_{onto}")
    assert change.station == pytest.approx(60.0, abs=0.5)
    assert change.across == pytest.approx(38.4, abs=0.5)  # as long as there is room for, if no shorter one is wanted
    assert end.lane == f"e0_e1_{onto}"
    stations = np.linspace(0.0, 60.0 - 2.5 * CAR.length, 20)
    np.testing.assert_allclose(other.line.at(stations), route.line.at(stations), atol=1e-3)
    for beyond in (change.station + change.across + CAR.length, end.station):
        x, y = other.line.at(np.array([beyond]))[0]
        assert route.line.project(x, y, beyond, 20.0)[1] == pytest.approx(side * 3.2, abs=0.1)


def test_a_lane_that_leads_on_is_kept_where_the_route_would_leave_it():
    network, edges = network_of("highway"), ("e0_e1", "e1_e2", "e2_e_exit")
    route = Route.along(edges, *network.route_lanes(edges, 1, position=60.0)).drivable_by(CAR)
    assert (route.lines[0].state, route.lines[1].lane) == (CHANGING, "e0_e1_0")
    kept = with_other_lane(route, 40.0, 1, network, CAR)
    assert [(line.state == CHANGING, line.lane) for line in kept.lines] == [
        (False, "e0_e1_1"), (True, "e1_e2_2"), (True, "e1_e2_1"), (False, "e1_e2_0")
    ]  # fmt: skip
    assert kept.length == pytest.approx(route.length, abs=0.5)


@pytest.mark.parametrize("share", [0.2, 0.6])
@pytest.mark.parametrize("edge", [0, 1])
def test_a_route_that_leaves_the_edge_from_that_lane_is_kept(edge, share):
    """A run of a city ended with an IndexError: the lane had become better that one behind the first had anyway."""
    network, edges = network_of("grid"), ("A2_B2", "B2_C2", "C2_D2", "D2_E2")
    route = Route.along(edges, *network.route_lanes(edges, 0)).drivable_by(CAR)
    first, second = route.lines[:2]
    begin, end = ((0.0, first), (first.station + first.across, second))[edge]
    station = begin + share * (end.station - begin)
    assert with_other_lane(route, station, int(end.lane[-1]), network, CAR) is route


@pytest.mark.parametrize(
    ("edges", "lane", "station", "onto"),
    [
        (("e1_e2", "e2_e3"), 1, 60.0, 0),  # from the exit lane it does not lead on
        (("e1_e2", "e2_e3"), 1, 230.0, 2),  # there is no room for the change before the end
        (("e1_e2", "e2_e3"), 1, 2.0, 2),  # its line would bend too sharply
        (("e2_e3",), 0, 60.0, 1),  # the route ends on this edge
    ],
)
def test_another_lane_is_not_taken_where_that_is_not_possible(edges, lane, station, onto):
    network = network_of("highway")
    route = Route.along(edges, *network.route_lanes(edges, lane)).drivable_by(CAR)
    assert with_other_lane(route, station, onto, network, CAR) is None


def test_a_lane_may_be_left_again_and_that_change_put_off():
    network, edges = network_of("highway"), ("e0_e1", "e1_e2", "e2_e3")
    route = Route.along(edges, *network.route_lanes(edges, 0)).drivable_by(CAR)
    there_and_back = with_other_lane(with_other_lane(route, 60.0, 1, network, CAR), 200.0, 0, network, CAR)
    first, back, end = there_and_back.lines[:3]
    assert [(line.lane[-1], line.onto[-1]) for line in (first, back)] == [("0", "1"), ("1", "0")]
    assert end.lane == "e0_e1_0"
    later = with_later_change(there_and_back, back, 50.0, network, CAR)
    assert later.lines[1].station == pytest.approx(back.station + 50.0, abs=0.3)
    # If it does not make the first one in time, it makes that one later, and stays on the other lane.
    assert longest_later(there_and_back, first, 50.0, 3.2, CAR.length) > 16.0
    later = with_later_change(there_and_back, first, 50.0, network, CAR)
    assert [line.onto for line in later.lines[:2]] == ["e0_e1_1", "e1_e2_2"]
