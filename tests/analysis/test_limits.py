"""Exact limits against their tables and closed forms; coverage by simulation; p values, Holm's correction, power."""

from __future__ import annotations

import itertools
import math
import warnings

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis import (
    binomial_limits,
    detectable,
    holm,
    interval,
    paired,
    poisson_limits,
    runs_needed,
    summarise,
)
from platoontraffic.analysis.limits import of_difference, sign_flip_p
from platoontraffic.analysis.tables import EQUAL, FEW, IDENTICAL
from tests.benchmarks import interval_coverage as coverage


@pytest.mark.parametrize(
    ("events", "low", "high"), [(0, 0, 3.689), (1, 0.0253, 5.572), (5, 1.623, 11.668), (10, 4.795, 18.390)]
)
def test_limits_of_counts_are_those_of_garwoods_table(events, low, high):
    assert poisson_limits(events) == pytest.approx((low, high), abs=5e-4)
    assert poisson_limits(events, 10) == pytest.approx((low / 10, high / 10), abs=5e-5)


def test_no_event_in_n_runs_leaves_its_closed_form():
    assert poisson_limits(0, 20) == (0, pytest.approx(-math.log(0.025) / 20))
    assert binomial_limits(0, 20) == (0, pytest.approx(1 - 0.025 ** (1 / 20)))
    low, high = binomial_limits(20, 20)
    assert (low, high) == (pytest.approx(0.025 ** (1 / 20)), 1)


@pytest.mark.parametrize(("hits", "runs", "low", "high"), [(1, 10, 0.0025, 0.4450), (5, 20, 0.0866, 0.4910)])
def test_limits_of_shares_are_those_of_clopper_and_pearsons_table(hits, runs, low, high):
    assert binomial_limits(hits, runs) == pytest.approx((low, high), abs=5e-4)
    mirrored = binomial_limits(runs - hits, runs)
    assert mirrored == pytest.approx((1 - high, 1 - low), abs=5e-4)


def test_many_events_approach_the_normal_distribution():
    low, high = poisson_limits(40_000)
    assert (low, high) == pytest.approx((40_000 - 1.96 * 200, 40_000 + 1.96 * 200), abs=4)


def test_exact_coverage_of_exact_limits_is_never_below_their_level():
    """Without simulation: the probabilities of all outcomes whose limits contain the truth."""
    for rate in (0.1, 0.5, 1.0, 5.0):
        for n in (8, 40):
            mean = rate * n
            at = range(int(mean + 12 * math.sqrt(mean)) + 12)
            covers = [low <= rate <= high for low, high in (poisson_limits(k, n) for k in at)]
            weights = [math.exp(k * math.log(mean) - mean - math.lgamma(k + 1)) for k in at]
            assert sum(w for w, c in zip(weights, covers, strict=True) if c) >= 0.95
    for share, n in itertools.product((0.02, 0.05, 0.3, 0.5), (8, 40)):
        weights = [math.comb(n, k) * share**k * (1 - share) ** (n - k) for k in range(n + 1)]
        covers = [low <= share <= high for low, high in (binomial_limits(k, n) for k in range(n + 1))]
        assert sum(w for w, c in zip(weights, covers, strict=True) if c) >= 0.95


@pytest.mark.parametrize(
    "kind", [k for k in coverage.KINDS if k.name in ("normal", "Poisson, 0.2 a run", "share of runs, 0.05")]
)
@pytest.mark.parametrize("measure", [coverage.of_means, coverage.of_differences])
def test_intervals_of_tables_cover_the_truth_as_the_benchmark_prints(kind, measure):
    with warnings.catch_warnings(action="ignore"):
        shares = [measure(kind, 10, 300)]
    assert coverage.verdict(kind, shares, 300) == ""
    assert shares[0] < 1 or kind.exact


def study(values: list[float], **columns) -> pd.DataFrame:
    return pd.DataFrame(
        {"seed": range(len(values)), "speed_mps": np.sin(np.arange(len(values))), **columns, "x": values}
    )


def test_no_contact_in_ten_runs_has_an_upper_limit():
    """Rule of three, two-sided: 3.7 / 10 contacts a run are not excluded. By the bootstrap, nothing would be."""
    table = study([0] * 10)
    (row,) = summarise(table, "x", counts="x").itertuples()
    assert (row.mean, row.low, row.high) == (0, 0, pytest.approx(0.3689, abs=1e-4))
    assert (row.n, row.method) == (10, "exact Poisson")
    table.attrs["counts"] = ["x"]
    assert summarise(table, "x").high.to_list() == [row.high]
    (row,) = summarise(study([0] * 10).assign(x=False), "x").itertuples()
    assert (row.low, row.high, row.method) == (0, pytest.approx(0.3085, abs=1e-4), "exact binomial")


def test_counts_in_clusters_get_the_wider_interval_of_the_bootstrap():
    (row,) = summarise(study([0, 0, 0, 0, 0, 0, 0, 0, 0, 40]), "x", counts="x").itertuples()
    exact = poisson_limits(40, 10)
    assert row.low < exact[0]
    assert row.high > exact[1]
    assert row.method == "exact Poisson or bootstrap"


def test_a_difference_of_no_contacts_has_limits():
    arms = pd.concat([study([0] * 10, arm=arm) for arm in (1, 2)])
    arms["speed_mps"] += arms.arm
    (row,) = paired(arms, "x", "arm", (1, 2), counts="x").itertuples()
    assert (row.mean, row.low, row.high) == (0, pytest.approx(-0.3689, abs=1e-4), pytest.approx(0.3689, abs=1e-4))
    assert row.p == 1


def test_limits_of_a_difference_of_normal_means_are_the_known_ones():
    """With symmetric limits they are d -+ sqrt(half-width^2 + half-width^2)."""
    assert of_difference((1, (0.7, 1.3)), (3, (2.6, 3.4))) == pytest.approx((1.5, 2.5))


def test_identical_runs_are_noticed_and_have_no_interval():
    same = study([0] * 10).assign(speed_mps=12.345)
    with pytest.warns(UserWarning, match="x: the runs are identical although their seeds differ"):
        (row,) = summarise(same, "x", counts="x").itertuples()
    assert math.isnan(row.high)
    assert row.method == IDENTICAL
    with pytest.warns(UserWarning, match="speed_mps: equal values have no interval"):
        (row,) = summarise(same.assign(x=range(10)), "speed_mps").itertuples()
    assert (math.isnan(row.low), row.method) == (True, EQUAL)


def test_few_values_are_warned_of():
    with pytest.warns(UserWarning, match="speed_mps: fewer than 8 values: the interval is too narrow"):
        assert summarise(study([1] * 7), "speed_mps").method.to_list() == [FEW]
    with warnings.catch_warnings(action="error"):
        summarise(study([1] * 8), "speed_mps")


def test_a_count_must_be_one():
    with pytest.raises(ValueError, match=r"is no count: it has 0\.5"):
        summarise(study([1, 0.5]), "x", counts="x")


def test_geometric_means_are_of_ratios():
    """A ratio and its inverse cancel, and the interval of inverses is the inverse interval."""
    ratios = np.exp(np.random.default_rng(1).normal(0, 0.3, 12))
    (row,) = summarise(study(list(ratios)), "x", geometric=True).itertuples()
    assert row.mean == pytest.approx(np.exp(np.log(ratios).mean()))
    assert (row.low, row.high) == pytest.approx(tuple(np.exp(interval(np.log(ratios)))))
    with pytest.raises(ValueError, match="'x': has values that are not positive"):
        summarise(study([1, 0]), "x", geometric=True)


def test_p_of_flipped_signs_is_exact():
    assert sign_flip_p([1, 2, 3, 4]) == 2 / 16
    assert sign_flip_p([1, -1]) == 1
    assert sign_flip_p([0.1] * 10) == 2 / 1024
    rng = np.random.default_rng(3)
    few = np.mean([sign_flip_p(rng.normal(0, 1, 10)) <= 0.05 for _ in range(600)])
    many = np.mean([sign_flip_p(rng.normal(0, 1, 20)) <= 0.05 for _ in range(300)])
    assert few == pytest.approx(0.05, abs=3 * math.sqrt(0.05 * 0.95 / 600))
    assert many == pytest.approx(0.05, abs=3 * math.sqrt(0.05 * 0.95 / 300))


def test_holms_correction_is_that_of_his_example():
    """Sorted p times 3, 2, 1, never falling, never above 1; in the given order."""
    assert holm([0.04, 0.01, 0.03]).tolist() == pytest.approx([0.06, 0.03, 0.06])
    assert holm([0.9, 0.8]).tolist() == [1, 1]
    assert holm([0.02]).tolist() == [0.02]


def test_holm_keeps_false_verdicts_of_a_study_at_five_percent():
    p = np.random.default_rng(4).random((2000, 9))
    assert (p.min(axis=1) < 0.05).mean() > 0.3
    corrected = np.array([holm(one).min() for one in p])
    assert (corrected < 0.05).mean() == pytest.approx(0.05, abs=0.015)


def test_runs_needed_find_a_difference_as_often_as_they_say():
    n = runs_needed(sd=2.0, difference=1.5)
    assert n == 16
    rng = np.random.default_rng(5)
    found = np.mean([sign_flip_p(rng.normal(1.5, 2.0, n)) < 0.05 for _ in range(400)])
    assert found == pytest.approx(0.8, abs=3 * math.sqrt(0.8 * 0.2 / 400))


def test_detectable_is_the_inverse_of_runs_needed():
    for n in (8, 20, 100):
        assert runs_needed(2.0, detectable(2.0, n) * (1 + 1e-9)) == n
    assert runs_needed(2.0, 1.5, verdicts=9) > runs_needed(2.0, 1.5, power=0.9) > runs_needed(2.0, 1.5)
    assert detectable(2.0, 1) == math.inf
    with pytest.raises(ValueError, match="power = 80: must be between 0 and 1"):
        runs_needed(1, 1, power=80)


def test_what_has_no_limits_is_said():
    with pytest.raises(ValueError, match="-1 events in 1 runs"):
        poisson_limits(-1)
    with pytest.raises(ValueError, match="3 events in 0 runs"):
        poisson_limits(3, 0)
    with pytest.raises(ValueError, match="5 hits in 3 runs"):
        binomial_limits(5, 3)
    with pytest.raises(ValueError, match="difference = 0"):
        runs_needed(1.0, 0.0)


@pytest.mark.parametrize("sd", [-1, math.nan, math.inf])
def test_a_standard_deviation_is_finite_and_not_negative(sd):
    for function, other in ((runs_needed, 0.5), (detectable, 10)):
        with pytest.raises(ValueError, match=f"sd = {sd}: must be finite, and not negative"):
            function(sd, other)


def test_holm_leaves_out_what_is_no_p_value():
    np.testing.assert_allclose(holm([np.nan, 0.01, 0.04]), [np.nan, 0.02, 0.04])
