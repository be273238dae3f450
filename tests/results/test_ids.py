"""Ids are text, whatever they look like: in tables, figures, pages and exports."""

from __future__ import annotations

import subprocess
import sys
from xml.etree import ElementTree

import matplotlib.pyplot as plt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from platoontraffic import analysis
from platoontraffic.analysis.reading import TEXTS, read_table
from platoontraffic.cli.printing import summary
from platoontraffic.export import fcd
from platoontraffic.replay import page as replay_page
from platoontraffic.report import page as report_page
from platoontraffic.results import csv_text
from platoontraffic.results.columns import ENCOUNTERS, EVENTS, METRICS, TRAFFIC, TRAJECTORIES, VEHICLES
from platoontraffic.results.sumo_tables import TABLES
from platoontraffic.study import batch, study
from tests.support import ROOT
from tests.support.made_runs import made_run
from tests.support.runs import run

LIKE_NUMBERS = ["1", "007", "-1", "1e5", "0x1F", "1_000", "inf", "-Infinity", "NaN", "9" * 30]
LIKE_NOTHING = ["NA", "nan", "None", "null", "NULL", "n-a", "true", "False", "-", "_", "1-1-2020", "__proto__"]
# SUMO's own vehicles may have more. A spreadsheet takes the first ones, and -1, for formulas.
OF_SUMO = [
    "=1+1",
    "+1",
    "@x",
    '=cmd|"/C calc"!A0',
    "#N/A",
    "<NA>",
    "N/A",
    " a ",
    "a,b",
    'a"b',
    '"',
    "a\nb",
    "a\rb",
    "ä",
]
IDS = [*LIKE_NUMBERS, *LIKE_NOTHING]

platoons = st.sampled_from(IDS) | st.from_regex(r"[A-Za-z0-9_-]+", fullmatch=True)
obstacles = st.sampled_from(IDS) | st.from_regex(r"[A-Za-z0-9_.-]+", fullmatch=True)
vehicles = st.sampled_from([*IDS, *OF_SUMO]) | st.text(
    st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1
)
ALL_TABLES = [TRAJECTORIES, EVENTS, TRAFFIC, VEHICLES, ENCOUNTERS, METRICS, *(t.written for t in TABLES.values())]


def test_the_columns_that_are_read_as_text_are_those_that_are_written_as_text():
    texts = {column.name for table in ALL_TABLES for column in table if column.type == "string"}
    others = {column.name for table in ALL_TABLES for column in table if column.type != "string"}
    assert texts <= set(TEXTS)
    assert not others & set(TEXTS)


@given(st.lists(st.tuples(platoons, vehicles, obstacles), min_size=1, max_size=5))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_a_table_is_read_as_it_was_written(tmp_path, rows):
    columns = [column for column in EVENTS if column.name in ("vehicle_id", "other_id", "detail", "x_m")]
    assert [column.type for column in columns] == ["string", "string", "number", "string"]
    lines = [(platoon, vehicle, 0.5, obstacle) for platoon, vehicle, obstacle in rows]
    file = tmp_path / "events.csv"
    file.write_text(csv_text.header(columns) + csv_text.lines(lines, columns), encoding="utf-8", newline="\n")
    assert list(read_table(file).itertuples(index=False, name=None)) == lines


@pytest.mark.parametrize("platoon", ["1", "007", "1e5", "inf", "NA", "null", "true", "__proto__"])
def test_figures_pages_and_exports_have_the_id_as_it_is(tmp_path, platoon):
    other = {"1": "2", "NA": "nan", "007": "=1+1", "inf": "+1"}.get(platoon, "NULL")
    folder = made_run(tmp_path / "run", seconds=13.0, others=4, every=0.5, platoon=platoon, other=other)
    ids = [f"{platoon}.{place}" for place in range(3)]

    results = analysis.load(folder)
    assert results.trajectories.vehicle_id.unique().tolist() == ids
    assert set(results.traffic.vehicle_id) == {other, "car.1", "car.2", "car.3"}
    assert results.trajectories.target_id.dropna().unique().tolist() == [*ids[:2], other]

    axes = plt.figure().subplots()
    analysis.over_time(results.trajectories, "gap_m", axes)
    analysis.losses(results.events, axes, results.trajectories)
    analysis.states(results.events, axes, results.trajectories)
    analysis.paths(results.trajectories, axes, results.scene, results.events)
    analysis.time_space(
        results.traffic, axes, results.trajectories.loc[results.trajectories.place == 0, ["x_m", "y_m"]]
    )
    analysis.growth(analysis.amplification(results.trajectories), axes)
    plt.close("all")
    analysis.picture(folder, folder / "plot.png")

    assert f"Members of {platoon}" in report_page(folder, folder / "report.html").read_text(encoding="utf-8")
    replay_page(folder, folder / "replay.html", ids[2])
    (xml,) = fcd.export(folder)
    assert {v.get("id") for v in ElementTree.parse(xml).iter("vehicle")} == {*ids, other, "car.1", "car.2", "car.3"}


def test_a_rosbag_is_made_of_ids_that_look_like_numbers_or_nothing(tmp_path):
    pytest.importorskip("rosbags", reason="needs rosbags: pip install platoontraffic[ros]")
    from platoontraffic.export import rosbag

    folder = made_run(tmp_path / "run", seconds=3.0, others=4, every=0.5, platoon="1e5", other="NA")
    assert any(file.suffix == ".mcap" for file in rosbag.export(folder))


# In a process of its own: libsumo and pyarrow do not go together.
EXPORTED = """
import sys
from pathlib import Path
from pyarrow.parquet import read_table
from platoontraffic.analysis import parquet
parquet.export(folder := Path(sys.argv[1]))
(platoon,) = read_table(folder / "summary.parquet")["platoon.id"].to_pylist()
assert set(read_table(folder / "trajectories.parquet")["vehicle_id"].to_pylist()) == {platoon + ".0", platoon + ".1"}
"""


@pytest.mark.sumo
@pytest.mark.parametrize("platoon", ["1", "NA"])
def test_a_run_has_the_metrics_of_its_platoon_whatever_its_id(tmp_path, platoon):
    short = ("run.duration_s=2", "platoon.size=2", "record.traffic_every_s=1", "record.scans_every_s=1")
    folder = run(tmp_path / "run", "paper_loop", *short, f"platoon.id={platoon}")
    usual = run(tmp_path / "usual", "paper_loop", *short)
    found, expected = (analysis.load(one).metrics for one in (folder, usual))
    assert found.platoon_id.dropna().unique().tolist() == [platoon]
    assert found.vehicle_id.dropna().unique().tolist() == [f"{platoon}.0", f"{platoon}.1"]
    assert found[["scope", "metric", "value"]].equals(expected[["scope", "metric", "value"]])
    assert summary(folder)["platoon.id"] == platoon

    pytest.importorskip("pyarrow")
    subprocess.run([sys.executable, "-c", EXPORTED, folder], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.sumo
def test_a_batch_over_ids_has_them_as_they_are(tmp_path):
    file = tmp_path / "ids.toml"
    base = f'name = "ids"\nbase = "paper_loop"\n[grid]\n"platoon.id" = {IDS[:3]}\n"run.duration_s" = [0.5]\n'
    file.write_text(base.replace("'", '"'))
    batch.run(study.load(str(file)), tmp_path / "ids", "serial")
    loaded = analysis.load(tmp_path / "ids")
    assert loaded.summary["platoon.id"].tolist() == loaded.runs["platoon.id"].tolist() == IDS[:3]
    assert loaded.table("vehicles").platoon_id.unique().tolist() == IDS[:3]
    assert analysis.summarise(loaded, "gap_mean_m", "platoon.id")["platoon.id"].tolist() == sorted(IDS[:3])


def test_one_function_reads_tables():
    files = [file for folder in ("platoontraffic", "analysis") for file in (ROOT / folder).rglob("*.py")]
    assert [file.name for file in files if "pd.read_csv" in file.read_text(encoding="utf-8")] == ["reading.py"]
