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
from platoontraffic.world import fleet
from platoontraffic.world.sensing import Sensing
from tests.benchmarks.what_holds import CAR, TRACKING, Leaders, straight_on
from tests.support.bench import BLIND, NO_WALLS, platoon, snapshot

PLATOONS, FOLLOWERS, SPEED = 100, 4, 20.0
STEPS, REPEATS = 40, 9


def deployed(dt: float) -> fleet.Fleet:
    law, eye, members = TRACKING.law, TRACKING.eye, []
    leader = Leaders((straight_on,))
    for i in range(PLATOONS):
        cars = platoon(
            leader, law, FOLLOWERS, at=(0.0, 300.0 * i, 0.0), distance=law.desired_distance(SPEED), model=CAR,
            leader_eye=replace(BLIND, rate=1 / dt), eye=eye, speed=SPEED,
        )  # fmt: skip
        members += [replace(m, id=f"{i}.{m.place}", platoon=str(i)) for m in cars if m.place]
        members.append(replace(cars[0], id=f"{i}.0", platoon=str(i)))
    return fleet.Fleet.deployed(members, dt)


def main() -> None:
    dt = TRACKING.step
    cars, sensing = deployed(dt), Sensing(NO_WALLS)
    group = next(g for g in cars.groups if g.law is TRACKING.law)
    deciding, scanning = [], []
    for step in range(20 + STEPS * REPEATS):
        traffic = snapshot(cars, step * dt)
        began = time.thread_time()
        scans = sensing.scan(traffic, cars, step)
        scanned = time.thread_time()
        cars = cars.decided(scans, dt)
        deciding.append(time.thread_time() - scanned)
        scanning.append(scanned - began)
        cars = cars.moved(dt)
    law, scan = (np.array(values[20:]).reshape(REPEATS, STEPS) * 1e3 for values in (deciding, scanning))
    each = np.median(law, axis=1)
    print(f"{len(group.rows)} followers, {group.lidar.samples} beams, {REPEATS} x {STEPS} steps")
    print(f"estimation and law: median {np.median(law):.2f} ms a step, by repeat {each.min():.2f} to {each.max():.2f}")
    print(f"that is {np.median(law) / np.median(scan):.2f} times their scans, {np.median(scan):.2f} ms")


if __name__ == "__main__":
    main()
