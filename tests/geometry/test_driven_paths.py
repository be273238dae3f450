"""Driven paths of many vehicles, compared with one line at a time."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.geometry.driven_paths import DrivenPaths
from platoontraffic.geometry.polyline import Polyline
from tests.support.grown_line import GrownLine


def drives(rng: np.random.Generator, n: int, steps: int, speed: float, turn: float = 0.3) -> tuple[np.ndarray, ...]:
    """Random drives of n vehicles, with stops and reversing: x, y and whether backwards, (steps, n)."""
    v = speed * rng.choice([1.0, 1.0, 1.0, 0.0, -0.5], (steps, n))
    heading = np.cumsum(rng.uniform(-turn, turn, (steps, n)), axis=0)
    return np.cumsum(v * np.cos(heading), axis=0), np.cumsum(v * np.sin(heading), axis=0), v < 0


def begun(paths: DrivenPaths, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, list[GrownLine]]:
    number = np.arange(len(x))
    paths.begin(number, x - 1.0, y, x, y)
    return number, [GrownLine([(a - 1.0, b), (a, b)]) for a, b in zip(x, y, strict=True)]


def test_with_no_spacing_every_path_equals_a_line_through_all_points():
    rng = np.random.default_rng(5)
    n, window = 6, 2.0
    xs, ys, back = drives(rng, n, 400, 0.2)
    paths = DrivenPaths(np.zeros(n))
    number, lines = begun(paths, xs[0], ys[0])
    for x, y, backwards in zip(xs[1:], ys[1:], back[1:], strict=True):
        paths.drive(number, x, y, backwards)
        for line, *point, reverse in zip(lines, x, y, backwards, strict=True):
            (line.retract if reverse else line.append)(*point)
        np.testing.assert_allclose(paths.end(number), [line.end for line in lines], atol=1e-9)
        near = paths.end(number) * rng.uniform(0, 1, n)
        # Beside the line: on it, rounding would decide which of two pieces is nearest.
        at = [line.at(s) + rng.normal(0, 0.3, 2) for line, s in zip(lines, near, strict=True)]
        found = paths.project(number, *np.array(at).T.copy(), near, np.full(n, window))
        expected = [line.project(*p, s, window) for line, p, s in zip(lines, at, near, strict=True)]
        np.testing.assert_allclose(np.transpose(found), expected, atol=1e-9)


@pytest.mark.parametrize("radius", [1.0, 6.0])
def test_points_left_out_shorten_a_curve_by_no_more_than_the_chords_do(radius):
    spacing = 0.2
    angle = np.linspace(0, 12, 4000)
    x, y = radius * np.sin(angle), radius * (1 - np.cos(angle))
    paths, line = DrivenPaths(np.array([spacing])), Polyline(np.column_stack([x, y]))
    number = np.array([0])
    paths.begin(number, x[:1], y[:1], x[:1], y[:1])
    for i in range(1, len(x)):
        paths.drive(number, x[i : i + 1], y[i : i + 1], np.array([False]))
    assert 12 * radius / spacing / 1.1 < paths._size[0] < 12 * radius / spacing + 3
    shorter = (1.1 * spacing / radius) ** 2 / 24  # relative difference of chord and arc
    assert paths.end(number)[0] == pytest.approx(line.length, rel=shorter)
    for i in range(100, len(x), 100):
        station, offset = paths.project(number, x[[i]], y[[i]], np.array([radius * angle[i]]), np.array([1.0]))
        assert station[0] == pytest.approx(radius * angle[i], rel=shorter)
        assert abs(offset[0]) <= (1.1 * spacing) ** 2 / 8 / radius


def test_a_sharp_corner_is_kept():
    paths, number = DrivenPaths(np.array([0.2])), np.array([0])
    paths.begin(number, np.array([-1.0]), np.array([0.0]), np.array([0.0]), np.array([0.0]))
    for x, y in [*((0.01 * k, 0.0) for k in range(1, 112)), *((1.11, 0.01 * k) for k in range(1, 100))]:
        paths.drive(number, np.array([x]), np.array([y]), np.array([False]))
    assert paths.end(number)[0] == pytest.approx(1 + 1.11 + 0.99, abs=1e-9)


def test_positions_on_the_forgotten_part_of_a_path_are_nan():
    paths, number = DrivenPaths(np.array([0.5, 0.5]), capacity=64), np.array([0, 1])
    zero, forward = np.zeros(2), np.array([False, False])
    paths.begin(number, zero - 1, zero, zero, zero)
    for k in range(1, 1001):
        paths.drive(number, zero + k, zero, forward)
    np.testing.assert_array_equal(paths.end(number), [1001.0, 1001.0])
    station, offset = paths.project(number, np.array([990.0, 30.0]), zero + 0.5, np.array([990.0, 30.0]), zero + 5)
    np.testing.assert_array_equal(station, [991.0, np.nan])
    np.testing.assert_array_equal(offset, [0.5, np.nan])
    # The window reaches the part that is kept; the nearest point would be on the forgotten part.
    station, _ = paths.project(number, zero + 900, zero, zero + 900, zero + 500)
    np.testing.assert_array_equal(station, [np.nan, np.nan])


def test_a_path_reversed_to_its_beginning_can_be_driven_again():
    paths, number, forward = DrivenPaths(np.array([0.1])), np.array([0]), np.array([False])
    zero = np.zeros(1)
    paths.begin(number, zero, zero, zero + 1, zero)
    paths.drive(number, zero - 3, zero, np.array([True]))
    assert paths.end(number)[0] == 0
    paths.drive(number, zero, zero + 2, forward)
    assert paths.end(number)[0] == 2
    assert paths.project(number, zero - 0.5, zero + 1.5, zero, zero + 5)[0][0] == 1.5
