"""Steps and resets a second of environments, beside highway-env with as many beams and vehicles: `bench env`.

Clocks are those of the wall, because an environment and its simulation are two processes; on a busy machine all rates
fall, so the ratios count.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.benchmark.frame import table

BEAMS, VEHICLES = 720, 5
SCENARIOS = {
    "lab_loop": ("paper_loop", ("learn.parents=1",)),
    "corridor, 300 s of warm-up": ("corridor_tracking", ("sumo.warm_up_s=300", "learn.parents=1")),
}


class Rates(NamedTuple):
    steps: float  # a second
    reset: float  # median [s]


def ours(scenario: str, changes: tuple[str, ...], steps: int, resets: int) -> Rates:
    from platoontraffic.environments.follower import Follower

    env = Follower(scenario, changes)
    try:
        env.reset(seed=0)
        return _rates(env, np.array([0.05, 0.0]), steps, resets)
    finally:
        env.close()


def highway_env(steps: int, resets: int) -> Rates:
    """One simulated step for each of the environment's, as in ours. raises: ImportError"""
    import gymnasium
    import highway_env

    gymnasium.register_envs(highway_env)
    config = {
        "observation": {"type": "LidarObservation", "cells": BEAMS},
        "vehicles_count": VEHICLES - 1,
        "simulation_frequency": 10,
        "policy_frequency": 10,
        "duration": 10**6,
    }
    env = gymnasium.make("highway-v0", config=config).unwrapped
    env.reset(seed=0)
    return _rates(env, 1, steps, resets)


def _rates(env, action, steps: int, resets: int) -> Rates:
    times = []
    for seed in range(resets):
        began = time.perf_counter()
        env.reset(seed=seed)
        times.append(time.perf_counter() - began)
    began, taken = time.perf_counter(), 0.0
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            pause = time.perf_counter()
            env.reset()
            taken -= time.perf_counter() - pause
    return Rates(steps / (time.perf_counter() - began + taken), float(np.median(times)))


def text(quick: bool) -> str:
    """The benchmark, as tables."""
    steps, resets = (100, 5) if quick else (1000, 30)
    rows, alone = [], {}
    for name, (scenario, changes) in SCENARIOS.items():
        rates = alone[name] = ours(scenario, changes, steps, resets)
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            both = [one.result() for one in [pool.submit(ours, scenario, changes, steps, resets) for _ in range(2)]]
        rows.append([name, "1", f"{rates.steps:.0f}", f"{1e3 * rates.reset:.0f}"])
        rows.append([name, "2", f"{sum(r.steps for r in both):.0f}", f"{1e3 * np.mean([r.reset for r in both]):.0f}"])
    try:
        other = highway_env(min(steps, 300), resets)
        rows.append([f"highway-env, {BEAMS} beams, {VEHICLES} vehicles", "1", f"{other.steps:.0f}",
                     f"{1e3 * other.reset:.0f}"])  # fmt: skip
        times = alone["lab_loop"].steps / other.steps
        ratio = f"lab_loop has {times:.1f} times the steps a second of highway-env (bar: 10)"
    except ImportError:
        ratio = "highway-env is not installed: pip install highway-env"
    heads = ["environment", "processes", "steps/s", "reset [ms]"]
    return f"{table([heads, *rows], [True, False, False, False])}\n\n{ratio}"
