"""Speed and acceleration of obstacles from successive free distances, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.controllers.tracker.obstacle_kernel import MEMORY, SAME, follow_obstacle
from platoontraffic.controllers.tracking import Obstacle

DT = 0.1


def followed(free: np.ndarray, own_speed: np.ndarray, dt: float = DT) -> Obstacle:
    """Speeds and accelerations after each scan, (k,), of one obstacle at distances (k,) [m]."""
    last, found = Obstacle.none(1), []
    for k in range(len(free)):
        speed, acceleration = np.empty((2, 1))
        before = own_speed[[max(k - 1, 0)]]
        follow_obstacle(free[[k]], own_speed[[k]], last, before, dt, speed, acceleration)
        last = Obstacle(free[[k]], speed, acceleration, np.full(1, math.nan))
        found.append((speed[0], acceleration[0]))
    speeds, accelerations = np.array(found).T
    return Obstacle(free, speeds, accelerations, np.full(len(free), math.nan))


def motion(speed: float, acceleration: np.ndarray, dt: float = DT) -> tuple[np.ndarray, np.ndarray]:
    """Place and speed at the instants of scans, with an acceleration from each to the next, (k + 1,)."""
    speeds = speed + np.cumsum([0.0, *acceleration * dt])
    return np.cumsum([0.0, *(speeds[1:] + speeds[:-1]) / 2 * dt]), speeds


@settings(deadline=None)
@given(st.floats(0, 30), st.floats(-9, 0), st.floats(10, 30), st.floats(-9, 3), st.sampled_from([0.025, 0.05, 0.1]))
def test_errors_of_both_fade_by_one_factor_a_scan_whatever_the_own_motion(
    speed, acceleration, own, own_acceleration, dt
):
    theirs, _ = motion(speed, np.full(12, acceleration), dt)
    mine, own_speed = motion(own, np.full(12, own_acceleration), dt)
    found = followed(60 + theirs - mine, own_speed, dt)
    # The first speed is the mean over its scan, acceleration dt / 2 off; the first acceleration is 0.
    error_speed = speed + acceleration * dt * np.arange(13) - found.speed
    error_acceleration = acceleration - found.acceleration
    f, k = math.exp(-dt / MEMORY), np.arange(1, 13)
    assert np.isnan(found.speed[0])
    assert error_speed[1] == pytest.approx(acceleration * dt / 2, abs=1e-6)
    # Both obey x(k + 2) = 2 f x(k + 1) - f^2 x(k), which has the one double root f.
    for error in (error_speed[k], error_acceleration[k]):
        assert error[2:] == pytest.approx(2 * f * error[1:-1] - f**2 * error[:-2], abs=1e-6)


def test_hard_braking_is_known_within_three_scans():
    theirs, _ = motion(25.0, np.repeat([0.0, -9.0], 10))
    mine, own_speed = motion(25.0, np.zeros(20))
    found = followed(20 + theirs - mine, own_speed)
    assert found.acceleration[:11][2:] == pytest.approx(0.0, abs=1e-9)
    assert found.acceleration[13] < -6.0
    assert found.acceleration[16] == pytest.approx(-9.0, abs=0.3)


def test_another_obstacle_begins_anew():
    free = np.array([20.0, 19.0, 18.0, 18.0 - 1.1 - SAME, 15.9 - 1.0, 14.9 - 1.0, math.inf, 13.0])
    found = followed(free, np.full(8, 20.0))
    assert np.isnan(found.speed).tolist() == [True, False, False, True, False, False, True, True]
    assert found.speed[[1, 2, 5]] == pytest.approx(10.0)


def test_rows_do_not_depend_on_each_other():
    rng = np.random.default_rng(3)
    free, last = rng.uniform(5, 6, 6), Obstacle(*rng.uniform(5, 6, (4, 6)))
    own, before = rng.uniform(5, 6, (2, 6))
    together, alone = np.empty((2, 6)), np.empty((2, 6))
    follow_obstacle(free, own, last, before, DT, *together)
    for i in range(6):
        one = slice(i, i + 1)
        follow_obstacle(free[one], own[one], Obstacle(*(c[one] for c in last)), before[one], DT, *alone[:, one])
    assert np.array_equal(together, alone, equal_nan=True)
