"""Growth of a disturbance along a platoon: against closed forms."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis import ResultsError, amplification, peak, summarise

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
    assert table.columns.to_list() == ["platoon_id", "vehicle_id", "place", "amplification", "signal_to_noise"]
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


def test_a_swing_below_the_noise_has_no_ratio():
    """The last member swings by 1 mm/s under noise of 5 mm/s: its ratio would be one of noise."""
    table = string([0.5, 0.4, 0.001], seconds=300)
    noise = np.random.default_rng(1).normal(0, 0.005 * np.sqrt(30), len(table))
    table["speed_mps"] += np.where(table.place > 0, noise, 0.0)
    found = amplification(table, FREQUENCY)
    assert found.amplification.iloc[1] == pytest.approx(0.8, rel=0.03)
    assert np.isnan(found.amplification.iloc[2])
    assert found.signal_to_noise.iloc[1] > 20 > 3 > found.signal_to_noise.iloc[2]


def test_head_to_tail_has_an_interval_around_the_geometric_mean():
    gains = np.exp(np.random.default_rng(2).normal(np.log(0.5), 0.2, 10))
    runs = pd.concat([string([0.5, 0.45, 0.5 * gain], id=str(i), seed=i) for i, gain in enumerate(gains)])
    found = amplification(runs, FREQUENCY)
    last = summarise(found[found.place == 2], "amplification", "place", geometric=True).iloc[0]
    assert last["mean"] == pytest.approx(np.exp(np.log(gains).mean()))
    assert last.low < last["mean"] < last.high
    assert last["n"] == 10


def test_the_peak_is_the_greatest_mean_over_frequency_with_a_wider_interval():
    """A resonance at the second of three frequencies; the frequency is a column of the runs."""
    rng, parts = np.random.default_rng(3), []
    for frequency, gain in ((0.05, 0.9), (0.1, 1.4), (0.2, 0.5)):
        for seed in range(8):
            gains = [0.5, 0.5 * gain * np.exp(rng.normal(0, 0.05))]
            time_scale = frequency / FREQUENCY
            run = string(gains, seconds=200, id=f"{frequency}-{seed}", seed=seed, hz=frequency)
            run["time_s"] /= time_scale
            parts.append(run)
    found = amplification(pd.concat(parts), "hz")
    (row,) = peak(found[found.place == 1], "hz").itertuples()
    assert (row.hz, row.place, row.n) == (0.1, 1, 8)
    assert row.mean == pytest.approx(1.4, rel=0.05)
    alone = summarise(found[(found.place == 1) & (found.hz == 0.1)], "amplification", geometric=True).iloc[0]
    assert row.low < alone.low
    assert row.high > alone.high
