"""Tables as text: the same bytes however they are written."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest

from platoontraffic.observation.observer import Measures
from platoontraffic.results import csv_text
from platoontraffic.results.columns import (
    ENCOUNTERS,
    EVENTS,
    METRICS,
    STATISTICS,
    TRAFFIC,
    TRAJECTORIES,
    VEHICLES,
    Instant,
    integer,
    number,
    text,
)
from platoontraffic.results.data_package import data_package
from platoontraffic.results.recorder import Clocks, Recorder
from platoontraffic.world.events import Event
from platoontraffic.world.fleet import Fleet
from tests.support.bench import constant, platoon, snapshot

NAMES = ["", "a", "nan", "-0.000000", "100%s", "b,c", 'd"e', "f\ng", "ä"]


def test_a_table_by_columns_is_the_table_by_rows():
    """Missing numbers, zeros of either sign, large and small numbers; names that look like numbers."""
    rng = np.random.default_rng(1)
    columns = (number("x", "m", ""), text("a", ""), integer("k", "", format="%.0f"), text("b", ""), number("y", "", ""))
    rows = []
    for _ in range(300):
        x, y = rng.choice([0.0, -0.0, np.nan, -4e-7, -6e-7, 1e9, -10.0, rng.normal()], 2)
        k = np.nan if rng.random() < 0.5 else float(rng.integers(1000))
        rows.append((x, str(rng.choice(NAMES)), k, str(rng.choice(NAMES)), y))

    def lines_at(rows, order=None):
        sources = [c._replace(source=lambda now, i=i: [row[i] for row in rows]) for i, c in enumerate(columns)]
        return csv_text.lines_at(None, sources, order)

    assert lines_at(rows) == csv_text.lines(rows, columns)
    order = rng.permutation(300)
    assert lines_at(rows, order) == csv_text.lines([rows[i] for i in order], columns)


def test_every_vehicle_of_the_tables_has_one_row_in_vehicles(tmp_path, fleet):
    recorder = Recorder(tmp_path / "run", Clocks(traffic=1))
    own = snapshot(fleet, 0.0)
    sizes = {"length": np.append(own.length, [4.5, 12.0]), "width": np.append(own.width, [1.8, 2.5])}
    beside = {name: np.append(getattr(own, name), [0.0, 9.0]) for name in ("x", "y", "heading", "speed")}
    for time in (0.0, 0.5):
        traffic = replace(own, time=time, ids=(*own.ids, "car", "bus"), **sizes, **beside)
        recorder.record(instant(fleet, own, whole=traffic))
    recorder.write_vehicles(fleet.members)
    table = pd.read_csv(recorder.keep_unfinished() / "vehicles.csv")
    assert table.vehicle_id.tolist() == ["robot.0", "robot.1", "robot.2", "second.0", "second.1", "car", "bus"]
    assert table.length_m.tolist()[-2:] == [4.5, 12.0]
    assert table.place.tolist()[:5] == [0, 1, 2, 0, 1]
    assert table.laser_x_m.isna().tolist() == [False] * 5 + [True] * 2


def test_what_an_interrupted_run_left_goes_once_an_equal_run_is_complete(tmp_path):
    other = Recorder(tmp_path / "other").keep_unfinished()
    Recorder(tmp_path / "run").keep_unfinished()
    repeated = Recorder(tmp_path / "run")
    assert (tmp_path / "run.unfinished").is_dir()
    repeated.close_tables()
    done = repeated.finish(replace=False)
    assert sorted(tmp_path.iterdir()) == [other, done]


@pytest.fixture
def fleet() -> Fleet:
    members = [*platoon(constant(0.0), constant(1.0), 2), *platoon(constant(0.0), constant(1.0), 1, at=(0.0, 1.0, 0.0))]
    two = [replace(m, platoon="second", id=f"second.{m.place}") for m in members[3:]]
    return Fleet.deployed([two[1], *members[2::-1], two[0]], 0.1)


def instant(fleet: Fleet, traffic, step: int = 0, events=(), whole=None) -> Instant:
    n = len(fleet)
    empty = {f.name: np.full(n, np.nan) for f in fields(Measures)} | dict.fromkeys(
        ("target", "closest"), np.full(n, "", dtype=object)
    )
    roads = [("edge", "edge_0")] * n
    unscanned = [None] * len(fleet.groups)
    return Instant(step, traffic, fleet, unscanned, roads, events, lambda fleet: Measures(**empty), whole=whole)


def record(recorder: Recorder, fleet: Fleet) -> None:
    for step in range(2):
        recorder.record(instant(fleet, snapshot(fleet, step / 10), step))


def test_rows_are_in_the_order_of_platoon_and_place(tmp_path, fleet):
    recorder = Recorder(tmp_path / "run")
    record(recorder, fleet)
    recorder.close_tables()
    table = pd.read_csv(recorder.finish(replace=False) / "trajectories.csv")
    assert table.vehicle_id.tolist() == ["robot.0", "robot.1", "robot.2", "second.0", "second.1"] * 2
    assert table.time_s.tolist() == [0.0] * 5 + [0.1] * 5
    assert table.x_m.tolist()[:3] == sorted(table.x_m.tolist()[:3], reverse=True)
    assert table.gap_m.isna().all()


def test_a_fleet_without_members_has_no_rows(fleet):
    nobody = Fleet.deployed([], 0.1)
    assert csv_text.lines_at(instant(nobody, snapshot(nobody, 0.0)), TRAJECTORIES, []) == ""


def test_background_traffic_is_written_on_request_only(tmp_path, fleet):
    without, with_ = Recorder(tmp_path / "without"), Recorder(tmp_path / "with", Clocks(traffic=2))
    own = snapshot(fleet, 0.0)
    arrays = ("x", "y", "heading", "speed", "length", "width")
    beside = replace(own, ids=(*own.ids, "car"), **{name: np.append(getattr(own, name), 1.0) for name in arrays})
    for recorder in (without, with_):
        for step in range(4):
            whole = None if step % 2 else replace(beside, time=step / 10)
            recorder.record(instant(fleet, own, step, whole=whole))
        recorder.close_tables()
    assert not (without.folder / "traffic.csv").exists()
    table = pd.read_csv(with_.folder / "traffic.csv")
    assert table.columns.tolist() == [c.name for c in TRAFFIC]
    assert table.vehicle_id.tolist() == ["car", "car"]
    assert table.time_s.tolist() == [0.0, 0.2]


def test_each_table_has_rows_by_its_own_clock(tmp_path, fleet):
    recorder = Recorder(tmp_path / "run", Clocks(trajectories=3))
    for step in range(7):
        happened = [Event(step / 10, "departed", "robot.0", "", 0.0, 0.0, "edge", np.nan, "")]
        recorder.record(instant(fleet, snapshot(fleet, step / 10), step, happened))
    recorder.close_tables()
    assert recorder.read_table("trajectories").time_s.unique().tolist() == [0.0, 0.3, 0.6]
    assert recorder.read_table("events").time_s.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@pytest.mark.parametrize("traffic", [False, True])
def test_the_data_package_describes_every_column_of_the_tables_that_there_are(traffic):
    tables = {r["name"]: r for r in data_package("name", "", traffic=traffic, encounters=traffic)["resources"]}
    columns = {"trajectories": TRAJECTORIES, "events": EVENTS, "metrics": METRICS, "vehicles": VEHICLES}
    columns |= {"statistics": STATISTICS}
    columns |= {"traffic": TRAFFIC, "encounters": ENCOUNTERS} if traffic else {}
    assert set(tables) == {*columns, "summary", "scene"}
    assert tables["events"]["kinds"]
    for name, of_table in columns.items():
        assert [f["name"] for f in tables[name]["schema"]["fields"]] == [c.name for c in of_table]
        assert all(f["description"] for f in tables[name]["schema"]["fields"])
