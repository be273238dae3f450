"""Checks of what laws decide, compiled."""

from __future__ import annotations

import math

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def all_finite(one, other, distance, bearing):
    """Whether both parts of all commands are finite, and no target is infinite; arrays (n,)."""
    sound = True
    for i in range(len(one)):
        sound &= math.isfinite(one[i]) and math.isfinite(other[i])
    for i in range(len(distance)):
        sound &= not (math.isinf(distance[i]) or math.isinf(bearing[i]))
    return sound
