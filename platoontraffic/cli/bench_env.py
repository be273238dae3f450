"""Steps and resets a second of environments, beside highway-env with as many beams and vehicles: `bench env`.

Rates are those of the wall, because an environment and its simulation are two processes; on a busy machine they fall.
Ratios are those of CPU time, of both processes together, which is nearly that of an idle machine.

Both kinds of environment simulate one step of the same length for each of the environment's. In `lab_loop` all five
robots scan; in highway-env one vehicle does, or all five, as agents that learn.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.lidar.benchmark.frame import table

BEAMS, VEHICLES, STEP = 720, 5, 0.025  # in the lab; length of a step [s]
BETWEEN = 40  # steps between two resets
LAB, CORRIDOR = "lab_loop", "corridor, 300 s of warm-up"
SCENARIOS = {
    LAB: ("paper_loop", ("learn.parents=1",)),
    CORRIDOR: ("corridor_tracking", ("sumo.warm_up_s=300", "learn.parents=1")),
}
STAGES = {  # of a step -> stages of `Episodes.spent`
    "SUMO: its step, members moved and read": ("step", "place", "read", "signals"),
    "scans of all members": ("scan",),
    "laws of the other members": ("decide", "move"),
    "observation: gaps, events, statistics": ("observe",),
    "the rest of the loop": ("loop",),
}


class Rates(NamedTuple):
    steps: float  # a second
    cpu: float  # of a step, in all processes [s]
    reset: float  # after an episode, median [s]
    seeded: float  # with a seed, at once after another reset, median [s]
    stages: dict[str, float]  # CPU time of a step [s]


def ours(scenario: str, changes: tuple[str, ...], resets: int, steps: int) -> Rates:
    from platoontraffic.environments.follower import Follower

    env = Follower(scenario, changes)
    try:
        return _rates(env, np.array([0.05, 0.0]), resets, steps, env.spent)
    finally:
        env.close()


def highway(scanning: int) -> tuple[Any, Any]:
    """An environment of highway-env, and an action. scanning: 1, or all of the vehicles. raises: ImportError"""
    import gymnasium
    import highway_env

    gymnasium.register_envs(highway_env)
    scan: dict[str, Any] = {"type": "LidarObservation", "cells": BEAMS}
    frequency = round(1 / STEP)
    config = {
        "observation": scan,
        "vehicles_count": VEHICLES - scanning,
        "simulation_frequency": frequency,
        "policy_frequency": frequency,
        "duration": 10**6,
    }
    action: Any = 1
    if scanning > 1:
        config |= {
            "controlled_vehicles": scanning,
            "observation": {"type": "MultiAgentObservation", "observation_config": scan},
            "action": {"type": "MultiAgentAction", "action_config": {"type": "DiscreteMetaAction"}},
        }
        action = (1,) * scanning
    return gymnasium.make("highway-v0", config=config).unwrapped, action


def _rates(env: Any, action: Any, resets: int, steps: int, spent: Any) -> Rates:
    """spent: gives the CPU time of the environment's further processes, by stage [s]"""
    env.reset(seed=0)
    times: dict[bool, list[float]] = {False: [], True: []}
    for again in (False, True):
        for seed in range(resets):
            began = time.perf_counter()
            env.reset(seed=seed if again else None)
            times[again].append(time.perf_counter() - began)
            for _ in range(0 if again else BETWEEN):
                env.step(action)
    env.step(action)
    before, own, began = spent(), time.process_time(), time.perf_counter()
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(action)
        if np.any(terminated) or truncated:
            raise RuntimeError("an episode of the benchmark has ended")
    taken, own = time.perf_counter() - began, time.process_time() - own
    stages = {stage: (seconds - before[stage]) / steps for stage, seconds in spent().items()}
    stages["environment"] = own / steps
    reset, seeded = (float(np.median(times[again])) for again in (False, True))
    return Rates(steps / taken, sum(stages.values()), reset, seeded, stages)


def text(quick: bool) -> str:
    """The benchmark, as tables."""
    resets, steps = (5, 100) if quick else (30, 400)
    rows, alone = [], {}
    for name, (scenario, changes) in SCENARIOS.items():
        alone[name] = rates = ours(scenario, changes, resets, steps)
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            both = [one.result() for one in [pool.submit(ours, scenario, changes, resets, steps) for _ in range(2)]]
        rows.append(_row(name, 1, [rates]))
        rows.append(_row(name, 2, both))
    ratios = []
    try:
        for scanning in (1, VEHICLES):
            other = _rates(*highway(scanning), resets, steps, dict)
            rows.append(_row(f"highway-env, {scanning} of {VEHICLES} vehicles with {BEAMS} beams", 1, [other]))
            times = other.cpu / alone[LAB].cpu
            ratios.append(f"{LAB}, where {VEHICLES} robots scan, has {times:.1f} times the steps in a CPU second of "
                          f"highway-env, where {scanning} of {VEHICLES} vehicles scans (bar: 10)")  # fmt: skip
    except ImportError:
        ratios.append("highway-env is not installed: pip install highway-env")
    heads = ["environment", "processes", "steps/s", "CPU of a step [ms]", "reset [ms]", "with a seed [ms]"]
    return "\n\n".join([
        table([heads, *rows], [True, *[False] * 5]),
        f"reset: after {BETWEEN} steps; with a seed: at once after another reset",
        *ratios,
        f"where the CPU time of a step goes, in {LAB}:\n\n{_where(alone[LAB])}",
    ])  # fmt: skip


def _row(name: str, processes: int, rates: list[Rates]) -> list[str]:
    steps, cpu, *resets = sum(r.steps for r in rates), *(np.mean([r[i] for r in rates]) for i in (1, 2, 3))
    return [name, str(processes), f"{steps:.0f}", f"{1e3 * cpu:.2f}", *(f"{1e3 * one:.0f}" for one in resets)]


def _where(rates: Rates) -> str:
    stages = {name: sum(rates.stages.get(stage, 0.0) for stage in parts) for name, parts in STAGES.items()}
    stages["frame: rewards, info, and sending them"] = rates.stages["frame"]
    stages["environment: receiving, spaces, dictionaries"] = rates.stages["environment"]
    rows = [[name, f"{1e3 * seconds:.2f}", f"{100 * seconds / rates.cpu:.0f} %"] for name, seconds in stages.items()]
    return table([["part", "CPU of a step [ms]", "share"], *rows], [True, False, False])
