"""The remembered path of the predecessor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracker.trail import POINTS, RouteSection, Strip, Trail
from platoontraffic.controllers.tracker.trail_kernel import BEHIND, first_return
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


def test_a_trail_along_the_end_of_a_route_goes_straight_on():
    """Where all points of the route ahead are one: the way the vehicle is headed, wherever the odometry began."""
    own = odometry(np.array([100.0]))._replace(heading=np.array([np.pi / 2]))
    points, distance = np.zeros((1, 3, 2)), np.array([[0.0, 1.0, 2.0]])
    section = RouteSection(np.ones(1, bool), points, distance, np.array([2.0]), np.array([0.5]))
    trail = Trail.begin(1).extended(Track.none(1), own, np.zeros(1, bool), section)
    assert trail.size == 2
    np.testing.assert_allclose(trail.points[0, :2], [[100, 0, 0], [100, 1, 1]], atol=1e-12)


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


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
@pytest.mark.parametrize(("radius", "out"), [(6.0, 1.4), (6.0, 1.8), (9.0, 1.3), (9.0, 1.4), (60.0, 1.05), (6.0, 3.0)])
def test_in_a_sharp_bend_the_strip_is_what_the_body_sweeps_where_its_front_swings_out(radius, out, side):
    """A return outside the path of the axle [m], in a bend that begins 5 m ahead, beside the body driven along it."""
    straight, turned = np.arange(-5.0, 5.0, 0.5), np.arange(0.0, 1.5, 0.5 / radius)
    x = np.concatenate([straight, 5 + radius * np.sin(turned)])
    y = side * np.concatenate([0 * straight, radius * (1 - np.cos(turned))])
    trail = Trail(np.column_stack([x, y, 0.5 * np.arange(len(x))])[None], np.array([len(x)]))
    where = 10 / radius  # angle of the place in the bend [rad]
    there = np.array([5 + (radius + out) * np.sin(where), side * (radius - (radius + out) * np.cos(where))])

    front, half = np.array([CAR.length / 2 - CAR.axle]), CAR.width / 2
    strip, free, first = Strip(*(np.array([size]) for size in (half + 0.15, 40.0, half))), np.empty(1), np.empty(1, int)
    far = np.hypot(*there)
    laser, ranges = (np.zeros(1), 0.0), np.array([[far]])
    skipped = np.full((1, 2), -1)
    first_return(
        trail, odometry(np.zeros(1)), strip, front, laser, ranges, (there / far)[:, None], skipped, free, first
    )

    driven = np.arange(0.0, 5 + 1.2 * radius, 0.02)
    angle = np.maximum(driven - 5, 0) / radius
    along = np.where(driven < 5, driven, 5 + radius * np.sin(angle))
    dx, dy = there[0] - along, there[1] - side * radius * (1 - np.cos(angle))
    ahead, aside = dx * np.cos(angle) + dy * side * np.sin(angle), dy * np.cos(angle) - dx * side * np.sin(angle)
    met = (ahead > -CAR.length / 2 - CAR.axle) & (ahead < front) & (np.abs(aside) < half)
    expected = driven[met][0] if met.any() else np.inf
    assert free[0] == pytest.approx(expected, abs=0.6)  # the points of the trail are 0.5 m apart


@pytest.mark.parametrize(("direction", "expected"), [(0.0, 0.0), (1.5, 0.0), (3.0, np.inf)])
def test_a_body_at_the_laser_is_in_the_way_if_it_is_not_behind(direction, expected):
    """A car of SUMO's had come over a member; it saw nothing, drove on, and into those that stood ahead of it."""
    x = np.arange(-5.0, 30.0, 0.5)
    trail = Trail(np.column_stack([x, 0 * x, x])[None], np.array([len(x)]))
    front, free, first = np.array([CAR.length / 2 - CAR.axle]), np.empty(1), np.empty(1, int)
    strip = Strip(*(np.array([size]) for size in (1.1, 40.0, 1.0)))
    beam = np.array([[np.cos(direction)], [np.sin(direction)]])
    for skipped in (-1, 0):
        seen = np.array([[-np.inf]]), beam, np.full((1, 2), skipped)
        first_return(trail, odometry(np.zeros(1)), strip, front, (front, 0.0), *seen, free, first)
        assert free[0] == expected
