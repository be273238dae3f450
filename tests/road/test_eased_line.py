"""Lines whose curvature changes gradually."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from platoontraffic.road import drivable_line, eased_line
from platoontraffic.road.drivable_line import drivable
from platoontraffic.road.eased_line import ABOVE_LOCK, BEYOND, EASING, corridor_of, eased
from platoontraffic.road.route import Route
from platoontraffic.vehicles.bicycle import CARS

LOCK, TOLERANCE, ROOM, WIDTH, SPACING = 1 / 4.65, 0.5, 0.7, 5.7, 0.47  # of a car
FRONT = CARS["car"].length / 2 - CARS["car"].axle
WITHIN = 0.03  # of its corridor [m]


def corner(radius, leg=60.0, turn=np.pi / 2):
    angle = np.linspace(0, turn, 40)
    arc = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    return np.vstack([(-leg, 0), arc, arc[-1] + leg * np.array([np.cos(turn), np.sin(turn)])])


def easy(points, closed=False, tolerance=TOLERANCE, front=0.0, room=ROOM):
    points = np.asarray(points, dtype=float)
    line, stations = drivable(points, LOCK, SPACING, closed)
    return eased(line, stations, points, LOCK, tolerance, BEYOND * tolerance, room, WIDTH, SPACING, front, closed)


def curvature(points):
    """At the inner points, without sign."""
    steps = np.diff(points, axis=0)
    turn = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    size = np.hypot(*steps.T)
    return np.abs(turn) / ((size[1:] + size[:-1]) / 2)


def over_a_length(points):
    """Curvature over one vehicle length, at places 0.5 m apart."""
    line = shapely.LineString(points)
    stations = np.arange(5.0, line.length - 5.0, 0.5)
    behind, here, ahead = (shapely.get_coordinates(line.interpolate(stations + s)) for s in (-2.37, 0.0, 2.37))
    one, two = np.arctan2(*(here - behind).T[::-1]), np.arctan2(*(ahead - here).T[::-1])
    return (np.unwrap(two) - np.unwrap(one)) / 2.37


def test_in_a_wide_corridor_the_sum_is_nearly_least():
    """The solution of the normal equations: the limits do not matter."""
    points, _ = easy(corner(30.0))
    before, its = drivable(corner(30.0), LOCK, SPACING)
    before = np.column_stack([np.interp(np.linspace(0.0, its[-1], len(points)), its, column) for column in before.T])
    third = np.diff(np.eye(len(points)), 3, axis=0)
    free = np.linalg.solve(np.eye(len(points)) + (WIDTH / SPACING) ** 6 * third.T @ third, before)
    inner = slice(30, -30)  # its ends are not free
    assert 0.1 < np.hypot(*(free - before)[inner].T).max() < TOLERANCE
    assert np.hypot(*(free - points)[inner].T).max() < 0.05


def test_within_a_corridor_no_other_line_has_a_lesser_sum():
    """Lines between the eased one and others within the limits have greater sums: the problem is nearly convex."""
    points, stations = easy(corner(8.0))
    before, its = drivable(corner(8.0), LOCK, SPACING)
    before = np.column_stack([np.interp(stations, its, column) for column in before.T])

    def total(line):
        return ((line - before) ** 2).sum() + (WIDTH / SPACING) ** 6 * (np.diff(line, 3, axis=0) ** 2).sum()

    off = (points - before) * (1 + 0.05 * np.sin(stations / 3.0))[:, None]
    assert total(points) < 0.5 * total(before)
    for share in (0.02, 0.1, 0.5):
        assert total(points) < total((1 - share) * points + share * before)
        assert total(points) < total((1 - share) * points + share * (before + 0.9 * off))


@pytest.mark.parametrize("radius", [5.7, 8.0, 12.0])
def test_the_curvature_of_an_arc_rises_gradually_within_the_tolerance(radius):
    given_line = corner(radius)
    points, _ = easy(given_line)
    off = shapely.distance(shapely.points(points), shapely.LineString(given_line))
    assert 0.2 < off.max() <= TOLERANCE + WITHIN
    assert curvature(points).max() < 1.08 / radius
    steepest = [np.abs(np.diff(over_a_length(line))).max() / 0.5 for line in (points, given_line)]
    assert steepest[0] < 0.65 * steepest[1]
    assert steepest[0] < 0.035  # what a car can steer at 4 m/s: 0.4 rad/s at a wheelbase of 2.7 m


@pytest.mark.parametrize("radius", [0.0, 2.0, 3.5])
def test_the_arc_at_full_lock_in_a_tight_corner_is_eased_too(radius):
    """The arc is (R - r) (sec 45 deg - 1) from the corner at least; without easing a car drives it at 1.5 m/s."""
    given_line = corner(radius)
    points, _ = easy(given_line)
    off = shapely.distance(shapely.points(points), shapely.LineString(given_line))
    assert off.max() <= (1 / LOCK - radius) * (np.sqrt(2) - 1) + 0.8
    assert curvature(points).max() <= ABOVE_LOCK * LOCK * 1.01
    steepest = np.abs(np.diff(over_a_length(points))).max() / 0.5
    assert steepest < 0.034  # 4.1 m/s


@pytest.mark.parametrize("turn", [117, 126])
def test_a_corner_that_turns_back_is_eased_within_the_lock(turn):
    """The arc itself takes 3.0 m/s; where its curvature jumps a car steers at 1.6 m/s."""
    points, _ = easy(corner(2.0, turn=np.radians(turn)))
    assert curvature(points).max() <= ABOVE_LOCK * LOCK * 1.01
    steepest = np.abs(np.diff(over_a_length(points))).max() / 0.5
    assert steepest < 0.04  # 3.5 m/s


def test_a_corner_is_cut_and_entered_from_its_outside():
    points, _ = easy(corner(8.0))
    apex = np.hypot(points[:, 0], points[:, 1] - 8.0).min()
    assert 7.4 < apex < 7.8
    assert (
        -0.7 * TOLERANCE - WITHIN < points[:, 1].min() < -0.2
    )  # less far than to the inner side, for others come there


def test_a_straight_line_and_the_ends_stay():
    points, stations = easy([(0, 0), (30, 40), (60, 80)])
    assert points[:, 1] == pytest.approx(points[:, 0] * 4 / 3, abs=1e-9)
    assert stations == pytest.approx(np.hypot(*points.T), abs=1e-6)
    ends, _ = easy(corner(6.0, leg=3.0))
    before, _ = drivable(corner(6.0, leg=3.0), LOCK, SPACING)
    assert ends[[0, -1]] == pytest.approx(before[[0, -1]])
    assert ends[1, 1] == pytest.approx(before[1, 1], abs=1e-6)  # and their directions


@pytest.mark.parametrize("radius", [6.0, 8.0, 15.0])
def test_stations_are_those_of_the_places_beside(radius):
    """A stop line lay up to 0.7 m beyond the end of its lane, as points had moved along the line."""
    given_line = corner(radius)
    points, stations = easy(given_line)
    assert (np.diff(stations) > 0).all()
    beside = shapely.get_coordinates(shapely.LineString(given_line).interpolate(stations))
    off = shapely.distance(shapely.points(points), shapely.LineString(given_line))
    assert np.hypot(*(points - beside).T) == pytest.approx(off, abs=0.02)


HALF_TURNS = [[(0, 0), (50, 0), (50, gap), (0, gap)] for gap in (1.0, 3.0, 8.0, 20.0)]
LOOP = [(0, 0), (50, 0), (50, 8), (42, 8), (42, -30)]


@pytest.mark.parametrize("kind", ["car", "van", "truck"])
@pytest.mark.parametrize("given_line", [*HALF_TURNS, LOOP])
def test_where_a_turn_is_too_tight_to_be_eased_the_line_stays_within_its_limits(given_line, kind):
    """Points that came close to one another gave a truck a path 15 m aside, and stop lines in disorder."""
    model, given_line = CARS[kind], np.array(given_line, dtype=float)
    spacing, tolerance = drivable_line.SPACING * model.length, EASING * model.width
    lock = 1 / (drivable_line.LOCK * model.turning_radius)
    before, along = drivable(given_line, lock, spacing)
    width, front = eased_line.WIDTH * model.length, model.length / 2 - model.axle
    points, stations = eased(before, along, given_line, lock, *corridor_of(model.width), width, spacing, front)
    inside = front**2 / 4 * np.pi / (2 * width)
    assert shapely.distance(shapely.points(points), shapely.LineString(before)).max() <= 1.1 * (tolerance + inside)
    assert curvature(points).max() <= 1.07 * max(lock, curvature(before).max())
    assert (np.diff(stations) > 0).all()


def test_each_corner_of_a_closed_line_is_eased_alike_wherever_the_line_begins():
    square = np.array([(0, 0), (60, 0), (60, 60), (0, 60), (0, 0)], dtype=float)
    from_the_middle = np.vstack([(30, 0), square[1:], (30, 0)])
    lines = [easy(points, closed=True)[0] for points in (square, from_the_middle)]
    assert lines[0][-1] == pytest.approx(lines[0][0])
    one, other = (shapely.LinearRing(points) for points in lines)
    assert one.hausdorff_distance(other) < 0.05


def test_far_from_the_origin_the_line_is_the_same():
    """Coordinates of a zone of the world have seven digits."""
    there = np.array([500_000.0, 5_000_000.0])
    assert easy(corner(6.0) + there)[0] == pytest.approx(easy(corner(6.0))[0] + there, abs=1e-4)


def test_without_tolerance_a_line_that_a_vehicle_can_drive_stays():
    given_line = corner(12.0)
    points, _ = easy(given_line, tolerance=1e-3)
    assert shapely.distance(shapely.points(points), shapely.LineString(given_line)).max() < 0.03


def test_a_circle_stays_a_circle():
    angle = np.linspace(0, 2 * np.pi, 400)
    points, _ = easy(15.0 * np.column_stack([np.cos(angle), np.sin(angle)]), closed=True)
    radius = np.hypot(*points.T)
    assert points[0] == pytest.approx(points[-1])
    assert np.ptp(radius) < 0.02
    assert radius.mean() == pytest.approx(15.0, abs=0.15)


@pytest.mark.parametrize("radius", [20.0, 30.0, 60.0])  # sharper bends are cut as well
def test_in_a_bend_the_body_takes_as_much_room_on_the_outer_side_as_on_the_inner(radius):
    """Members kept their rear axles to the lane, and their fronts swung over the lane beside: in a roundabout of two
    lanes seven pairs touched. On a circle the axle is f^2 / 4R inside of it, the front as far outside."""
    angle = np.linspace(0, 2 * np.pi, 1000)
    points, _ = easy(radius * np.column_stack([np.cos(angle), np.sin(angle)]), closed=True, front=FRONT)
    axle = np.hypot(*points.T)
    assert axle == pytest.approx(radius - FRONT**2 / 4 / radius, abs=0.015)
    assert np.hypot(axle, FRONT) - radius == pytest.approx(radius - axle, abs=0.03)


@pytest.mark.parametrize("kind", ["car", "van"])
@pytest.mark.parametrize("radius", [7.0, 10.0, 15.0])
def test_in_a_sharp_bend_that_is_cut_the_body_reaches_as_far_to_either_side(radius, kind):
    """Cars cut corners by up to 0.8 m, and reached 0.3 m farther to the inside, where others may turn beside them."""
    model, given_line = CARS[kind], corner(radius)
    route = Route.along(("a", "b"), given_line, np.full(len(given_line), 13.9), []).drivable_by(model)
    places = np.arange(20.0, route.length - 20.0, 0.25)
    axle, ahead = route.line.at(places), route.line.at(places + 0.1) - route.line.at(places - 0.1)
    ahead /= np.hypot(*ahead.T)[:, None]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    bend, centre = shapely.LineString(given_line), np.array([0.0, radius])
    inside, outside = 0.0, 0.0
    for along in np.linspace(-model.length / 2, model.length / 2, 10) - model.axle:
        for side in (-1, 1):
            points = axle + along * ahead + side * model.width / 2 * left
            beyond = shapely.distance(shapely.points(points), bend) - model.width / 2
            is_inside = np.hypot(*(points - centre).T) < radius  # of the arc; and left of both straights
            is_inside |= (points[:, 0] < 0) & (points[:, 1] > 0) | (points[:, 1] > radius) & (points[:, 0] < radius)
            inside = max(inside, beyond[is_inside].max(initial=0.0))
            outside = max(outside, beyond[~is_inside].max(initial=0.0))
    assert inside == pytest.approx(outside, abs=0.13)
    assert inside < model.length / 6


@pytest.mark.parametrize("side", [1, -1])
def test_where_lanes_leap_aside_the_front_of_a_van_stays_clear_of_oncoming_cars(side):
    """A junction of SUMO's `fokr_bs_demo`: oncoming cars are 2.2 m from the middle of the lane beyond it."""
    van = CARS["van"]
    points = np.array([(0, 0), (60, 0), (62.8, 4.6), (120, 4.6)]) * (1, side)
    route = Route.along(("a",), points, np.full(4, 13.9)).drivable_by(van)
    beyond = np.column_stack([np.arange(62.8, 90, 0.2), np.full(136, 4.6 * side)])
    line = shapely.LineString(route.line.points)
    axles = shapely.get_coordinates(line.interpolate(np.arange(50.0, 90.0, 0.2)))
    ahead = np.gradient(axles, axis=0)
    ahead /= np.hypot(*ahead.T)[:, None]
    outer = side * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    corners = axles + (van.length / 2 - van.axle) * ahead + van.width / 2 * outer
    assert (side * corners[:, 1] - 4.6).max() < 2.0
    assert shapely.distance(line, shapely.points(beyond))[30:].max() < 0.5


def test_a_lane_change_is_eased_as_if_there_were_endless_room():
    change = [(0, 0), (40, 0), (70, 3.2), (110, 3.2)]
    assert (easy(change, front=FRONT)[0] == easy(change, front=FRONT, room=np.inf)[0]).all()


def test_a_vehicle_that_is_too_wide_for_that_may_cut_bends_by_more():
    """With less, in a roundabout of two lanes, vans and trucks swung out over the lane beside more often."""
    assert corridor_of(1.8) == pytest.approx((0.504, 0.252, 0.7))
    assert corridor_of(2.4) == pytest.approx((0.672, 0.672, 0.4))


@settings(max_examples=40, deadline=None)
@given(
    steps=st.lists(st.floats(4.0, 25.0), min_size=3, max_size=25),
    aside=st.lists(st.floats(-3.0, 3.0), min_size=26, max_size=26),
    front=st.sampled_from([0.0, FRONT]),
)
@example(steps=[4.0] * 3, aside=[0.0, 0.0, 3.0] + [0.0] * 23, front=0.0)
@example(steps=[4.0] * 3, aside=[0.0, 0.0, 3.0] + [0.0] * 23, front=FRONT)
def test_any_line_stays_drivable_and_near_and_its_mirror_image_is_eased_alike(steps, aside, front):
    x = np.concatenate([[0.0], np.cumsum(steps)])
    given_line = np.column_stack([x, aside[: len(x)]])
    before, stations = drivable(given_line, LOCK, SPACING)
    points, _ = eased(before, stations, given_line, LOCK, TOLERANCE, BEYOND * TOLERANCE, ROOM, WIDTH, SPACING, front)
    sharpest = max(LOCK, curvature(before).max(initial=0.0))
    assert curvature(points).max(initial=0.0) <= 1.075 * sharpest  # a vehicle can turn 1.08 times as sharply as LOCK
    off = shapely.distance(shapely.points(points), shapely.LineString(before))
    assert off.max() <= TOLERANCE + front**2 / 4 * curvature(before).max(initial=0.0) + WITHIN
    mirrored, _ = easy(given_line * (1, -1), front=front)
    assert mirrored == pytest.approx(points * (1, -1), abs=1e-6)


@pytest.mark.parametrize("begin", np.linspace(0.0, 0.9, 10))
def test_a_line_is_eased_about_a_sharp_bend_wherever_its_points_lie(begin):
    """A bend of 130 degrees at full lock, and two lane changes behind it. Points crowded in the bend, so four in ten
    such lines were not eased 40 m about it: members drove 3 m/s in each lane change, where SUMO's cars drove 12."""
    first, bend, beyond = (30.0, -39.2), [(98.61, -64.68), (101.29, -65.97), (102.3, -67.44), (101.62, -69.09)], [
        (99.26, -70.91), (93.81, -74.16), (79.56, -86.37), (75.59, -88.73), (61.35, -100.94), (48.06, -108.86),
        (20.5, -143.8),
    ]  # fmt: skip
    line, _ = easy([np.add(first, np.multiply(begin, (1.37, -0.5))), *bend, *beyond])
    changes = np.hypot(*(line - (93.81, -74.16)).T).argmin() + 8
    assert curvature(line)[changes:-60].max() < 0.03
