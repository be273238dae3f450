"""The least distance between a line and the path of a vehicle that cannot turn as sharply."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.road.turning import tight_turns

RADIUS = 5.0


def corner(degrees: float, leg: float = 30.0) -> np.ndarray:
    angle = math.radians(degrees)
    return np.array([(-leg, 0.0), (0.0, 0.0), (leg * math.cos(angle), leg * math.sin(angle))])


def arc(degrees: float, radius: float, pieces: int = 2000, leg: float = 30.0) -> np.ndarray:
    """A straight line, an arc to the left, and its tangent."""
    angles = np.linspace(0, math.radians(degrees), pieces + 1)
    curve = radius * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    onward = leg * np.array([np.cos(angles[-1]), np.sin(angles[-1])])
    return np.vstack([(-leg, 0.0), curve, curve[-1] + onward])


def crooked(seed: int, points: int = 14) -> np.ndarray:
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0, 0.9, points))
    return np.cumsum(rng.uniform(0.2, 6, (points, 1)) * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)


def worst(line: np.ndarray, radius: float = RADIUS) -> float:
    return tight_turns([line], radius).offset.max(initial=0.0)


@pytest.mark.parametrize("degrees", [10, 45, 90, 135, -90, -135])
def test_a_corner_is_passed_by_the_arc_that_touches_both_legs(degrees):
    """The arc's centre is R from both legs, so on the bisector R sec(angle / 2) from the corner."""
    found = tight_turns([corner(degrees)], RADIUS)
    inward = math.radians(degrees) / 2 + math.copysign(math.pi / 2, degrees)
    from_corner = RADIUS / math.cos(math.radians(degrees) / 2)
    centre = from_corner * np.array([math.cos(inward), math.sin(inward)])
    assert abs(centre[1]) == pytest.approx(RADIUS)
    assert found.offset == pytest.approx([min(np.hypot(*centre) - RADIUS, 2 * RADIUS)])
    assert found.angle == pytest.approx([math.radians(degrees)])
    assert found.start == found.end == pytest.approx([30.0])
    assert found.before == pytest.approx([abs(centre[0])])  # where it touches


@pytest.mark.parametrize("radius", [3.0, 4.0, 4.5])
def test_beyond_a_half_turn_two_arcs_lead_back_to_the_line(radius):
    """A half turn of radius R ends 2 (R - r) aside. The two arcs meet where each has turned as far as the other."""
    found = tight_turns([arc(180, radius)], RADIUS)
    whole = int(np.argmax(np.abs(found.angle)))
    aside = 2 * (RADIUS - radius)
    turned = math.acos(1 - aside / 2 / RADIUS)
    assert found.offset[whole] == pytest.approx(aside, rel=0.01)
    assert found.before[whole] == pytest.approx(2 * RADIUS * math.sin(turned), rel=0.01)


def test_no_car_drives_a_corner_of_135_degrees_within_6_m():
    assert worst(corner(135), radius=4.3) > 6


def test_a_straight_line_costs_nothing():
    assert not len(tight_turns([np.array([(0.0, 0.0), (50.0, 20.0)])], RADIUS))
    assert not len(tight_turns([np.outer(np.linspace(0, 1, 30), [50.0, 20.0])], RADIUS))
    assert not len(tight_turns([], RADIUS))


@pytest.mark.parametrize(("degrees", "radius"), [(90, 2.0), (60, 4.0), (120, 0.5)])
def test_an_arc_below_the_turning_radius_costs_the_distance_of_two_arcs_with_the_same_tangents(degrees, radius):
    bisector = 1 / math.cos(math.radians(degrees) / 2)
    middles = bisector * (RADIUS - radius) - (RADIUS - radius)  # of the arcs, on the bisector
    assert worst(arc(degrees, radius)) == pytest.approx(middles, rel=2e-3)


@pytest.mark.parametrize("radius", [RADIUS, 7.0, 20.0])
def test_an_arc_of_the_turning_radius_or_more_costs_nothing(radius):
    # m sides of a polygon have m + 1 corners, so a stretch of them turns on R m / (m + 1). From 141 degrees on, which
    # is 0.94 of this arc, the offset is twice what is lacking.
    pieces = 2000
    assert worst(arc(150, radius, pieces)) <= 2 * RADIUS / (0.94 * pieces)


@pytest.mark.parametrize("radius", [0.0, 1.0, 3.0])
def test_a_half_turn_ends_aside_by_the_difference_of_the_diameters(radius):
    assert worst(arc(180, radius) if radius else corner(179.999)) == pytest.approx(2 * (RADIUS - radius), rel=2e-3)


def test_a_swerve_does_not_cancel():
    swerve = np.array([(-20.0, 0.0), (0.0, 0.0), (1.0, 1.0), (21.0, 1.0)])
    assert worst(swerve) == pytest.approx(RADIUS * (1 / math.cos(math.radians(22.5)) - 1))


def test_two_corners_in_one_sense_cost_more_than_one():
    once, twice = corner(40), np.array([(-20.0, 0.0), (0.0, 0.0), (0.5, 0.5), (0.5, 20.0)])
    assert worst(twice) > 2 * worst(once)


def test_corners_far_apart_are_found_each_in_its_place():
    line = np.array([(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (90.0, 40.0)])
    found = tight_turns([line], RADIUS)
    np.testing.assert_allclose(found.start, [40.0, 80.0])
    np.testing.assert_allclose(found.angle, [math.pi / 2, -math.pi / 2])
    at = found.least_offset(np.array([0.0, 40.0, 40.0 + 0.99 * RADIUS, 60.0, 80.0, 130.0]))
    np.testing.assert_allclose(at, RADIUS * (math.sqrt(2) - 1) * np.array([0, 1, 1, 0, 1, 0]))


def test_lines_are_apart():
    """Two lines of which one ends where the other begins have no corner between them."""
    one, other = np.array([(0.0, 0.0), (9.0, 0.0)]), np.array([(9.0, 0.0), (9.0, 9.0)])
    assert not len(tight_turns([one, other], RADIUS))
    assert tight_turns([one, corner(90), other, corner(45)], RADIUS).line.tolist() == [1, 3]


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 12.0))
@settings(max_examples=60, deadline=None)
def test_the_offsets_agree_with_all_stretches_tried_one_by_one(seed, radius):
    line = crooked(seed)
    steps = np.diff(line, axis=0)
    sizes = np.hypot(*steps.T)
    turns = [math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]) for a, b in pairwise(steps)]
    stations = np.cumsum(sizes)
    expected = np.zeros(len(turns))
    for i in range(len(turns)):
        for j in range(i, len(turns)):
            angle, length = abs(sum(turns[i : j + 1])), stations[j] - stations[i]
            if length > math.pi * radius:
                continue
            half_secant = 1 / math.cos(angle / 2) if angle < math.pi else math.inf
            cost = (radius - length / angle) * min(half_secant - 1, 2)
            expected[i : j + 1] = np.maximum(expected[i : j + 1], cost)
    found = tight_turns([line], radius)
    inside = [
        max((o for o, s, e in zip(found.offset, found.start, found.end, strict=True) if s - 1e-9 <= at <= e + 1e-9),
            default=0.0)
        for at in stations[:-1]
    ]  # fmt: skip
    np.testing.assert_allclose(inside, expected, atol=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_a_mirrored_line_and_a_line_driven_the_other_way_cost_the_same(seed):
    line = crooked(seed)
    found, mirrored, back = (tight_turns([x], RADIUS) for x in (line, line * [1, -1], line[::-1]))
    np.testing.assert_allclose(mirrored.offset, found.offset)
    np.testing.assert_allclose(mirrored.angle, -found.angle)
    np.testing.assert_allclose(np.sort(back.offset), np.sort(found.offset))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_points_between_the_points_of_a_line_change_nothing(seed):
    line, rng = crooked(seed), np.random.default_rng(seed)
    share = np.unique(np.concatenate([np.arange(len(line)), rng.uniform(0, len(line) - 1, 60)]))
    finer = np.column_stack([np.interp(share, np.arange(len(line)), line[:, i]) for i in (0, 1)])
    doubled = np.repeat(line, 2, axis=0)
    for other in (finer, doubled):
        np.testing.assert_allclose(tight_turns([other], RADIUS).offset, tight_turns([line], RADIUS).offset, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 12.0))
@settings(max_examples=40, deadline=None)
def test_a_smaller_turning_radius_never_costs_more(seed, radius):
    assert worst(crooked(seed), 0.9 * radius) <= worst(crooked(seed), radius) + 1e-12
