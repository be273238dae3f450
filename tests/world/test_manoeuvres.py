"""Orders to split off, to join and to leave."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario, shipped, simulation
from platoontraffic.errors import InputError
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.manoeuvres import Manoeuvres, Order
from tests.support.bench import BLIND, constant, platoon
from tests.support.runs import run


def fleet(members: int = 4) -> Fleet:
    return Fleet.deployed(platoon(constant(0.0), constant(0.0), members - 1, eye=BLIND), 0.1)


def order(kind: str, vehicle: int, behind: str = "", time: float = 1.0) -> Order:
    return Order(time, kind, f"robot.{vehicle}", behind, None)


def test_an_order_is_carried_out_once_when_its_time_has_come():
    manoeuvres = Manoeuvres([order("split", 2)])
    before, notes = manoeuvres.applied(fleet(), 0.9)
    assert (notes, before.leads.tolist()) == ([], [True, False, False, False])
    after, notes = manoeuvres.applied(before, 1.0)
    assert [(one.row, one.kind, one.what, one.done) for one in notes] == [(2, "told", "split", 1)]
    assert after.leads.tolist() == [True, False, True, False]
    assert after.predecessor.tolist() == [-1, 0, -1, 2]
    assert manoeuvres.applied(after, 2.0)[1] == []


def test_the_follower_of_a_member_that_leaves_gets_its_predecessor():
    after, _ = Manoeuvres([order("leave", 1)]).applied(fleet(), 1.0)
    assert after.predecessor.tolist() == [-1, -1, 0, 2]
    assert after.leads.tolist() == [True, True, False, False]


def test_a_member_that_joins_follows_again():
    manoeuvres = Manoeuvres([order("split", 2), order("join", 2, "robot.0", time=3.0)])
    apart, _ = manoeuvres.applied(fleet(), 1.0)
    after, _ = manoeuvres.applied(apart, 3.0)
    assert after.predecessor.tolist() == [-1, 0, 0, 2]
    assert not after.leads[1:].any()


def test_a_rejected_order_changes_nothing_and_is_noted_with_the_reason():
    before = fleet()
    orders = [("join", 3, "other.0"), ("split", 9), ("join", 1, "robot.2"), ("join", 1, "robot.0"), ("split", 0)]
    after, notes = Manoeuvres([order(*one) for one in orders]).applied(before, 1.0)
    assert [(n.row, n.vehicle, n.detail) for n in notes] == [
        (3, "robot.3", "to join; rejected: other.0 is not on the road"),
        (-1, "robot.9", "to split; rejected: robot.9 is not on the road"),
        (1, "robot.1", "to join; rejected: robot.2 is behind robot.1"),
        (1, "robot.1", "to join; rejected: robot.1 is behind robot.0 already"),
        (0, "robot.0", "to split; rejected: robot.0 leads already"),
    ]
    assert [n.done for n in notes] == [0] * 5
    assert after is before


PASSED = "to leave; rejected: platoon.1 has passed the place where the routes part"


def orders_in(events: pd.DataFrame) -> list[tuple]:
    told = events[events.kind == "told"]
    return list(zip(told.what, told.done, told.detail, strict=True))


def written(folder, text: str):
    base = shipped.scenarios()["corridor_manoeuvres"].read_text(encoding="utf-8")
    file = folder / "orders.toml"
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
def test_an_impossible_order_is_a_fault_with_its_line(tmp_path, text, said):
    with pytest.raises(InputError) as error:
        simulation.prepare(scenario.load(written(tmp_path, text)))
    (fault,) = error.value.faults
    assert said in fault
    assert "manoeuvre.0" in fault
    assert fault.startswith(f"{tmp_path / 'orders.toml'}:")


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


@pytest.mark.slow
@pytest.mark.sumo
def test_a_member_that_joins_after_a_lap_has_a_gap_without_that_lap(tmp_path):
    file = tmp_path / "ring.toml"
    file.write_text(RING, encoding="utf-8")
    rows = pd.read_csv(run(tmp_path / "run", file) / "trajectories.csv")
    joined = rows[(rows.vehicle_id == "b.0") & (rows.time_s > 145.0)]
    np.testing.assert_allclose(joined.gap_m, joined.seen_gap_m, atol=0.5)


@pytest.mark.slow
@pytest.mark.sumo
def test_an_order_to_leave_is_rejected_past_the_place_where_the_routes_part(tmp_path):
    base = shipped.scenarios()["corridor_manoeuvres"].read_text(encoding="utf-8").split("[[manoeuvre]]")[0]
    order = 'kind = "leave"\nvehicle = "platoon.1"\nroute = ["west_light", "light_light_s"]\ntime_s = 60.0\n'
    file = tmp_path / "late.toml"
    file.write_text(
        base.replace("duration_s = 400.0", "duration_s = 75.0") + "[[manoeuvre]]\n" + order, encoding="utf-8"
    )
    events = pd.read_csv(run(tmp_path / "run", file) / "events.csv")
    assert orders_in(events) == [("leave", 0, PASSED)]
    assert not events.kind.isin(["off_road", "collision"]).any()


@pytest.mark.sumo
def test_an_order_to_leave_is_rejected_once_the_member_turns_into_another_route(tmp_path):
    """In the junction it is still near both routes."""
    base = shipped.scenarios()["corridor_cut_in"].read_text(encoding="utf-8").split("[[obstacle]]")[0]
    base = base.replace("duration_s = 60.0", "duration_s = 45.0").replace("size = 5", "size = 3")
    base = base.replace("speed_mps = 10.0", "speed_mps = 8.0").replace("gap_m = 10.0", "gap_m = 6.0")
    base = base.replace('odometry = "car"', 'odometry = "car", policy = "obey", on_loss = "drive"')
    order = '[[manoeuvre]]\nkind = "leave"\nvehicle = "platoon.1"\nto = "prio_prio_s"\ntime_s = 36.0\n'
    (tmp_path / "turns.toml").write_text(base + order, encoding="utf-8")
    events = pd.read_csv(run(tmp_path / "run", tmp_path / "turns.toml") / "events.csv")
    assert orders_in(events) == [("leave", 0, PASSED)]
    assert not events.kind.isin(["off_road", "collision"]).any()


@pytest.mark.sumo
@pytest.mark.slow
def test_one_car_leaves_one_splits_off_and_joins_again_and_a_platoon_joins_the_end(tmp_path):
    folder = run(tmp_path / "run", "corridor_manoeuvres")
    events, rows = (pd.read_csv(folder / f"{name}.csv") for name in ("events", "trajectories"))
    assert events[events.kind == "told"].done.tolist() == [1] * 4
    assert not events.kind.isin(["collision", "off_road", "red_light"]).any()
    assert (events.kind == "arrived").sum() == 7
    last = rows[rows.vehicle_id == "platoon.1"].iloc[-1]
    assert last.edge_id == "prio_prio_s"
    for joined, behind in (("platoon.3", "platoon.2"), ("late.0", "platoon.4"), ("platoon.2", "platoon.0")):
        back = events[(events.kind == "rejoined") & (events.vehicle_id == joined) & (events.other_id == behind)]
        assert len(back) >= 1
        own = rows[(rows.vehicle_id == joined) & (rows.time_s > 130) & (rows.time_s < 150)]
        assert (own.target_id == behind).mean() > 0.98
        assert own.gap_error_m.abs().median() < 0.5
    apart = rows[(rows.vehicle_id == "platoon.3") & rows.time_s.between(20.1, 109.9)]
    assert apart.gap_m.isna().all()
    assert (apart.target_id.fillna("") == "").all()
    assert np.nanmax(rows.cross_track_m.abs()) < 5.0
