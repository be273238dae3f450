"""Followers that SUMO drives: a control arm with as many cars, recorded as members."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from platoontraffic import Simulation, scenario
from platoontraffic.recording import run
from platoontraffic.simulation import prepare

CONTROL = """
[sumo]
net = "highway"
[scene]
walls = "none"
[run]
duration_s = 40
[record]
every_s = 0.5
[[platoon]]
size = 4
vehicle = "car"
gap_m = 20.0
to = "w4_w5"
leader = "sumo"
follower = { law = "LAW", odometry = "car" }
start = { time_s = 2.0, edge = "w0_w1", position_m = 200, speed_mps = 20 }
"""
BY_LASER = {"lock_on_ratio", "lock_losses", "splits", "in_platoon_share", "steal_share", "gap_error_rms"}


@pytest.fixture
def file(tmp_path):
    def written(law: str):
        path = tmp_path / f"{law}.toml"
        path.write_text(CONTROL.replace("LAW", law))
        return path

    return written


@pytest.mark.sumo
def test_they_start_where_members_do_and_are_all_driven_by_sumo(file):
    starts = []
    for law in ("sumo", "tracking"):
        with Simulation.load(file(law)) as simulation:
            instant = next(now for now in simulation if len(now.fleet))
            starts.append((instant.fleet.motion.x, instant.fleet.motion.y))
            assert instant.fleet.native.tolist() == [law == "sumo" or place == 0 for place in range(4)]
            assert len({member.route for member in instant.fleet.members}) == 1
    assert np.array(starts[0]) == pytest.approx(np.array(starts[1]), abs=2.5)  # SUMO's drive for a step first


@pytest.mark.sumo
def test_they_have_gaps_but_nothing_that_a_laser_gives(file, tmp_path):
    folder = run(prepare(scenario.load(file("sumo"))), tmp_path / "results")
    tables = {name: pd.read_csv(folder / f"{name}.csv") for name in ("trajectories", "events", "metrics")}
    followers = tables["trajectories"][tables["trajectories"].place > 0]
    gap = followers.gap_m.dropna()
    assert len(gap)
    assert (gap > 0).all()
    assert followers.cross_track_m.abs().max() < 1.8  # of two cars abreast there is no gap
    assert followers.beams_on_predecessor.isna().all()
    assert {"locked", "lock_lost", "split", "wrong_target"}.isdisjoint(tables["events"].kind)
    of_followers = tables["metrics"][tables["metrics"].vehicle_id.isin(followers.vehicle_id)]
    assert BY_LASER.isdisjoint(of_followers.metric)
    assert {"gap_mean", "time_gap_median", "ttc_min", "collisions"} <= {*of_followers.metric}
