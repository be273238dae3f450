"""Steering to a path: its stability argument, step by step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from platoontraffic.controllers.steering import STEEPEST, Errors, curvature_along, curvature_back


def back(offset, off_heading, catch_up=5.0, greatest=0.2):
    errors = Errors(np.atleast_1d(float(offset)), np.atleast_1d(float(off_heading)))
    return float(curvature_back(errors, np.array([catch_up]), np.array([greatest]))[0])


def lyapunov(offset, off_heading, catch_up, greatest):
    """V of the docstring."""
    steepest = min(STEEPEST, 0.45 * catch_up * greatest)
    linear = min(abs(offset), 2 * catch_up * steepest)
    area = linear**2 / (4 * catch_up) + (abs(offset) - linear) * steepest
    return 2 / catch_up * area + 4 * (1 - np.cos(off_heading / 2))


@given(
    offset=st.floats(-60, 60),
    off_heading=st.floats(-3.1, 3.1),
    catch_up=st.floats(2.0, 15.0),
    greatest=st.floats(0.02, 0.3),
)
def test_from_any_offset_and_heading_the_lyapunov_function_falls(offset, off_heading, catch_up, greatest):
    step = 0.01
    before = lyapunov(offset, off_heading, catch_up, greatest)
    turn = back(offset, off_heading, catch_up, greatest) * step
    after = lyapunov(offset + np.sin(off_heading) * step, off_heading + turn, catch_up, greatest)
    assert after <= before + 1e-4 * (1 + before)


def test_it_reaches_the_path_and_stays():
    """Eight vehicles at once, as the loop of steps is what takes long."""
    begun, sharpest = np.array([(3.0, 0.0), (-40.0, 1.0), (0.5, 3.0), (100.0, -3.1)]), (0.03, 0.2)
    (e, p), greatest, step = np.tile(begun.T, len(sharpest)), np.repeat(sharpest, len(begun)), 0.02
    catch_up = np.full(len(e), 5.0)
    for _ in range(int(3000 / step)):
        e, p = e + np.sin(p) * step, p + curvature_back(Errors(e, p), catch_up, greatest) * step
    assert np.abs(e).max() < 1e-6
    assert np.abs(p).max() < 1e-6


def test_near_the_path_both_poles_are_at_one_over_the_catch_up_distance():
    """e(s) = (1 + s / c) exp(-s / c) of the offset, from rest on a parallel course."""
    e, p, catch_up, step = 0.01, 0.0, 4.0, 0.001
    for _ in range(int(8.0 / step)):
        e, p = e + np.sin(p) * step, p + back(e, p, catch_up) * step
    assert e == pytest.approx(0.01 * 3 * np.exp(-2), rel=0.01)


@given(offset=st.floats(-60, 60), off_heading=st.floats(-3, 3))
def test_mirrored_errors_are_steered_to_the_other_side_and_never_beyond_the_limit(offset, off_heading):
    assert back(-offset, -off_heading) == -back(offset, off_heading)
    assert abs(back(offset, off_heading)) <= 0.2


@pytest.mark.parametrize("offset", [-3.0, 0.0, 2.0])
def test_beside_a_circle_it_drives_the_circle_about_the_same_centre(offset):
    """To the left of a left turn of radius 10 m lies its inside."""
    errors = Errors(np.array([offset]), np.zeros(1))
    assert curvature_along(errors, np.array([0.1])) == pytest.approx(1 / (10 - offset))
