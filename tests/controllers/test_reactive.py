"""The paper's leader: its seven rules, its sectors and the sign of its turn."""

import numpy as np
import pytest
import shapely

from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.controllers.reactive_rules import rule
from platoontraffic.lidar import PRESETS, Boxes, Scene
from tests.support.bench import LEADER_EYE, LOOP, asked, drive, platoon

EYE = PRESETS["paper-leader"]


@pytest.mark.parametrize(
    ("number", "front", "front_left", "front_right"),
    [
        (1, 3.0, 3.0, 0.6),
        (2, 0.8, 2.0, 0.6),  # a wall 0.8 m ahead, and the leader drives on
        (2, 1.5, 0.5, 0.6),
        (3, 0.8, 0.8, 0.4),
        (4, 0.8, 2.0, 0.4),
        (6, 3.0, 3.0, 0.4),
        (7, 3.0, 0.9, 0.6),
        (7, 3.0, 0.9, 0.4),
        (7, 0.8, 3.0, 1.0),
        (7, 3.0, 3.0, 0.5),  # the paper's signs are strict
    ],
)
def test_each_rule_applies_to_its_cases(number, front, front_left, front_right):
    assert rule(front, front_left, front_right) == number


def test_rules_are_tried_in_the_papers_order():
    """Where two rules apply, the first is taken. Rules 1, 3, 4 and 6 exclude each other by F, FL or FR."""
    assert rule(1.5, 2.0, 0.6) == 1  # also 2
    assert rule(1.5, 2.0, 0.8) == 1  # also 2 and 5
    assert rule(0.8, 0.8, 0.8) == 2  # also 3
    assert rule(0.8, 2.0, 0.8) == 2  # also 4


def test_rule_5_never_applies_and_each_other_one_does():
    rng = np.random.default_rng(5)
    values = rng.uniform(0.3, 3.0, (100_000, 3))
    near = rng.choice([0.5, 0.7, 1.0, 2.0, 3.0], values.shape) + rng.choice([-1e-9, 0, 1e-9], values.shape)
    values = np.where(rng.random(values.shape) < 0.5, values, near)
    assert set(np.vectorize(rule)(*values.T).tolist()) == {1, 2, 3, 4, 6, 7}


def turn_with_return_in(beam):
    """The right sector is 0-143, front-right 144-287, front 288-431, front-left 432-575, left 576-719."""
    ranges = np.full((1, 720), np.inf)
    ranges[0, beam] = 0.4
    speed, yaw_rate = asked(ReactiveLeader(), ranges, EYE).command
    return float(speed[0]), float(yaw_rate[0])


@pytest.mark.parametrize(
    ("beams", "twist"),
    [
        ((0, 143), (0.1, 0.0)),  # right: not asked, rule 1
        ((144, 287), (0.0, 0.1)),  # front-right: rule 6, to the left
        ((288, 431), (0.0, 0.0)),  # front alone: F < 1, FL = 3, so not even rule 2
        ((432, 575), (0.0, 0.0)),  # front-left alone: rule 7
        ((576, 719), (0.1, 0.0)),  # left: not asked
    ],
)
def test_sectors_are_144_beams_from_the_right(beams, twist):
    for beam in beams:
        assert turn_with_return_in(beam) == twist


@pytest.mark.parametrize(
    ("sector", "beam", "turns"),
    [("smallest", 144, True), ("mean", 144, False), ("middle", 144, False), ("middle", 216, True)],
)
def test_the_range_of_a_sector_is_its_smallest_or_its_mean_or_that_of_its_middle_beam(sector, beam, turns):
    """One return of 0.4 m in front-right, rule 6: the mean of 144 beams is hardly changed by it."""
    ranges = np.full((1, 720), np.inf)
    ranges[0, beam] = 0.4
    assert (asked(ReactiveLeader(sector=sector), ranges, EYE).command.yaw_rate[0] > 0) == turns
    ranges[0, 144:288] = 0.4
    assert asked(ReactiveLeader(sector=sector), ranges, EYE).command.yaw_rate[0] > 0


def test_each_vehicle_decides_by_its_own_scan():
    rng = np.random.default_rng(6)
    sectors = rng.choice([0.4, 0.6, 0.9, 1.5, np.inf, -np.inf, np.nan], (500, 5))
    scans = np.repeat(sectors, 144, axis=1)
    together = np.array(asked(ReactiveLeader(), scans, EYE).command)
    alone = [np.array(asked(ReactiveLeader(), [ranges], EYE).command)[:, 0] for ranges in scans]
    np.testing.assert_array_equal(together.T, alone)
    assert len(np.unique(together, axis=1).T) == 3  # on, turn, stand


@pytest.mark.parametrize(("sign", "yaw_rate"), [("clockwise", 0.1), ("counterclockwise", -0.1)])
def test_positive_turns_to_the_left_at_a_wall_only_if_the_papers_positive_is_clockwise(sign, yaw_rate):
    with np.errstate(divide="ignore"):
        wall = 0.45 / np.cos(EYE.angles)
    twist = asked(ReactiveLeader(positive_turn=sign), [np.where(wall > 3, np.inf, wall)], EYE).command
    assert (twist.speed[0], twist.yaw_rate[0]) == (0.0, yaw_rate)


def clearance(log):
    """Distance from the footprint to the outer wall of the loop [m], (k,); negative: through the wall."""
    one = np.ones(len(log.time))
    boxes = Boxes(log.x[:, 0], log.y[:, 0], log.heading[:, 0], 0.2 * one, 0.15 * one, np.arange(len(one)))
    x, y = np.moveaxis(boxes.corners(), 2, 0)
    return np.min([x, 6 - x, y, 5 - y], axis=(0, 2))


def around_the_loop(seconds, **law):
    return drive(platoon(ReactiveLeader(**law), at=(2.9, 0.5, 0.0), leader_eye=LEADER_EYE), LOOP, seconds)


def test_the_leader_keeps_the_right_lane_and_turns_the_first_two_corners():
    """FR > 0.5 m keeps the laser 0.5 sin 54 deg = 0.404 m from a wall on the right; started at 0.5 m."""
    log = around_the_loop(100.0)
    turned = np.degrees(log.turned[:, 0])
    assert turned[-1] > 170
    assert clearance(log).min() > 0.3
    for corner, aside in ((0, log.y[:, 0]), (90, 6 - log.x[:, 0])):
        straight = (np.abs(turned - corner) < 2) & (log.wanted_speed[:, 0] > 0)
        assert straight.sum() > 40 * 10
        assert aside[straight].min() > 0.404 - 0.001
        assert aside[straight].max() < 0.501


def test_with_the_other_sign_it_turns_right_and_into_the_wall():
    log = around_the_loop(60.0, positive_turn="counterclockwise")
    assert log.turned[-1, 0] < -np.pi / 2
    assert clearance(log)[-1] < 0


def test_the_leader_stands_for_ever_beside_a_wall_on_its_left():
    """0.7 m away: FL = 0.7 / sin 54 deg = 0.87 m, F = 0.7 / sin 18 deg = 2.27 m: rule 7."""
    wall = Scene.from_shapely(walls=[shapely.LineString([(-9, 0.7), (9, 0.7)])])
    log = drive(platoon(ReactiveLeader(), leader_eye=LEADER_EYE), wall, 5.0)
    assert not log.wanted_speed.any()
    assert not log.wanted_yaw_rate.any()
