"""The law `tracking` with scans and odometry that are used late: it predicts to the instant of use."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.tracker.prediction_kernel import EASING
from platoontraffic.controllers.tracker.records import OVERHANG, SPEED
from platoontraffic.controllers.tracking import HEADWAY_PER_DELAY, LEAST_HEADWAY, TrackingFollower
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import OdometryErrors
from tests.controllers.test_tracking_follower import CAR, DT, EXACT, turn
from tests.support.bench import BLIND, NO_WALLS, Log, Prescribed, amplitude, drive, platoon

LAW = TrackingFollower()
AT_ONCE = replace(CAR, lag=0.0, brake_lag=0.0, max_jerk=1e6)
ESTIMATE_LAG = 0.2  # of a predecessor's acceleration, T' of the law's docstring [s]


def late(at, seconds: float, speed: float, delay: float, *, odometry=None, followers=4, model=CAR, observe=None) -> Log:
    """odometry: its delay [s]; by default that of the scans"""
    members = platoon(
        Prescribed(lambda time: Drive(*at(time))), LAW, followers, distance=LAW.desired_distance(speed), model=model,
        leader_eye=replace(BLIND, rate=10.0), eye=replace(EXACT, delay=delay), speed=speed,
        odometry=OdometryErrors(delay=delay if odometry is None else odometry),
    )  # fmt: skip
    return drive(members, NO_WALLS, seconds, DT, observe or (lambda now: None))


def seen_ahead(now, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the predecessors' distances [m] and speeds [m/s] at the instant of use, on a straight, (n - 1,)."""
    fleet, memory = now.fleet, next(group.memory for group in now.fleet.groups if group.law is LAW)
    mean = memory.track.predicted(memory.odometry, delay).mean if delay else memory.track.mean
    x, _ = fleet.model.axle_position(fleet.motion)
    distance = np.hypot(mean[:, 0] - memory.odometry.x, mean[:, 1] - memory.odometry.y)
    distance = distance + CAR.length / 2 + CAR.axle - OVERHANG  # the law assumes an axle OVERHANG before the rear
    return distance - (x[:-1] - x[1:]), mean[:, SPEED] - fleet.motion.speed[:-1]


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.25, 0.3])
def test_at_constant_speed_the_estimate_at_the_instant_of_use_is_the_truth(delay):
    """And behind a leader that has accelerated by a since a time t up to the delay, a t^2 / 2 and a t behind it."""
    errors, begins, rate = {}, 6.0, 2.0
    steps = math.ceil(delay / DT)

    def observe(now) -> None:
        if now.time > 4.0:
            errors[round(now.time, 3)] = [one[0] for one in seen_ahead(now, steps * DT)]

    late(lambda time: (rate if time >= begins - 1e-6 else 0.0, 0.0), begins + 1.0, 20.0, delay, model=AT_ONCE,
         observe=observe)  # fmt: skip
    for time, (distance, speed) in errors.items():
        since = max(time - begins, 0.0)
        if since < steps * DT + 1e-6:
            assert distance == pytest.approx(-rate * since**2 / 2, abs=2e-3)
            assert speed == pytest.approx(-rate * since, abs=5e-3)


@pytest.mark.parametrize(
    ("scan", "odometry"), [(0.3, 0.3), (0.3, 0.0), (0.0, 0.3), (0.3, 0.15), (0.1, 0.4), (0.7, 0.2)]
)
def test_own_motion_is_known_now_and_at_the_scan(scan, odometry):
    """As by the readings, which come later; through a turn of 12 m, behind a leader that brakes and accelerates."""
    rows, (steps, reading_steps) = [], (math.ceil(delay / DT - 1e-9) for delay in (scan, odometry))

    def observe(now) -> None:
        memory = next(group.memory for group in now.fleet.groups if group.law is LAW)
        if memory is not None:
            then = memory.past.at(steps * DT, reading_steps * DT, DT)
            rows.append([pose[:4] for pose in (memory.past.at_reading(), memory.odometry, then)])

    bend = turn(12.0, math.pi / 2, 6.0, begins=8.0)
    late(lambda time: (math.sin(time), bend(time)[1]), 25.0, 6.0, scan, odometry=odometry, observe=observe)
    read, now, then = np.array(rows)[20:].transpose(1, 0, 2, 3)
    known = read[reading_steps:]
    for pose, true in (now[: len(known)], known), (then[steps:][: len(known) - steps], known[: -steps or None]):
        off = pose[: len(true)] - true
        assert np.hypot(off[:, 0], off[:, 1]).max() < 0.06
        assert np.abs(off[:, 2]).max() < 0.02
        assert np.abs(off[:, 3]).max() < 0.15


def string_gain(frequency: float, delay: float, headway: float = LAW.time_headway) -> float:
    """|G| of the law's docstring for the shipped car."""
    s = 2j * math.pi * frequency
    k, lag = LAW.distance_gain, (CAR.lag + CAR.brake_lag) / 2 + DT / 2
    rate = s / (1 + ESTIMATE_LAG * s)
    fades = math.exp(-delay / EASING)
    c = EASING * (1 - fades)
    g = EASING * (delay - c)
    ahead = (1 + lag * k) * (1 + c * rate) + k * (1 / s + delay + g * rate) + lag * fades * rate
    return abs(np.exp(-delay * s) * ahead / ((1 + lag * s) * (1 + headway * s) * (1 + k / s)))


@pytest.mark.parametrize("delay", [0.1, 0.3])
@pytest.mark.parametrize("frequency", [0.1, 0.2])
def test_a_string_follows_by_the_closed_form(frequency, delay):
    omega = 2 * math.pi * frequency
    log = late(lambda time: (1.0 * math.cos(omega * time), 0.0), 50.0, 20.0, delay)
    end = log.time > 50.0 - 20.0 - 1e-6
    of = amplitude(log.time[end], log.speed[end], omega)
    assert of[1:] / of[:-1] == pytest.approx(string_gain(frequency, delay), rel=0.05)


def test_with_the_least_headway_no_frequency_grows():
    for delay in np.arange(0.0, 1.05, 0.1):
        headway = LEAST_HEADWAY + HEADWAY_PER_DELAY * delay
        gains = [string_gain(frequency, delay, headway) for frequency in np.geomspace(0.005, 2.0, 200)]
        assert max(gains) < 1.002
    assert max(string_gain(frequency, 0.5, 0.8) for frequency in (0.05, 0.1, 0.2)) > 1.02
