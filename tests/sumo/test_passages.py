"""Vehicles that pass the ends of edges: as SUMO's own detectors count them, and each member once."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from types import SimpleNamespace

import pandas as pd
import pytest

from platoontraffic import scenario, simulation
from platoontraffic.errors import InputError
from platoontraffic.sumo.passages import Passages
from tests.support.runs import run

pytestmark = pytest.mark.sumo

STEP = 0.1  # [s]


def passages(folder):
    return pd.read_csv(folder / "passages.csv")


def test_vehicles_that_sumo_drives_pass_when_its_detector_says(tmp_path):
    """A loop 5 cm before the end of each edge, in the same run."""
    loops = "".join(
        f'<instantInductionLoop id="{edge}" lane="{edge}_0" pos="-0.05" file="loops.xml"/>' for edge in ("b_c", "s_t")
    )
    (tmp_path / "loops.add.xml").write_text(f"<additional>{loops}</additional>")
    changes = "equip.share=0", "run.duration_s=110", f"sumo.additional=['{tmp_path}/loops.add.xml']"
    folder = run(tmp_path / "run", "capacity", *changes)
    ours = {(row.edge_id, row.vehicle_id): row.time_s for row in passages(folder).itertuples()}
    (file,) = folder.glob("*loops.xml")
    entered = {
        (one.get("id"), one.get("vehID")): float(one.get("time"))
        for one in ET.parse(file).getroot()
        if one.get("state") == "enter"
    }
    assert ours.keys() == entered.keys()
    late = [ours[key] - entered[key] for key in ours]
    # The run's time 0 is one step after SUMO's; the loop lies 5 cm, up to 6 ms, before the end of the edge.
    assert len(late) > 30
    assert all(0 < seconds + STEP < STEP + 0.007 for seconds in late)


def test_every_member_passes_once(tmp_path):
    folder = run(tmp_path / "run", "capacity", "equip.share=1", "run.duration_s=110")
    rows, trips = passages(folder), pd.read_csv(folder / "trips.csv")
    assert not rows.duplicated(["edge_id", "vehicle_id"]).any()
    assert set(trips.vehicle_id[trips.status == "arrived"]) <= set(rows.vehicle_id)
    member = dict(zip(trips.vehicle_id, trips.member, strict=True))
    assert rows.member.tolist() == [member[vehicle] for vehicle in rows.vehicle_id]
    assert rows.member.mean() > 0.9
    assert set(rows.type) == {"car"}


def test_a_member_that_is_put_back_before_its_red_line_passes_once():
    """Its front was a little over the line; it passed again at green, half a minute later."""
    here = SimpleNamespace(road="road")
    client = SimpleNamespace(
        TraCIException=KeyError,
        vehicle=SimpleNamespace(getRoadID=lambda _: here.road, getTypeID=lambda _: "car", getSpeed=lambda _: 0.0),
        lane=SimpleNamespace(getLastStepVehicleIDs=lambda _: ("m",) if here.road == "road" else ()),
    )
    network = SimpleNamespace(
        edges={"road": [None]}, beyond=lambda _: lambda road: road in (":a_0", "next", ":b_0", "far"),
    )  # fmt: skip
    counter = Passages(client, network, ["road"], SimpleNamespace(knows=lambda _: False))
    roads = [(0.0, "road"), (1.0, ":a_0"), (2.0, "road"), (30.0, "road"), (31.0, ":a_0"), (33.0, "next"),
             (40.0, ":b_0"), (60.0, "road"), (61.0, ":a_0")]  # fmt: skip
    times = [time for time, here.road in roads if counter.observe((), time)]
    assert times == [1.0, 61.0]


def test_an_edge_that_is_not_there_is_named():
    with pytest.raises(InputError, match=r"record\.passages\.1: 's_u': no such edge; did you mean"):
        simulation.prepare(scenario.load("capacity", ["record.passages=b_c,s_u"]))


def test_edges_of_the_file_are_not_counted_on_another_road():
    assert not scenario.load("capacity", ["sumo.net=corridor"]).spec.record.passages
