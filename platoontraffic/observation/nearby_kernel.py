"""Bodies that are near a place, of thousands. Compiled."""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar.compiled import compiler

FEW = 24  # bodies up to which each is looked at, as that takes less time than to sort them

compiled = compiler(__file__)


@compiled
def in_order_of_x(x, y):
    """Rows of bodies in the order of x, and their places in that order, for `nearby`; up to FEW bodies stay as they
    are."""
    by_x = np.argsort(x) if len(x) > FEW else np.arange(len(x))
    return by_x, x[by_x], y[by_x]


@compiled
def nearby(x, y, order, reach, rows):
    """Fill in the rows of the bodies within `reach` of a place along x and along y [m], in order.

    order   : of `in_order_of_x`
    rows    : (N,), filled in from its begin
    returns : how many there are
    """
    by_x, all_x, all_y = order
    count = 0
    if len(all_x) <= FEW:
        for k in range(len(all_x)):
            if abs(all_x[k] - x) <= reach and abs(all_y[k] - y) <= reach:
                rows[count] = k
                count += 1
        return count
    for place in range(np.searchsorted(all_x, x - reach), len(all_x)):
        if all_x[place] - x > reach:
            break
        if abs(all_y[place] - y) <= reach:
            # Into its place among those before: they are few, and a sort of its own takes several times as long.
            row, at = by_x[place], count
            while at > 0 and rows[at - 1] > row:
                rows[at] = rows[at - 1]
                at -= 1
            rows[at] = row
            count += 1
    return count
