"""The benchmark of environments: that its parts are all of a step. Never how fast."""

from __future__ import annotations

import os

import pytest

pytest.importorskip("gymnasium")

from platoontraffic.cli import bench_env

pytestmark = [pytest.mark.slow, pytest.mark.sumo, pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")]


def test_the_parts_of_a_step_are_all_of_it(monkeypatch):
    monkeypatch.setattr(bench_env, "BETWEEN", 2)
    rates = bench_env.ours("paper_loop", ("platoon.size=2", "learn.parents=1"), 2, 5)
    shown = {stage for stages in bench_env.STAGES.values() for stage in stages} | {"frame", "environment"}
    assert {stage for stage, seconds in rates.stages.items() if seconds > 0} <= shown
    assert sum(rates.stages.values()) == pytest.approx(rates.cpu)
    assert min(rates[:4]) > 0
    shares = [int(line.split()[-2]) for line in bench_env._where(rates).splitlines() if line.endswith("%")]
    assert sum(shares) == pytest.approx(100, abs=len(shares))


@pytest.mark.parametrize("scanning", [1, bench_env.VEHICLES])
def test_highway_env_has_as_many_beams_and_vehicles(scanning):
    pytest.importorskip("highway_env")
    env, action = bench_env.highway(scanning)
    seen, _ = env.reset(seed=0)
    scans = [seen] if scanning == 1 else seen
    assert [one.shape for one in scans] == [(bench_env.BEAMS, 2)] * scanning
    assert len(env.road.vehicles) == bench_env.VEHICLES
    before = env.time
    env.step(action)
    assert env.time - before == pytest.approx(bench_env.STEP)
