"""Lines rounded so that a vehicle can drive them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from platoontraffic.geometry.polyline import Polyline
from platoontraffic.road.drivable_line import LOCK, drivable
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.route import Route
from platoontraffic.road.turning import tight_turns
from platoontraffic.vehicles.bicycle import CARS

RADIUS, SPACING = 5.0, 0.5


def rounded(points, closed=False):
    return drivable(np.asarray(points, dtype=float), 1 / RADIUS, SPACING, closed)


def curvature(points):
    steps = np.diff(points, axis=0)
    size = np.hypot(*steps.T)
    turn = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    return np.abs((turn + np.pi) % (2 * np.pi) - np.pi) / ((size[1:] + size[:-1]) / 2)


def corner(degrees, leg=60.0):
    angle = np.radians(degrees)
    return np.array([(-leg, 0.0), (0.0, 0.0), (leg * np.cos(angle), leg * np.sin(angle))])


@pytest.mark.parametrize("degrees", [30, 60, 90, 120, 135, 150])
def test_a_corner_becomes_the_arc_that_touches_its_legs(degrees):
    points, _ = rounded(corner(degrees))
    half = np.radians(degrees) / 2
    vertex = np.hypot(*points.T).min()
    assert curvature(points).max() <= 1.01 / RADIUS
    # The arc of radius r passes the corner at r (sec - 1), and its foot on the legs is r (1 - cos) away.
    assert vertex == pytest.approx(RADIUS * (1 / np.cos(half) - 1), abs=0.12 * RADIUS)
    off = shapely.distance(shapely.points(points), shapely.LineString(corner(degrees)))
    assert off.max() == pytest.approx(RADIUS * (1 - np.cos(half)), abs=0.5)


def test_a_straight_line_stays():
    points, stations = rounded([(0, 0), (30, 40), (60, 80)])
    assert points[:, 1] == pytest.approx(points[:, 0] * 4 / 3)
    assert stations == pytest.approx(np.hypot(*points.T))


def test_what_a_vehicle_can_drive_stays():
    angle = np.linspace(0, np.pi / 2, 30)
    arc = 1.1 * RADIUS * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    points, _ = rounded(np.vstack([(-40, 0), arc, arc[-1] + (0, 40)]))
    off = shapely.distance(shapely.points(points), shapely.LineString(np.vstack([(-40, 0), arc, arc[-1] + (0, 40)])))
    assert off.max() < 0.02


def test_a_spike_vanishes():
    points, _ = rounded([(0, 0), (30, 0), (26, 0.01), (60, 0)])
    assert np.abs(points[:, 1]).max() < 0.1
    assert (np.diff(points[:, 0]) > 0).all()


@settings(max_examples=40, deadline=None)
@given(
    steps=st.lists(st.floats(4.0, 25.0), min_size=3, max_size=25),
    aside=st.lists(st.floats(-3.0, 3.0), min_size=26, max_size=26),
)
@example(steps=[4.0] * 3, aside=[-2.75, 1.0, -0.53125] + [0.0] * 23)
def test_any_line_becomes_drivable_between_the_same_ends(steps, aside):
    x = np.concatenate([[0.0], np.cumsum(steps)])
    given_line = np.column_stack([x, aside[: len(x)]])
    points, stations = rounded(given_line)
    assert curvature(points).max(initial=0.0) <= 1.01 / RADIUS
    assert points[[0, -1]] == pytest.approx(given_line[[0, -1]])
    assert (np.diff(stations) >= 0).all()
    mirrored, _ = rounded(given_line * (1, -1))
    assert mirrored == pytest.approx(points * (1, -1), abs=1e-9)


@pytest.mark.parametrize("radius", [2.5, 4.0])
@pytest.mark.parametrize("side", [1, -1])
def test_a_half_turn_that_is_too_tight_becomes_a_bulb(radius, side):
    """No arc of 5 m fits between its legs, so the line swings out before and after it."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 20)
    turn = np.column_stack([60 + radius * np.cos(angle), side * radius * (1 + np.sin(angle))])
    points, _ = rounded(np.vstack([(0, 0), turn, (0, 2 * side * radius)]))
    assert curvature(points).max() <= 1.12 / RADIUS
    beside = side * points[:, 1]
    assert 2 * RADIUS - 0.7 < np.ptp(beside) < 2 * RADIUS + 0.5
    assert beside.max() - 2 * radius == pytest.approx(-beside.min(), abs=0.05)


@pytest.mark.parametrize("side", [1, -1])
def test_a_half_turn_aslant_swings_out_less_before_it_and_more_beyond(side):
    """A U-turn of an OpenStreetMap import: its first leg turns in before the tip, where a car is still on the lane."""
    points = [(60, 13.9), (22.9, 16.4), (15.2, 12.9), (14, 11.6), (12.1, 9.1), (11.8, 7.8), (11.7, 7.5), (12.7, 6.9),
              (15, 7.1), (20.3, 8.1), (60, 5.9)]  # fmt: skip
    lane = np.array(points) * (1, side)
    radius = CARS["car"].turning_radius
    points, stations = drivable(lane, 1 / (LOCK * radius), SPACING)
    places = [Polyline(lane).project(*point, near, 10.0) for point, near in zip(points, stations, strict=True)]
    station, off = np.abs(places).T
    assert off.max() < 2.4
    assert (off - tight_turns([lane], radius).least_offset(station)).max() < 0.8


def test_a_loop_that_is_too_tight_does_not_shrink_its_legs_away():
    """A loop of 2 m at the far end of two legs that almost touch."""
    angle = np.linspace(-np.pi / 2, 1.4 * np.pi, 40)
    loop = np.column_stack([62 + 2 * np.cos(angle), 2 + 2 * np.sin(angle)])
    line = np.vstack([(0, 0), loop, (0, 4)])
    points, _ = rounded(line)
    off = shapely.distance(shapely.LineString(points), shapely.points(loop))
    assert off.max() < 5 * RADIUS
    assert points[:, 0].max() > 40


def test_a_closed_line_is_rounded_where_it_closes_too():
    square = [(0, 0), (40, 0), (40, 40), (0, 40), (0, 0)]
    points, stations = rounded(square, closed=True)
    assert points[0] == pytest.approx(points[-1])
    assert stations[[0, -1]] == pytest.approx((0.0, 160.0))
    around = np.vstack([points[-2:-1], points])
    assert curvature(around).max() <= 1.01 / RADIUS
    near = [np.hypot(*(points - vertex).T).min() for vertex in square]
    assert near == pytest.approx([near[1]] * 5, abs=0.15)


def test_stop_lines_and_limits_of_a_route_move_with_its_line():
    """Beyond a rounded corner the route is shorter than the lanes; a line stays at its place on the road."""
    line = Line(90.0, "M", "", 0, "a", "b", (), 5.0)
    points, limit = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 80.0)]), np.array([14.0, 5.0, 5.0])
    given_route = Route.along(("a", "b"), points, limit, (line,))
    route = given_route.drivable_by(CARS["car"])
    there = route.line.at(np.array([route.lines[0].station]))[0]
    assert there == pytest.approx((60.0, 30.0), abs=0.2)
    assert route.length < given_route.length - 0.5
    radius = LOCK * CARS["car"].turning_radius
    assert curvature(route.line.points[:-1]).max() <= 1.03 / radius  # easing may add 2 %
    drop = route.line.points[np.flatnonzero(np.diff(route.limit) < 0) + 1][0]
    assert np.hypot(*(drop - (60.0, 0.0))) < radius


def test_half_turns_on_the_spot_between_long_legs_come_to_an_end():
    """The product of two weights of a half turn fell below the least number, and the flow went on for ever."""
    points = [(0, -1.6), (250, -1.6), (150, -1.6), (398.4, -1.6), (400, -1.6), (400.7, -1.5), (401.2, -1.2),
              (401.5, -0.7), (401.6, 0), (401.6, 6), (401.5, 6.7), (401.2, 7.2), (400.7, 7.5), (400, 7.6),
              (0, 7.6)]  # fmt: skip
    line, _ = drivable(np.array(points), 0.21484929063123775, 0.474)
    assert np.isfinite(line).all()
    assert shapely.LineString(line).length < shapely.LineString(points).length
