"""Closing speeds, compiled."""

from __future__ import annotations

import math

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

FASTEST = 40.0  # greatest speed of anything that comes towards the vehicle or drives away from it [m/s]


@compiled
def closing_speeds(free, before, closing, speed, dt, same, time_constant, found):
    """Fill in the result of `closing.closing_speed`, (n,)."""
    for i in range(len(free)):
        known = (before[i] - free[i]) / dt if math.isnan(closing[i]) else closing[i]
        if not (known > -FASTEST and known < speed[i] + FASTEST):  # another obstacle
            known = math.nan
        surprise = free[i] - (before[i] - known * dt)
        found[i] = math.nan
        if math.isfinite(free[i]) and abs(surprise) < same[i]:
            found[i] = known + math.expm1(-dt / time_constant) * surprise / dt
