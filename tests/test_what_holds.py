"""The benchmark `what_holds`: platoons driven at once do as each alone, and it runs."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from tests.benchmarks.what_holds import (
    FOLLOWERS,
    QUARTER,
    SMOKE,
    Trial,
    bend_of,
    bend_trial,
    drive,
    smallest,
    straight_on,
)
from tests.support import ROOT

EXACT = FOLLOWERS["tracking, no noise"]


def test_a_platoon_drives_the_same_alone_and_among_others():
    trials = [bend_trial(EXACT, 5.0, radius, QUARTER)._replace(seconds=12.0 - radius / 4) for radius in (8.0, 12.0)]
    for one, (alone,) in zip(drive(trials), ([run] for trial in trials for run in drive([trial])), strict=True):
        assert len(one.time) == len(alone.time)
        assert one.speed == pytest.approx(alone.speed, abs=1e-6)
        assert np.diff(one.axle, axis=0) == pytest.approx(np.diff(alone.axle, axis=0), abs=1e-6)
        assert (one.beams == alone.beams).all()


def test_a_platoon_on_a_straight_road_has_no_gap_error_and_stays_on_its_path():
    (run,) = drive([Trial(EXACT, 10.0, straight_on, 5.0)])
    assert run.gaps == pytest.approx(EXACT.wanted_gap(10.0), abs=0.02)
    assert run.gap_error < 0.02
    assert run.off_path < 0.01
    assert run.lock_on == 1.0


def test_a_platoon_that_cannot_see_round_the_bend_does_not_hold():
    """The laser sees only 30 deg, too little for a bend of radius 8 m."""
    wide, narrow = (bend_of(drive([bend_trial(EXACT.seeing(view), 5.0, 8.0, QUARTER)])[0]) for view in (180.0, 30.0))
    assert wide.holds
    assert not narrow.together


def test_a_platoon_leaves_when_two_of_its_cars_touch():
    blind = EXACT.seeing(reach=1.0)
    trial = Trial(blind, 20.0, lambda time: (-8.0 if time > 0.5 else 0.0, 0.0), 10.0, 1, distance=2.0)
    (run,) = drive([trial])
    assert run.hit == 1
    assert run.time[-1] < 10.0
    assert run.gaps[-1, 0] == pytest.approx(0.0, abs=2.0)  # the distance driven between two samples


def test_the_smallest_radius_that_holds_is_above_all_that_do_not():
    assert smallest([1, 2, 3, 4], [True, False, True, True]) == 3
    assert smallest([1, 2], [True, True]) == 1
    assert math.isnan(smallest([1, 2], [True, False]))


@pytest.mark.slow
def test_a_few_cells_of_every_table_in_seconds(tmp_path):
    picture = tmp_path / "what_holds.png"
    command = [sys.executable, str(ROOT / "tests/benchmarks/what_holds.py"), "--quick", "--picture", str(picture)]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": path})
    tables = [line for line in done.stdout.splitlines() if line.startswith("| ---")]
    assert len(tables) == 8
    assert done.stdout.count("| tracking |") >= 7
    assert picture.stat().st_size > 20000
    assert SMOKE.laws == ("repaired", "tracking")
