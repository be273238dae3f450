"""String gains of made-up platoons: strings of first-order lags have closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from platoontraffic.results.metrics import compute
from platoontraffic.results.strings import EXCITED, FILTER, RESPONSE, SETTLING, windows, without
from tests.results.test_metrics import events, trajectories

LAG = 1.3  # time constant of every follower [s]
BEFORE = 30.0  # time of steady driving before anything happens [s]
FINE = 0.01  # step of integration [s]


def lagged(acceleration: np.ndarray, lag: float) -> np.ndarray:
    """Response of a first-order lag that was at rest; exact for an input that is constant over a step."""
    keeps, out = math.exp(-FINE / lag), np.zeros_like(acceleration)
    for i in range(1, len(out)):
        out[i] = keeps * out[i - 1] + (1 - keeps) * acceleration[i - 1]
    return out


def recorded(speeds: list[np.ndarray], every: float = 0.1, since: list[float] | None = None) -> pd.DataFrame:
    """trajectories.csv of a platoon whose members have these speeds, given at steps of FINE."""
    step = round(every / FINE)
    parts = []
    for place, speed in enumerate(speeds):
        time = np.round(np.arange(len(speed))[::step] * FINE, 3)
        rows = trajectories(time_s=time, speed_mps=speed[::step]).query("place == 1")
        parts.append(rows.assign(vehicle_id=f"p.{place}", place=place))
    return pd.concat(parts)


def string(acceleration, seconds: float, followers: int = 3, lag: float = LAG, speed: float = 25.0, **kwargs):
    """Each follower's acceleration lags its predecessor's; acceleration: the leader's, a function of time."""
    time = np.arange(round(seconds / FINE) + 1) * FINE
    members = [np.array([acceleration(t) for t in time])]
    for _ in range(followers):
        members.append(lagged(members[-1], lag))
    return recorded([speed + np.concatenate([[0], np.cumsum(a)[:-1]]) * FINE for a in members], **kwargs)


def gains(table: pd.DataFrame, *more: tuple) -> dict[str, dict[str, float]]:
    """Metrics by vehicle or scope, where every follower is locked on from the start."""
    vehicles = table.vehicle_id.unique()
    locked = [(0.0, "locked", own, ahead) for ahead, own in pairwise(vehicles)]
    departed = [(0.0, "departed", name) for name in vehicles]
    end = (float(table.time_s.max()), "end")
    found: dict[str, dict[str, float]] = {}
    for value in compute(table, events(*departed, *locked, *sorted(more), end)):
        found.setdefault(value.vehicle or value.scope, {})[value.name] = value.value
    return found


def pulse(size: float, length: float, begin: float = BEFORE):
    """Acceleration that is constant for a while."""
    return lambda t: size if begin <= t < begin + length - FINE / 2 else 0.0


@pytest.mark.parametrize("frequency", [0.02, 0.05, 0.1, 0.2, 0.3])
def test_the_gain_of_a_sinusoid_is_that_of_the_lag_at_its_frequency(frequency):
    """1 / sqrt(1 + (lag omega)^2), from one member to the next, and its power from head to tail."""
    omega = 2 * math.pi * frequency
    of = gains(string(lambda t: 0.5 * np.clip((t - BEFORE) / 40, 0, 1) * math.cos(omega * t), BEFORE + 400.0))
    gain = 1 / math.hypot(1, LAG * omega)
    for member in ("p.1", "p.2", "p.3"):
        assert of[member]["accel_gain_l2"] == pytest.approx(gain, rel=0.01)
    assert of["platoon"]["head_to_tail_accel_gain_l2"] == pytest.approx(gain**3, rel=0.03)
    assert of["p.1"]["accel_gain_linf"] == pytest.approx(gain, rel=0.02)
    assert of["run"]["accel_gain_l2_max"] == max(of[f"p.{i}"]["accel_gain_l2"] for i in (1, 2, 3))
    assert "accel_gain_l2" not in of["p.0"]


def test_a_string_that_amplifies_has_gains_above_one():
    """Overshoot: a response of twice the leader's acceleration minus its lagged one has the gain
    sqrt((1 + (2 lag omega)^2) / (1 + (lag omega)^2))."""
    omega = 2 * math.pi * 0.05
    time = np.arange(round(430 / FINE) + 1) * FINE
    leader = 0.5 * np.clip((time - BEFORE) / 40, 0, 1) * np.cos(omega * time)
    own = 2 * leader - lagged(leader, LAG)
    of = gains(recorded([25 + np.cumsum(a) * FINE for a in (leader, own)]))
    expected = math.sqrt((1 + (2 * LAG * omega) ** 2) / (1 + (LAG * omega) ** 2))
    assert expected > 1.19
    assert of["p.1"]["accel_gain_l2"] == pytest.approx(expected, rel=0.01)


def filtered_energy(length: float, lag: float) -> float:
    """Energy of a pulse of 1 m/s2 through a lag (0: none) and the mean over FILTER, by Parseval's theorem."""
    f = np.linspace(1e-6, 20, 400_001)
    spectrum = (np.sinc(f * length) * length) ** 2 * np.sinc(f * FILTER) ** 2 / (1 + (2 * math.pi * f * lag) ** 2)
    return 2 * float(np.trapezoid(spectrum, f))


@pytest.mark.parametrize(("size", "speed"), [(-5.0, 25.0), (2.5, 0.0)])
def test_a_stop_and_a_start_from_rest_have_the_energies_of_a_lagged_pulse(size, speed):
    """A stop after steady driving; a start at which all stand when the run begins, and nothing need settle."""
    length, begin = (5.0, BEFORE) if speed else (10.0, 1.0)
    of = gains(string(pulse(size, length, begin), begin + 60.0, speed=speed))
    expected = math.sqrt(filtered_energy(length, LAG) / filtered_energy(length, 0.0))
    assert of["p.1"]["accel_gain_l2"] == pytest.approx(expected, rel=0.003)
    assert expected < of["p.2"]["accel_gain_l2"] < of["p.3"]["accel_gain_l2"] < 1
    # At the end of the pulse the lag has reached 1 - exp(-length / lag) of it, less over the mean.
    reached = 1 - LAG / FILTER * (math.exp(FILTER / LAG) - 1) * math.exp(-length / LAG)
    assert of["p.1"]["accel_gain_linf"] == pytest.approx(reached, rel=0.01)


def test_the_recording_interval_hardly_matters():
    at = [gains(string(pulse(-3.0, 4.0), 80.0, every=every))["p.2"]["accel_gain_l2"] for every in (0.05, 0.1, 0.2, 0.5)]
    assert at == pytest.approx([at[0]] * 4, rel=0.01)
    assert gains(string(pulse(-3.0, 4.0), 80.0, every=2.0))["p.2"]["accel_gain_l2"] < 1


def test_units_of_time_before_and_after_do_not_count():
    """Long steady driving adds nothing, although a follower's speed is noisy."""
    rng = np.random.default_rng(1)
    table = string(pulse(-3.0, 4.0), 600.0)
    noise = np.where(table.place > 0, rng.normal(0, 0.003, len(table)), 0)
    of = gains(table.assign(speed_mps=table.speed_mps + noise))
    assert of["p.1"]["accel_gain_l2"] == pytest.approx(
        gains(string(pulse(-3.0, 4.0), 90.0))["p.1"]["accel_gain_l2"], 1e-3
    )


def test_behind_a_steady_leader_noise_is_no_gain():
    rng = np.random.default_rng(1)
    table = string(lambda t: 0.0, 200.0)
    of = gains(table.assign(speed_mps=table.speed_mps + rng.normal(0, 0.003, len(table))))
    for name in ("accel_gain_l2", "accel_gain_linf"):
        assert all(math.isnan(of[f"p.{i}"][name]) for i in (1, 2, 3))
    assert math.isnan(of["platoon"]["head_to_tail_accel_gain_l2"])
    assert math.isnan(of["run"]["accel_gain_l2_max"])


def test_noise_of_a_tenth_of_the_threshold_changes_a_gain_by_a_hundredth_at_most():
    """The least that counts: a swing that just exceeds the threshold, and the noise that the threshold is made for."""
    omega = 2 * math.pi * 0.05
    table = string(lambda t: 1.02 * EXCITED * math.cos(omega * t) if t >= BEFORE else 0.0, 600.0, followers=1)
    clean = gains(table)["p.1"]["accel_gain_l2"]
    noise = np.random.default_rng(2).normal(0, 0.005 * FILTER / math.sqrt(2), len(table)) * table.place
    noisy = gains(table.assign(speed_mps=table.speed_mps + noise))["p.1"]["accel_gain_l2"]
    assert clean < noisy < 1.012 * clean


def test_what_happens_while_split_off_does_not_count():
    """The leader brakes twice; the second time the first follower is split off, and stands."""
    first, second = pulse(-3.0, 4.0), pulse(-3.0, 4.0, 100.0)
    table = string(lambda t: first(t) + second(t), 160.0, followers=2)
    alone = gains(string(first, 90.0, followers=2))
    table.loc[(table.place == 1) & (table.time_s > 101), "speed_mps"] = 0.0
    split = (101.0, "split", "p.1", "p.0")
    of = gains(table, split)
    assert of["p.1"]["accel_gain_l2"] == pytest.approx(alone["p.1"]["accel_gain_l2"])
    name = "head_to_tail_accel_gain_l2"
    assert of["platoon"][name] == pytest.approx(alone["platoon"][name])
    assert gains(table)["p.1"]["accel_gain_l2"] > 1.5  # without the event it would
    # It is in its platoon again, and has had time to settle, when the leader brakes a second time.
    whole = string(lambda t: first(t) + second(t), 160.0, followers=2)
    again = gains(whole, (50.0, "split", "p.1", "p.0"), (70.0, "rejoined", "p.1", "p.0", 22.0))
    assert again["p.1"]["accel_gain_l2"] == pytest.approx(gains(whole)["p.1"]["accel_gain_l2"])
    late = gains(whole, (50.0, "split", "p.1", "p.0"), (90.0, "rejoined", "p.1", "p.0", 42.0))
    assert late["p.1"]["accel_gain_l2"] == pytest.approx(alone["p.1"]["accel_gain_l2"])


def test_without_a_lock_there_is_no_gain():
    table = string(pulse(-3.0, 4.0), 90.0, followers=1)
    of = {v.name: v.value for v in compute(table, events((90.0, "end"))) if v.vehicle == "p.1"}
    assert math.isnan(of["accel_gain_l2"])


def test_a_member_that_joins_is_compared_with_its_new_predecessor():
    """p.2 leaves p.1, whose follower p.3 closes up; gains are over the predecessor of the time."""
    table = string(pulse(-3.0, 4.0, 100.0), 160.0)
    leaves = (10.0, "told", "p.2", "", 0.0, "leave", 1)
    of = gains(table, leaves, (12.0, "locked", "p.3", "p.1"), (14.0, "rejoined", "p.3", "p.1", 4.0))
    two = gains(string(pulse(-3.0, 4.0, 100.0), 160.0))
    product = two["p.2"]["accel_gain_l2"] * two["p.3"]["accel_gain_l2"]
    assert of["p.3"]["accel_gain_l2"] == pytest.approx(product, rel=0.01)
    assert math.isnan(of["p.2"]["accel_gain_l2"])
    assert math.isnan(of["platoon"]["head_to_tail_accel_gain_l2"])


def test_a_window_that_is_cut_counts_only_if_it_is_long():
    """Else a response would be counted without its cause, or a cause without its response."""
    time = np.arange(0.0, 200.0, 0.1)
    excited = (time > 9.95) & (time < 12.05)
    assert windows(time, excited, (0.0, 200.0), RESPONSE) == [(pytest.approx(10), pytest.approx(12 + RESPONSE))]
    assert windows(time, excited, (11.0, 200.0), RESPONSE) == []
    assert windows(time, excited, (0.0, 13.0), RESPONSE) == []
    always = np.ones(len(time), bool)
    assert windows(time, always, (20.0, 180.0), RESPONSE) == [(20.0, 180.0)]
    assert windows(time, always, (20.0, 60.0), RESPONSE) == []
    twice = excited | ((time > 14.95) & (time < 15.05)) | ((time > 99.95) & (time < 100.05))
    assert [round(end - begin, 6) for begin, end in windows(time, twice, (0.0, 200.0), RESPONSE)] == [10.0, 5.0]


def test_a_platoon_that_departs_at_speed_has_time_to_settle():
    early = gains(string(pulse(-3.0, 4.0, SETTLING - 5), 60.0))
    assert math.isnan(early["p.1"]["accel_gain_l2"])
    assert gains(string(pulse(-3.0, 4.0, SETTLING + 0.5), 60.0))["p.1"]["accel_gain_l2"] < 1


def test_periods_without_others():
    assert without((0, 10), [(2, 3), (8, 12)]) == [(0, 2), (3, 8)]
    assert without((0, 10), [(4, 5), (-1, 1), (4.5, 6)]) == [(1, 4), (6, 10)]
    assert without((0, 10), [(-5, 20)]) == []
    assert without((0, 10), []) == [(0, 10)]
