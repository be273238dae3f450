"""The law `tracking` on the shipped roads, without background traffic, with errors of laser and odometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario, shipped, simulation
from platoontraffic.errors import InputError
from tests.support import ODD_NETS
from tests.support.runs import run

pytestmark = pytest.mark.sumo

ROUTES = [  # each turn of each junction of `corridor`, and its bends in both directions
    "west_light light_prio prio_rw rw_rs rs_re re_b0 b0_b1 b1_b2 b2_east",
    "east_b2 b2_b1 b1_b0 b0_re re_rn rn_rw rw_prio prio_light light_west",
    "west_light light_light_n",
    "west_light light_light_s",
    "light_n_light light_west",
    "light_n_light light_prio prio_prio_s",
    "light_s_light light_prio prio_prio_n",
    "light_s_light light_west",
    "prio_n_prio prio_light light_light_n",
    "prio_n_prio prio_rw rw_rs rs_round_s",
    "prio_s_prio prio_light light_light_s",
    "prio_s_prio prio_rw rw_rs rs_re re_rn rn_round_n",
    "round_n_rn rn_rw rw_prio prio_prio_n",
    "round_s_rs rs_re re_b0 b0_b1",
    "east_b2 b2_b1 b1_b0 b0_re re_rn rn_rw rw_rs rs_re re_b0",
    "b0_re re_rn rn_rw rw_prio prio_prio_s",
]


def followers(folder: Path) -> pd.DataFrame:
    """Rows of trajectories.csv; `locked`: the target is the predecessor; `visible`: five beams meet the predecessor."""
    rows = pd.read_csv(folder / "trajectories.csv")
    rows = rows[rows.place > 0]
    ahead = rows.vehicle_id.str.rpartition(".")[0] + "." + (rows.place - 1).astype(str)
    return rows.assign(locked=rows.target_id == ahead, visible=rows.beams_on_predecessor >= 5)


@pytest.mark.slow
@pytest.mark.parametrize("route", ROUTES)
def test_a_platoon_of_five_stays_together_through_every_turn_of_the_corridor(route, tmp_path):
    edges = route.split()
    text = shipped.scenarios()["corridor_tracking"].read_text(encoding="utf-8")
    text = text.replace('edge = "west_light", position_m = 60.0', f'edge = "{edges[0]}", position_m = 51.0')
    (tmp_path / "turns.toml").write_text(text.replace('to = "b2_east"', f"route = {edges}"), encoding="utf-8")
    folder = run(tmp_path / "run", tmp_path / "turns.toml")
    rows, events = followers(folder), pd.read_csv(folder / "events.csv")
    assert rows[rows.visible].locked.mean() >= 0.99
    assert rows.visible.mean() >= 0.99
    assert rows.cross_track_m.abs().max() < 0.3
    assert not events.kind.isin(["collision", "lock_lost", "off_road"]).any()
    assert events.detail.iloc[-1] == "arrived"


@pytest.mark.slow
def test_a_platoon_of_ten_stays_together_at_thirty_metres_a_second(tmp_path):
    folder = run(tmp_path / "run", "highway_tracking")
    rows, events = followers(folder), pd.read_csv(folder / "events.csv")
    assert rows[rows.visible].locked.mean() >= 0.99
    assert rows.visible.all()
    steady = rows[rows.time_s > 120]
    assert steady.speed_mps.to_numpy() == pytest.approx(30, abs=0.5)
    assert (steady.gap_error_m.abs() < 0.02 * 33).all()
    assert rows.cross_track_m.abs().max() < 0.3
    assert not events.kind.isin(["collision", "lock_lost", "off_road"]).any()


OVERTAKES = """
[sumo]
net = "highway"
traffic = false
[scene]
walls = "none"
[run]
duration_s = 60.0
step_s = 0.1
[[platoon]]
size = 5
gap_m = 15.0
vehicle = "car"
start = { edge = "e0_e1", position_m = 300.0, speed_mps = 20.0 }
to = "e4_e5"
leader = { law = "sumo", max_speed_mps = 25.0 }
follower = { law = "tracking", odometry = "car" }
[[obstacle]]
kind = "car"
start = { edge = "e0_e1", position_m = 420.0 }
speed_mps = 15.0
"""


def test_a_platoon_changes_lanes_behind_a_sumo_driven_leader(tmp_path):
    """The leader overtakes a slow car; each follower changes lanes where the leader did."""
    file = tmp_path / "overtakes.toml"
    file.write_text(OVERTAKES, encoding="utf-8")
    folder = run(tmp_path / "run", file)
    events, rows = (pd.read_csv(folder / f"{name}.csv") for name in ("events", "trajectories"))
    assert set(events.kind) == {"departed", "locked", "obstacle", "end"}
    rows = rows[rows.edge_id == "e0_e1"]
    assert (rows.groupby("vehicle_id").lane_id.last() == "e0_e1_1").all()
    half_over = rows.y_m.iloc[0] + 3.5 / 2
    changed = [np.interp(half_over, one.y_m, one.x_m) for _, one in rows.groupby("vehicle_id")]
    assert len(changed) == 5
    assert np.ptp(changed) < 2.0
    assert rows.cross_track_m.abs().max() < 0.1
    follow = rows[rows.place > 0]
    assert (follow.target_id == "platoon." + (follow.place - 1).astype(str)).all()
    sideways = rows[rows.place == 0].y_m.diff().abs().max()
    assert sideways == pytest.approx(3.5 / 30, rel=0.2)  # a lane's width in three seconds


TURNS_RIGHT = """
[sumo]
net = "{net}"
traffic = false
[scene]
walls = "none"
[run]
duration_s = 30.0
step_s = 0.1
[[platoon]]
size = 5
gap_m = 4.0
vehicle = "car"
start = {{ edge = "west_in", position_m = 440.0, speed_mps = 5.0 }}
route = ["west_in", "south_out"]
leader = {{ law = "path", lidar = "car-leader", odometry = "car" }}
follower = {{ law = "tracking", policy = "obey", on_loss = "drive", odometry = "car" }}
"""


def test_followers_take_a_sharp_turn_of_their_route_nearly_as_fast_as_their_leader(tmp_path):
    """By the bends of the trail, which is estimated, each was a third slower; the last ones missed green lights."""
    file = tmp_path / "turns_right.toml"
    file.write_text(TURNS_RIGHT.format(net=(ODD_NETS / "cross.net.xml").as_posix()), encoding="utf-8")
    rows = pd.read_csv(run(tmp_path / "run", file) / "trajectories.csv")
    in_bend = rows[rows.lateral_accel_mps2.abs() > 1.0].groupby("vehicle_id").speed_mps.min()
    assert (in_bend > 0.95 * in_bend["platoon.0"]).all()
    leaves = rows[rows.edge_id == "south_out"].groupby("vehicle_id").time_s.min()
    after = np.diff(leaves)
    assert after.mean() == pytest.approx(
        1 + (3 + 4.6) / in_bend.drop("platoon.0").mean(), abs=0.05
    )  # 1 s, 3 m and a length
    assert np.ptp(after) < 0.21  # each of the two is known to the 0.1 s of a record
    assert rows.lateral_accel_mps2.abs().max() < 4.5
    assert rows.cross_track_m.abs().max() < 0.15


def test_followers_already_on_the_target_lane_do_not_wait_for_a_lane_change(tmp_path):
    """The SUMO-driven leader changes lanes earlier than the route; its followers go with it."""
    text = OVERTAKES[: OVERTAKES.index("[[platoon]]")].replace("highway", "NET").replace("60.0", "75.0")
    text += """
[[platoon]]
size = 3
gap_m = 4.0
vehicle = "car"
start = { edge = "west_in", position_m = 420.0 }
to = "north_out"
leader = { law = "sumo", max_speed_mps = 10.0 }
follower = { law = "tracking", policy = "obey" }
"""
    cross = ODD_NETS / "cross.net.xml"
    file = tmp_path / "cross.toml"
    file.write_text(text.replace("NET", cross.as_posix()), encoding="utf-8")
    events = pd.read_csv(run(tmp_path / "run", file) / "events.csv")
    assert not (events.what == "lane_change").any()
    assert not (events.kind == "collision").any()


def test_a_member_behind_the_start_of_its_route_drives_onto_it(tmp_path):
    """The last cars of a platoon may stand on the prolongation of the lane where it starts."""
    text = shipped.scenarios()["corridor_breakdown"].read_text(encoding="utf-8").split("[[breakdown]]")[0]
    text = text.replace("warm_up_s = 120.0", "traffic = false").replace("duration_s = 400.0", "duration_s = 5.0")
    text = text.replace('edge = "west_light", position_m = 90.0', 'edge = "light_prio", position_m = 5.0')
    (tmp_path / "start.toml").write_text(text, encoding="utf-8")
    events = pd.read_csv(run(tmp_path / "run", tmp_path / "start.toml") / "events.csv")
    assert set(events.kind) == {"departed", "locked", "end"}
    assert (events.time_s[events.kind == "locked"] == 0).all()
    (tmp_path / "start.toml").write_text(text.replace("position_m = 5.0", "position_m = -5.0"), encoding="utf-8")
    with pytest.raises(InputError, match=r"platoon\.0\.start: .* position -5 m is not on it; must be 0\.\.331\.6 m"):
        simulation.prepare(scenario.load(tmp_path / "start.toml"))
