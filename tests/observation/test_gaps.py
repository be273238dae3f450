"""The compiled gaps against their second implementation, bit for bit."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.observation.gaps import Gaps
from tests.support.gaps_by_arrays import GapsByArrays
from tests.support.observed import cars

N = 7
STATE = "gap", "cross_track", "_end", "_station", "_ahead", "beside", "_passed"


@pytest.mark.parametrize("seed", range(5))
def test_gaps_are_those_of_whole_arrays(seed):
    """Members that wander, stop, reverse, and now and then have another predecessor, or are driven by SUMO."""
    rng = np.random.default_rng(seed)
    members = cars(N - 1)
    one, other = Gaps(members), GapsByArrays(members)
    x, y, heading = -9.0 * np.arange(N), np.zeros(N), np.zeros(N)
    predecessor = np.arange(N) - 1
    step = _step(rng.permutation(N), predecessor, x, y, heading, np.zeros(N), np.zeros(N, bool))
    for gaps in (one, other):
        gaps.begin(step, np.arange(N))
    number, apart = step.fleet.number, 0
    for _ in range(300):
        if rng.random() < 0.05:
            predecessor = np.array([rng.integers(-1, i) for i in range(N)])
        speed = rng.choice([-1.0, 0.0, 0.5, 1.5], N)
        heading = heading + rng.normal(0, 0.2, N)
        x, y = x + speed * np.cos(heading), y + speed * np.sin(heading)
        step = _step(number, predecessor, x, y, heading, speed, rng.random(N) < 0.3)
        for gaps in (one, other):
            gaps.observe(step)
        for name in STATE:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), strict=True)
        apart += np.isfinite(one.gap).sum()
    assert apart > 300


@pytest.mark.parametrize(("aside", "is_known"), [(0.0, True), (3.2, True), (90.0, False)])
@pytest.mark.parametrize("speed", [0.0, 4.0])
def test_the_gap_to_a_new_predecessor_is_that_to_where_it_is_also_from_behind_its_start(speed, aside, is_known):
    """A member that was told to join another one 96 m ahead had a gap of 0.1 m, and a near miss."""
    gaps, n, x, y = Gaps(cars(N - 1)), np.arange(N), -200.0 * np.arange(N), np.zeros(N)
    x[1], y[1], speeds = x[0] - 115.0, aside, np.where(n == 1, 10.0, speed * (n == 0))
    alone, joined = np.full(N, -1), np.where(n == 1, 0, -1)
    for k in range(60):
        step = _step(n, alone if k < 2 else joined, x, y, np.zeros(N), speeds, np.zeros(N, bool))
        if k == 0:
            gaps.begin(step, n)
        gaps.observe(step)
        if k >= 2:
            model = step.fleet.model
            gap = x[0] - x[1] - model.length[0] / 2 - model.axle[0] - model.length[1] / 2 + model.axle[1]
            assert gaps.gap[1] == (pytest.approx(gap) if is_known else pytest.approx(np.nan, nan_ok=True))
            assert np.isnan(gaps.cross_track[1]) != is_known
            assert not is_known or gaps.cross_track[1] == pytest.approx(aside)
        x = x + 0.1 * speeds
    assert np.isnan(gaps.gap[[0, *range(2, N)]]).all()


def test_a_follower_that_passes_its_predecessor_has_no_gap_and_is_beside_its_path():
    """Its gap was stuck at one length, and its offset grew to 148 m: the distance to the end of the path."""
    gaps, n, x, y = Gaps(cars(N - 1)), np.arange(N), -30.0 * np.arange(N), np.zeros(N)
    speeds = np.where(n == 1, 20.0, 10.0)
    only = np.where(n == 1, 0, -1)
    known = []
    for k in range(100):
        y[1] = 3.2 * min(k / 20, 1.0)
        step = _step(n, only, x, y, np.zeros(N), speeds, np.zeros(N, bool))
        if k == 0:
            gaps.begin(step, n)
        gaps.observe(step)
        model = step.fleet.model
        gap = x[0] - x[1] - model.length[0] / 2 - model.axle[0] - model.length[1] / 2 + model.axle[1]
        assert gaps.gap[1] == pytest.approx(gap if gap >= 0 else np.nan, nan_ok=True)
        assert gaps.cross_track[1] == pytest.approx(y[1] if gap >= 0 else np.nan, nan_ok=True)
        assert gaps.beside[1] == (y[1] > model.width[:2].mean())
        known.append(gap >= 0)
        x = x + 0.1 * speeds
    assert x[1] > x[0] + 10
    assert any(known[20:])


def test_a_follower_that_has_passed_a_predecessor_which_turns_off_has_no_gap():
    """The corner of its predecessor's path is the nearest place on it, and that path's end is ahead of the corner."""
    gaps, n, x, y = Gaps(cars(N - 1)), np.arange(N), -30.0 * np.arange(N), np.zeros(N)
    only, heading, known = np.where(n == 1, 0, -1), np.zeros(N), []
    y[1] = 3.2
    for k in range(200):
        heading[0] = -np.pi / 2 if k > 60 else 0.0
        step = _step(n, only, x, y, heading, np.where(n == 1, 20.0, 10.0), np.zeros(N, bool))
        if k == 0:
            gaps.begin(step, n)
        gaps.observe(step)
        known.append(bool(np.isfinite(gaps.gap[1])))
        x = x + 0.1 * np.where(n == 1, 20.0, 10.0) * np.cos(heading)
        y = y + 0.1 * np.where(n == 1, 20.0, 10.0) * np.sin(heading)
    assert known == sorted(known, reverse=True)
    assert 10 < sum(known) < 60


def test_a_follower_that_drives_into_its_predecessor_has_a_gap_until_it_has_driven_through_it():
    gaps, n, x, zero = Gaps(cars(N - 1)), np.arange(N), -10.0 * np.arange(N), np.zeros(N)
    only, found = np.where(n == 1, 0, -1), []
    for k in range(60):
        step = _step(n, only, x, zero, zero, np.where(n == 1, 5.0, 1.0), np.zeros(N, bool))
        if k == 0:
            gaps.begin(step, n)
        gaps.observe(step)
        found.append((x[0] - x[1], gaps.gap[1]))
        x = x + 0.1 * np.where(n == 1, 5.0, 1.0)
    assert min(gap for _, gap in found) < -3.0
    assert all(np.isnan(gap) == (apart < 0) for apart, gap in found)


def _step(number, predecessor, x, y, heading, speed, native):
    model = SimpleNamespace(length=np.linspace(3.0, 9.0, N), width=np.linspace(1.6, 2.4, N), axle=np.full(N, -1.3))
    motion = SimpleNamespace(heading=heading, speed=speed)
    fleet = SimpleNamespace(model=model, motion=motion, predecessor=predecessor, native=native, number=number)
    return SimpleNamespace(fleet=fleet, number=number, x=x, y=y)
