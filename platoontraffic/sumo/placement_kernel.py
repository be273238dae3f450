"""Poses of members as SUMO takes them, compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.sumo import frame
from platoontraffic.sumo.frame import front_of, sumo_angle

compiled = compiler(__file__, frame.__file__)
_front_of, _sumo_angle = compiled(front_of), compiled(sumo_angle)


def load() -> None:
    """Load what is compiled here."""
    fill_in_poses(*np.empty((4, 0)), np.empty((3, 0)))


@compiled
def fill_in_poses(x, y, heading, length, poses):
    """Fill in SUMO's x, y and angle, (3, n), of vehicles with these centres, headings and lengths, (n,).

    returns: whether all are finite
    """
    sound = True
    for i in range(len(x)):
        poses[0, i], poses[1, i] = _front_of(x[i], y[i], heading[i], length[i])
        poses[2, i] = _sumo_angle(heading[i])
        sound &= math.isfinite(poses[0, i] + poses[1, i] + poses[2, i])
    return sound
