"""Print the time that the law `tracking` takes for a step of 400 followers, and that of their scans.

    .venv/bin/python tests/benchmarks/tracking_step.py

A hundred platoons of five at 20 m/s, with the errors of a car's laser; CPU time of the single working thread.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from platoontraffic.results.provenance import Stopwatch
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.world.fleet import Member
from tests.benchmarks.what_holds import CAR, TRACKING, Leaders, straight_on
from tests.support.bench import BLIND, NO_WALLS, platoon

PLATOONS, FOLLOWERS, SPEED = 100, 4, 20.0
STEPS, REPEATS = 40, 9


def deployed(dt: float) -> list[Member]:
    law, eye, members = TRACKING.law, TRACKING.eye, []
    leader = Leaders((straight_on,))
    for i in range(PLATOONS):
        cars = platoon(
            leader, law, FOLLOWERS, at=(0.0, 300.0 * i, 0.0), distance=law.desired_distance(SPEED), model=CAR,
            leader_eye=replace(BLIND, rate=1 / dt), eye=eye, speed=SPEED,
        )  # fmt: skip
        members += [replace(m, id=f"{i}.{m.place}", platoon=str(i)) for m in (*cars[1:], cars[0])]
    return members


def main() -> None:
    setting = Setting(deployed(TRACKING.step), NO_WALLS, TRACKING.step, steps=19 + STEPS * REPEATS)
    with Simulation(setting, Stopwatch(time.thread_time)) as simulation:
        spent = simulation.stopwatch.seconds
        until = np.array([(spent["decide"], spent["scan"]) for _ in simulation])
        group = next(g for g in simulation.now.fleet.groups if g.law is TRACKING.law)
    deciding, scanning = np.diff(until, axis=0, prepend=0.0).T
    law, scan = (np.array(values[20:]).reshape(REPEATS, STEPS) * 1e3 for values in (deciding, scanning))
    each = np.median(law, axis=1)
    print(f"{len(group.rows)} followers, {group.lidar.samples} beams, {REPEATS} x {STEPS} steps")
    print(f"estimation and law: median {np.median(law):.2f} ms a step, by repeat {each.min():.2f} to {each.max():.2f}")
    print(f"that is {np.median(law) / np.median(scan):.2f} times their scans, {np.median(scan):.2f} ms")


if __name__ == "__main__":
    main()
