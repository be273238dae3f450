"""Estimation of the predecessor, against truth and against its own covariance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from platoontraffic.controllers.tracker.records import ACCELERATION, CURVATURE, HEADING, OVERHANG, SPEED
from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.observation.instant import Instant
from platoontraffic.vehicles.motion import Drive
from tests.controllers.test_tracking_follower import CAR, DT, EXACT, NOISY, s_bend, straight_on, turn
from tests.support.bench import BLIND, NO_WALLS, Prescribed, drive, platoon

LAW = TrackingFollower()


class Errors(NamedTuple):
    """Errors (k, n, 6): along and across the predecessor's heading, heading, speed, acceleration, curvature."""

    error: np.ndarray
    claimed: np.ndarray  # standard deviations
    nis: np.ndarray  # (k, n)
    blind: np.ndarray


HERE = Odometry.begin(np.zeros(1), np.zeros(1))


def tracked(at, seconds: float, speed: float, eye=NOISY, followers: int = 6, seed: int = 0, distance=None) -> Errors:
    law = LAW if distance is None else replace(LAW, stand_off=distance - LAW.time_headway * speed)
    members = platoon(
        Prescribed(lambda time: Drive(*at(time))), law, followers, distance=law.desired_distance(speed), model=CAR,
        leader_eye=replace(BLIND, rate=10.0), eye=eye, speed=speed,
    )  # fmt: skip
    rows = []

    def observe(now: Instant) -> None:
        fleet = now.fleet
        motion, (memory,) = fleet.motion, [group.memory for group in fleet.groups if group.law is law]
        x, y = fleet.model.axle_position(motion)
        ahead, own = slice(None, -1), slice(1, None)
        dx, dy = x[ahead] - x[own], y[ahead] - y[own]
        cos, sin = np.cos(motion.heading[own]), np.sin(motion.heading[own])
        odometry, mean = memory.odometry, memory.track.mean
        # Both relative to the own axle; odometry has no errors here.
        mx, my = mean[:, 0] - odometry.x, mean[:, 1] - odometry.y
        mcos, msin = np.cos(odometry.heading), np.sin(odometry.heading)
        off_x = mcos * mx + msin * my - (cos * dx + sin * dy)
        off_y = mcos * my - msin * mx - (cos * dy - sin * dx)
        heading = motion.heading[ahead] - motion.heading[own]
        along = off_x * np.cos(heading) + off_y * np.sin(heading)
        across = off_y * np.cos(heading) - off_x * np.sin(heading)
        turned = np.remainder(mean[:, HEADING] - odometry.heading - heading + np.pi, 2 * np.pi) - np.pi
        curvature = motion.yaw_rate[ahead] / np.maximum(motion.speed[ahead], 0.5)
        error = np.column_stack([
            # The law assumes that every car's axle is OVERHANG before its rear.
            along + (CAR.length / 2 + CAR.axle - OVERHANG), across, turned, mean[:, SPEED] - motion.speed[ahead],
            mean[:, ACCELERATION] - motion.acceleration[ahead], mean[:, CURVATURE] - curvature,
        ])  # fmt: skip
        claimed = np.sqrt(np.diagonal(memory.track.cov, axis1=1, axis2=2))
        rows.append((error, claimed, memory.track.nis, memory.track.blind))

    drive(members, NO_WALLS, seconds, DT, observe, seed=seed)
    return Errors(*(np.array(column) for column in zip(*rows[20:], strict=True)))


@pytest.mark.parametrize(
    ("at", "seconds", "speed"),
    [(straight_on, 15.0, 30.0), (turn(8.0, math.pi / 2, 5.0), 25.0, 5.0), (s_bend(6.0), 45.0, 6.0)],
    ids=["straight", "junction turn", "S-bend"],
)
def test_without_noise_the_estimate_is_the_truth(at, seconds, speed):
    found = tracked(at, seconds, speed, EXACT)
    assert (found.blind == 0).all()
    worst = np.abs(found.error).max(axis=(0, 1))
    assert (worst < [0.02, 0.05, 0.02, 0.1, 1.0, 0.06]).all()


@pytest.mark.parametrize("sigma", [0.01, 0.02, 0.03])
@pytest.mark.parametrize("distance", [8.0, 15.0, 25.0, 40.0, 55.0])
def test_errors_match_the_estimated_covariance(sigma, distance):
    """By distance and noise; rounding and lower bounds of the measured variances make the covariance too wide."""
    eye = replace(NOISY, range_max=80.0, noise=replace(NOISY.noise, sigma=sigma))
    found = tracked(straight_on, 25.0, 15.0, eye, distance=max(distance, 15.5) if distance > 15 else distance + 0.5)
    nis = found.nis[~np.isnan(found.nis)]
    assert 0.2 < nis.mean() < 3.5  # 3 if all its assumptions held
    assert np.mean(nis > 11.3) < 0.02  # 0.01
    spread, claimed = found.error.std(axis=(0, 1)), np.median(found.claimed, axis=(0, 1))
    assert (spread < 1.5 * claimed).all()
    assert np.abs(found.error.mean(axis=(0, 1))[:4]).max() < 0.02  # no bias
    assert (found.blind == 0).mean() > 0.99


def test_speed_and_acceleration_of_a_braking_predecessor_are_known_soon():
    found = tracked(lambda time: ((-8.0 if time > 5 else 0.0), 0.0), 8.0, 25.0, followers=1)
    begins = round(5 / DT) - 20
    late = found.error[begins + 6 :, 0]
    assert np.abs(late[:, SPEED]).max() < 0.8
    assert np.abs(late[4:, ACCELERATION]).max() < 3


def test_odometry_integrates_arcs():
    odometry = Odometry.begin(np.array([5.0]), np.array([0.5]))
    for _ in range(round(2 * np.pi / 0.5 / 0.1)):
        odometry = odometry.moved(np.array([5.0]), np.array([0.5]), 0.1)
    turned = odometry.heading[0]
    assert odometry.x[0] == pytest.approx(10 * math.sin(turned), abs=1e-9)  # radius 10 m
    assert odometry.y[0] == pytest.approx(10 * (1 - math.cos(turned)), abs=1e-9)


def test_uncertainty_grows_out_of_sight_and_covers_unseen_braking():
    """The predecessor brakes at 4 m/s2."""
    mean = np.array([[20.0, 0.0, 0.0, 15.0, 0.0, 0.0]])
    spread_now = np.array([0.01, 0.02, 0.005, 0.1, 0.8, 0.003])
    track = Track(mean, np.diag(spread_now**2)[None], np.array([1.8]), np.zeros(1), np.zeros(1))
    spread = []
    for step in range(1, 11):
        track = track.predicted(HERE, DT)
        spread.append(np.sqrt(track.cov[0, 0, 0]))
        assert abs(20 + 15 * step * DT - 2 * (step * DT) ** 2 - track.mean[0, 0]) < 5 * spread[-1]
    assert (np.diff(spread) > 0).all()
    assert track.blind == pytest.approx(1.0)
    assert (np.linalg.eigvalsh(track.cov[0]) > 0).all()


def test_the_predicted_covariance_is_that_of_particles():
    """A second implementation: particles with random noise."""
    rng = np.random.default_rng(1)
    mean = np.array([0.0, 0.0, 0.3, 12.0, 0.5, 0.01])
    spread = np.array([0.1, 0.1, 0.02, 0.3, 0.5, 0.003])
    track = Track(mean[None], np.diag(spread**2)[None], np.array([1.8]), np.zeros(1), np.zeros(1)).predicted(HERE, 0.5)
    state = (mean + spread * rng.standard_normal((200_000, 6))).T
    steps = 50
    h = 0.5 / steps
    turning = min(0.08, 5.0 / 12**2)
    for _ in range(steps):
        x, y, heading, speed, acceleration, curvature = state
        state = np.array([
            x + speed * np.cos(heading) * h, y + speed * np.sin(heading) * h, heading + speed * curvature * h,
            speed + acceleration * h, acceleration * (1 - h / 2.0) + 2.0 * math.sqrt(h) * rng.standard_normal(len(x)),
            curvature + turning * math.sqrt(h) * rng.standard_normal(len(x)),
        ])  # fmt: skip
    assert track.mean[0] == pytest.approx(state.mean(axis=1), abs=0.06)
    ratio = np.sqrt(np.diagonal(track.cov[0])) / state.std(axis=1)
    assert ratio == pytest.approx(1, abs=0.12)


def test_an_empty_track_stays_empty():
    track = Track.none(3).predicted(Odometry.begin(np.zeros(3), np.zeros(3)), DT)
    assert not track.known.any()
    assert not track.seen.any()
    assert np.isnan(track.mean).all()
