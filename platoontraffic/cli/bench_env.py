"""Steps and resets a second of environments, beside highway-env with as many beams and vehicles: `bench env`.

Rates are those of the wall; on a busy machine they fall. Ratios are those of CPU time, which is nearly that of an idle
machine: of both processes together, where an environment and its simulation in SUMO are two. The lab needs no SUMO.

A step is one decision and the observation after it, on either side. In `lab_loop` it is one step of the simulation, of
0.025 s, in which all five robots scan walls and each other with 720 beams. highway-env has five vehicles and 720 beams,
which meet vehicles only. Its rates are once its own: a decision a second, and 15 steps of its simulation for each. Then
they are those of the lab: 40 decisions a second, and one step for each, where one of its vehicles scans, or all five
do, as agents that learn.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.lidar.benchmark.frame import table

BEAMS, VEHICLES, STEP = 720, 5, 0.025  # in the lab; simulated time of a step [s]
BETWEEN = 40  # steps between two resets
LAB, CORRIDOR = "lab_loop", "corridor, 300 s of warm-up"
SCENARIOS = {  # scenario, its changes, simulated time of a step [s]
    LAB: ("paper_loop", ("learn.parents=1",), STEP),
    CORRIDOR: ("corridor_tracking", ("sumo.warm_up_s=300", "learn.parents=1"), 0.1),
}
STAGES = {  # of a step -> stages of a simulation's stopwatch, "loop" for all else in it, "environment" for the rest
    "ground: bare, without SUMO": ("step", "place", "read", "signals"),
    "scans of all members": ("scan",),
    "laws of the other members": ("decide", "move"),
    "observation: gaps, events, statistics": ("observe", "measure"),
    "the rest of the loop": ("loop",),
    "environment: spaces, dictionaries, rewards, info": ("environment",),
}
AHEAD = 0.05  # speed that the member that learns is commanded [m/s]


class Rates(NamedTuple):
    steps: float  # a second
    environment: float  # CPU time of a step in the process that steps the environment [s]
    simulation: float  # the same in the process of its simulation [s]; 0: it has none
    reset: float  # after an episode, median [s]
    seeded: float  # with a seed, at once after another reset, median [s]

    @property
    def cpu(self) -> float:
        """CPU time of a step [s]."""
        return self.environment + self.simulation


def ours(scenario: str, changes: tuple[str, ...], resets: int, steps: int) -> Rates:
    from platoontraffic.environments.follower import Follower

    env = Follower(scenario, changes)
    try:
        return _rates(env, np.array([AHEAD, 0.0]), resets, steps, env.spent)
    finally:
        env.close()


def stages(scenario: str, changes: tuple[str, ...], steps: int) -> dict[str, float]:
    """CPU time of a step of an environment of a lab, by part [s].

    Each part is timed where it runs, in this process: a difference of two measurements can be below 0.
    """
    from platoontraffic.environments.follower import Follower
    from platoontraffic.episodes import episodes
    from platoontraffic.results.provenance import Stopwatch
    from platoontraffic.simulation import Simulation

    watch, action = Stopwatch(time.process_time), np.array([AHEAD, 0.0])

    class Timed(Simulation):
        def __init__(self, setting: Any) -> None:
            super().__init__(setting, watch)

        def step(self, override: Any = None) -> Any:
            return watch.call("loop", super().step, override)

    episodes.Simulation = Timed  # an environment takes no stopwatch
    try:
        env = Follower(scenario, changes)
        env.reset(seed=0)
        env.step(action)
        before = dict(watch.seconds)
        for _ in range(steps):
            watch.call("environment", env.step, action)
        env.close()
    finally:
        episodes.Simulation = Simulation
    spent = {stage: (seconds - before.get(stage, 0.0)) / steps for stage, seconds in watch.seconds.items()}
    return {part: sum(spent[stage] for stage in found) for part, found in STAGES.items()}


def highway(scanning: int, own_rates: bool = False) -> tuple[Any, Any]:
    """An environment of highway-env, and an action.

    scanning : 1, or all of the vehicles
    own_rates: it simulates and decides as often as it does by default; else once in each STEP
    raises   : ImportError
    """
    import gymnasium
    import highway_env

    gymnasium.register_envs(highway_env)
    scan: dict[str, Any] = {"type": "LidarObservation", "cells": BEAMS}
    config = {"observation": scan, "vehicles_count": VEHICLES - scanning, "duration": 10**6}
    if not own_rates:
        config |= dict.fromkeys(("simulation_frequency", "policy_frequency"), round(1 / STEP))
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
    """spent: gives the CPU time of the process of the environment's simulation [s]; float: it has none"""
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
    before, own, taken = spent(), 0.0, 0.0
    for _ in range(steps):
        own, taken = own - time.process_time(), taken - time.perf_counter()
        _, _, terminated, truncated, _ = env.step(action)
        own, taken = own + time.process_time(), taken + time.perf_counter()
        if np.any(terminated) or truncated:
            if spent is not float:
                raise RuntimeError("an episode of the benchmark has ended")
            env.reset()  # two cars of highway-env have met
    reset, seeded = (float(np.median(times[again])) for again in (False, True))
    return Rates(steps / taken, own / steps, (spent() - before) / steps, reset, seeded)


def text(quick: bool) -> str:
    """The benchmark, as tables."""
    resets, steps = (5, 100) if quick else (30, 400)
    rows, alone = [], {}
    for name, (scenario, changes, step) in SCENARIOS.items():
        alone[name] = rates = ours(scenario, changes, resets, steps)
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            both = [one.result() for one in [pool.submit(ours, scenario, changes, resets, steps) for _ in range(2)]]
        rows += [_row(name, [rates], step), _row(name, both, step)]
    ratios = []
    try:
        for scanning, own_rates in ((1, True), (1, False), (VEHICLES, False)):
            env, action = highway(scanning, own_rates)
            lasts = 1 / env.config["policy_frequency"]
            other = _rates(env, action, resets, steps, float)
            name = f"highway-env, {scanning} of {VEHICLES} vehicles with {BEAMS} beams, {lasts:g} s a step"
            rows.append(_row(name, [other], lasts))
            ratios.append(f"{other.cpu / alone[LAB].cpu:.1f} times the steps of {name}")
    except ImportError:
        ratios.append("... highway-env is not installed: pip install highway-env")
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        parts = pool.submit(stages, *SCENARIOS[LAB][:2], steps).result()
    heads = [
        "environment", "processes", "steps/s", "CPU of a step [ms]", "simulated s in a CPU s", "reset [ms]",
        "with a seed [ms]",
    ]  # fmt: skip
    return "\n\n".join([
        table([heads, *rows], [True, *[False] * 6]),
        f"reset: after {BETWEEN} steps; with a seed: at once after another reset",
        f"step: one decision and one observation, of {STEP} s in {LAB}, where {VEHICLES} robots scan with {BEAMS} "
        f"beams, and of {SCENARIOS[CORRIDOR][2]} s in the corridor; 1 s a step are highway-env's own rates",
        "\n".join([f"{LAB} has in a CPU second, where the bar is 10,", *ratios]),
        f"where the CPU time of a step goes, in {LAB}, timed in one more process:\n\n{_where(parts)}",
    ])  # fmt: skip


def _row(name: str, rates: list[Rates], step: float) -> list[str]:
    """step: simulated time of one [s]"""
    steps, (cpu, *resets) = sum(r.steps for r in rates), np.mean([(r.cpu, r.reset, r.seeded) for r in rates], axis=0)
    figures = f"{steps:.0f}", f"{1e3 * cpu:.2f}", f"{step / cpu:.0f}", *(f"{1e3 * one:.0f}" for one in resets)
    return [name, str(len(rates)), *figures]


def _where(parts: dict[str, float]) -> str:
    """parts: of `stages`"""
    whole = sum(parts.values())
    rows = [[name, f"{1e3 * seconds:.2f}", f"{100 * seconds / whole:.0f} %"] for name, seconds in parts.items()]
    rows.append(["all of it", f"{1e3 * whole:.2f}", "100 %"])
    return table([["part", "CPU of a step [ms]", "share"], *rows], [True, False, False])
