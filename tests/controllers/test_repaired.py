"""The repaired follower: equal to the printed one without repairs, and worse without any one of them."""

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.printed import SPEED_GAIN, PrintedFollower, middle
from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.lidar import PRESETS
from tests.support.bench import (
    FOLLOWER_EYE,
    LEADER_EYE,
    LOOP,
    NO_WALLS,
    asked,
    batch_of,
    constant,
    drive,
    platoon,
    rear_at,
)

EYE = PRESETS["paper-follower"]
REPAIRED = RepairedFollower()


def random_scans(n, rng):
    """Pieces of random length and range, with misses, returns too near and failures; (n, 720)."""
    scans = np.empty((n, 720))
    for ranges in scans:
        pieces = rng.choice([rng.uniform(0.05, 1.0), 0.3, 1.0, np.inf, -np.inf, np.nan, *rng.uniform(0.3, 1.0, 6)], 8)
        ends = np.sort(rng.integers(0, 720, 7))
        ranges[:] = np.repeat(pieces, np.diff([0, *ends, 720])) + rng.choice([0.0, 1e-3, 0.02]) * rng.random(720)
    return scans


def test_with_all_repairs_off_it_is_the_printed_law():
    scans = random_scans(2000, np.random.default_rng(7))
    off = asked(RepairedFollower(nearest_group=False, visible_middle=False, stand_off=0.0), scans)
    printed = asked(PrintedFollower(), scans)
    np.testing.assert_array_equal(off.command, printed.command)
    np.testing.assert_array_equal(off.target, printed.target)
    assert 0.2 < (printed.command.speed > 0).mean() < 0.95


@pytest.mark.parametrize("visible_middle", [True, False])
def test_the_middle_is_that_of_the_papers_formulas(visible_middle):
    law, batch = RepairedFollower(visible_middle=visible_middle), batch_of(random_scans(500, np.random.default_rng(9)))
    ranges, ends = law.nearest(batch)
    whole = visible_middle | ((ends[0] > 0) & (ends[1] < 719))
    np.testing.assert_array_equal(law.find(batch), middle(EYE, ranges, np.where(whole, ends, -1)))


def test_beams_out_of_view_count_as_without_a_return():
    batch = batch_of(random_scans(500, np.random.default_rng(10)))
    ranges = batch.ranges.copy()
    ranges[:, :200] = ranges[:, 500:] = np.inf
    seen = REPAIRED.nearest_middle(batch, (200, 500))
    np.testing.assert_array_equal(seen, REPAIRED.find(batch_of(ranges)))
    assert np.isfinite(seen.distance).mean() > 0.3


@pytest.mark.parametrize("nearest_group", [True, False])
@pytest.mark.parametrize("visible_middle", [True, False])
def test_each_vehicle_decides_by_its_own_scan(nearest_group, visible_middle):
    law = RepairedFollower(nearest_group, visible_middle)
    scans = random_scans(300, np.random.default_rng(8))
    together = asked(law, scans)
    for i, ranges in enumerate(scans):
        alone = asked(law, [ranges])
        np.testing.assert_array_equal(alone.command, np.array(together.command)[:, [i]])
        np.testing.assert_array_equal(alone.target, np.array(together.target)[:, [i]])
    assert np.isfinite(together.target.distance).mean() > 0.05


def group_by_walking(ranges, step):
    """First and last beam: from the nearest return to both sides, over lost returns, to a miss or a step."""
    near = np.where(np.isneginf(ranges), EYE.range_min, ranges)
    ends = []
    for way in (-1, 1):
        at = end = int(np.nanargmin(near))
        while 0 <= at + way < len(near):
            at += way
            if np.isnan(near[at]):
                continue
            if not abs(near[at] - near[end]) <= step:
                break
            end = at
        ends.append(end)
    return ends


def test_group_is_what_a_walk_from_the_nearest_return_to_both_sides_finds():
    rng = np.random.default_rng(9)
    scans = random_scans(1000, rng)
    scans[rng.random(scans.shape) < rng.choice([0, 0.02, 0.5], (1000, 1))] = np.nan
    scans = scans[(scans < np.inf).any(axis=1)]
    expected = [group_by_walking(ranges, REPAIRED.group_step) for ranges in scans]
    _, ends = REPAIRED.nearest(batch_of(scans))
    np.testing.assert_array_equal(ends.T, expected)
    _, none = REPAIRED.nearest(batch_of([np.full(720, np.inf), np.full(720, np.nan)]))
    np.testing.assert_array_equal(none, -1)


def to_the_first_corner(law, seconds=65.0):
    """Three robots on the loop road, the leader by Algorithm 1, from 4.2 m; the corner is at 5.46 m."""
    members = platoon(ReactiveLeader(), law, 2, at=(4.2, 0.5, 0.0), leader_eye=LEADER_EYE, distance=0.48)
    return drive(members, LOOP, seconds)


def first_loss(log):
    """First step in which a follower's target is not its predecessor."""
    lost = ~log.locked().all(axis=1)
    assert lost.any()
    return int(lost.argmax())


@pytest.mark.slow
def test_with_all_repairs_it_is_locked_on_in_every_step_of_the_first_corner():
    log = to_the_first_corner(REPAIRED, 75.0)
    assert log.locked().all()
    assert (np.degrees(log.turned[-1]) > 85).all()
    assert np.nanmin(log.distance) > 0.36


def test_without_nearest_group_it_loses_its_predecessor_on_the_straight():
    """A 0.5 m edge exists up to 1.0 - 0.5 m; the wanted distance at 0.1 m/s is 0.45 + 0.09 m."""
    log = to_the_first_corner(RepairedFollower(nearest_group=False), 10.0)
    i = first_loss(log)
    assert log.turned[i, 0] == 0
    assert log.distance[i - 1, 1] == pytest.approx(0.5, abs=0.01)
    assert np.isnan(log.distance[-1, 1])
    assert log.wanted_speed[-1, 1:].max() < 1e-3  # all followers stand


def test_without_visible_middle_it_loses_its_predecessor_when_that_turns_on_the_spot():
    """The tail swings, a corner leaves the view of 11.5 deg, and with it the whole target."""
    log = to_the_first_corner(RepairedFollower(visible_middle=False), 30.0)
    i = first_loss(log)
    assert 5 < np.degrees(log.turned[i, 0]) < 45
    assert log.wanted_speed[i, 0] == 0
    assert np.isnan(log.distance[-1, 1])
    assert log.turned[-1, 1] < 0.1


def test_without_stand_off_it_comes_too_near_for_its_laser_and_loses_its_predecessor():
    """The wanted distance at 0.1 m/s is 0.09 m; nearer than 0.30 m there is no range."""
    log = to_the_first_corner(RepairedFollower(stand_off=0.0), 5.0)
    i = first_loss(log)
    assert log.time[i] < 4
    assert np.nanmin(log.distance[: i + 1]) == pytest.approx(FOLLOWER_EYE.range_min, abs=0.01)


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.2])
def test_steady_distance_is_the_stand_off_and_0_900_s(speed):
    """6 s leave exp(-6.7) of the 2 cm it starts with."""
    wanted = 0.45 + speed / 1.1107
    log = drive(platoon(constant(speed), REPAIRED, 1, distance=wanted + 0.02), NO_WALLS, 6.0)
    assert log.locked().all()
    assert log.distance[-1, 1] == pytest.approx(wanted, rel=1e-3)
    assert REPAIRED.desired_distance(speed) == pytest.approx(wanted, rel=1e-4)


def test_nearer_never_means_faster():
    distances = np.linspace(0.31, 0.98, 300)
    speed = asked(REPAIRED, [rear_at(d, 0.15) for d in distances]).command.speed
    assert (np.diff(speed) >= 0).all()
    assert not speed[distances < 0.45].any()
    np.testing.assert_allclose(speed, np.maximum(SPEED_GAIN * (distances - 0.45), 0), atol=1e-9)


def test_something_too_near_to_be_measured_stops_it():
    ranges = rear_at(0.8, 0.15)
    ranges[300:420] = -np.inf
    assert not asked(REPAIRED, [ranges]).command.speed.any()


def test_a_return_at_the_laser_itself_stops_it():
    """The sensor is inside a solid and has no blind zone, so that the distance is 0 and the angle any."""
    decision = asked(REPAIRED, [np.full(720, -np.inf)], replace(EYE, range_min=0.0))
    assert decision.target.distance == 0
    assert decision.command.speed == 0


def test_mirrored_scan_mirrors_the_turn():
    """One robot in view; of two at one distance the law takes the right-hand one."""
    rng = np.random.default_rng(3)
    scans = np.array([rear_at(d, w, b) for d, w, b in rng.uniform((0.31, 0.05, -0.25), (0.95, 0.3, 0.25), (200, 3))])
    seen, mirrored = asked(REPAIRED, scans), asked(REPAIRED, scans[:, ::-1])
    np.testing.assert_allclose(mirrored.command.yaw_rate, -seen.command.yaw_rate, atol=1e-12)
    np.testing.assert_allclose(mirrored.target.distance, seen.target.distance, rtol=1e-12)
    assert np.isfinite(seen.target.distance).mean() > 0.9


def test_a_wall_behind_the_robot_is_not_joined_to_it():
    ranges = rear_at(0.6, 0.1)
    robot = np.flatnonzero(np.isfinite(ranges))
    wall = np.where(np.isinf(ranges), 0.75 / np.cos(EYE.angles), ranges)
    aside = ranges.copy()
    aside[robot] = np.inf
    aside[robot + 60] = ranges[robot]  # it is followed there
    distance, theta = REPAIRED.find(batch_of([wall, ranges, aside]))
    assert (distance[0], theta[0]) == (distance[1], theta[1])
    assert distance == pytest.approx([0.6] * 3, abs=1e-6)
    assert theta[2] == pytest.approx(np.pi / 2 + 60 * EYE.angle_increment, abs=1e-9)


def test_the_visible_part_of_a_robot_at_the_border_is_followed_into_view():
    for side in (1, -1):
        ranges = rear_at(0.6, 0.15, side * EYE.angle_max)
        assert np.isfinite(ranges[-1 if side > 0 else 0])
        decision = asked(REPAIRED, [ranges])
        assert 0 < side * decision.target.bearing[0] < EYE.angle_max
        assert side * decision.command.yaw_rate[0] > 0
        assert np.isnan(RepairedFollower(visible_middle=False).find(batch_of([ranges])).distance)
