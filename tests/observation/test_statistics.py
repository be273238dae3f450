"""Statistics over all steps: closed forms, and the same from a table with a row for every step."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from platoontraffic.results import metrics
from platoontraffic.results.columns import TRAJECTORIES
from platoontraffic.results.statistics import Row, by_vehicle, from_trajectories, rows
from tests.results.test_metrics import events
from tests.support.observed import LENGTH, Observed, cars
from tests.support.runs import run

DT = 0.1
# Metrics that need the rows of trajectories.csv, and so depend on how often is recorded.
BY_RECORDED_INSTANTS = {
    "right_lane_share", "right_lane_share_min", "leader_right_lane_share", "steal_share", "steal_share_mean",
    "lock_on_seen", "lock_on_seen_min", "in_platoon_distance", "in_platoon_distance_mean", "time_gap_median",
    "time_gap_mean", "time_gap_mean_all", "accel_gain_l2", "accel_gain_l2_max", "accel_gain_linf",
    "accel_gain_linf_max", "head_to_tail_accel_gain_l2", "head_to_tail_accel_gain_linf",
}  # fmt: skip


def over(observed: Observed) -> dict[str, dict[str, Row]]:
    """Vehicle -> quantity -> row."""
    table = pd.DataFrame(rows(observed.observer.statistics, observed.members, DT), columns=Row._fields)
    return by_vehicle(table)


def approach(steps: int = 11, speed: float = 10.0, gap: float = 30.0, measure: bool = True) -> Observed:
    """A follower that drives towards a standing leader at constant speed."""
    observed = Observed(cars())
    if not measure:
        observed.observer.measure = lambda fleet: None
    for k in range(steps):
        x = [0.0, -gap - LENGTH + speed * DT * k]
        observed.at(DT * k, x=x, speed=[0.0, speed], yaw_rate=[0.0, 0.5], turned=[0.0, 0.5 * DT * k])
    return observed


def test_a_steady_approach_has_closed_forms():
    of = over(approach())["robot.1"]
    gaps = 30.0 - np.arange(11.0)
    assert (of["gap_m"].max, of["gap_m"].min) == (pytest.approx(30.0), pytest.approx(20.0))
    assert of["gap_m"].mean == pytest.approx(25.0)
    assert of["ttc_s"].min == pytest.approx(2.0)
    assert of["ttc_shortfall_s"].time_s == pytest.approx(1.0)  # 10 instants below 3 s
    assert of["ttc_shortfall_s"].integral == pytest.approx(sum(3.0 - gaps[1:] / 10) * DT)
    assert of["drac_mps2"].max == pytest.approx(100 / 40)
    assert of["centre_speed_mps"].integral == pytest.approx(10.0)  # of 10 steps
    assert of["turning_radps"].integral == pytest.approx(0.5)
    assert of["lateral_accel_mps2"].largest == pytest.approx(5.0)
    assert of["lateral_accel_beyond"].mean == 1.0
    assert of["speed_mps"].rms == pytest.approx(10.0)


def test_what_never_had_a_value_has_no_row():
    of = over(approach())
    assert "ttc_s" not in of["robot.0"]
    assert "gap_m" not in of["robot.0"]
    assert of["robot.0"]["speed_mps"].max == 0.0


def test_statistics_do_not_depend_on_what_is_measured():
    np.testing.assert_equal(over(approach(measure=False)), over(approach()))


def test_an_extreme_between_two_other_steps_counts():
    observed = Observed(cars())
    for k, acceleration in enumerate([0.0, 0.0, -3.0, 0.0, 0.0]):
        observed.at(DT * k, x=[50.0, 0.0], acceleration=[0.0, acceleration])
    of = over(observed)["robot.1"]
    assert of["accel_mps2"].min == -3.0
    assert (of["jerk_mps3"].min, of["jerk_mps3"].max) == (pytest.approx(-30), pytest.approx(30))
    assert of["jerk_mps3"].rms == pytest.approx(math.sqrt(2 * 900 / 5))


def test_a_member_counts_while_it_is_on_the_road():
    observed = Observed(cars())
    observed.at(0.0, [0], x=0.0, speed=4.0)
    observed.at(0.1, [0, 1], x=[0.4, -30.0], speed=[4.0, 8.0])
    observed.at(0.2, [1], x=-29.2, speed=8.0)
    of = over(observed)
    assert (of["robot.0"]["speed_mps"].time_s, of["robot.1"]["speed_mps"].time_s) == (0.2, 0.2)
    assert of["robot.0"]["centre_speed_mps"].time_s == 0.1  # from its second instant on
    assert of["robot.1"]["closing_mps"].time_s == 0.1  # only then it had a predecessor


def test_a_member_that_no_instant_recorded_has_metrics():
    statistics = pd.DataFrame(rows(approach().observer.statistics, cars(), DT), columns=Row._fields)
    nothing = pd.DataFrame({c.name: [] for c in TRAJECTORIES}).astype({"time_s": float})
    came = [(0.0, "departed", "robot.0"), (0.0, "departed", "robot.1")]
    found = metrics.compute(nothing, events(*came, (1.0, "end")), statistics)
    of = {m.name: m.value for m in found if m.vehicle == "robot.1"}
    assert (of["ttc_min"], of["distance"]) == (pytest.approx(2.0), pytest.approx(10.0))
    assert {m.name: m.value for m in found if m.scope == "run"}["duration"] == 1.0


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("name", "changes"), [("corridor_two_platoons", ["run.duration_s=12"]), ("paper_loop", ["run.duration_s=8"])]
)
def test_metrics_do_not_depend_on_how_often_is_recorded(name, changes, tmp_path):
    tables = []
    for every in (0.1, 2.0):
        folder = run(tmp_path / f"{every}", name, *changes, f"record.every_s={every}")
        tables.append(pd.read_csv(folder / "metrics.csv").query("metric not in @BY_RECORDED_INSTANTS"))
    often, seldom = (table.reset_index(drop=True) for table in tables)
    assert {"ttc_min", "tet", "tit", "drac_max", "jerk_max", "jerk_rms", "clearance_min"} <= set(often.metric)
    pd.testing.assert_frame_equal(often, seldom, check_exact=True)


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("corridor_two_platoons", ["run.duration_s=15"]),
        ("paper_loop", ["run.duration_s=15", "record.every_s=0.025"]),
    ],
)
def test_a_table_with_every_step_gives_the_same_statistics(name, changes, tmp_path):
    """Values in trajectories.csv are rounded to a millionth, of which a jerk has 1 / step."""
    folder = run(tmp_path / "run", name, *changes)
    kept, table = pd.read_csv(folder / "statistics.csv"), pd.read_csv(folder / "trajectories.csv")
    anew = from_trajectories(table).sort_values(["vehicle_id", "quantity"], ignore_index=True)
    kept = kept.sort_values(["vehicle_id", "quantity"], ignore_index=True)
    assert len(kept) > 60
    pd.testing.assert_frame_equal(kept, anew, check_dtype=False, rtol=1e-5, atol=2e-4)
