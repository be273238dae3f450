"""Stations on open, closed and growing lines."""

import numpy as np
import pytest

from platoontraffic.geometry.polyline import Polyline

BENT = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (1.0, 4.0)])
SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])


def test_length_is_the_sum_of_its_pieces():
    assert Polyline(BENT).length == Polyline(BENT).end == pytest.approx(5 + np.sqrt(8))
    assert Polyline(SQUARE, closed=True).length == 8.0


@pytest.mark.parametrize(("points", "closed"), [(BENT, False), (SQUARE, True)])
@pytest.mark.parametrize("offset", [0.0, 0.2, -0.2])
def test_project_finds_station_and_offset_again(points, closed, offset):
    """A point at a station, put aside to the left by an offset; away from the corners, where it is not unique."""
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


def test_a_closed_line_wraps():
    line = Polyline(SQUARE, closed=True)
    stations = np.array([-0.5, 7.5, 15.5])
    np.testing.assert_allclose(line.at(stations), [(0.0, 0.5)] * 3, atol=1e-12)
    for near in (7.9, 0.1, 8.1, 16.3):
        station, _ = line.project(0.1, 0.3, near=near, window=1.0)
        assert station % 8.0 == pytest.approx(7.7)


def test_an_open_line_ends():
    line = Polyline(BENT)
    np.testing.assert_array_equal(line.at(np.array([-1.0, 99.0])), BENT[[0, -1]])
    assert line.project(-2.0, 0.5, near=0.0, window=1.0)[0] == 0.0
    assert line.project(0.0, 9.0, near=line.end, window=1.0)[0] == line.end


def test_the_window_keeps_to_its_own_branch_of_a_line_that_comes_back():
    there_and_back = Polyline(np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 0.2), (0.0, 0.2)]))
    assert there_and_back.project(2.0, 0.15, near=2.0, window=1.0)[0] == pytest.approx(2.0)
    assert there_and_back.project(2.0, 0.05, near=8.2, window=1.0)[0] == pytest.approx(8.2)


def test_appended_points_make_the_same_line():
    circle = np.column_stack([np.cos(np.linspace(0, 6, 300)), np.sin(np.linspace(0, 6, 300))])
    grown, whole = Polyline(circle[:2]), Polyline(circle)
    for x, y in circle[2:]:
        grown.append(x, y)
        grown.append(x, y)  # a robot that stands
    assert grown.end == pytest.approx(whole.length, rel=1e-12)
    stations = np.linspace(0, 6, 50)
    np.testing.assert_allclose(grown.at(stations), whole.at(stations), atol=1e-12)
    assert grown.project(*circle[200], near=4.0, window=1.0) == pytest.approx((whole.length * 200 / 299, 0), abs=1e-12)


def test_repeated_points_count_once():
    doubled = Polyline(np.repeat(BENT, 2, axis=0))
    assert doubled.length == Polyline(BENT).length
    assert doubled.project(3.0, 1.0, near=4.0, window=9.0) == (4.0, 0.0)


def test_driven_backwards_a_path_ends_where_the_vehicle_is():
    path = Polyline([(0.0, 0.0), (1.0, 0.0)])
    path.append(1.0, 1.0)
    path.retract(1.0, 0.6)
    assert path.end == pytest.approx(1.6)
    path.retract(0.7, 0.0)
    assert path.end == pytest.approx(0.7)
    path.append(0.7, -0.5)
    assert path.end == pytest.approx(1.2)
