"""Errors of own speed and yaw rate."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors, measured

N, STEPS = 200, 200
IDS = tuple(f"car.{i}" for i in range(N))
SPEED, YAW_RATE = np.full(N, 20.0), np.full(N, 0.1)


def readings(errors: OdometryErrors, ids=IDS, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Errors (steps, n) of speed and of yaw rate."""
    told = [measured([errors] * len(ids), ids, SPEED[: len(ids)], YAW_RATE[: len(ids)], seed, k) for k in range(STEPS)]
    return np.array([one.speed for one in told]) - 20.0, np.array([one.yaw_rate for one in told]) - 0.1


def test_errors_have_the_deviations_that_are_said():
    speed, yaw_rate = readings(OdometryErrors(0.01, 0.05, 0.002, 0.004))
    assert speed.mean(axis=0).std() == pytest.approx(0.2, rel=0.15)  # kept: 1 % of 20 m/s
    assert (speed - speed.mean(axis=0)).std() == pytest.approx(0.05, rel=0.03)
    assert yaw_rate.mean(axis=0).std() == pytest.approx(0.002, rel=0.15)
    assert (yaw_rate - yaw_rate.mean(axis=0)).std() == pytest.approx(0.004, rel=0.03)
    assert np.abs(np.corrcoef(speed[0], yaw_rate[0])[0, 1]) < 0.25


def test_they_are_of_seed_vehicle_and_step_alone():
    errors = OdometryErrors(0.01, 0.05, 0.002, 0.004)
    one, other = readings(errors), readings(errors, IDS[::-1])
    assert (one[0] == other[0][:, ::-1]).all()
    assert (one[1] == other[1][:, ::-1]).all()
    assert (readings(errors, seed=2)[0] != one[0]).all()


def test_who_stands_knows_it():
    told = measured([ODOMETRY["car"]] * 2, ("a", "b"), np.array([0.0, 0.01]), np.array([0.0, 0.0]), 1, 1)
    assert told.speed[0] == told.yaw_rate[0] == 0
    assert told.speed[1] >= 0
    assert told.yaw_rate[1] != 0


def test_without_errors_it_is_as_it_is():
    told = measured([ODOMETRY["none"]] * N, IDS, SPEED, YAW_RATE, 1, 1)
    assert (told.speed == SPEED).all()
    assert (told.yaw_rate == YAW_RATE).all()
