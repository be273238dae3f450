"""SUMO's outputs as tables, and metrics of the background traffic."""

from __future__ import annotations

import filecmp
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario
from platoontraffic.analysis.reading import read_table
from platoontraffic.results.metrics import of_trips
from platoontraffic.results.sumo_tables import TABLES, sumo_options
from tests.support.runs import run

SCENARIO = """
[sumo]
net = "ring"
traffic = false
routes = ["few.rou.xml"]
warm_up_s = 20

[scene]
walls = "none"

[run]
step_s = 0.1
duration_s = 30

[record]
sumo = ["trips", "summary", "edges"]
sumo_every_s = 10

[[platoon]]
size = 2
vehicle = "car"
start = { edge = "east_north", position_m = 40 }
to = "west_south"
leader = "sumo"
follower = { law = "repaired", stand_off_m = 4, group_step_m = 1, lidar = "car-follower" }
"""


def trip(name: str, status: str = "arrived", **more: float) -> dict:
    row = {column.name: 0.0 for column in TABLES["trips"].written}
    return row | {"vehicle_id": name, "type": "car", "status": status} | more


def test_metrics_of_trips():
    trips = pd.DataFrame(
        [
            trip("a", duration_s=100.0, time_loss_s=10.0, route_length_m=1500.0, co2_kg=0.3, fuel_kg=0.1),
            trip("b", duration_s=200.0, time_loss_s=30.0, route_length_m=2500.0, co2_kg=0.5, fuel_kg=0.1),
            trip("c", "running", duration_s=7.0, time_loss_s=500.0, route_length_m=1000.0, co2_kg=0.2),
            trip("d", "waiting", depart_delay_s=50.0),
        ]
    )
    values = {one.name: one.value for one in of_trips("traffic", trips)}
    assert [values[f"trips_{kind}"] for kind in ("finished", "running", "waiting")] == [2, 1, 1]
    finished = [values[f"{name}_mean_finished"] for name in ("travel_time", "delay", "depart_delay")]
    assert finished == [150, 20, 0]
    assert values["distance"] == 5
    assert values["co2_per_distance"] == pytest.approx(0.2)
    assert values["fuel_per_distance"] == pytest.approx(0.04)


def test_without_traffic_counts_are_zero_and_means_undefined():
    none = pd.DataFrame([trip("platoon.0")]).iloc[:0]
    values = {one.name: one.value for one in of_trips("traffic", none)}
    assert values["trips_finished"] == values["distance"] == 0
    assert np.isnan(values["delay_mean_finished"])
    assert np.isnan(values["co2_per_distance"])


@pytest.fixture(scope="module")
def with_outputs(tmp_path_factory) -> Path:
    """A run in which a car arrives, one is on the road to the end, and one finds no room to depart."""
    folder = tmp_path_factory.mktemp("outputs")
    short = '<route edges="west_south"/></vehicle>'
    far = '<route edges="west_south south_east east_north"/></vehicle>'
    vehicles = (
        f'<vehicle id="gone" depart="0" arrivalPos="60" departPos="30">{short}'  # before the platoon is there
        f'<vehicle id="arriving" depart="21" departPos="100" departSpeed="10" arrivalPos="150">{short}'
        f'<vehicle id="driving" depart="25" departPos="30">{far}'
        f'<vehicle id="stuck" depart="26" departPos="25">{far}'
    )
    (folder / "few.rou.xml").write_text(f"<routes>{vehicles}</routes>".replace(' type="', ' type="'))
    (folder / "few.toml").write_text(SCENARIO)
    return run(folder / "run", folder / "few.toml")


@pytest.mark.sumo
def test_trips_have_a_status_each(with_outputs):
    trips = read_table(with_outputs / "sumo_trips.csv").set_index("vehicle_id")
    assert "gone" not in trips.index
    assert trips.status["arriving"] == "arrived"
    assert trips.status["driving"] == "running"
    # Departed 20 + 0.2 s after SUMO began, and so 0.8 s before a clock that began there.
    assert trips.depart_s["arriving"] == pytest.approx(21 - 20.2, abs=1e-3)
    assert trips.arrival_s["arriving"] - trips.depart_s["arriving"] == pytest.approx(trips.duration_s["arriving"])
    assert trips.route_length_m["arriving"] == pytest.approx(50, abs=0.01)
    assert np.isnan(trips.arrival_s["driving"])
    assert 0 < trips.co2_kg["arriving"] < 0.1
    # Members are inserted in the first of the two steps before time 0.
    assert (trips.depart_s[["platoon.0", "platoon.1"]] == -0.2).all()


@pytest.mark.sumo
def test_summary_and_edges_begin_when_the_platoons_do(with_outputs):
    summary, edges = (pd.read_csv(with_outputs / f"sumo_{name}.csv") for name in ("summary", "edges"))
    assert summary.time_s.min() >= 0
    assert summary.time_s.diff()[1:-1].to_numpy() == pytest.approx(10)
    assert edges.begin_s.unique() == pytest.approx([0, 10, 20])
    assert "west_south" in set(edges.edge_id)
    assert (edges.sampled_s > 0).all()


@pytest.mark.sumo
def test_every_column_is_described_and_nothing_else_is_left(with_outputs):
    package = json.loads((with_outputs / "datapackage.json").read_text())
    described = {resource["path"]: resource for resource in package["resources"]}
    for name in ("trips", "summary", "edges"):
        fields = described[f"sumo_{name}.csv"]["schema"]["fields"]
        assert [field["name"] for field in fields] == list(pd.read_csv(with_outputs / f"sumo_{name}.csv").columns)
        assert all(field["description"] for field in fields)
    assert sorted(file.name for file in with_outputs.glob("sumo_*")) == [
        "sumo_edges.csv", "sumo_summary.csv", "sumo_trips.csv",
    ]  # fmt: skip
    metrics = pd.read_csv(with_outputs / "metrics.csv").query("scope == 'traffic'").set_index("metric").value
    assert metrics.trips_finished == 1


@pytest.mark.sumo
def test_outputs_change_nothing_and_are_the_same_bytes_again(with_outputs, tmp_path):
    again = run(tmp_path / "again", with_outputs / "config.toml")
    for table in ("trips", "summary", "edges"):
        assert filecmp.cmp(with_outputs / f"sumo_{table}.csv", again / f"sumo_{table}.csv", shallow=False)
    without = run(tmp_path / "without", with_outputs / "config.toml", "record.sumo=[]")
    assert filecmp.cmp(with_outputs / "trajectories.csv", without / "trajectories.csv", shallow=False)
    assert not list(without.glob("sumo_*"))


@pytest.mark.sumo
@pytest.mark.parametrize(("demand", "vehicles"), [(0.5, 20), (1.0, 40), (2.0, 80)])
def test_demand_multiplies_the_vehicles_of_the_routes_and_not_the_members(tmp_path, demand, vehicles):
    changes = (f"sumo.demand={demand}", "sumo.warm_up_s=125", "run.duration_s=1", "record.sumo=summary")
    summary = pd.read_csv(run(tmp_path / "run", "ring_platoon", *changes) / "sumo_summary.csv")
    assert summary.inserted.iloc[-1] + summary.waiting.iloc[-1] == vehicles + 5


def test_without_a_demand_sumo_gets_no_scale(tmp_path):
    (tmp_path / "few.toml").write_text(SCENARIO.replace('["few.rou.xml"]', "[]"))
    assert "scale" not in sumo_options(scenario.load(tmp_path / "few.toml"), tmp_path)
    assert sumo_options(scenario.load(tmp_path / "few.toml", ["sumo.demand=1.5"]), tmp_path)["scale"] == "1.5"
