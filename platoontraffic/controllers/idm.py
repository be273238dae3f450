"""The Intelligent Driver Model.

M. Treiber, A. Hennecke, D. Helbing, "Congested traffic states in empirical observations and microscopic simulations",
Phys. Rev. E 62 (2000) 1805:

    dv/dt = a (1 - (v / v0)^4 - (s* / s)^2),      s* = s0 + max(0, v T + v dv / (2 sqrt(a b)))

without their s1; the maximum keeps s* from falling below s0 behind a faster vehicle. Arguments are floats or arrays.
"""

from __future__ import annotations

import numpy as np


def desired_gap(speed, closing, standing_gap, time_headway, acceleration, braking):
    """s* [m].

    speed        : v [m/s]
    closing      : dv, own speed less that of the vehicle ahead [m/s]
    standing_gap : s0 [m]
    time_headway : T [s]
    acceleration : a, greatest [m/s2]
    braking      : b, comfortable [m/s2]
    """
    dynamic = speed * time_headway + speed * closing / (2 * np.sqrt(acceleration * braking))
    return standing_gap + np.maximum(dynamic, 0.0)


def free_road(speed, desired_speed):
    """1 - (v / v0)^4: the share of the greatest acceleration on a free road."""
    return 1 - (speed / desired_speed) ** 4


def acceleration(desired, gap, greatest, free=1.0):
    """dv/dt [m/s2].

    desired, gap : s* and s [m]
    greatest     : a [m/s2]
    free         : `free_road`; 1 leaves the interaction with the vehicle ahead alone
    """
    return greatest * (free - (desired / gap) ** 2)
