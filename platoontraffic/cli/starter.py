"""`platoontraffic new NAME`: a scenario with a follower of the user's own, small enough to be read at once."""

from __future__ import annotations

import re
from pathlib import Path

from platoontraffic.errors import InputError

SCENARIO = """\
title = "My follower behind the paper's leader"

[sumo]
net = "lab_loop"                # a shipped network (platoontraffic list nets), or a .net.xml file

[run]
duration_s = 120.0

[[platoon]]
id = "robot"
size = 3
start = { edge = "sw_se", position_m = 1.9 }
gap_m = 0.45

[platoon.leader]
law = "reactive"

[platoon.follower]
law = "follower:MyFollower"
gap_m = 0.40                    # a field of the law
"""

LAW = '''\
"""Follow the nearest return, at a gap."""

from dataclasses import dataclass

import numpy as np

from platoontraffic import Decision, Target, Twist, per_vehicle


@dataclass(frozen=True)
class MyFollower:
    gap_m: float = 0.40          # its fields are keys of [platoon.follower] in the scenario
    speed_gain: float = 1.0      # [1/s]
    turn_gain: float = 1.0       # [1/s]

    @per_vehicle
    def __call__(self, sensed, memory, dt):
        ranges = np.where(sensed.scan.valid(), sensed.scan.ranges, np.inf)
        nearest = ranges.argmin()
        if np.isinf(ranges[nearest]):
            return Decision(Twist(0.0, 0.0))
        distance, bearing = ranges[nearest], sensed.scan.angles()[nearest]
        twist = Twist(max(self.speed_gain * (distance - self.gap_m), 0.0), self.turn_gain * bearing)
        return Decision(twist, target=Target(distance, bearing))
'''


def write_starter(folder: Path) -> Path:
    """raises: InputError if the name is no name, or the folder is there already"""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", folder.name):
        raise InputError(f"argument 1: {folder.name!r}: must begin with a letter, then letters, digits, _ or -")
    try:
        folder.mkdir(parents=True)
        (folder / f"{folder.name}.toml").write_text(SCENARIO, encoding="utf-8")
        (folder / "follower.py").write_text(LAW, encoding="utf-8")
    except FileExistsError:
        raise InputError(f"argument 1: {folder} is there already; nothing was changed") from None
    except OSError as error:
        raise InputError(f"argument 1: {folder}: {error.strerror}") from error
    return folder
