"""How long vehicles have stood before what does not move either, compiled."""

from __future__ import annotations

import math

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

STANDS = 0.02  # speed below which a vehicle stands [vehicle lengths a second]
MOVES = 0.05  # change of the obstacle's distance from one scan to the next by which it moves [vehicle lengths]


@compiled
def wait(last, speed, length, free, before, held, patience, dt, after):
    """Fill in `Creeping.after`, where none begins to creep; returns whether one might.

    last : `Creeping` before
    free, before, held : as of `Creeping.after`
    patience : time that it stands before it creeps [s]
    """
    may_begin = False
    for i in range(len(speed)):
        driven, blocked = speed[i] * dt, math.isfinite(free[i])
        same = blocked and abs(free[i] - (before[i] - driven)) < MOVES * length[i]
        stands = speed[i] < STANDS * length[i] and same and not held[i]
        after.stood[i] = last.stood[i] + dt if stands else 0.0
        moved = blocked and math.isfinite(before[i]) and not same
        left = length[i] if same and last.left[i] > 0.0 else max(last.left[i] - driven, 0.0)
        after.left[i] = 0.0 if moved or held[i] else left
        may_begin |= after.stood[i] > patience and not last.left[i] > 0.0
    return may_begin
