"""Bodies near one another, against a comparison of all with all."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.observation.nearby_kernel import FEW, in_cells, nearby, sort_few


def compare_with_all(x, y, places_x, places_y, reach):
    cells, rows = in_cells(x, y), np.empty(len(x), np.intp)
    for px, py in zip(places_x, places_y, strict=True):
        near = (np.abs(x - px) <= reach) & (np.abs(y - py) <= reach)
        found = rows[: nearby(px, py, cells, reach, rows)]
        sort_few(found)
        assert found.tolist() == np.flatnonzero(near).tolist()


@pytest.mark.parametrize("bodies", [1, FEW, FEW + 1, 300])
@pytest.mark.parametrize("reach", [0.0, 3.0, 200.0])
def test_they_are_those_within_reach_along_both_axes(reach, bodies):
    x, y = np.round(np.random.default_rng(1).uniform(0, 100, (2, bodies)))  # many have equal ones
    compare_with_all(x, y, x, y, reach)


@pytest.mark.parametrize("reach", [0.5, 40.0, 1e9])
def test_places_may_be_far_from_all_bodies_and_bodies_in_a_line_or_nowhere(reach):
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 5000, 400), np.full(400, -3.0)
    compare_with_all(x, y, [-1e6, 7e3, 2500.0, *x], [0.0, -3.0, -2.5, *y], reach)
    y = rng.uniform(-1e4, 1e4, 400)
    x[::7], y[3::11] = np.nan, np.inf
    compare_with_all(x, y, [2500.0, 2500.0, 0.0], [0.0, 1e6, 1e4], reach)
    compare_with_all(np.full(50, np.nan), y[:50], [0.0], [0.0], reach)
    compare_with_all(np.full(50, 3.0), np.full(50, 4.0), [3.0, 3.6], [4.0, 4.0], reach)
