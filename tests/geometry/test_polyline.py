"""Stations on open and closed lines, and the nearest place on them."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.geometry.polyline import Polyline, beside, left_of

BENT = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (1.0, 4.0)])
SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])


def test_left_of_a_line_is_as_numpy_has_its_direction_by_the_points_before_and_beyond():
    points = np.random.default_rng(1).normal(0, 0.2, (60, 2)).cumsum(axis=0)
    points[20] = points[22] = points[21]  # where it has no direction, none is to its left
    along = np.gradient(points, axis=0)
    expected = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    assert left_of(points) == pytest.approx(expected, abs=1e-12)
    assert (left_of(np.array([(0.0, 0.0), (3.0, 0.0)])) == [0.0, 1.0]).all()


def test_the_length_is_the_sum_of_the_pieces():
    assert Polyline(BENT).length == Polyline(BENT).stations[-1] == pytest.approx(5 + np.sqrt(8))
    assert Polyline(SQUARE, closed=True).length == 8.0


@pytest.mark.parametrize(("points", "closed"), [(BENT, False), (SQUARE, True)])
@pytest.mark.parametrize("offset", [0.0, 0.2, -0.2])
def test_a_point_at_a_station_and_offset_projects_to_them(points, closed, offset):
    """Away from the corners, where the nearest place is not unique."""
    line = Polyline(points, closed)
    corners = np.append(np.cumsum(np.hypot(*np.diff(points, axis=0).T)), [0.0, line.length])
    for station in np.linspace(0.01, line.length - 0.01, 60):
        if np.abs(station - corners).min() < 0.25:
            continue
        before, here, after = line.at(station + np.array([-1e-3, 0, 1e-3]))
        along = (after - before) / np.hypot(*(after - before))
        x, y = here + offset * np.array([-along[1], along[0]])
        found, aside = line.project(x, y, near=station + 0.1, window=0.5)
        assert found % line.length == pytest.approx(station, abs=1e-9)
        assert aside == pytest.approx(offset, abs=1e-9)


def test_stations_of_a_closed_line_wrap_round():
    line = Polyline(SQUARE, closed=True)
    stations = np.array([-0.5, 7.5, 15.5])
    np.testing.assert_allclose(line.at(stations), [(0.0, 0.5)] * 3, atol=1e-12)
    for near in (7.9, 0.1, 8.1, 16.3):
        station, _ = line.project(0.1, 0.3, near=near, window=1.0)
        assert station % 8.0 == pytest.approx(7.7)


def test_places_beyond_an_open_line_are_its_ends():
    line = Polyline(BENT)
    np.testing.assert_array_equal(line.at(np.array([-1.0, 99.0])), BENT[[0, -1]])
    assert line.project(-2.0, 0.5, near=0.0, window=1.0)[0] == 0.0
    assert line.project(0.0, 9.0, near=line.length, window=1.0)[0] == pytest.approx(line.length)


def test_the_window_chooses_between_the_two_legs_of_a_line_that_turns_back():
    there_and_back = Polyline(np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 0.2), (0.0, 0.2)]))
    assert there_and_back.project(2.0, 0.15, near=2.0, window=1.0)[0] == pytest.approx(2.0)
    assert there_and_back.project(2.0, 0.05, near=8.2, window=1.0)[0] == pytest.approx(8.2)


def test_repeated_points_do_not_count():
    doubled = Polyline(np.repeat(BENT, 2, axis=0))
    assert doubled.length == Polyline(BENT).length
    assert doubled.project(3.0, 1.0, near=4.0, window=9.0) == (4.0, 0.0)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_without_a_window_the_projection_agrees_with_shapely(seed):
    rng = np.random.default_rng(seed)
    points, (x, y) = rng.normal(0, 40, (12, 2)), rng.normal(0, 60, 2)
    line, other, point = Polyline(points), shapely.LineString(points), shapely.Point(x, y)
    station, offset = line.project(x, y, 0.0, np.inf)
    assert abs(offset) == pytest.approx(other.distance(point), abs=1e-9)
    assert other.interpolate(station).distance(point) == pytest.approx(abs(offset), abs=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_the_place_beside_a_prolonged_piece_is_the_foot_of_the_perpendicular(seed):
    start, end, point = points = np.random.default_rng(seed).normal(0, 10, (3, 2))
    size = (end - start) @ (end - start)
    share, squared, side = beside(points[:2], 0, *point, size, -np.inf, np.inf, 1.0)
    along, *_ = beside(points[:2], 0, *point, np.sqrt(size), -np.inf, np.inf, np.sqrt(size))
    assert along == pytest.approx(share * np.sqrt(size))
    foot = start + share * (end - start)
    assert (point - foot) @ (end - start) == pytest.approx(0, abs=1e-9)
    assert np.hypot(*(point - foot)) == pytest.approx(np.sqrt(squared), abs=1e-9)
    assert abs(side) == pytest.approx(np.sqrt(squared) * np.hypot(*(end - start)), abs=1e-9)


def test_a_piece_without_length_is_a_point():
    assert beside(np.array([(3.0, 4.0), (3.0, 4.0)]), 0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0) == (0.0, 25.0, 0.0)
