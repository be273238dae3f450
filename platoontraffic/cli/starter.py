"""`platoontraffic new NAME`: a scenario with a law to start from, short enough to read in a minute."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from platoontraffic.errors import InputError, not_written

SCENARIO = """\
title = "My follower behind the paper's leader"

[sumo]
net = "lab_loop"                # a shipped network (see: platoontraffic list nets), or a .net.xml file

[run]
duration_s = 120.0

[[platoon]]
id = "robot"
size = 3
start = { edge = "sw_se", position_m = 1.9 }
gap_m = 0.45                    # between the bumpers, at the start

[platoon.leader]
law = "reactive"

[platoon.follower]
law = "follower:MyFollower"
gap_m = 0.40                    # a field of MyFollower
"""

LAW = '''\
"""A follower that drives towards the nearest return of its laser, and stops at a distance from it."""

from dataclasses import dataclass

import numpy as np

from platoontraffic import Decision, Law, Target, Twist, per_vehicle


@dataclass(frozen=True)
class MyFollower(Law):
    gap_m: float = 0.40          # laser to rear [m]; the fields are keys of [platoon.follower] in the scenario
    speed_gain: float = 1.0      # [1/s]
    turn_gain: float = 1.0       # [1/s]

    def desired_distance(self, speed):
        """Distance that it keeps at a steady speed [m]; with it the results have a gap error."""
        return self.gap_m + speed / self.speed_gain

    @per_vehicle                 # written for one vehicle: a scan and floats
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
    """Make a folder with a scenario and a law in it.

    raises: InputError if its name cannot be that of a scenario, or if it exists; RunError if the disk is full
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", folder.name):
        raise InputError(f"argument 1: {folder.name!r}: must begin with a letter, then letters, digits, _ or -")
    try:
        folder.mkdir(parents=True)
        (folder / f"{folder.name}.toml").write_text(SCENARIO, encoding="utf-8")
        (folder / "follower.py").write_text(LAW, encoding="utf-8")
    except FileExistsError:
        raise InputError(f"argument 1: {folder} exists; nothing was changed") from None
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise not_written(error, folder) from error
    return folder
