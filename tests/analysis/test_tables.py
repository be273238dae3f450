"""Means with intervals, differences on common seeds: against closed forms and theory."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis import Batch, ResultsError, interval, paired, summarise

SIZE = "platoon.size"
BOTH = [SIZE, "sumo.demand"]


@pytest.fixture
def summary() -> pd.DataFrame:
    """Two sizes at two demands, five seeds each; the delay has an effect of every one of them."""
    rows = [
        (f"run{size}{demand}{seed}", seed, size, demand, 16.0 * seed**3 + 2.0 * size + demand * seed)
        for size in (1, 5)
        for demand in (0.5, 1.0)
        for seed in range(1, 6)
    ]
    table = pd.DataFrame(rows, columns=["id", "seed", SIZE, "sumo.demand", "delay_s"])
    table.attrs["units"] = {"delay_s": "s"}
    return table


def test_a_row_a_combination(summary):
    table = summarise(summary, "delay_s", [SIZE, "sumo.demand"])
    assert table.columns.to_list() == [SIZE, "sumo.demand", "metric", "mean", "low", "high", "n", "method"]
    assert table[[SIZE, "sumo.demand"]].to_numpy().tolist() == [[1, 0.5], [1, 1.0], [5, 0.5], [5, 1.0]]
    own = summary[(summary[SIZE] == 5) & (summary["sumo.demand"] == 1.0)].delay_s
    assert table["mean"].iloc[3] == pytest.approx(own.mean())
    assert (table.n == 5).all()
    assert ((table.low < table["mean"]) & (table["mean"] < table.high)).all()
    assert table.attrs["units"]["delay_s"] == "s"
    assert len(summarise(summary, ["delay_s", "seed"], BOTH)) == 8


def test_points_with_common_seeds_are_not_taken_for_more_runs(summary):
    """Four seeds at two sizes are not the eight values that an interval needs."""
    four = summary[(summary["sumo.demand"] == 1.0) & (summary.seed < 5)]
    with pytest.raises(ResultsError, match=r"^several runs have seed 1; `by` must name what else varies$"):
        summarise(four, "delay_s")
    with pytest.raises(ResultsError, match=r"^sumo\.demand = 0\.5: several runs have seed 1; "):
        summarise(summary, "delay_s", "sumo.demand")
    of_seeds = four.groupby("seed", as_index=False)["delay_s"].mean()
    (row,) = summarise(of_seeds, "delay_s").itertuples()
    assert (row.n, row.mean) == (4, pytest.approx(four.delay_s.mean()))


def test_of_a_batch_it_is_that_of_its_summary(summary, tmp_path):
    batch = Batch(tmp_path, summary, summary, [SIZE, "sumo.demand"])
    pd.testing.assert_frame_equal(summarise(batch, "delay_s", BOTH), summarise(summary, "delay_s", BOTH))


def test_the_same_table_in_any_order_gives_the_same_bytes(summary):
    once = summarise(summary, "delay_s", BOTH).to_csv()
    assert summarise(summary.sample(frac=1, random_state=3), "delay_s", BOTH).to_csv() == once


def test_missing_values_are_not_counted(summary):
    summary.loc[summary[SIZE] == 1, "delay_s"] = np.nan
    first, _, second, _ = summarise(summary, "delay_s", BOTH).itertuples()
    assert (first.n, math.isnan(first.mean), math.isnan(first.low)) == (0, True, True)
    assert second.n == 5


def test_an_interval_moves_and_grows_with_its_values():
    values = np.random.default_rng(1).normal(size=12)
    low, high = interval(values)
    assert interval(3 * values + 7) == pytest.approx((3 * low + 7, 3 * high + 7))
    assert interval(-values) == pytest.approx((-high, -low), abs=0.05)  # other draws, the same distribution


def test_an_interval_narrows_as_the_root_of_n():
    rng = np.random.default_rng(2)
    widths = [np.mean([np.ptp(interval(rng.normal(size=n), resamples=1000)) for _ in range(60)]) for n in (25, 100)]
    assert widths[0] / widths[1] == pytest.approx(2, rel=0.1)


def test_of_one_value_or_equal_ones_nothing_is_said():
    """Equal values do not say that another run would give the same: an interval without width would."""
    assert np.isnan(interval([3.0])).all()
    assert np.isnan(interval([3.0] * 4)).all()


@pytest.mark.parametrize("n", [10, 20])
def test_a_95_percent_interval_covers_the_mean_in_95_percent(n):
    """The share of 2000 has a standard deviation of 0.0049. Three of them, and 0.01 as n is not infinite."""
    rng = np.random.default_rng(n)
    ends = np.array([interval(rng.normal(5, 2, n), resamples=1000) for _ in range(2000)])
    share = ((ends[:, 0] <= 5) & (ends[:, 1] >= 5)).mean()
    assert abs(share - 0.95) < 3 * math.sqrt(0.95 * 0.05 / 2000) + 0.01


def test_pairing_removes_what_a_seed_does_to_both(summary):
    """The effect of the size is 2 a vehicle, and hardly a hundredth more or less; seeds differ by thousands."""
    summary.loc[summary[SIZE] == 5, "delay_s"] += 0.01 * np.sin(summary.seed)
    table = paired(summary, "delay_s", SIZE, (1, 5), "sumo.demand")
    assert (table[["mean", "low", "high"]] - 8.0).abs().max(axis=None) < 0.02
    assert (table.high > table.low).all()
    assert (table.n == 5).all()
    assert (table.left_out == "").all()
    backwards = paired(summary, "delay_s", SIZE, (5, 1), "sumo.demand")
    assert backwards["mean"].to_list() == pytest.approx((-table["mean"]).to_list())
    apart = summarise(summary, "delay_s", BOTH)
    assert (apart.high - apart.low).min() > 500


def test_seeds_that_only_one_has_are_left_out_and_named(summary):
    summary = summary[(summary[SIZE] == 1) | (summary.seed < 4)]
    summary.loc[(summary[SIZE] == 1) & (summary.seed == 2), "delay_s"] = np.nan
    table = paired(summary, "delay_s", SIZE, (1, 5), ["sumo.demand"])
    assert (table.n == 2).all()
    assert (table.left_out == "2 4 5").all()
    assert (table["mean"] == 8.0).all()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda t: summarise(t, "delay"), r"'delay': not a column; did you mean 'delay_s'\?"),
        (lambda t: summarise(t, "delay_s", "sizes"), "'sizes': not a column; "),
        (lambda t: summarise(t, "id", BOTH), "'id': has no numbers, such as 'run10.51'"),
        (lambda t: summarise(t[:0], "delay_s"), "no run is done"),
        (lambda t: paired(t, "delay_s", SIZE, (1, 5)), "seed 1; `by` must name what else varies"),
        (lambda t: paired(t, "delay_s", SIZE, (1, 4), "sumo.demand"), "platoon.size: no run has 4; there are 1, 5"),
        (
            lambda t: paired(t[(t[SIZE] == 1) | (t.seed > 9)], "delay_s", SIZE, (1, 5), "sumo.demand"),
            "no run has 5; there are 1",
        ),
        (
            lambda t: paired(t[(t[SIZE] == 1) == (t.seed < 3)], "delay_s", SIZE, (1, 5), "sumo.demand"),
            "platoon.size = 1 and 5, sumo.demand = 0.5: no seed has delay_s of both",
        ),
        (lambda t: interval([1.0, math.inf]), "must be finite"),
        (lambda t: interval([1.0, 2.0], level=95), "level = 95: must be between 0 and 1"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(summary, call, said):
    with pytest.raises(ValueError, match=said) as raised:
        call(summary)
    assert "\n" not in str(raised.value)
