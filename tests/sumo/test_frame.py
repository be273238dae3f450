"""Conversion of angles and positions between SUMO and the project: cases and round trips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from platoontraffic.sumo.frame import centre_of, front_of, heading_of, sumo_angle
from platoontraffic.sumo.placement_kernel import fill_in_poses

headings = st.floats(-np.pi, np.pi, exclude_min=True)
metres = st.floats(-1e6, 1e6)


@given(headings)
def test_heading_to_sumo_angle_and_back(heading):
    assert heading_of(sumo_angle(heading)) == pytest.approx(heading, abs=1e-12) or abs(heading) > np.pi - 1e-9


@pytest.mark.parametrize(("heading", "angle"), [(0, 90), (np.pi / 2, 0), (np.pi, 270), (-np.pi / 2, 180)])
def test_sumo_counts_clockwise_from_north(heading, angle):
    assert sumo_angle(heading) == pytest.approx(angle)


@given(metres, metres, headings, st.floats(0.1, 20))
def test_centre_to_front_bumper_and_back(x, y, heading, length):
    assert centre_of(*front_of(x, y, heading, length), heading, length) == pytest.approx((x, y), abs=1e-6)


def test_front_bumper_is_half_a_length_ahead():
    assert front_of(1.0, 2.0, np.pi / 2, 4.0) == pytest.approx((1.0, 4.0))


def test_poses_of_many_vehicles_are_those_of_each():
    rng, n = np.random.default_rng(1), 1000
    (x, y), heading = rng.uniform(-1e4, 1e4, (2, n)), rng.uniform(-np.pi, np.pi, n)
    length, poses = rng.uniform(0.2, 18.0, n), np.empty((3, n))
    assert fill_in_poses(x, y, heading, length, poses)
    np.testing.assert_array_equal(poses, [*front_of(x, y, heading, length), sumo_angle(heading)])
    x[7] = np.nan
    assert not fill_in_poses(x, y, heading, length, poses)
