"""A way round a body that stands on a part of the path: where there is one, and that it touches nothing."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from platoontraffic.road import way_round as ways
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.route import Route
from platoontraffic.road.way_round import (
    Body,
    blocked_return,
    corners,
    is_free_without,
    way_round,
    with_later_return,
)
from platoontraffic.vehicles.bicycle import CARS

CAR = CARS["car"]
BODY = Body(CAR.length, CAR.width, CAR.axle, float(CAR.turning_radius))
NOSE = BODY.length / 2 - BODY.axle  # of a vehicle whose driven axle is at the origin [m]


def street(bend: float = 0.0) -> Route:
    """From the west to the origin and on, with a constant curvature [1/m] to the left."""
    s = np.linspace(-50.0, 150.0, 2001)
    points = np.column_stack([s, np.zeros_like(s)])
    if bend:
        points = np.column_stack([np.sin(bend * s), 1 - np.cos(bend * s)]) / bend
    return Route.along(("road",), points, np.full(len(s), 13.9))


def anywhere(_shift, _corners) -> bool:
    return True


def within(half: float):
    """A straight corridor about the x axis [m]."""
    return lambda _, body: bool((np.abs(body[..., 1]) < half).all())


def seen(body: shapely.Geometry, every: float = 0.1) -> np.ndarray:
    """Points all round a body, (k, 2)."""
    ring = body.exterior
    return shapely.get_coordinates(ring.interpolate(np.arange(0.0, ring.length, every)))


def box(overlap: float, ahead: float = 3.0, length: float = 3.0, angle: float = 0.0) -> shapely.Polygon:
    """A body to the left, so far ahead of the bumper, that covers so much of the path of the body [m]."""
    body = shapely.box(NOSE + ahead, BODY.width / 2 - overlap, NOSE + ahead + length, BODY.width / 2 + 4.0)
    return affinity.rotate(body, angle, origin=(NOSE + ahead, BODY.width / 2 - overlap))


def car(ahead: float) -> shapely.Polygon:
    """A car on the path, so far ahead of the bumper [m]."""
    return shapely.box(NOSE + ahead, -BODY.width / 2, NOSE + ahead + BODY.length, BODY.width / 2)


def found(bodies, bend: float = 0.0, may_use=anywhere, aside: float = 0.0):
    returns = np.vstack([seen(one) for one in bodies])
    return way_round(street(bend), 50.0, (0.0, aside, 0.0), BODY, returns, may_use)


def swept(way, end: float = 2.0) -> shapely.Geometry:
    stations = np.arange(50.0, way.ends + end, 0.05)
    section = ways._Section(stations - 50.0, way.route.line.at(stations))
    return shapely.union_all(shapely.polygons(corners(section, BODY)))


def turning(after: float, radius: float) -> Route:
    """From the west, straight to a place beyond the origin [m], and a bend of 20 degrees to the right there [m]."""
    s = np.linspace(-50.0, 150.0, 4001)
    heading = -np.clip((s - after) / radius, 0.0, np.radians(20))
    steps = (s[1] - s[0]) * np.column_stack([np.cos(heading), np.sin(heading)])
    points = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)[:-1]]) - [50.0, 0.0]
    return Route.along(("road",), points, np.full(len(s), 13.9))


@pytest.mark.parametrize("after", [8.0, 18.0])
def test_there_is_a_way_where_the_road_bends_nearly_as_sharply_as_it_can_steer(after):
    """In a junction in Bologna, past a bus that waited midway; a platoon stood before it, and the bus for that."""
    body, route = box(0.3), turning(after, 1.25 * BODY.turning_radius)
    way = way_round(route, 50.0, (0.0, 0.0, 0.0), BODY, seen(body), anywhere)
    assert way.shift == pytest.approx(-0.5, abs=0.25)
    assert swept(way).distance(body) > ways.CLEARANCES[1] - 0.02
    section = ways._ahead(way.route, 50.0, way.ends - 50.0)
    assert np.abs(section.curvature).max() < 1.02 / BODY.turning_radius


@pytest.mark.parametrize("overlap", [-0.1, 0.1, 0.5, 1.0, 1.4])
def test_there_is_a_way_past_a_body_that_leaves_room(overlap):
    body = box(overlap)
    way = found([body])
    assert way.shift == pytest.approx(-(overlap + ways.CLEARANCES[0]), abs=0.15)
    assert swept(way).distance(body) > ways.CLEARANCES[1] - 0.02
    assert way.route.line.at(np.array([way.ends + 1.0]))[0, 1] == pytest.approx(0.0, abs=1e-9)  # it is back


def test_it_is_mirrored():
    """Of a body to the right the way is the mirrored one; left-hand traffic is no special case."""
    left, right = found([box(0.6)]), found([affinity.scale(box(0.6), yfact=-1, origin=(0, 0))])
    mirrored = right.route.line.points * np.array([1.0, -1.0])
    assert left.route.line.points == pytest.approx(mirrored, abs=1e-9)
    assert left.shift == -right.shift


@pytest.mark.parametrize(
    ("bodies", "may_use"),
    [
        ([car(3.0), car(10.2)], anywhere),  # a queue: it could not go back to its path
        ([box(BODY.width)], within(BODY.width / 2 + 1.9)),  # the whole path
        ([box(0.5, ahead=0.2)], anywhere),  # too near to steer round it
        ([box(0.5), affinity.scale(box(-0.3), yfact=-1, origin=(0, 0))], anywhere),  # no room on the other side
        ([box(1.0)], within(BODY.width / 2 + 0.8)),  # the road is too narrow
        ([box(-0.25)], anywhere),  # nothing is in the way
    ],
)
def test_there_is_none(bodies, may_use):
    assert found(bodies, may_use=may_use) is None


def test_it_goes_through_a_gap_with_less_clearance():
    """Between two bodies there is room for 0.2 m on each side, not for 0.3 m."""
    first = box(0.4, ahead=7.5)
    second = affinity.translate(box(0.0, ahead=7.5), 0, -BODY.width - 4.0 - 0.8)
    way = found([first, second])
    assert swept(way).distance(shapely.union(first, second)) > ways.CLEARANCES[1] - 0.02


def test_it_goes_through_a_gap_that_just_suffices():
    """With a shift between 0.5 and 0.6 m, which are tried anyway: with 0.6 m a corner was 3 cm beyond the kerb."""
    overlap = 0.41  # the smaller clearance needs a shift of 0.55 m; the corner swings out by 0.68 m more
    assert found([box(overlap)], may_use=within(BODY.width / 2 + 1.26)).shift == pytest.approx(-0.56)
    assert found([box(overlap)], may_use=within(BODY.width / 2 + 1.22)) is None


def test_it_goes_past_a_body_that_is_close_beside_it():
    """It does not come nearer to that one."""
    beside = shapely.box(1.0, BODY.width / 2 + 0.08, 5.0, 4.0)
    way = found([beside, box(0.3)])
    assert way.shift < -0.4
    assert swept(way).distance(beside) > 0.04


def test_it_goes_past_a_single_car_if_the_road_is_wide_enough():
    way = found([car(3.0)])
    assert abs(way.shift) == pytest.approx(BODY.width + ways.CLEARANCES[0], abs=0.1)
    assert swept(way).distance(car(3.0)) > ways.CLEARANCES[1]


@pytest.mark.parametrize("driven", [3.0, 6.0, 9.0])
def test_it_stays_beside_a_further_body_that_was_hidden_at_first(driven):
    first, second = box(1.0), box(0.6, ahead=14.0)
    way, station = found([first]), 50.0 + driven
    assert blocked_return(way, station, BODY, seen(first)) == np.inf
    both = np.vstack([seen(first), seen(second)])
    assert station < blocked_return(way, station, BODY, both) < way.ends
    later = with_later_return(way, station, BODY, both, anywhere)
    assert later.shift == way.shift
    before = np.arange(40.0, station, 0.5)
    assert later.route.line.at(before) == pytest.approx(way.route.line.at(before), abs=1e-3)
    assert swept(later).distance(shapely.union(first, second)) > ways.CLEARANCES[1] - 0.02
    assert later.route.line.at(np.array([later.ends + 1.0]))[0, 1] == pytest.approx(0.0, abs=1e-9)
    assert blocked_return(later, station, BODY, both) == np.inf
    assert with_later_return(way, station, BODY, both, within(1.0)) is None


@pytest.mark.parametrize("aside", [-0.5, 0.45, 0.9])
def test_it_begins_where_the_member_stands_beside_its_line(aside):
    """A follower cuts corners, and comes to a stand there."""
    body = box(0.2, ahead=4.0)
    way = found([body], aside=aside)
    line = way.route.line
    begin = line.stations[np.hypot(*(line.points - (0.0, aside)).T).argmin()]
    assert line.at(np.array([begin]))[0] == pytest.approx((0.0, aside), abs=1e-9)
    assert begin == pytest.approx(50.0, abs=0.2)
    assert swept(way).distance(body) > ways.CLEARANCES[1] - 0.02
    assert line.at(np.array([way.ends + 1.0]))[0, 1] == pytest.approx(0.0, abs=1e-9)
    turned = np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(line.points, axis=0).T[::-1]))))
    assert turned.max() < 0.35  # the route leads to it without a sharp corner


def test_it_cannot_stay_beside_where_it_comes_back_already_or_there_is_no_room():
    way, second = found([box(1.0)]), box(0.6, ahead=14.0)
    assert blocked_return(way, way.ends - 2.0, BODY, seen(second)) == np.inf
    wall = np.vstack([seen(box(1.0)), seen(box(3.0, ahead=14.0))])
    assert blocked_return(way, 53.0, BODY, wall) < np.inf
    assert with_later_return(way, 53.0, BODY, wall, anywhere) is None


def test_stop_lines_keep_their_places():
    route = street()
    lines = [Line(s, "m", "", 0, "a_0", "b_0", (), 5.0) for s in (40.0, 60.0, 120.0)]
    route = Route.along(route.edges, route.line.points, route.limit, lines)
    way = way_round(route, 50.0, (0.0, 0.0, 0.0), BODY, seen(box(1.0)), anywhere)
    before, after = ([one.line.at(np.array([line.station]))[0, 0] for line in one.lines] for one in (route, way.route))
    assert after == pytest.approx(before, abs=0.05)
    assert way.route.length == pytest.approx(route.length, abs=0.6)
    assert way.route.limit[np.searchsorted(way.route.line.stations, [46.0, 51.0, way.ends + 2.0])].tolist() == [
        13.9, ways.SPEED, 13.9,
    ]  # fmt: skip


def test_it_is_slow_only_until_its_rear_is_past_the_body():
    ends = np.array([[-50.0, 0.0], [150.0, 0.0]])  # a straight lane has no points in between
    route = Route.along(("road",), ends, np.full(2, 13.9))
    way = way_round(route, 50.0, (0.0, 0.0, 0.0), BODY, seen(box(1.0)), anywhere)
    past = 50.0 + way.plan.returns
    places = [49.0, 51.0, past - 0.3, past + 1.0, way.ends - 0.3, way.ends + 0.3]
    assert [way.route.limit_at(place) for place in places] == [13.9, *[ways.SPEED] * 2, *[13.9] * 3]
    assert past > 50.0 + 1.0 + BODY.length / 2 + BODY.axle  # the body begins 1 m ahead of its front


@pytest.mark.parametrize(("driven", "free"), [(0.0, True), (0.5, True), (8.0, False), (12.0, False)])
def test_it_is_not_left_beside_the_body_that_no_laser_sees(driven, free):
    """It stood at a red light beside a body that began behind its bumper: its laser had no return of it."""
    body, route = box(1.2, ahead=4.0, length=4.5), street()
    way = way_round(route, 50.0, (0.0, 0.0, 0.0), BODY, seen(body), anywhere)
    returns = seen(body) if driven > 1.0 else np.empty((0, 2))  # the body has gone
    ahead = returns[returns[:, 0] > driven + NOSE]
    assert is_free_without(way, route, 50.0 + driven, BODY, ahead) == free


@settings(max_examples=25, deadline=None)
@given(
    overlap=st.floats(0.05, 1.9),
    ahead=st.floats(0.3, 6.0),
    length=st.floats(0.5, 12.0),
    angle=st.floats(-40.0, 40.0),
    bend=st.sampled_from([0.0, 0.02, -0.02, 0.08, -0.08]),
    other=st.floats(1.0, 6.0),
    mirrored=st.booleans(),
)
def test_it_never_touches_anything_and_can_be_steered(overlap, ahead, length, angle, bend, other, mirrored):
    bodies = [box(overlap, ahead, length, angle), shapely.box(NOSE - 3, -other - 3.0, NOSE + 20, -other)]
    if mirrored:
        bodies = [affinity.scale(one, yfact=-1, origin=(0, 0)) for one in bodies]
    way = found(bodies, bend)
    if way is None:
        return
    assert swept(way).distance(shapely.union_all(bodies)) > ways.CLEARANCES[1] - 0.06  # returns are 0.1 m apart
    stations = np.arange(50.0, way.ends, 0.5)
    heading = np.unwrap(np.arctan2(*np.gradient(way.route.line.at(stations), axis=0).T[::-1]))
    assert np.abs(np.gradient(heading, 0.5)).max() < 1.05 / BODY.turning_radius


def test_what_the_body_touches_is_what_lies_in_its_grown_rectangle():
    section = ways._ahead(street(bend=0.02), 45.0, 20.0)
    returns = np.random.default_rng(1).uniform(-30, 30, (2000, 2))
    touched = ways._touches(section, BODY, returns, np.full(len(returns), 0.3))
    assert touched.any()
    grown = BODY._replace(length=BODY.length + 0.6, width=BODY.width + 0.6)
    places = shapely.polygons(ways.corners(section, grown))
    assert (touched == shapely.contains_xy(places[:, None], *returns.T)).all()


def test_it_comes_back_as_gently_as_there_is_room():
    """By the shortest way back, a car's front was 0.8 m on the other side of its route, and met what came there."""
    farther = shapely.box(NOSE + 15.5, -6.0, NOSE + 20.0, -BODY.width / 2 - 0.35)

    def front_over(way) -> float:
        places = way.route.line.at(np.arange(50.0, way.ends, 0.25))
        heading = np.arctan2(*np.gradient(places, axis=0).T[::-1])
        return float((places[:, 1] + np.sin(heading) * NOSE).max())

    gentle, short = found([box(0.9)]), found([box(0.9), farther])
    assert short.shift == gentle.shift
    assert front_over(gentle) < 0.3
    assert front_over(short) > 0.6
