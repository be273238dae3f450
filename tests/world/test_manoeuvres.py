"""Members that are told to split off, to join and to leave."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario, shipped, simulation
from platoontraffic.errors import InputError
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.manoeuvres import Order, Orders
from tests.support.bench import BLIND, constant, platoon
from tests.support.runs import run


def fleet(members: int = 4) -> Fleet:
    return Fleet.deployed(platoon(constant(0.0), constant(0.0), members - 1, eye=BLIND), 0.1)


def order(kind: str, vehicle: int, behind: str = "", time: float = 1.0) -> Order:
    return Order(time, kind, f"robot.{vehicle}", behind, None)


def test_an_order_is_given_once_when_its_time_has_come():
    orders = Orders([order("split", 2)])
    before, told = orders.given(fleet(), 0.9)
    assert (told, before.leads.tolist()) == ([], [True, False, False, False])
    after, told = orders.given(before, 1.0)
    assert [(one.row, one.detail) for one in told] == [(2, "to split")]
    assert after.leads.tolist() == [True, False, True, False]
    assert after.predecessor.tolist() == [-1, 0, -1, 2]
    assert orders.given(after, 2.0)[1] == []


def test_who_was_behind_one_that_leaves_is_behind_the_next():
    after, _ = Orders([order("leave", 1)]).given(fleet(), 1.0)
    assert after.predecessor.tolist() == [-1, -1, 0, 2]
    assert after.leads.tolist() == [True, True, False, False]


def test_who_joins_follows_again():
    orders = Orders([order("split", 2), order("join", 2, "robot.0", time=3.0)])
    apart, _ = orders.given(fleet(), 1.0)
    after, _ = orders.given(apart, 3.0)
    assert after.predecessor.tolist() == [-1, 0, 0, 2]
    assert not after.leads[1:].any()


def test_what_is_told_in_vain_changes_nothing_and_is_noted_with_why():
    here = fleet()
    orders = [("join", 3, "other.0"), ("split", 9), ("join", 1, "robot.2"), ("join", 1, "robot.0"), ("split", 0)]
    after, told = Orders([order(*one) for one in orders]).given(here, 1.0)
    assert [(n.row, n.vehicle, n.detail) for n in told] == [
        (3, "robot.3", "to join, but other.0 is not on the road"),
        (-1, "robot.9", "to split, but it is not on the road"),
        (1, "robot.1", "to join, but robot.2 is behind it"),
        (1, "robot.1", "to join, but it is behind that"),
        (0, "robot.0", "to split, but it follows nobody"),
    ]
    assert after is here


def written(folder, text: str):
    base = shipped.scenarios()["corridor_manoeuvres"].read_text(encoding="utf-8")
    file = folder / "told.toml"
    base = base.replace("position_m = 60.0 }", "position_m = 60.0, time_s = 5.0 }")
    file.write_text(base.split("[[manoeuvre]]")[0] + "[[manoeuvre]]\n" + text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('kind = "split"\nvehicle = "platoon.9"\ntime_s = 1.0', "vehicle: 'platoon.9': no such member; did you mean"),
        ('kind = "split"\nvehicle = "platoon.0"\ntime_s = 1.0', "leads already; must be a follower"),
        ('kind = "join"\nvehicle = "platoon.2"\ntime_s = 1.0', "`behind` must be given to join"),
        ('kind = "join"\nvehicle = "platoon.2"\nbehind = "platoon.2"\ntime_s = 1.0', "cannot follow itself"),
        ('kind = "join"\nvehicle = "platoon.2"\nbehind = "platoon.4"\ntime_s = 1.0', "is behind platoon.2 itself"),
        ('kind = "leave"\nvehicle = "platoon.2"\ntime_s = 1.0', "either `route` or `to` must be given"),
        ('kind = "leave"\nvehicle = "platoon.2"\ntime_s = 1.0\nto = "nowhere"', "no edge 'nowhere'"),
        ('kind = "split"\nvehicle = "platoon.2"\ntime_s = 1000.0', "must be before the end, run.duration_s = 400"),
        ('kind = "split"\nvehicle = "late.1"\ntime_s = 1.0', "late.1 departs at 5; must not be earlier"),
        ('kind = "merge"\nvehicle = "platoon.2"\ntime_s = 1.0', "kind"),
        ('kind = "leave"\nvehicle = "platoon.0"\ntime_s = 1.0\nto = "b2_east"', "cannot drive alone"),
    ],
)
def test_what_cannot_be_is_said_in_a_line_with_its_place(tmp_path, text, said):
    with pytest.raises(InputError) as error:
        simulation.prepare(scenario.load(written(tmp_path, text)))
    (fault,) = error.value.faults
    assert said in fault
    assert "manoeuvre.0" in fault
    assert fault.startswith(f"{tmp_path / 'told.toml'}:")


RING = """
[sumo]
net = "ring"
traffic = false
[scene]
walls = "none"
[run]
duration_s = 170.0
step_s = 0.1
[[platoon]]
id = "a"
vehicle = "car"
start = { edge = "east_north", position_m = 120.0 }
route = ["east_north", "north_west", "west_south", "south_east"]
loop = true
leader = { law = "path", speed_mps = 10.0, lidar = "car-leader" }
[[platoon]]
id = "b"
vehicle = "car"
start = { edge = "east_north", position_m = 80.0 }
route = ["east_north", "north_west", "west_south", "south_east"]
loop = true
leader = { law = "tracking", on_loss = "drive" }
[[manoeuvre]]
kind = "join"
vehicle = "b.0"
behind = "a.0"
time_s = 145.0
"""


def test_who_joins_after_a_lap_has_the_gap_to_the_one_before_it_and_not_a_lap_more(tmp_path):
    file = tmp_path / "ring.toml"
    file.write_text(RING, encoding="utf-8")
    rows = pd.read_csv(run(tmp_path / "run", file) / "trajectories.csv")
    joined = rows[(rows.vehicle_id == "b.0") & (rows.time_s > 145.0)]
    np.testing.assert_allclose(joined.gap_m, joined.seen_gap_m, atol=0.5)


def test_who_is_past_the_place_where_the_ways_part_does_not_leave(tmp_path):
    base = shipped.scenarios()["corridor_manoeuvres"].read_text(encoding="utf-8").split("[[manoeuvre]]")[0]
    told = 'kind = "leave"\nvehicle = "platoon.1"\nroute = ["west_light", "light_light_s"]\ntime_s = 60.0\n'
    file = tmp_path / "late.toml"
    file.write_text(
        base.replace("duration_s = 400.0", "duration_s = 75.0") + "[[manoeuvre]]\n" + told, encoding="utf-8"
    )
    events = pd.read_csv(run(tmp_path / "run", file) / "events.csv")
    (told,) = events[events.kind == "told"].detail
    assert told == "to leave, but the ways have parted"
    assert not events.kind.isin(["off_road", "collision"]).any()


def test_who_turns_the_other_way_already_does_not_leave(tmp_path):
    """In the junction it is beside both ways yet."""
    base = shipped.scenarios()["corridor_cut_in"].read_text(encoding="utf-8").split("[[obstacle]]")[0]
    base = base.replace("duration_s = 60.0", "duration_s = 45.0").replace("size = 5", "size = 3")
    base = base.replace("speed_mps = 10.0", "speed_mps = 8.0").replace("gap_m = 10.0", "gap_m = 6.0")
    base = base.replace('odometry = "car"', 'odometry = "car", policy = "obey", on_loss = "drive"')
    order = '[[manoeuvre]]\nkind = "leave"\nvehicle = "platoon.1"\nto = "prio_prio_s"\ntime_s = 36.0\n'
    (tmp_path / "turns.toml").write_text(base + order, encoding="utf-8")
    events = pd.read_csv(run(tmp_path / "run", tmp_path / "turns.toml") / "events.csv")
    assert events[events.kind == "told"].detail.tolist() == ["to leave, but the ways have parted"]
    assert not events.kind.isin(["off_road", "collision"]).any()


@pytest.mark.slow
def test_a_car_leaves_two_split_off_and_join_again_and_others_join_the_end(tmp_path):
    folder = run(tmp_path / "run", "corridor_manoeuvres")
    events, rows = (pd.read_csv(folder / f"{name}.csv") for name in ("events", "trajectories"))
    assert (events.kind == "told").sum() == 4
    assert not events.kind.isin(["collision", "off_road", "red_light"]).any()
    assert (events.kind == "arrived").sum() == 7
    last = rows[rows.vehicle_id == "platoon.1"].iloc[-1]
    assert last.edge_id == "prio_prio_s"
    for joined, behind in (("platoon.3", "platoon.2"), ("late.0", "platoon.4"), ("platoon.2", "platoon.0")):
        back = events[(events.kind == "rejoined") & (events.vehicle_id == joined) & (events.other_id == behind)]
        assert len(back) >= 1
        own = rows[(rows.vehicle_id == joined) & (rows.time_s > 150) & (rows.time_s < 175)]
        assert (own.target_id == behind).mean() > 0.98
        assert own.gap_error_m.abs().median() < 2.0
    apart = rows[(rows.vehicle_id == "platoon.3") & rows.time_s.between(20.1, 109.9)]
    assert apart.gap_m.isna().all()
    assert (apart.target_id.fillna("") == "").all()
    assert np.nanmax(rows.cross_track_m.abs()) < 5.0
