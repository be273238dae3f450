"""Routes of many vehicles compared with one line at a time, and routes along the lanes of networks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from platoontraffic import shipped
from platoontraffic.errors import InputError
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.road.network import Network
from platoontraffic.road.route import REACH, Route, Routes
from tests.support import ODD_NETS

NETS = ODD_NETS
RIGHT, MIDDLE, LEFT = 0, 1, 2  # lanes

seeds = st.integers(0, 2**32 - 1)


def route(points, limit=20.0, closed=False, lines=()) -> Route:
    points = np.asarray(points, dtype=float)
    return Route.along(("road",), points, np.broadcast_to(limit, len(points)), lines, closed)


def circle(radius: float, sign: int = 1, points: int = 720) -> Route:
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    return route(radius * np.column_stack([np.sin(angle), sign * (1 - np.cos(angle))]), closed=True)


def some_routes(rng: np.random.Generator, n: int) -> tuple[list[Route], np.ndarray]:
    """Random routes, open and closed, some of them shared by several vehicles; and the vehicles' lengths."""
    kinds = [
        route(rng.normal(0, 40, (k, 2)), rng.uniform(5, 30, k), closed)
        for k, closed in zip(rng.integers(3, 12, 4), (True, False, True, False), strict=True)
    ]
    return [kinds[i] for i in rng.integers(0, 4, n)], rng.choice([0.2, 4.74, 9.2], n)


def beside(rng: np.random.Generator, routes: list[Route], station: np.ndarray) -> np.ndarray:
    """Points some metres beside the routes, where no two pieces are equally near, (n, 2)."""
    on = np.array([r.line.at(np.array([s]))[0] for r, s in zip(routes, station, strict=True)])
    return on + rng.normal(0, 2, (len(routes), 2))


# ---- stations


@given(seeds)
@example(5643)
@settings(max_examples=50, deadline=None)
def test_all_rows_project_as_onto_one_line_each(seed):
    rng = np.random.default_rng(seed)
    routes, length = some_routes(rng, 12)
    station = rng.uniform(0, 1, 12) * [r.length for r in routes]
    window = rng.uniform(1, 60, 12)
    x, y = beside(rng, routes, station).T
    found = Routes(routes, length).project(x, y, station, window)
    expected = [r.line.project(*row, w)[0] for r, *row, w in zip(routes, x, y, station, window, strict=True)]
    # On closed routes, stations one lap apart are the same place.
    turn = np.array([r.length if r.closed else np.inf for r in routes])
    off = np.abs(found - expected)
    np.testing.assert_allclose(np.minimum(off, np.abs(off - turn)), 0, atol=1e-7)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_without_a_window_the_nearest_of_all_points_is_found(seed):
    rng = np.random.default_rng(seed)
    routes, length = some_routes(rng, 8)
    station = rng.uniform(0, 1, 8) * [r.length for r in routes]
    x, y = beside(rng, routes, station).T
    found = Routes(routes, length).project(x, y, station, np.full(8, np.inf))
    for r, s, a, b in zip(routes, found, x, y, strict=True):
        everywhere = r.line.at(np.linspace(0, r.line.stations[-1], 5000))
        nearest = np.hypot(*(everywhere - (a, b)).T).min()
        assert np.hypot(*(r.line.at(np.array([s]))[0] - (a, b))) <= nearest + 1e-9


@pytest.mark.parametrize("passed", [-0.4, -1e-9, 0.0, 1e-9, 0.4])
def test_stations_continue_across_the_seam_of_a_closed_route(passed):
    ring = circle(50.0)
    angle = passed / 50.0
    x, y = np.array([[50 * np.sin(angle)], [50 * (1 - np.cos(angle))]])
    found = Routes([ring], np.array([4.0])).project(x, y, np.array([ring.length - 0.5]), np.array([20.0]))
    assert found[0] % ring.length == pytest.approx(passed % ring.length, abs=1e-3) or passed == 0.0
    assert (found[0] + 1) % ring.length == pytest.approx(1 + passed, abs=1e-3)


def test_the_window_keeps_a_vehicle_on_its_leg_where_a_route_returns_beside_itself():
    there_and_back = route([(0, 0), (100, 0), (100, 1), (0, 1)])
    at, near = np.array([50.0, 50.0]), np.array([49.0, 150.0])
    found = Routes([there_and_back] * 2, np.full(2, 4.0)).project(at, np.full(2, 0.5), near, np.full(2, 20.0))
    np.testing.assert_allclose(found, [50.0, 151.0])


def test_the_distance_left_is_finite_on_open_routes_only():
    routes = [route([(0, 0), (30, 40)]), circle(10.0)]
    np.testing.assert_allclose(Routes(routes, np.full(2, 4.0)).left(np.array([20.0, 20.0])), [30.0, np.inf])


def test_routes_that_are_known_are_laid_out_once_and_those_that_have_gone_are_dropped():
    rng = np.random.default_rng(5)
    routes, pose = [circle(20.0 + i) for i in range(6)], (np.zeros(1), *rng.normal(0, 5, (3, 1)))
    found = Routes(routes[:1], np.array([4.0]))
    for i, one in enumerate(routes[1:]):
        found = Routes([routes[i], one], np.full(2, 4.0), found)
        assert len(found._layout.places) <= 4
        known, anew = (
            r.ahead(*(np.repeat(v, 2) for v in pose)) for r in (found, Routes(routes[i : i + 2], np.full(2, 4.0)))
        )
        for values, expected in zip(known, anew, strict=True):
            np.testing.assert_array_equal(values, expected)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_one_route_in_place_of_another_is_as_if_all_were_given_anew(seed):
    rng = np.random.default_rng(seed)
    (routes, length), (others, _) = some_routes(rng, 6), some_routes(rng, 12)
    found = Routes(routes, length)
    for other in [*others, *routes]:  # some of them new, some of them another vehicle's
        k = int(rng.integers(6))
        routes[k], found = other, found.with_one(k, other)
        assert len(found._layout.places) <= 12
        anew = Routes(routes, length)
        station, (x, y) = rng.uniform(0, 1, 6) * [r.length for r in routes], rng.normal(0, 40, (2, 6))
        place = x, y, station, np.full(6, 20.0)
        np.testing.assert_array_equal(found.project(*place), anew.project(*place))
        np.testing.assert_array_equal(found.left(station), anew.left(station))
        for values, expected in zip(found.ahead(station, x, y, x), anew.ahead(station, x, y, x), strict=True):
            np.testing.assert_array_equal(values, expected)


# ---- the road ahead


@given(seeds)
@settings(max_examples=30, deadline=None)
@example(3)
def test_the_road_ahead_ends_where_it_is_not_needed_any_more(seed):
    rng = np.random.default_rng(seed)
    routes, length = some_routes(rng, 6)
    pose = rng.uniform(0, 1, 6) * [r.length for r in routes], *rng.normal(0, 40, (2, 6)), rng.uniform(-3, 3, 6)
    whole, reach = Routes(routes, length).ahead(*pose), rng.uniform(0, 60 * length.max())
    part = Routes(routes, length).ahead(*pose, reach=reach)
    for values, expected in zip(part, whole, strict=True):
        np.testing.assert_array_equal(values, expected[:, : values.shape[1]])
    assert (part.distance[:, -1] >= np.minimum(reach, whole.distance[:, -1])).all()
    assert part.distance.shape[1] < 3 or part.distance[:, -2].min() < reach


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_points_and_limits_ahead_agree_with_those_of_each_vehicle_alone(seed):
    rng = np.random.default_rng(seed)
    n = 6
    routes, length = some_routes(rng, n)
    station, (x, y) = rng.uniform(0, 1, n) * [r.length for r in routes], rng.normal(0, 40, (2, n))
    heading = rng.uniform(-np.pi, np.pi, n)
    ahead = Routes(routes, length).ahead(station, x, y, heading)
    for i, r in enumerate(routes):
        there = station[i] + REACH * length[i]
        np.testing.assert_allclose(ahead.distance[i], there - station[i])
        east, north = (r.line.at(there) - (x[i], y[i])).T
        turned = (east + 1j * north) * np.exp(-1j * heading[i])
        np.testing.assert_allclose(ahead.points[i], np.column_stack([turned.real, turned.imag]), atol=1e-7)
        on = there % r.length if r.closed else np.minimum(there, r.line.stations[-1])
        last_point = [max(k for k, s in enumerate(r.line.stations) if s <= at) for at in on]
        np.testing.assert_array_equal(ahead.limit[i], r.limit[last_point])


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_the_road_ahead_does_not_depend_on_other_rows(seed):
    rng = np.random.default_rng(seed)
    routes, length = some_routes(rng, 6)
    pose = rng.uniform(0, 1, 6) * [r.length for r in routes], *rng.normal(0, 40, (2, 6)), rng.uniform(-3, 3, 6)
    together = Routes(routes, length).ahead(*pose)
    for i, r in enumerate(routes):
        alone = Routes([r], length[[i]]).ahead(*(values[[i]] for values in pose))
        for one, all_rows in zip(alone, together, strict=True):
            np.testing.assert_allclose(all_rows[i], one[0], atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("radius", [15.0, 80.0])
def test_the_curvature_of_a_circle_is_one_over_its_radius_with_the_sign_of_its_side(radius, sign):
    zero = np.zeros(1)
    ahead = Routes([circle(radius, sign, 3000)], np.array([4.74])).ahead(zero + 7.0, zero, zero, zero)
    assert ahead.curvature == pytest.approx(sign / radius, rel=0.01)


def test_a_straight_route_has_no_curvature_even_at_its_ends():
    straight, zero = route([(0, 0), (10, 10), (100, 100)]), np.zeros(2)
    ahead = Routes([straight] * 2, np.array([4.74, 9.2])).ahead(np.array([0.0, 130.0]), zero, zero, zero)
    assert ahead.curvature == pytest.approx(0, abs=1e-12)


def test_the_curvature_of_a_corner_is_spread_in_proportion_to_the_vehicle_length():
    """Its integral is the angle of the corner, for long and for short vehicles."""
    corner = route([(0, 0), (100, 0), (100, 100)])
    for length in (2.0, 10.0):
        zero = np.zeros(1)
        ahead = Routes([corner], np.array([length])).ahead(zero + 100 - 5 * length, zero, zero, zero)
        assert np.trapezoid(ahead.curvature[0], ahead.distance[0]) == pytest.approx(np.pi / 2, rel=0.06)


def test_an_open_route_continues_straight_beyond_its_end():
    bent, zero = route([(0, 0), (100, 0), (100, 60)]), np.zeros(1)
    points = Routes([bent], np.array([2.0])).ahead(zero + bent.length, zero + 100, zero + 60, zero).points[0]
    np.testing.assert_allclose(points[:, 0], 0, atol=1e-9)
    np.testing.assert_allclose(points[:, 1], REACH * 2.0, atol=1e-9)


# ---- stop lines


def line_at(station: float) -> Line:
    return Line(station, "M", "", 0, "from", "onto", (), 0.0)


@pytest.mark.parametrize(
    ("station", "passed", "ahead", "distance"),
    [
        (0.0, None, 30.0, 30.0),
        (29.0, None, 30.0, 1.0),
        (30.0, None, 30.0, 0.0),  # at the line, which is not passed yet
        (30.1, 30.0, 70.0, 39.9),
        (70.1, 70.0, None, np.inf),
        (150.0, 70.0, None, np.inf),
    ],
)
def test_stop_lines_before_and_ahead_on_an_open_route(station, passed, ahead, distance):
    straight = route([(0, 0), (100, 0)], lines=[line_at(30.0), line_at(70.0)])
    before, since, onward = straight.lines_about(station, 1.0)
    assert (before and before.station, onward[0][0].station if onward else None) == (passed, ahead)
    assert not before or since == pytest.approx(station - passed)
    assert not onward or onward[0][1] == pytest.approx(distance)


@pytest.mark.parametrize(
    ("station", "passed", "ahead", "distance"),
    [
        (0.0, 70.0, 30.0, 30.0),
        (50.0, 30.0, 70.0, 20.0),
        (99.0, 70.0, 30.0, 31.0),
        (100.0, 70.0, 30.0, 30.0),
        (100.5, 70.0, 30.0, 29.5),
        (131.0, 30.0, 70.0, 39.0),
        (270.0, 30.0, 70.0, 0.0),
    ],
)
def test_stop_lines_before_and_ahead_on_a_closed_route_and_at_its_seam(station, passed, ahead, distance):
    square = route([(0, 0), (25, 0), (25, 25), (0, 25)], closed=True, lines=[line_at(30.0), line_at(70.0)])
    before, since, ((after, left),) = square.lines_about(station, 1.0)
    assert (before.station, after.station) == (passed, ahead)
    assert left == pytest.approx(distance)
    assert since == pytest.approx((station - passed) % 100.0)
    *_, both = square.lines_about(station, 100.0)
    assert [line.station for line, _ in both] == [ahead, passed]
    assert both[1][1] == pytest.approx(100.0 - since)


def test_routes_without_junctions_have_no_stop_lines():
    for one in (route([(0, 0), (9, 0)]), circle(3.0)):
        assert one.lines_about(5.0, np.inf) == (None, np.inf, [])


# ---- along the lanes of networks


@pytest.fixture(scope="module")
def highway() -> Network:
    return Network.read(shipped.networks()["highway"])


@pytest.fixture(scope="module")
def cross() -> Network:
    return Network.read(NETS / "cross.net.xml")


@pytest.fixture(scope="module")
def lights() -> Network:
    return Network.read(NETS / "lights.net.xml")


def changes(lines: list[Line]) -> list[tuple[str, str]]:
    return [(line.lane, line.onto) for line in lines if line.state == CHANGING]


@pytest.mark.parametrize(
    ("start", "to", "crossed"),
    [(RIGHT, "e2_e_exit", 1), (MIDDLE, "e2_e_exit", 2), (RIGHT, "e2_e3", 0), (MIDDLE, "e2_e3", 0)],
)
def test_a_route_off_the_highway_changes_as_few_lanes_as_possible(highway, start, to, crossed):
    """Before the exit a lane is added on the right: lane i continues as lane i + 1."""
    _, _, lines = highway.route_lanes(["e0_e1", "e1_e2", to], start)
    assert sum(abs(int(one[-1]) - int(other[-1])) for one, other in changes(lines)) == crossed
    assert all(one[:-1] == other[:-1] for one, other in changes(lines))
    assert lines[-1].onto.startswith(to)


@pytest.mark.parametrize("start", [RIGHT, MIDDLE])
def test_the_line_of_a_route_lies_on_its_lanes_except_where_it_changes_them(highway, start):
    edges = ["e0_e1", "e1_e2", "e2_e_exit"]
    points, _, lines = highway.route_lanes(edges, start)
    line = Polyline(points)
    assert points[0] == pytest.approx(highway.lane_pose(edges[0], start)[:2])
    end = highway.lane_pose("e2_e_exit", 0, highway.edges["e2_e_exit"][0])
    assert points[-1] == pytest.approx(end[:2], abs=0.01)
    for crossing in (one for one in lines if one.state != CHANGING):
        edge, _, lane = crossing.lane.rpartition("_")
        there = highway.lane_pose(edge, int(lane), highway.edges[edge][int(lane)])
        assert line.at(np.array([crossing.station]))[0] == pytest.approx(there[:2], abs=0.01)
    for change in (one for one in lines if one.state == CHANGING):
        edge, _, lane = change.lane.rpartition("_")
        _, offset = line.project(*line.at(np.array([change.station]))[0], change.station, 5.0)
        assert abs(offset) < 1e-9
        length = 12 * 3.2 * abs(int(lane) - int(change.onto[-1]))
        aside = line.at(change.station + np.array([0.0, length / 2, length]))[:, 1]
        assert np.diff(aside) == pytest.approx(1.6 * (int(change.onto[-1]) - int(lane)), abs=0.05)


def test_a_route_that_starts_late_on_a_lane_changes_it_after_its_start(highway):
    *_, (change, *_) = highway.route_lanes(["e1_e2", "e2_e_exit"], MIDDLE, position=120.0)
    assert change.state == CHANGING
    assert 120.0 < change.station < 244.55 - 12 * 3.2 + 1


@pytest.mark.parametrize(("left", "length"), [(120.0, 38.4), (50.0, 23.0), (30.0, 18.0), (20.0, 16.0)])
def test_a_lane_change_near_the_line_is_short_enough_to_end_before_a_queue_there(cross, left, length):
    """Of what is left of the lane, as far as it is not shorter than 16 m."""
    *_, (change, *_) = cross.route_lanes(["west_in", "north_out"], 0, position=492.8 - left)
    assert change.across == pytest.approx(length, abs=0.5)
    assert change.station >= 492.8 - left - 0.1


def test_speed_limits_are_those_of_the_lanes_on_the_route(highway):
    points, limit, _ = highway.route_lanes(["e1_e2", "e2_e_exit"], RIGHT)
    assert len(points) == len(limit)
    before = points[:, 0] < 1548
    assert limit[before] == pytest.approx(33.33)
    assert limit[points[:, 0] > 1552] == pytest.approx(22.22)


def test_a_lap_ends_on_the_lane_where_it_starts(highway):
    ring = Network.read(shipped.networks()["ring"])
    lap = ["east_north", "north_west", "west_south", "south_east"]
    for lane in (0, 1):
        points, _, lines = ring.route_lanes(lap, lane, closed=True)
        assert points[0] == pytest.approx(points[-1])
        assert changes(lines) == []
        assert len(lines) == 4
        assert [one.station for one in lines] == sorted(one.station for one in lines)
        radius = np.hypot(*points.T)
        assert radius.max() - radius.min() < 0.1


def test_stop_lines_are_at_the_ends_of_lanes_and_have_the_right_of_way(cross, lights):
    *_, (line,) = cross.route_lanes(["north_in", "south_out"])
    assert (line.state, line.light, line.lane, line.onto) == ("m", "", "north_in_0", "south_out_0")
    assert (line.station, line.across) == pytest.approx((289.6, 20.8))
    *_, (line,) = lights.route_lanes(["north_in", "south_out"])
    assert (line.light, line.index) == ("middle", 1)
    *_, (line,) = cross.route_lanes(["west_in", "north_out"], 1)
    assert (line.via, line.across) == ((":middle_16_0", ":middle_20_0"), pytest.approx(3.71 + 13.14))


def test_a_turn_from_the_wrong_lane_begins_with_a_lane_change(cross):
    *_, lines = cross.route_lanes(["west_in", "north_out"], 0)
    assert changes(lines) == [("west_in_0", "west_in_1")]
    assert [line.state for line in lines] == [CHANGING, "m"]
    assert all(one.station < other.station for one, other in pairwise(lines))


def test_a_route_without_a_connection_is_an_input_error(cross):
    with pytest.raises(InputError, match="no connection from edge 'west_in' to 'south_in'; it leads to: east_out"):
        cross.route_lanes(["west_in", "south_in"])
    with pytest.raises(InputError, match="the route is empty"):
        cross.route_lanes([])


def test_upstream_gives_the_lanes_that_lead_to_a_lane_and_the_distances_of_their_ends(highway):
    near = highway.upstream("e1_e2_1", 100.0)
    assert near == [("e1_e2_1", 0.0)]
    far = dict(highway.upstream("e1_e2_1", 300.0))
    inside = highway._net.getLane(":e1_0_0").getLength()
    assert far == {"e1_e2_1": 0.0, ":e1_0_0": pytest.approx(244.55), "e0_e1_0": pytest.approx(244.55 + inside)}
    merged = dict(highway.upstream("e3_e4_0", 300.0))
    assert list(merged) == ["e3_e4_0", ":e3_0_0", "e_entry_e3_0"]
    assert merged[":e3_0_0"] == pytest.approx(294.51)


def test_approaches_are_the_paths_on_which_a_lane_is_reached():
    corridor = Network.read(shipped.networks()["corridor"])
    assert [*corridor.approaches("rn_rw_0", 16.0)] == [()]
    assert sorted(corridor.approaches("rn_rw_0", 27.0)) == [(":rn_0_0",), (":rn_2_0",)]
    assert sorted(corridor.approaches("rn_rw_0", 32.0)) == [("re_rn_0", ":rn_2_0"), ("round_n_rn_0", ":rn_0_0")]
    assert [*corridor.approaches("west_light_0", 1000.0)] == [()]  # nothing leads there


def test_upstream_gives_each_lane_once_with_its_shortest_distance():
    world = Network.read(shipped.networks()["lab_world"])  # its blocks are small: millions of paths
    lane = next(f"{edge}_0" for edge in sorted(world.edges))
    lanes, distances = zip(*world.upstream(lane, 50.0), strict=True)
    assert len(set(lanes)) == len(lanes)
    assert (lanes[0], distances[0]) == (lane, 0.0)
    assert list(distances) == sorted(distances)
    there = dict(zip(lanes, distances, strict=True))
    for name, distance in zip(lanes[1:], distances[1:], strict=True):
        onward = [link.getViaLaneID() or link.getToLane().getID() for link in world._net.getLane(name).getOutgoing()]
        lengths = {one: there[one] + world._net.getLane(one).getLength() for one in onward if one in there}
        assert distance == pytest.approx(min(lengths.values()))


@pytest.mark.parametrize(
    ("inside", "lane"),
    [(":middle_14_0", "west_in_0"), (":middle_16_0", "west_in_1"), (":middle_20_0", "west_in_1")],
)
def test_entered_from_is_the_lane_before_the_junction_for_each_lane_of_a_chain(cross, inside, lane):
    assert cross.entered_from[inside] == lane
