"""Does any combination of the readings of the paper's follower come round the first corner behind the leader?

    PYTHONPATH=. .venv/bin/python tests/benchmarks/combined_readings.py

Combinations of the options of `printed` that the text leaves open, on a loop road 2 m wide, each with one follower:
where that is lost, so is every platoon. Loops stand side by side, far from each other, in one simulation for each speed
of the leader. A follower comes round if it has turned through the corner, is on its leader at the end, and touches
nothing. Takes some ten minutes.

Left out are combinations that cannot: a frame in which straight ahead is 0 (it turns right by a quarter turn a second
there), and only outward steps where two edges or more are needed (a body has one).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import shapely

from platoontraffic.controllers.printed import PrintedFollower
from platoontraffic.controllers.reactive import ReactiveLeader
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.lidar import Scene
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.world.contact import Contacts
from tests.support.bench import DT, LEADER_EYE, platoon, targets

READINGS = {
    "edge": ("absolute", "signed"),
    "no_return": ("range_max", "infinity"),
    "yaw_unit": ("rad", "deg"),
    "angle_in_speed": ("polar", "bearing"),
    "between": ("first_two", "last_edge", "offsets"),
    "on_loss": ("stop", "hold"),
}
SPEEDS = (0.45, 0.1)  # of the leader [m/s]
AWAY, ROW = 20.0, 8  # of the loops [m]; so many in a row
ROUND = math.radians(80)
START = (2.9, 0.5)  # on a loop of 6 m by 5 m


def come_round(laws: list, speed: float) -> np.ndarray:
    """Which laws come round the first corner behind a leader at this speed, (n,) bool."""
    seconds = (6 - START[0]) / speed + math.pi / 2 / 0.1 + 1.5 / speed
    corners = [(AWAY * (i % ROW), AWAY * (i // ROW)) for i in range(len(laws))]
    boxes = [(shapely.box(x, y, x + 6, y + 5), shapely.box(x + 2, y + 2, x + 4, y + 3)) for x, y in corners]
    scene = Scene.from_shapely(*(list(shapes) for shapes in zip(*boxes, strict=True)))
    members = []
    for i, (law, (x, y)) in enumerate(zip(laws, corners, strict=True)):
        pair = platoon(
            ReactiveLeader(speed=speed),
            law,
            1,
            at=(x + START[0], y + START[1], 0.0),
            distance=0.43,
            leader_eye=LEADER_EYE,
        )
        members += [replace(m, id=f"{i}.{m.place}", platoon=f"{i}") for m in pair]
    contacts = Contacts(scene, {m.id for m in members})
    touched: set[int] = set()
    with Simulation(Setting(members, scene, DT, steps=round(seconds / DT))) as simulation:
        for now in simulation:
            touched |= {int(name.split(".")[0]) for pair in contacts.of(now.traffic) for name in pair if "." in name}
            turned, on = now.fleet.motion.turned, targets(now)
    assert (np.abs(turned[::2]) > ROUND).any(), "no leader is round"
    clear = np.array([i not in touched for i in range(len(laws))])
    return (np.abs(turned[1::2]) > ROUND) & (on[1::2] == np.arange(0, len(on), 2)) & clear


def main() -> None:
    values = [dict(zip(READINGS, one, strict=True)) for one in itertools.product(*READINGS.values())]
    values = [one for one in values if one["edge"] == "absolute" or one["between"] == "last_edge"]
    laws = [*(PrintedFollower(**one) for one in values), RepairedFollower()]
    for speed in SPEEDS:
        *printed, repaired = come_round(laws, speed)
        for one in itertools.compress(values, printed):
            print(", ".join(one.values()))
        of_all = f"{sum(printed)} of {len(values)} combinations come round"
        print(f"leader at {speed} m/s: {of_all}, the repaired follower {'too' if repaired else 'not'}", flush=True)


if __name__ == "__main__":
    main()
