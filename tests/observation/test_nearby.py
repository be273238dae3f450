"""Bodies near one another, against a comparison of all with all."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.observation.nearby_kernel import FEW, in_order_of_x, nearby


@pytest.mark.parametrize("bodies", [1, FEW, FEW + 1, 300])
@pytest.mark.parametrize("reach", [0.0, 3.0, 200.0])
def test_they_are_those_within_reach_along_both_axes_in_order(reach, bodies):
    x, y = np.round(np.random.default_rng(1).uniform(0, 100, (2, bodies)))  # many have equal ones
    order, rows = in_order_of_x(x, y), np.empty(len(x), np.intp)
    for i in range(len(x)):
        near = (np.abs(x - x[i]) <= reach) & (np.abs(y - y[i]) <= reach)
        count = nearby(x[i], y[i], order, reach, rows)
        assert rows[:count].tolist() == np.flatnonzero(near).tolist()
