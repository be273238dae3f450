"""Means with intervals, differences on common seeds, growth along a platoon: against closed forms and theory."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis import Batch, ResultsError, amplification, interval, paired, summarise

SIZE = "platoon.size"


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
    assert table.columns.to_list() == [SIZE, "sumo.demand", "metric", "mean", "low", "high", "n"]
    assert table[[SIZE, "sumo.demand"]].to_numpy().tolist() == [[1, 0.5], [1, 1.0], [5, 0.5], [5, 1.0]]
    own = summary[(summary[SIZE] == 5) & (summary["sumo.demand"] == 1.0)].delay_s
    assert table["mean"].iloc[3] == pytest.approx(own.mean())
    assert (table.n == 5).all()
    assert ((table.low < table["mean"]) & (table["mean"] < table.high)).all()
    assert table.attrs["units"]["delay_s"] == "s"
    assert len(summarise(summary, ["delay_s", "seed"])) == 2


def test_of_a_batch_it_is_that_of_its_summary(summary, tmp_path):
    batch = Batch(tmp_path, summary, summary, [SIZE, "sumo.demand"])
    pd.testing.assert_frame_equal(summarise(batch, "delay_s", SIZE), summarise(summary, "delay_s", SIZE))


def test_the_same_table_in_any_order_gives_the_same_bytes(summary):
    once = summarise(summary, "delay_s", SIZE).to_csv()
    assert summarise(summary.sample(frac=1, random_state=3), "delay_s", SIZE).to_csv() == once


def test_missing_values_are_not_counted(summary):
    summary.loc[summary[SIZE] == 1, "delay_s"] = np.nan
    first, second = summarise(summary, "delay_s", SIZE).itertuples()
    assert (first.n, math.isnan(first.mean), math.isnan(first.low)) == (0, True, True)
    assert second.n == 10


def test_an_interval_moves_and_grows_with_its_values():
    values = np.random.default_rng(1).normal(size=12)
    low, high = interval(values)
    assert interval(3 * values + 7) == pytest.approx((3 * low + 7, 3 * high + 7))
    assert interval(-values) == pytest.approx((-high, -low), abs=0.05)  # other draws, the same distribution


def test_an_interval_narrows_as_the_root_of_n():
    rng = np.random.default_rng(2)
    widths = [np.mean([np.ptp(interval(rng.normal(size=n), resamples=1000)) for _ in range(60)]) for n in (25, 100)]
    assert widths[0] / widths[1] == pytest.approx(2, rel=0.1)


def test_of_one_value_nothing_is_said_and_equal_ones_have_no_spread():
    assert np.isnan(interval([3.0])).all()
    assert interval([3.0] * 4) == (3.0, 3.0)


@pytest.mark.parametrize("n", [10, 20])
def test_a_95_percent_interval_covers_the_mean_in_95_percent(n):
    """The share of 2000 has a standard deviation of 0.0049. Three of them, and 0.01 as n is not infinite."""
    rng = np.random.default_rng(n)
    ends = np.array([interval(rng.normal(5, 2, n), resamples=1000) for _ in range(2000)])
    share = ((ends[:, 0] <= 5) & (ends[:, 1] >= 5)).mean()
    assert abs(share - 0.95) < 3 * math.sqrt(0.95 * 0.05 / 2000) + 0.01


def test_pairing_removes_what_a_seed_does_to_both(summary):
    """The effect of the size is 2 a vehicle, exactly; seeds differ by thousands."""
    table = paired(summary, "delay_s", SIZE, (1, 5), "sumo.demand")
    assert table[["mean", "low", "high"]].to_numpy().tolist() == [[8.0] * 3] * 2
    assert (table.n == 5).all()
    assert (table.left_out == "").all()
    backwards = paired(summary, "delay_s", SIZE, (5, 1), "sumo.demand")
    assert (backwards["mean"] == -8.0).all()
    apart = summarise(summary, "delay_s", SIZE)
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
        (lambda t: summarise(t, "id"), "'id': has no numbers, such as 'run10.51'"),
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


FREQUENCY = 0.13


def string(gains: list[float], *, trend: float = 0.0, seconds: float = 61.7, **before) -> pd.DataFrame:
    """A platoon whose member i swings gains[i] m/s, ever later, about speeds that drift."""
    time = np.arange(0, seconds, 0.1)
    parts = [
        pd.DataFrame(
            {
                **before,
                "time_s": time,
                "platoon_id": "p",
                "vehicle_id": f"p.{place}",
                "place": place,
                "speed_mps": 20 + place + trend * time + gain * np.sin(2 * np.pi * FREQUENCY * time - 0.4 * place),
            }
        )
        for place, gain in enumerate(gains)
    ]
    return pd.concat(parts).sort_values(["time_s", "place"], kind="stable", ignore_index=True)


def test_amplification_of_sinusoids_is_that_of_their_amplitudes():
    """However long, whatever the drift and the delay."""
    table = amplification(string([0.5, 0.6, 0.45], trend=0.07), FREQUENCY)
    assert table.columns.to_list() == ["platoon_id", "vehicle_id", "place", "amplification"]
    assert table.amplification.to_list() == pytest.approx([1, 1.2, 0.9], abs=1e-9)


@pytest.mark.parametrize("norm", ["l2", "linf"])
def test_over_whole_periods_norms_say_the_same(norm):
    periods = string([0.5, 1.0, 0.25], seconds=50 / FREQUENCY)
    assert amplification(periods, norm=norm).amplification.to_list() == pytest.approx([1, 2, 0.5], rel=0.01)


def test_what_is_outside_the_window_does_not_count():
    table = string([0.5, 0.6])
    table.loc[(table.place == 1) & (table.time_s > 40), "speed_mps"] = 0.0
    assert amplification(table, FREQUENCY, window=(0, 40)).amplification.iloc[1] == pytest.approx(1.2)


def test_runs_of_a_batch_are_kept_apart():
    both = [string(gains, id=name, seed=1) for name, gains in (("a", [0.5, 0.6]), ("b", [0.5, 0.4]))]
    table = amplification(pd.concat(both), FREQUENCY)
    assert table.columns.to_list()[:2] == ["id", "seed"]
    assert table.amplification.to_list() == pytest.approx([1, 1.2, 1, 0.8])
    assert summarise(table, "amplification", "place")["mean"].to_list() == pytest.approx([1, 1])


def test_behind_a_leader_that_hardly_swings_there_is_nothing_to_compare_with():
    assert amplification(string([0.0, 0.6]), FREQUENCY).amplification.isna().all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"norm": "l1"}, "norm = 'l1': must be 'l2' or 'linf'"),
        ({"frequency": -1.0}, "frequency = -1.0: must be positive"),
        ({"window": (90, 100)}, r"no rows within \(90, 100\) s"),
    ],
)
def test_amplification_says_what_is_wrong(arguments, said):
    with pytest.raises(ResultsError, match=said):
        amplification(string([0.5, 0.6]), **arguments)


def test_amplification_needs_the_leader():
    table = string([0.5, 0.6])
    with pytest.raises(ResultsError, match="platoon p: its leader is not in the table"):
        amplification(table[table.place > 0])
