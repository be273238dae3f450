"""The remembered path of the predecessor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracker.trail import POINTS, Trail
from platoontraffic.controllers.tracker.trail_kernel import BEHIND
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.vehicles.motion import Drive
from tests.controllers.test_tracking_follower import CAR, DT, NOISY
from tests.support.bench import BLIND, NO_WALLS, Prescribed, drive, platoon


def odometry(x: np.ndarray) -> Odometry:
    return Odometry(x, *np.zeros((4, len(x))))


def seen_at(x: np.ndarray) -> Track:
    """Predecessors on the x axis, in the last scan."""
    track, mean = Track.none(len(x)), np.zeros((len(x), 6))
    mean[:, 0] = x
    return track._replace(mean=mean, blind=np.zeros(len(x)))


def test_a_trail_reaches_from_a_length_behind_the_own_axle_to_the_predecessor():
    trail, gap = Trail.begin(2), np.zeros(2, bool)
    for place in np.arange(0.0, 200.0):
        own = odometry(np.array([place, place / 2]))
        trail = trail.extended(seen_at(own.x + 20), own, gap)
    last = trail.points[np.arange(2), trail.size - 1]
    np.testing.assert_allclose(last[:, 0], own.x + 20, atol=1.0)
    np.testing.assert_allclose(trail.points[:, 0, 0], own.x - BEHIND, atol=1.0)


def test_extending_a_trail_leaves_the_given_one_as_it_was():
    before, own = Trail.begin(2), odometry(np.zeros(2))
    given = before.points.copy()
    after = before.extended(seen_at(np.array([10.0, 0.1])), own, np.zeros(2, bool))
    np.testing.assert_array_equal(before.points, given)
    np.testing.assert_array_equal(after.size, [3, 2])


def test_a_trail_that_is_full_forgets_its_oldest_quarter():
    trail, own = Trail.begin(1), odometry(np.zeros(1))
    for place in np.arange(1.0, POINTS):
        trail = trail.extended(seen_at(np.array([place])), own, np.zeros(1, bool))
    assert trail.size == POINTS + 1 - POINTS // 4
    assert trail.points[0, trail.size[0] - 1, 0] == POINTS - 1


@pytest.mark.parametrize("radius", [20.0, 25.0])
def test_followers_keep_their_distance_for_laps_of_a_small_circle(radius):
    """Where the trail of the lap before lies beside that of this one."""
    law, speed = TrackingFollower(), 8.0
    members = platoon(
        Prescribed(lambda time: Drive(0.0, 1 / radius)), law, 2, distance=law.desired_distance(speed), model=CAR,
        leader_eye=replace(BLIND, rate=1 / DT), eye=NOISY, speed=speed,
    )  # fmt: skip
    log = drive(members, NO_WALLS, 50.0, dt=DT)
    chord = np.hypot(np.diff(log.x, axis=1), np.diff(log.y, axis=1))[100:]
    assert np.ptp(chord) < 0.5
