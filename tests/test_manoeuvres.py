"""Members that are told to split off, to join and to leave."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from bench import BLIND, constant, platoon
from conftest import run

from platoontraffic import data, scenario, simulation
from platoontraffic.errors import InputError
from platoontraffic.fleet import Fleet
from platoontraffic.manoeuvres import Order, Orders


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


def test_who_is_not_on_the_road_is_told_nothing():
    here = fleet()
    after, told = Orders([order("join", 3, "other.0"), order("split", 9)]).given(here, 1.0)
    assert told == []
    assert after is here


def written(folder, text: str):
    base = data.scenarios()["corridor_manoeuvres"].read_text(encoding="utf-8")
    file = folder / "told.toml"
    file.write_text(base.split("[[manoeuvre]]")[0] + "[[manoeuvre]]\n" + text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('kind = "split"\nvehicle = "platoon.9"\ntime_s = 1.0', "vehicle: 'platoon.9': no member; did you mean"),
        ('kind = "split"\nvehicle = "platoon.0"\ntime_s = 1.0', "leads already; must be a follower"),
        ('kind = "join"\nvehicle = "platoon.2"\ntime_s = 1.0', "`behind` must be given to join"),
        ('kind = "join"\nvehicle = "platoon.2"\nbehind = "platoon.2"\ntime_s = 1.0', "cannot follow itself"),
        ('kind = "join"\nvehicle = "platoon.2"\nbehind = "platoon.4"\ntime_s = 1.0', "is behind platoon.2 itself"),
        ('kind = "leave"\nvehicle = "platoon.2"\ntime_s = 1.0', "a route or `to`, one of both, must be given"),
        ('kind = "leave"\nvehicle = "platoon.2"\ntime_s = 1.0\nto = "nowhere"', "no edge 'nowhere'"),
        ('kind = "split"\nvehicle = "platoon.2"\ntime_s = 1000.0', "must be before the end, 400"),
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
