"""The law `tracking` with poor sensors: lost returns, slow scans, a yaw rate with a bias, delays."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.vehicles.odometry import ODOMETRY
from tests.controllers.test_tracking_follower import NOISY, cars, off_path, turn
from tests.controllers.test_tracking_vehicles import TRACKER, mixed


def energy(values: np.ndarray) -> np.ndarray:
    """Norm over time of values (k, n), (n,)."""
    return np.sqrt((values**2).sum(axis=0))


@pytest.mark.parametrize("share", [0.3, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_lost_returns_make_no_string_brake_without_cause(share, seed):
    """One scan with few returns on the predecessor does not look like its braking."""
    rain = replace(NOISY, noise=replace(NOISY.noise, dropout=share))
    omega = 2 * math.pi * 0.1

    def wave(time: float) -> tuple[float, float]:
        return (1.5 * omega * math.cos(omega * time) if 5 < time < 25 else 0.0), 0.0

    log = cars(wave, 40.0, 15.0, followers=6, eye=rain, seed=seed)
    driven = energy(log.acceleration)
    assert (driven[1:] / driven[:-1]).max() < 1.02
    assert log.acceleration.min() > 1.1 * log.acceleration[:, 0].min()
    assert log.locked().mean(axis=0).min() > 0.99


def test_a_fast_laser_sees_no_bends_in_its_noise():
    """At twenty scans a second a car has half as much way between two of them."""
    log = mixed(["car"] * 4, lambda time: (0.0, 0.0), 25.0, 15.0, laser=replace(TRACKER, rate=20.0), step=0.05)
    assert np.abs(log.acceleration[:, 1:]).max() < 0.5


@pytest.mark.parametrize(("radius", "speed"), [(6.0, 4.2), (15.0, 6.0)])
def test_turns_are_held_with_a_laser_of_five_scans_a_second(radius, speed):
    log = mixed(["car"] * 5, turn(radius, math.pi / 2, speed), speed, 30.0, laser=replace(TRACKER, rate=5.0))
    assert max(off_path(log, i, i - 1) for i in range(1, 5)) < 0.4
    assert log.locked()[::2].mean(axis=0).min() >= 0.99


@pytest.mark.parametrize(("radius", "speed"), [(6.0, 4.2), (12.0, 6.0)])
def test_a_bias_of_the_yaw_rate_is_learned_while_driving_straight(radius, speed):
    biased = replace(ODOMETRY["car"], yaw_rate_bias=math.radians(1.0))
    log = mixed(["car"] * 5, turn(radius, math.pi / 2, speed), speed, 30.0, odometry=biased)
    assert max(off_path(log, i, i - 1) for i in range(1, 5)) < 0.2
    assert log.locked().mean(axis=0).min() >= 0.99
