"""The law `tracking` in tight turns, behind a leader that drives a line at the speed that it plans; without SUMO."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from platoontraffic.controllers import Decision, Law, Sensed
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracker.own_motion import steered
from platoontraffic.controllers.tracker.track import Track
from platoontraffic.controllers.tracker.trail import Trail
from platoontraffic.controllers.tracking import Memory, TrackingFollower
from platoontraffic.lidar import PRESETS, Mount, Noise
from platoontraffic.road.route import Route
from platoontraffic.vehicles.odometry import ODOMETRY
from tests.controllers.test_tracking_follower import BEHIND_BUMPER, CAR, DT, off_path
from tests.controllers.tracker.test_trail import odometry
from tests.support.bench import FAR, NO_WALLS, Log, drive, platoon

LIMIT = 30 / 3.6
NOISY = replace(PRESETS[TrackingFollower.lidar], mount=Mount(CAR.length / 2 - BEHIND_BUMPER))
EXACT = replace(NOISY, noise=Noise())


@dataclass(frozen=True)
class Remembering(Law):
    """The law, and what it remembers at each instant."""

    law: Law
    memories: list[Memory] = field(default_factory=list, compare=False)

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        decision = self.law(sensed, memory, dt)
        self.memories.append(decision.memory)
        return decision


def line_of(*pieces: tuple[float, float]) -> np.ndarray:
    """A line of straights (length, 0) and turns (radius, angle to the left) [m], [rad]; (k, 2)."""
    points, heading = [np.zeros(2)], 0.0
    for size, angle in pieces:
        count = max(round(abs(angle) * size), 1) if angle else 1
        for _ in range(count):
            step = 2 * size * math.sin(abs(angle) / count / 2) if angle else size
            heading += angle / count / 2
            points.append(points[-1] + step * np.array([math.cos(heading), math.sin(heading)]))
            heading += angle / count / 2
    return np.array(points)


RIGHT_ANGLE = line_of((60.0, 0.0), (6.0, math.pi / 2), (330.0, 0.0))
S_BEND = line_of((60.0, 0.0), (6.0, math.pi / 2), (6.0, -math.pi / 2), (330.0, 0.0))
KINK = np.array([(0.0, 0.0), (60.0, 0.0), (60 + 330 * math.cos(math.pi / 3), 330 * math.sin(math.pi / 3))])


def behind_a_leader(line: np.ndarray, followers: int, law: Law, eye=NOISY, errors="car", seconds=65.0, seed=0) -> Log:
    members = platoon(
        PathLeader(), law, followers, at=(-CAR.axle, 0.0, 0.0), distance=3.0, model=CAR, leader_eye=FAR, eye=eye,
        odometry=ODOMETRY[errors],
    )  # fmt: skip
    route = Route.along(("road",), line, np.full(len(line), LIMIT)).drivable_by(CAR)
    return drive([replace(members[0], route=route), *members[1:]], NO_WALLS, seconds, DT, seed=seed)


@pytest.mark.parametrize(
    ("line", "followers", "most"), [(RIGHT_ANGLE, 9, 0.3), (S_BEND, 9, 0.5), (KINK, 4, 0.4)], ids=["90", "S", "kink"]
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 3))])
def test_no_member_swings_out_after_a_tight_turn(line, followers, most, seed):
    log = behind_a_leader(line, followers, TrackingFollower(), seed=seed)
    assert max(off_path(log, i, 0) for i in range(1, followers + 1)) < most
    assert log.locked().mean() > 0.95


def test_own_motion_does_not_turn_in_a_tight_turn():
    """The yaw rate is measured ten times a second, while the steering moves."""
    law = Remembering(TrackingFollower())
    log = behind_a_leader(S_BEND, 1, law, eye=EXACT, errors="none", seconds=30.0)
    heading = np.array([memory.odometry.heading[0] for memory in law.memories])
    assert np.abs(heading - log.turned[:, 1]).max() < math.radians(0.05)
    assert np.ptp(log.turned[:, 1]) > math.radians(60)
    bias = np.array([memory.yaw_bias.mean[0] for memory in law.memories])
    assert np.abs(bias).max() < math.radians(0.05)


@pytest.mark.parametrize("rate", [0.05, 0.148, np.inf])
@pytest.mark.parametrize("command", [0.2, -0.1, 0.011])
def test_steering_approaches_its_command_within_its_rate(command, rate):
    lag, dt, steps = 0.1, 0.1, 20000
    curvature, total = 0.01, 0.0
    for _ in range(steps):
        change = min(max((command - curvature) / lag, -rate), rate) * dt / steps
        total += (curvature + change / 2) / steps
        curvature += change
    assert steered(0.01, command, lag, rate, dt) == pytest.approx((curvature, total), abs=2e-6)


@pytest.mark.parametrize("radius", [5.0, 6.0, 12.0])
def test_the_curvature_of_a_circular_trail_is_that_of_the_circle(radius):
    """In a steady turn nobody cuts in: an error of the curvature would add to the offset from member to member."""
    angle = np.arange(-6.0, 12.0, 0.5) / radius
    points = np.zeros((1, len(angle), 3))
    points[0, :, 0], points[0, :, 1] = radius * np.sin(angle), radius * (1 - np.cos(angle))
    points[0, :, 2] = radius * angle
    trail, window = Trail(points, np.array([len(angle)])), np.array([2.4])
    ahead = trail.ahead(
        odometry(np.zeros(1)), Track.none(1), np.zeros(1, bool), (window / 2, window, window), np.zeros(1)
    )
    assert ahead.curvature[0] == pytest.approx(1 / radius, rel=2 * (2.4 / radius) ** 4 + 1e-3)
    assert ahead.offset[0] == pytest.approx(0.0, abs=1e-3)
