"""Where paths through a junction are near each other, against the distances of all their points."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.sumo.conflicts import Sampled, _met


@pytest.mark.parametrize("apart", [0.01, 0.5, 2.0, 50.0])
def test_the_stretches_are_those_of_the_points_that_are_nearer(apart):
    rng = np.random.default_rng(1)
    for _ in range(20):
        one, other = (Sampled(np.arange(k) / 4, rng.uniform(-9, 9, 2) + rng.normal(0, 0.3, (k, 2)).cumsum(axis=0))
                      for k in (30, 40))  # fmt: skip
        near = np.hypot(*(one.points[:, None] - other.points).transpose(2, 0, 1)) < apart
        mine, its = one.stations[near.any(axis=1)], other.stations[near.any(axis=0)]
        expected = ((mine[0], mine[-1]), (its[0], its[-1])) if near.any() else None
        assert _met(one, other, apart) == expected
