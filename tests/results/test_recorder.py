"""Tables as text: the same bytes however they are written."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest
from tests.support.bench import constant, platoon, snapshot

from platoontraffic.results import recorder as recording
from platoontraffic.world.fleet import Fleet
from platoontraffic.observation.observer import Measures
from platoontraffic.results.recorder import EVENTS, METRICS, TRAFFIC, TRAJECTORIES, VEHICLES, Recorder, datapackage

NAMES = ["", "a", "nan", "-0.000000", "100%s", "b,c", 'd"e', "f\ng", "ä"]


def test_a_table_by_columns_is_the_table_by_fields():
    """Numbers that are none, that are zero from either side, large and small; names that look like numbers."""
    rng = np.random.default_rng(1)
    rows = []
    for _ in range(300):
        row = []
        for c in TRAJECTORIES:
            number = rng.choice([0.0, -0.0, np.nan, -4e-7, -6e-7, 1e9, -10.0, rng.normal()])
            whole = np.nan if c.name == "beams_on_predecessor" and rng.random() < 0.5 else float(rng.integers(1000))
            of_type = {"string": str(rng.choice(NAMES)), "integer": whole, "number": number}
            row.append(abs(rng.normal()) if c.name == "time_s" else of_type[c.type])
        rows.append(tuple(row))
    columns = {c.name: [row[i] for row in rows] for i, c in enumerate(TRAJECTORIES)}
    assert recording._table(columns, TRAJECTORIES) == recording._lines(rows, TRAJECTORIES)
    order = rng.permutation(300)
    assert recording._table(columns, TRAJECTORIES, order) == recording._lines([rows[i] for i in order], TRAJECTORIES)


def test_who_they_were_is_written_with_those_of_the_traffic_once(tmp_path, fleet):
    recorder = Recorder(tmp_path / "run", traffic=True)
    own = snapshot(fleet, 0.0)
    sizes = {"length": np.append(own.length, [4.5, 12.0]), "width": np.append(own.width, [1.8, 2.5])}
    beside = {name: np.append(getattr(own, name), [0.0, 9.0]) for name in ("x", "y", "heading", "speed")}
    for time in (0.0, 0.5):
        recorder.record_traffic(replace(own, time=time, ids=(*own.ids, "car", "bus"), **sizes, **beside), len(fleet))
    recorder.write_vehicles(fleet.members)
    table = pd.read_csv(recorder.keep_unfinished() / "vehicles.csv")
    assert table.vehicle_id.tolist() == ["robot.0", "robot.1", "robot.2", "second.0", "second.1", "car", "bus"]
    assert table.length_m.tolist()[-2:] == [4.5, 12.0]
    assert table.place.tolist()[:5] == [0, 1, 2, 0, 1]
    assert table.laser_x_m.isna().tolist() == [False] * 5 + [True] * 2


@pytest.fixture
def fleet() -> Fleet:
    members = [*platoon(constant(0.0), constant(1.0), 2), *platoon(constant(0.0), constant(1.0), 1, at=(0.0, 1.0, 0.0))]
    two = [replace(m, platoon="second", id=f"second.{m.place}") for m in members[3:]]
    return Fleet.deployed([two[1], *members[2::-1], two[0]], 0.1)


def record(recorder: Recorder, fleet: Fleet) -> None:
    n = len(fleet)
    empty = {f.name: np.full(n, np.nan) for f in fields(Measures)} | {"target": np.full(n, "", dtype=object)}
    for time in (0.0, 0.1):
        recorder.record(snapshot(fleet, time), fleet, Measures(**empty), [("edge", "edge_0")] * n)


def test_rows_are_in_the_order_of_platoon_and_place(tmp_path, fleet):
    recorder = Recorder(tmp_path / "run")
    record(recorder, fleet)
    recorder.close_tables()
    table = pd.read_csv(recorder.finish(replace=False) / "trajectories.csv")
    assert table.vehicle_id.tolist() == ["robot.0", "robot.1", "robot.2", "second.0", "second.1"] * 2
    assert table.time_s.tolist() == [0.0] * 5 + [0.1] * 5
    assert table.x_m.tolist()[:3] == sorted(table.x_m.tolist()[:3], reverse=True)
    assert table.gap_m.isna().all()


def test_a_fleet_without_members_has_no_rows():
    assert recording._table({c.name: [] for c in TRAJECTORIES}, TRAJECTORIES, []) == ""


def test_other_traffic_is_written_on_request_only(tmp_path, fleet):
    without, with_ = Recorder(tmp_path / "without"), Recorder(tmp_path / "with", traffic=True)
    for recorder in (without, with_):
        record(recorder, fleet)
    with_.record_traffic(snapshot(fleet, 0.2), 3)
    with_.record_traffic(snapshot(fleet, 0.3), 5)
    for recorder in (without, with_):
        recorder.close_tables()
    assert not (without.folder / "traffic.csv").exists()
    table = pd.read_csv(with_.folder / "traffic.csv")
    assert table.columns.tolist() == [c.name for c in TRAFFIC]
    assert table.vehicle_id.tolist() == [m.id for m in fleet.members[3:]]
    assert table.time_s.tolist() == [0.2, 0.2]


@pytest.mark.parametrize("traffic", [False, True])
def test_the_data_package_describes_every_column_of_the_tables_that_there_are(traffic):
    tables = {r["name"]: r for r in datapackage("name", "", traffic=traffic)["resources"]}
    columns = {"trajectories": TRAJECTORIES, "events": EVENTS, "metrics": METRICS, "vehicles": VEHICLES}
    columns |= {"traffic": TRAFFIC} if traffic else {}
    assert set(tables) == {*columns, "summary", "scene"}
    for name, of_table in columns.items():
        assert [f["name"] for f in tables[name]["schema"]["fields"]] == [c.name for c in of_table]
        assert all(f["description"] for f in tables[name]["schema"]["fields"])
