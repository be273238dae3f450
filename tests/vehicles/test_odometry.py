"""Errors of own speed and yaw rate."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.lidar.noise import GOLDEN, gauss, mixed, scan_keys, sensor_keys
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors, measured
from platoontraffic.vehicles.records import stack

N, STEPS = 200, 200
IDS = tuple(f"car.{i}" for i in range(N))
SPEED, YAW_RATE = np.full(N, 20.0), np.full(N, 0.1)


def readings(errors: OdometryErrors, ids=IDS, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Errors (steps, n) of speed and of yaw rate."""
    own = [
        measured(stack([errors] * len(ids)), ids, SPEED[: len(ids)], YAW_RATE[: len(ids)], seed, k)
        for k in range(STEPS)
    ]
    return np.array([one.speed for one in own]) - 20.0, np.array([one.yaw_rate for one in own]) - 0.1


def test_errors_have_the_declared_standard_deviations():
    speed, yaw_rate = readings(OdometryErrors(0.01, 0.05, 0.002, 0.004))
    assert speed.mean(axis=0).std() == pytest.approx(0.2, rel=0.15)  # kept: 1 % of 20 m/s
    assert (speed - speed.mean(axis=0)).std() == pytest.approx(0.05, rel=0.03)
    assert yaw_rate.mean(axis=0).std() == pytest.approx(0.002, rel=0.15)
    assert (yaw_rate - yaw_rate.mean(axis=0)).std() == pytest.approx(0.004, rel=0.03)
    assert np.abs(np.corrcoef(speed[0], yaw_rate[0])[0, 1]) < 0.25


def test_errors_depend_on_seed_vehicle_and_step_alone():
    errors = OdometryErrors(0.01, 0.05, 0.002, 0.004)
    one, other = readings(errors), readings(errors, IDS[::-1])
    assert (one[0] == other[0][:, ::-1]).all()
    assert (one[1] == other[1][:, ::-1]).all()
    assert (readings(errors, seed=2)[0] != one[0]).all()


def test_a_standing_vehicle_measures_speed_0_and_yaw_rate_0():
    own = measured(stack([ODOMETRY["car"]] * 2), ("a", "b"), np.array([0.0, 0.01]), np.array([0.0, 0.0]), 1, 1)
    assert own.speed[0] == own.yaw_rate[0] == 0
    assert own.speed[1] >= 0
    assert own.yaw_rate[1] != 0


def test_odometry_without_errors_is_the_truth():
    own = measured(stack([ODOMETRY["none"]] * N), IDS, SPEED, YAW_RATE, 1, 1)
    assert (own.speed == SPEED).all()
    assert (own.yaw_rate == YAW_RATE).all()


def test_the_kernel_draws_as_the_formula_for_arrays():
    rng = np.random.default_rng(3)
    errors = OdometryErrors(0.01, 0.05, 0.002, 0.004)
    speed, yaw_rate = rng.uniform(0, 0.2, N) * rng.integers(0, 2, N), rng.normal(0, 0.1, N) * rng.integers(0, 2, N)
    own = measured(stack([errors] * N), IDS, speed, yaw_rate, 7, 30)
    keys = sensor_keys(7, tuple(f"{name} odometry" for name in IDS))
    now = scan_keys(keys, 30)
    driven = speed * (1 + 0.01 * gauss(mixed(keys))) + 0.05 * gauss(mixed(now))
    turned = yaw_rate + 0.002 * gauss(mixed(keys + GOLDEN)) + 0.004 * gauss(mixed(now + GOLDEN))
    stands = (speed == 0) & (yaw_rate == 0)
    assert 20 < stands.sum() < 80
    assert (own.speed == np.where(stands, 0.0, np.maximum(driven, 0.0))).all()
    assert (own.yaw_rate == np.where(stands, 0.0, turned)).all()


def test_a_robot_that_turns_on_the_spot_or_reverses_is_measured():
    """It counted as standing, as the paper's leader does at every corner; and one that reversed as slow."""
    errors = stack([OdometryErrors(yaw_rate_noise=0.01), OdometryErrors(), OdometryErrors(speed_noise=0.001)])
    own = measured(errors, ("a", "b", "c"), np.array([0.0, 0.0, -0.2]), np.array([0.1, 0.1, 0.0]), 0, 3)
    assert own.yaw_rate[0] == pytest.approx(0.1, abs=0.05)
    assert own.yaw_rate[0] != 0.1
    assert own.yaw_rate[1] == 0.1
    assert own.speed[:2].tolist() == [0.0, 0.0]
    assert own.speed[2] == pytest.approx(-0.2, abs=0.01)
