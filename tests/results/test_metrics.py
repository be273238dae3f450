"""Metrics of tables small enough to work out by hand."""

from __future__ import annotations

import io
import math

import pandas as pd
import pytest

from platoontraffic.results import metrics
from platoontraffic.results.columns import EVENTS, TRAJECTORIES
from platoontraffic.results.metrics import compute
from platoontraffic.results.statistics import from_trajectories


def trajectories(**columns: list) -> pd.DataFrame:
    """One follower behind one leader, as many instants as values; what is not given is zero."""
    n = len(next(iter(columns.values())))
    rows = {c.name: [0.0] * n for c in TRAJECTORIES} | {"time_s": [float(i) for i in range(n)], "platoon_id": ["p"] * n}
    leader = pd.DataFrame(rows | {"vehicle_id": ["p.0"] * n, "place": [0] * n})
    return pd.concat([leader, pd.DataFrame(rows | {"vehicle_id": ["p.1"] * n, "place": [1] * n} | columns)])


def events(*rows: tuple) -> pd.DataFrame:
    columns = "time_s", "kind", "vehicle_id", "other_id", "duration_s", "what", "done"
    table = [dict(zip(columns, row, strict=False)) for row in rows]
    return pd.DataFrame(table, columns=[c.name for c in EVENTS], dtype=object).fillna("")


def values(table: pd.DataFrame, *rows: tuple, scope="vehicle", vehicle="p.1", end=10.0) -> dict[str, float]:
    found = compute(table, events(*rows, (end, "end")))
    return {m.name: m.value for m in found if m.scope == scope and m.vehicle == vehicle}


def test_gap_and_cross_track_metrics_have_their_closed_forms():
    of = values(trajectories(gap_m=[1.0, 2.0, 3.0], gap_error_m=[-3.0, 0.0, 3.0], cross_track_m=[0.0, -0.4, 0.3]))
    assert (of["gap_min"], of["gap_mean"], of["gap_max"]) == (1, 2, 3)
    assert of["gap_error_rms"] == pytest.approx(math.sqrt(6))
    assert of["cross_track_max"] == 0.4
    assert of["cross_track_rms"] == pytest.approx(math.sqrt(0.25 / 3))


def test_gaps_errors_and_headways_are_those_in_the_platoon_and_beside_them_all():
    """From 3 s on the gap is that to a predecessor far ahead; noted 2 s later, the split began then."""
    gap = [10.0, 12.0, 14.0, 300.0, 400.0, 500.0]
    table = trajectories(gap_m=gap, gap_error_m=[g - 12 for g in gap], time_gap_s=[g / 10 for g in gap],
                         cross_track_m=[0.1, -0.2, 0.1, 3.0, 3.0, 3.0], speed_mps=[10.0] * 6)  # fmt: skip
    of = values(table, (5.0, "split", "p.1"))
    assert [of[f"gap_{name}"] for name in ("mean", "min", "max")] == [12, 10, 14]
    assert [of[f"gap_{name}_all"] for name in ("mean", "min", "max")] == [206, 10, 500]
    assert of["gap_error_rms"] == pytest.approx(math.sqrt(8 / 3))
    assert of["gap_error_rms_all"] > 100
    assert (of["time_gap_median"], of["time_gap_mean"], of["time_gap_mean_all"]) == pytest.approx((1.2, 1.2, 20.6))
    assert (of["cross_track_max"], of["cross_track_max_all"]) == (0.2, 3.0)
    run = values(table, (5.0, "split", "p.1"), scope="run", vehicle="")
    assert (run["gap_mean"], run["gap_mean_all"], run["gap_error_rms_max_all"]) == (12, 206, of["gap_error_rms_all"])


def test_the_last_instant_counts_in_all_means():
    """A member that is never split off has equal means over its time in the platoon and over all of it."""
    gap = [1.0, 2.0, 4.0]
    table = trajectories(time_gap_s=gap, speed_mps=[10.0] * 3, target_id=["p.0", "p.0", "x"])
    of = values(table, end=2.0)
    assert of["time_gap_mean"] == of["time_gap_mean_all"] == pytest.approx(7 / 3)
    assert of["time_gap_median"] == 2.0
    assert of["steal_share"] == pytest.approx(1 / 3)
    table = trajectories(gap_m=[10.0, 100.0, 100.0, 100.0, 12.0])
    back = values(table, (3.0, "split", "p.1"), (4.0, "rejoined", "p.1", "", 3.0), end=4.0)
    assert back["gap_mean"] == 11


def test_a_follower_that_is_back_counts_again():
    table = trajectories(gap_m=[10.0, 100.0, 100.0, 12.0, 14.0])
    assert values(table, (3.0, "split", "p.1"), (3.0, "rejoined", "p.1", "p.0", 2.0))["gap_mean"] == 12


def test_in_a_platoon_throughout_metrics_are_over_all_steps():
    statistics = from_trajectories(trajectories(gap_m=[10.0, 5.0, 12.0]))
    seldom = trajectories(gap_m=[10.0])
    found = compute(seldom, events((10.0, "end")), statistics)
    assert {m.name: m.value for m in found if m.vehicle == "p.1"}["gap_min"] == 5


def test_laps_count_on_loops_only():
    table = trajectories(turned_rad=[0.0, 2 * math.pi])
    for loops, laps in ((None, 1), ({"p"}, 1), (set(), math.nan), ({"q"}, math.nan)):
        found = compute(table, events((10.0, "end")), on_loops=loops)
        of = {m.name: m.value for m in found if m.vehicle == "p.1"}
        assert (of["laps"], of["corners"]) == pytest.approx((laps, 4 * laps), nan_ok=True)


def test_counts_are_integers_in_a_summary_and_shares_are_not():
    rows = [(1.0, "collision", "p.1", "p.0"), (0.0, "locked", "p.1", "p.0")]
    found = compute(trajectories(gap_m=[1.0]), events(*rows, (10.0, "end")), on_loops=())
    table = pd.read_csv(io.StringIO(metrics.summary("mine", 3, {}, found)))
    assert table.dtypes[["seed", "members", "collisions", "splits"]].eq("int64").all()
    assert table.dtypes[["lock_on_ratio_min", "gap_mean_m", "laps_min"]].eq("float64").all()
    assert (table.collisions[0], table.lock_on_ratio_min[0]) == (1, 1.0)


def test_lock_on_counts_from_the_first_lock_to_the_end():
    still = trajectories(gap_m=[1.0])
    lost_twice = [(2.0, "locked", "p.1", "p.0"), (4.0, "lock_lost", "p.1"), (5.0, "lock_regained", "p.1", "p.0"),
                  (8.0, "lock_lost", "p.1")]  # fmt: skip
    of = values(still, *lost_twice)
    assert of["lock_on_ratio"] == pytest.approx(1 - (1 + 2) / 8)
    assert (of["lock_losses"], of["lock_loss_longest"], of["lost_for_good"]) == (2, 2, 8)
    assert values(still, *lost_twice[:3])["lock_on_ratio"] == pytest.approx(1 - 1 / 8)
    assert math.isnan(values(still, *lost_twice[:3])["lost_for_good"])
    assert values(still)["lock_on_ratio"] == 0


def test_the_target_is_not_the_new_predecessor_until_it_is_locked_on_it():
    """It was locked on one that left at 4 s; nothing was lost, and it counted as locked all the time."""
    rows = [(0.0, "locked", "p.2", "p.1"), (4.0, "told", "p.1", "", 0.0, "leave", 1)]
    table = trajectories(gap_m=[1.0])
    table = pd.concat([table, table[table.vehicle_id == "p.1"].assign(vehicle_id="p.2", place=2)])
    assert values(table, *rows, (7.0, "locked", "p.2", "p.0"), vehicle="p.2")["lock_on_ratio"] == pytest.approx(0.7)
    assert values(table, *rows, vehicle="p.2")["lock_on_ratio"] == pytest.approx(0.4)


def test_a_join_by_an_order_ends_no_split():
    rows = [(1.0, "split", "p.1"), (3.0, "rejoined", "p.1", "p.0", 4.0), (6.0, "rejoined", "p.1", "p.0", 0.0)]
    of = values(trajectories(gap_m=[1.0]), *rows)
    assert of["rejoin_time_mean"] == 4
    assert math.isnan(values(trajectories(gap_m=[1.0]), rows[2])["rejoin_time_mean"])


def test_the_distance_in_a_platoon_is_driven_between_recorded_instants():
    """Up to the last one, and not across a time in which it was elsewhere."""
    table = trajectories(x_m=[0.0, 10.0, 20.0, 500.0, 510.0, 520.0])
    assert values(table, end=5.0)["in_platoon_distance"] == 520
    told = [(2.0, "told", "p.1", "", 0.0, "leave", 1), (3.0, "told", "p.1", "p.0", 0.0, "join", 1)]
    assert values(table, *told, (3.0, "rejoined", "p.1", "p.0", 0.0), end=5.0)["in_platoon_distance"] == 40


def test_a_standstill_that_lasts_to_the_end_counts_in_full():
    rows = [(12.0, "standstill", "p.1"), (15.0, "standstill_end", "p.1", "", 13.0), (95.0, "standstill", "p.1")]
    of = values(trajectories(gap_m=[1.0]), *rows, end=100.0)
    assert (of["standstills"], of["standstill_share"]) == (2, pytest.approx((13 + 15) / 100))


def test_right_lane_share_skips_instants_without_a_middle_line():
    of = values(trajectories(right_of_middle_m=[0.5, math.nan, -0.5, 0.1]))
    assert of["right_lane_share"] == pytest.approx(2 / 3)


def test_corners_are_quarter_turns():
    for degrees, corners in [(0, 0), (79, 0), (89, 1), (171, 2), (-359, 4)]:
        assert values(trajectories(turned_rad=[0.0, math.radians(degrees)]))["corners"] == corners


def test_a_contact_between_two_members_counts_once_in_the_run():
    touch = [(1.0, "collision", "p.0", "p.1"), (2.0, "collision", "p.1", "wall")]
    assert values(trajectories(gap_m=[1.0]), *touch)["collisions"] == 2
    assert values(trajectories(gap_m=[1.0]), *touch, scope="run", vehicle="")["collisions"] == 2


def test_shares_are_over_the_time_between_departure_and_arrival():
    rows = [(20.0, "departed", "p.1"), (40.0, "standstill", "p.1"), (42.0, "locked", "p.1", "p.0"),
            (52.0, "lock_lost", "p.1"), (62.0, "arrived", "p.1")]  # fmt: skip
    of = values(trajectories(time_s=[20.0, 61.0]), *rows, end=100.0)
    assert of["standstill_share"] == pytest.approx((62 - 40 + 10) / 42)
    assert of["lock_on_ratio"] == 0.5
    assert (of["lock_loss_longest"], of["lost_for_good"]) == (10, 52)


def test_exposure_to_short_times_to_collision():
    """2 s, 1 s and 0.5 s are below 3 s; each instant stands for a step of half a second."""
    table = trajectories(
        time_s=[0.0, 0.5, 1.0, 1.5, 2.0], ttc_s=[math.nan, 2.0, 1.0, 4.0, 0.5], drac_mps2=[0, 1, 3, 1, 9]
    )
    of = values(table, (1.0, "near_miss", "p.1"), (2.0, "near_miss", "p.0"))
    assert (of["ttc_min"], of["tet"], of["tit"], of["drac_max"]) == (0.5, 1.5, 0.5 + 1.0 + 1.25, 9)
    assert of["near_misses"] == 1


def test_acceleration_and_jerk_metrics_have_their_closed_forms():
    of = values(trajectories(accel_mps2=[3.0, -4.0], jerk_mps3=[0.0, -2.0]), (1.0, "emergency_brake", "p.1"))
    assert of["accel_rms"] == pytest.approx(math.sqrt(25 / 2))
    assert (of["jerk_rms"], of["jerk_max"], of["hard_brakings"]) == (pytest.approx(math.sqrt(2)), 2, 1)


def test_lateral_acceleration_beyond_what_the_model_is_valid_for():
    of = values(trajectories(lateral_accel_mps2=[3.0, -5.0, 4.0, 1.0]))
    assert (of["lateral_accel_max"], of["lateral_accel_beyond_share"]) == (5, 0.25)


def test_time_off_the_road_that_lasts_to_the_end_counts_in_full():
    rows = [(1.0, "off_road", "p.1"), (3.0, "on_road", "p.1", "", 2.0), (7.0, "off_road", "p.1")]
    assert values(trajectories(gap_m=[1.0]), *rows)["off_road_share"] == pytest.approx((2 + 3) / 10)


def test_beams_and_occlusion_skip_instants_without_a_value():
    table = trajectories(beams_on_predecessor=[math.nan, 5, 4, 9], occluded_share=[math.nan, math.nan, 0.5, 0.25])
    of = values(table)
    assert (of["beams_share5"], of["occluded_share_mean"]) == (pytest.approx(2 / 3), 0.375)


def test_mean_and_least_time_gap_skip_instants_at_walking_pace():
    of = values(trajectories(time_gap_s=[500.0, 1.0, 2.0], speed_mps=[0.1, 10.0, 10.0]))
    assert (of["time_gap_min"], of["time_gap_mean"], of["time_gap_median"]) == (1, 1.5, 2)


def test_the_run_takes_the_worst_or_the_sum_over_its_members():
    table = trajectories(ttc_s=[2.0, 1.0, 5.0], drac_mps2=[1.0, 2.0, 0.0], jerk_mps3=[0.0, -9.0, 1.0])
    rows = [(1.0, "near_miss", "p.1"), (2.0, "emergency_brake", "p.0"), (3.0, "emergency_brake", "p.1")]
    of = values(table, *rows, scope="run", vehicle="")
    # The leader's zeros are no measures of a follower.
    assert (of["ttc_min"], of["tet"], of["drac_max"], of["jerk_max"]) == (1, 2, 2, 9)
    assert (of["near_misses"], of["hard_brakings"]) == (1, 2)


def test_every_contact_of_two_members_has_one_cause():
    """But where lanes overlap, neither is."""
    rows = [(1.0, "collision", "p.1", "p.0", 0.0, what) for what in ("struck_other_from_behind", "struck_from_behind",
            "other_changed_lanes", "changed_lanes", "beside", "stood", "lanes_overlap")]  # fmt: skip
    table = trajectories(gap_m=[1.0])
    assert values(table, *rows)["collisions_caused"] == 3  # it struck the other, cut in, or met it
    # It struck p.1 from behind or where that stood, or cut in.
    assert values(table, *rows, vehicle="p.0")["collisions_caused"] == 3
    assert values(table, *rows, scope="run", vehicle="")["collisions_caused"] == 6


def test_encroachments_count_for_both_and_once_for_the_run():
    rows = [(1.0, "encroachment", "p.1", "car", 2.5, "first"), (2.0, "encroachment", "p.0", "p.1", 1.4, "second"),
            (3.0, "encroachment", "p.0", "car", 1.9, "first")]  # fmt: skip
    table = trajectories(gap_m=[1.0])
    for vehicle, least, short in [("p.1", 1.4, 1), ("p.0", 1.4, 2)]:
        of = values(table, *rows, vehicle=vehicle)
        assert (of["pet_min"], of["short_encroachments"]) == (least, short)
    of = values(table, *rows, scope="run", vehicle="")
    assert (of["pet_min"], of["short_encroachments"]) == (1.4, 2)
    assert math.isnan(values(table)["pet_min"])


def test_collisions_with_obstacles_are_counted_by_the_kind_of_obstacle():
    came = [(0.0, "obstacle", "ball", "", 0.0, "robot"), (0.0, "obstacle", "van", "", 0.0, "car")]
    hits = [(1.0, "collision", "p.1", other) for other in ("ball", "ball", "wall", "person.3")]
    none = pd.DataFrame(columns=["kind", "gap_min_m", "ttc_min_s", "avoidable", "contact"])
    of = {m.name: m.value for m in metrics.of_obstacles(none, events(*came, *hits))}
    assert (of["collisions_robot"], of["collisions_car"], of["collisions_person"]) == (2, 0, 1)


def test_a_run_without_members_has_no_events_of_members():
    """As one of a study at share 0; gaps it has none."""
    found = compute(trajectories(gap_m=[1.0])[:0], events((10.0, "end")))
    of = {m.name: m.value for m in found if m.scope == "run"}
    assert [of[name] for name in ("collisions", "collisions_caused", "splits", "red_lights", "arrived")] == [0] * 5
    assert math.isnan(of["gap_mean"])


def test_every_metric_has_a_meaning_and_an_order_names_metrics_that_exist():
    meanings = metrics.meanings()
    assert all(all(of_scope.values()) for of_scope in meanings.values())
    assert set(metrics.ORDER) <= set(meanings["run"])
    found = compute(trajectories(gap_m=[1.0, 2.0]), events((10.0, "end")))
    assert {(one.scope, one.name) for one in found} <= {(s, name) for s, names in meanings.items() for name in names}
    assert [one.name for one in found if one.scope == "run"] == [
        *metrics.ORDER,
        *(metric.name for metric in metrics.OF_STRINGS),
        "duration",
    ]
