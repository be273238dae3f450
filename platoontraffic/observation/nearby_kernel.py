"""Bodies that are near a place, of thousands. Compiled."""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar.compiled import compiler

FEW = 24  # bodies up to which each is looked at, as that takes less time than to sort them

compiled = compiler(__file__)


@compiled
def in_order_of_x(x):
    """Rows of bodies in the order of x, and their x in that order, for `nearby`; up to FEW bodies stay as they are."""
    by_x = np.argsort(x) if len(x) > FEW else np.arange(len(x))
    return by_x, x[by_x]


@compiled
def nearby(x, y, by_x, sorted_x, i, reach, rows):
    """Fill in the rows of the bodies within `reach` [m] of body i along x and along y, itself among them, in order.

    x, y           : of all bodies, (N,) [m]
    by_x, sorted_x : of `in_order_of_x`
    rows           : (N,), filled in from its begin
    returns        : how many there are
    """
    count = 0
    if len(x) <= FEW:
        for k in range(len(x)):
            if abs(x[k] - x[i]) <= reach and abs(y[k] - y[i]) <= reach:
                rows[count] = k
                count += 1
        return count
    for place in range(np.searchsorted(sorted_x, x[i] - reach), len(x)):
        if sorted_x[place] - x[i] > reach:
            break
        if abs(y[by_x[place]] - y[i]) <= reach:
            # Into its place among those before: they are few, and a sort of its own takes several times as long.
            row, at = by_x[place], count
            while at > 0 and rows[at - 1] > row:
                rows[at] = rows[at - 1]
                at -= 1
            rows[at] = row
            count += 1
    return count
