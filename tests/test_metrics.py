"""Metrics of tables small enough to work out by hand."""

from __future__ import annotations

import math

import pandas as pd
import pytest

from platoontraffic.metrics import compute
from platoontraffic.recording import EVENTS, TRAJECTORIES


def trajectories(**columns: list) -> pd.DataFrame:
    """One follower behind one leader, as many instants as values; what is not given is zero."""
    n = len(next(iter(columns.values())))
    rows = {c.name: [0.0] * n for c in TRAJECTORIES} | {"time_s": [float(i) for i in range(n)], "platoon_id": ["p"] * n}
    leader = pd.DataFrame(rows | {"vehicle_id": ["p.0"] * n, "place": [0] * n})
    return pd.concat([leader, pd.DataFrame(rows | {"vehicle_id": ["p.1"] * n, "place": [1] * n} | columns)])


def events(*rows: tuple) -> pd.DataFrame:
    table = [dict(zip(("time_s", "kind", "vehicle_id", "other_id", "duration_s"), row, strict=False)) for row in rows]
    return pd.DataFrame(table, columns=[c.name for c in EVENTS], dtype=object).fillna("")


def values(table: pd.DataFrame, *rows: tuple, scope="vehicle", vehicle="p.1", end=10.0) -> dict[str, float]:
    metrics = compute(table, events(*rows, (end, "end")))
    return {m.name: m.value for m in metrics if m.scope == scope and m.vehicle == vehicle}


def test_gaps_and_distance_off_the_path():
    of = values(trajectories(gap_m=[1.0, 2.0, 3.0], gap_error_m=[-3.0, 0.0, 3.0], cross_track_m=[0.0, -0.4, 0.3]))
    assert (of["gap_min"], of["gap_mean"], of["gap_max"]) == (1, 2, 3)
    assert of["gap_error_rms"] == pytest.approx(math.sqrt(6))
    assert of["cross_track_max"] == 0.4
    assert of["cross_track_rms"] == pytest.approx(math.sqrt(0.25 / 3))


def test_lock_on_counts_from_the_first_lock_to_the_end():
    still = trajectories(gap_m=[1.0])
    lost_twice = [(2.0, "locked", "p.1"), (4.0, "lock_lost", "p.1"), (5.0, "lock_regained", "p.1"),
                  (8.0, "lock_lost", "p.1")]  # fmt: skip
    of = values(still, *lost_twice)
    assert of["lock_on_ratio"] == pytest.approx(1 - (1 + 2) / 8)
    assert (of["lock_losses"], of["lock_loss_longest"], of["lost_for_good"]) == (2, 2, 8)
    assert values(still, *lost_twice[:3])["lock_on_ratio"] == pytest.approx(1 - 1 / 8)
    assert math.isnan(values(still, *lost_twice[:3])["lost_for_good"])
    assert values(still)["lock_on_ratio"] == 0


def test_the_share_of_standstills_counts_the_one_that_lasts_to_the_end():
    rows = [(12.0, "standstill", "p.1"), (15.0, "standstill_end", "p.1", "", 13.0), (95.0, "standstill", "p.1")]
    of = values(trajectories(gap_m=[1.0]), *rows, end=100.0)
    assert (of["standstills"], of["standstill_share"]) == (2, pytest.approx((13 + 15) / 100))


def test_right_lane_leaves_out_where_it_is_undefined():
    of = values(trajectories(right_of_middle_m=[0.5, math.nan, -0.5, 0.1]))
    assert of["right_lane_share"] == pytest.approx(2 / 3)


def test_corners_are_quarter_turns():
    for degrees, corners in [(0, 0), (79, 0), (89, 1), (171, 2), (-359, 4)]:
        assert values(trajectories(turned_rad=[0.0, math.radians(degrees)]))["corners"] == corners


def test_a_contact_of_two_members_is_one_contact_of_the_run():
    touch = [(1.0, "collision", "p.0", "p.1"), (2.0, "collision", "p.1", "wall")]
    assert values(trajectories(gap_m=[1.0]), *touch)["collisions"] == 2
    assert values(trajectories(gap_m=[1.0]), *touch, scope="run", vehicle="")["collisions"] == 2
