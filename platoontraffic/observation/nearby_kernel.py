"""Bodies that are near a place, of thousands. Compiled."""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def nearby(x, y, by_x, sorted_x, i, reach, rows):
    """Fill in the rows of the bodies within `reach` [m] of body i along x and along y, itself among them, in order.

    x, y     : of all bodies, (N,) [m]
    by_x     : their rows in the order of x, sorted_x: their x in that order
    rows     : (N,), filled in from its begin
    returns  : how many there are
    """
    count = 0
    for place in range(np.searchsorted(sorted_x, x[i] - reach), len(x)):
        if sorted_x[place] - x[i] > reach:
            break
        if abs(y[by_x[place]] - y[i]) <= reach:
            rows[count] = by_x[place]
            count += 1
    rows[:count] = np.sort(rows[:count])
    return count
