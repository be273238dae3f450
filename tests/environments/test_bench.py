"""The benchmark of environments: that its parts are all of a step. Never how fast."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

pytest.importorskip("gymnasium")

from platoontraffic.cli import bench_env
from platoontraffic.environments.follower import Follower
from platoontraffic.episodes import episodes
from platoontraffic.results.provenance import Stopwatch
from platoontraffic.simulation import Simulation

pytestmark = [pytest.mark.slow, pytest.mark.sumo, pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")]


def test_the_parts_of_a_step_are_all_of_it(monkeypatch):
    monkeypatch.setattr(bench_env, "BETWEEN", 2)
    rates = bench_env.ours("paper_path", ("platoon.size=2", "learn.parents=1"), 2, 5)
    assert min(rates) > 0
    rates = bench_env.ours("paper_loop", ("platoon.size=2", "learn.parents=1"), 2, 5)
    assert rates.simulation == 0 < min(rates.environment, rates.reset, rates.seeded)
    assert rates.cpu == rates.environment + rates.simulation
    parts = bench_env.stages("paper_loop", ("platoon.size=2", "learn.parents=1"), 5)
    assert list(parts) == list(bench_env.STAGES)
    assert min(parts.values()) > 0
    assert episodes.Simulation is Simulation
    *shares, whole = [int(line.split()[-2]) for line in bench_env._where(parts).splitlines() if line.endswith("%")]
    assert sum(shares) == pytest.approx(whole, abs=len(shares))


def test_the_time_outside_the_simulation_is_a_measurement_of_its_own(monkeypatch):
    """On a clock of calls, the environment's part is what passes outside the simulation's step."""
    clock = [0.0]

    def takes(seconds, function):
        def slow(*arguments):
            clock[0] += seconds
            return function(*arguments)

        return slow

    monkeypatch.setattr(time, "process_time", lambda: clock[0])
    monkeypatch.setattr(Follower, "step", takes(2.0, Follower.step))
    monkeypatch.setattr(Simulation, "step", takes(3.0, Simulation.step))
    parts = bench_env.stages("paper_loop", ("platoon.size=2", "learn.parents=1"), 4)
    ours, loop = list(bench_env.STAGES)[-1], list(bench_env.STAGES)[-2]
    assert {part: spent for part, spent in parts.items() if spent} == {loop: 3.0, ours: 2.0}


def test_all_stages_of_a_simulation_are_in_a_part():
    with Simulation.load("paper_loop", "platoon.size=2") as simulation:
        watch = simulation.stopwatch = Stopwatch()
        simulation.reset()
        simulation.step()
    shown = [stage for stages in bench_env.STAGES.values() for stage in stages]
    assert sorted(shown) == sorted({*watch.seconds, "loop", "environment"})


@pytest.mark.parametrize("name", bench_env.SCENARIOS)
def test_a_step_is_as_long_as_is_said(name):
    scenario, changes, step = bench_env.SCENARIOS[name]
    env = Follower(scenario, (*changes, "sumo.warm_up_s=0"))
    _, before = env.reset(seed=0)
    *_, info = env.step(np.array([0.0, 0.0]))
    env.close()
    assert info["time_s"] - before["time_s"] == pytest.approx(step)


@pytest.mark.parametrize(
    ("scanning", "own_rates", "lasts"),
    [(1, True, 1.0), (1, False, bench_env.STEP), (bench_env.VEHICLES, False, bench_env.STEP)],
)
def test_highway_env_has_as_many_beams_and_vehicles(scanning, own_rates, lasts):
    pytest.importorskip("highway_env")
    env, action = bench_env.highway(scanning, own_rates)
    seen, _ = env.reset(seed=0)
    scans = [seen] if scanning == 1 else seen
    assert [one.shape for one in scans] == [(bench_env.BEAMS, 2)] * scanning
    assert len(env.road.vehicles) == bench_env.VEHICLES
    before = env.time
    env.step(action)
    assert env.time - before == pytest.approx(lasts)
