"""Flow, headways and queues from passages: against closed forms."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis.flow import (
    FROM_POSITION,
    at,
    by_interval,
    harmonic,
    mean_headway,
    queue_positions,
    saturation_headway,
)


def passing(times, speed=10.0, edge="e", lane=0):
    return pd.DataFrame({"time_s": times, "edge_id": edge, "lane_index": lane, "speed_mps": speed})


def test_equal_headways_have_their_mean_and_no_error():
    rows = at(passing(np.arange(0, 200, 2.0)), "e", since=20)
    assert mean_headway(rows) == pytest.approx((2.0, 0.0, 89))


def test_headways_are_those_of_a_lane():
    both = pd.concat([passing([0, 2, 4]), passing([1, 3, 5], lane=1), passing([1.5], edge="f")])
    assert at(both, "e").headway_s.dropna().tolist() == [2, 2, 2, 2]


def test_the_error_of_independent_headways_is_that_of_their_mean():
    """Standard deviation over the root of their number, here 1 / 40; from ten batches it is known within a quarter."""
    gaps = np.random.default_rng(1).exponential(1.0, size=(50, 1600)) + 1.0
    errors = [mean_headway(at(passing(np.cumsum(one)), "e")).error for one in gaps]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1 / 40, rel=0.1)


def test_a_queue_discharges_behind_its_first_four():
    """Starts cost 2, 1.5, 1 and 0.5 s; then 1.8 s each; after the tenth, vehicles arrive as they like."""
    one = np.cumsum([0, 3.8, 3.3, 2.8, *[1.8] * 6, 5, 6])
    rows = at(passing(np.concatenate([one + 70 * cycle for cycle in range(12)])), "e")
    assert queue_positions(rows).tolist() == [*range(1, 13)] * 12
    assert saturation_headway(rows, per_cycle=10) == pytest.approx((1.8, 0.0, 12 * (10 - FROM_POSITION)))


def test_the_capacity_of_a_mixture_is_the_harmonic_mean():
    """Drawn in random order, each headway that of its own vehicle."""
    member = np.random.default_rng(2).random(100_000) < 0.3
    rows = at(passing(np.cumsum(np.where(member, 1.2, 2.0))), "e")
    assert mean_headway(rows).value == pytest.approx(harmonic(0.3, 2.0, 1.2), rel=0.002)


def test_flow_is_density_times_speed():
    """Two streams, of 10 and 20 m/s: by Wardrop the mean speed is the harmonic one, the densities add."""
    table = by_interval(pd.concat([passing(np.arange(0, 600, 4.0), 10.0), passing(np.arange(1, 600, 4.0), 20.0)]), "e")
    assert table.time_s.tolist() == [*range(0, 600, 60)]
    assert table.flow_1ph.tolist() == [1800.0] * 10
    assert table.density_1pkm.to_numpy() == pytest.approx(900 / 36 + 900 / 72)
    assert table.speed_mps.to_numpy() == pytest.approx(1800 / 3.6 / (900 / 36 + 900 / 72))


def test_an_interval_that_the_end_of_the_run_cuts_off_is_left_out():
    """It had the passages of half a minute as those of a minute."""
    rows = passing(np.arange(0, 90, 2.0), 20.0)
    assert by_interval(rows, "e", until=90.0).flow_1ph.tolist() == [1800.0]
    at_rest = by_interval(pd.concat([passing(np.arange(0, 60, 3.0), 20.0), passing(np.arange(1, 60, 6.0), 0.0)]), "e")
    assert (at_rest.flow_1ph[0], at_rest.speed_mps[0]) == (1800.0, pytest.approx(20.0))  # all pass, few have a speed
    assert by_interval(passing(np.arange(0, 61, 2.0), 20.0), "e").flow_1ph.tolist() == [1800.0, 60.0]
    assert by_interval(rows, "e", until=120.0).flow_1ph.tolist() == [1800.0, 900.0]
