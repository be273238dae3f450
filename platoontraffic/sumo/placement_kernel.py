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
    fill_in_poses(*np.empty((4, 0)), np.empty((0, 3)))


@compiled
def fill_in_poses(x, y, heading, length, poses):
    """Fill in SUMO's x, y and angle, (n, 3), of vehicles with these centres, headings and lengths, (n,).

    returns: whether all are finite
    """
    sound = True
    for i in range(len(x)):
        poses[i, 0], poses[i, 1] = _front_of(x[i], y[i], heading[i], length[i])
        poses[i, 2] = _sumo_angle(heading[i])
        sound &= math.isfinite(poses[i, 0] + poses[i, 1] + poses[i, 2])
    return sound
