"""Tables for analysis, where there is no SUMO: tidy, with units, and plain words about what is not there."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario
from platoontraffic.analysis import Batch, ResultsError, load
from platoontraffic.analysis.results import Scans, load_run
from platoontraffic.errors import InputError
from platoontraffic.study import batch, study
from tests.support.runs import forget_sizes

KEY = "platoon.follower.heading_gain_per_s"


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """The folder of a batch of four runs."""
    folder = tmp_path_factory.mktemp("study")
    text = 'base = "paper_loop"\nreplications = 2\n[set]\nrun.duration_s = 0.5\nplatoon.size = 2\n'
    (folder / "small.toml").write_text(f"{text}[grid]\n{KEY} = [1.0, 2.0]\n")
    batch.run(study.load(folder / "small.toml"), folder / "results", "serial")
    return folder / "results"


@pytest.fixture
def copy(small, tmp_path) -> Path:
    return shutil.copytree(small, tmp_path / "copy")


pytestmark = pytest.mark.sumo


def test_a_batch_is_tidy_tables_with_units(small):
    results = load(small)
    assert isinstance(results, Batch)
    assert results.varied == [KEY]
    assert results.runs[["seed", KEY]].to_numpy().tolist() == [[1, 1.0], [2, 1.0], [1, 2.0], [2, 2.0]]
    assert results.summary.attrs["units"]["gap_mean_m"] == "m"
    assert {"collisions", "splits", "lock_losses"} <= {*results.summary.attrs["counts"]}
    assert not {"arrived", "members", "gap_mean_m", "lock_on_ratio_min"} & {*results.summary.attrs["counts"]}
    assert results.runs.attrs["units"]["wall_s"] == "s"
    assert len(results.missing) == 0


def test_a_run_in_a_notebook_is_one_line(small):
    results = load(next(small.glob("*-s1")))
    assert (
        repr(results)
        == f"<Results of {results.folder}: {len(results.trajectories)} rows of 2 members, {len(results.events)} events>"
    )
    none = np.empty(0)
    empty = Scans(**{field.name: none for field in fields(Scans)})
    assert repr(empty) == "<0 scans of 0 lasers>"
    two = replace(empty, time_s=np.array([0.0, 0.0, 1.5]), vehicle_id=np.array(["a", "b"]))
    assert repr(two) == "<3 scans of 2 lasers, 0 to 1.5 s>"


@pytest.mark.parametrize("name", ["trajectories", "events", "metrics"])
def test_tables_of_all_runs_have_what_was_varied(small, name):
    results = load(small)
    table = results.table(name)
    for row in results.summary.itertuples():
        own = table[table.id == row.id].reset_index(drop=True)
        assert (own.seed == row.seed).all()
        assert own[KEY].nunique() == 1
        alone = pd.read_csv(small / row.id / f"{name}.csv")
        pd.testing.assert_frame_equal(own[alone.columns.to_list()], alone, check_dtype=False)
    assert table.id.unique().tolist() == results.summary.id.tolist()
    if name == "trajectories":
        assert table.attrs["units"]["gap_m"] == "m"


def test_cells_with_line_feeds_stay_with_their_run(copy):
    events = sorted(copy.glob("*-s1/events.csv"))[0]
    lines = events.read_text().rstrip("\n")
    events.write_text(f'{lines}\n0.5,odd,robot.0,,0,0,,,"two\nlines"\n')
    forget_sizes(events.parent)
    table = load(copy).table("events")
    assert table[table.kind == "odd"].id.to_list() == [events.parent.name]
    assert len(table) == sum(len(pd.read_csv(file)) for file in copy.glob("*/events.csv"))


def test_a_run_without_rows_does_not_make_numbers_objects(copy):
    """As the run of a study of shares that has no members."""
    file = sorted(copy.glob("*-s1/trajectories.csv"))[0]
    file.write_text(file.read_text().partition("\n")[0] + "\n")
    forget_sizes(file.parent)
    table = load(copy).table("trajectories")
    assert file.parent.name not in set(table.id)
    assert table.x_m.dtype == float
    assert table.place.dtype == int


def test_a_run_has_units_too(small):
    results = load(next(small.glob("*-s1")))
    assert results.trajectories.attrs["units"]["speed_mps"] == "m/s"


def test_what_is_missing_is_said(copy):
    runs = pd.read_csv(copy / "runs.csv", dtype=str)
    runs.loc[1, ["status", "error"]] = ["failed", "why"]
    runs.loc[2, "status"] = "waiting"
    runs.to_csv(copy / "runs.csv", index=False)
    for name in runs.id[1:3]:
        (copy / name / "DONE").unlink()
    with pytest.warns(UserWarning, match="2 of 4 runs are missing: 1 failed, 1 waiting"):
        assert load(copy).missing.error.to_list()[0] == "why"


@pytest.mark.parametrize("name", ["trajectories.csv", "vehicles.csv", "summary.csv"])
def test_a_table_that_was_cut_off_is_refused(copy, name):
    """Its last row was read as one with empty cells, and the rest of the run was missing without a word."""
    file = next(copy.glob(f"*-s1/{name}"))
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(ResultsError, match=rf"{name}: damaged or changed: it has \d+ bytes; the run wrote \d+"):
        load(file.parent)
    with pytest.raises(ResultsError, match=rf"{file.parent.name}.{name}: damaged"):
        load(copy).table("trajectories")


def test_a_byte_that_is_not_utf8_is_named_with_its_line(copy):
    file = next(copy.glob("*-s1")) / "trajectories.csv"
    content = bytearray(file.read_bytes())
    content[2000] = 0xFF
    file.write_bytes(content)
    line = content[:2000].count(b"\n") + 1
    for read in (lambda: load(file.parent), lambda: load(copy).table("trajectories")):
        with pytest.raises(ResultsError) as raised:
            read()
        assert str(raised.value) == f"{file}:{line}: byte 0xff: is not UTF-8"


def test_a_cell_that_is_no_number_is_named(copy):
    file = sorted(copy.glob("*-s1/trajectories.csv"))[1]
    first, second, *rest = file.read_text().splitlines()
    file.write_text("\n".join([first, second, "x" + rest[0][1:], *rest[1:], ""]))
    for table in (lambda: load(file.parent), lambda: load(copy).table("trajectories")):
        with pytest.raises(ResultsError, match=r"trajectories.csv: row 2: time_s: 'x.*' is no number"):
            table()


@pytest.mark.parametrize("name", ["runs.csv", "summary.csv", "datapackage.json"])
@pytest.mark.parametrize("content", [None, "", "nonsense"])
def test_a_batch_that_is_not_whole_is_refused(copy, name, content):
    (copy / name).unlink() if content is None else (copy / name).write_text(content)
    with pytest.raises(ResultsError, match=name):
        load(copy)


def test_a_table_that_is_not_there_is_refused(copy):
    results = load(copy)
    with pytest.raises(
        ResultsError, match=r"traffic.csv: is missing; there are events, metrics, statistics, summary, trajectories"
    ):
        results.table("traffic")
    shutil.rmtree(copy / results.summary.id[0])
    with pytest.raises(ResultsError, match=r"is missing, though runs.csv has it as done"):
        results.table("metrics")


def test_it_works_without_sumo(small):
    code = """
import sys
sys.modules["libsumo"] = sys.modules["traci"] = sys.modules["sumolib"] = None  # an import of them fails
from platoontraffic.analysis import load
print(len(load(sys.argv[1]).table("metrics")))
"""
    done = subprocess.run([sys.executable, "-c", code, str(small)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == len(load(small).table("metrics"))


def test_parquet_is_what_the_csv_is(copy):
    tables = "runs", "summary", "trajectories", "events", "metrics", "statistics", "vehicles"
    pytest.importorskip("pyarrow")
    command = [sys.executable, "-m", "platoontraffic", "export", "--to", "parquet"]
    done = subprocess.run([*command, str(copy)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    names = {Path(line).name for line in done.stdout.splitlines()}
    assert names == {f"{name}.parquet" for name in tables}
    # In a process of its own: this one has libsumo.
    code = """
import sys, json, pandas as pd, pyarrow.parquet as parquet
folder = sys.argv[1]
table = pd.read_parquet(f"{folder}/trajectories.parquet")
unit = parquet.read_schema(f"{folder}/trajectories.parquet").field("gap_m").metadata[b"unit"].decode()
print(json.dumps([len(table), table.columns.to_list(), table.x_m.sum(), unit]))
"""
    read = subprocess.run([sys.executable, "-c", code, str(copy)], capture_output=True, text=True, check=True)
    rows, columns, total, unit = json.loads(read.stdout)
    table = load(copy).table("trajectories")
    assert (rows, columns, unit) == (len(table), table.columns.to_list(), "m")
    assert total == pytest.approx(table.x_m.sum())


def test_nothing_is_warned_of_where_all_is_there(small):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(small)


def test_an_unfinished_run_opens_as_far_as_it_was_written(small, tmp_path):
    done = next(small.glob("*-s1"))
    cut = shutil.copytree(done, tmp_path / "run.unfinished")
    for name in ("DONE", "metrics.csv", "datapackage.json", "vehicles.csv"):
        (cut / name).unlink()
    whole = load(done).trajectories
    text = (cut / "trajectories.csv").read_text()
    (cut / "trajectories.csv").write_text(text[:-5])  # a killed process may leave a part of a line
    with pytest.warns(UserWarning, match=r"unfinished run: its tables end at 0\.5 s, and it has no metrics"):
        results = load(cut)
    assert not results.finished
    assert results.trajectories.equals(whole[:-1])
    assert results.metrics.empty
    assert results.vehicles is None
    (cut / "trajectories.csv").write_text(text.partition("\n")[0] + "\n")
    with pytest.raises(ResultsError, match="nothing was recorded"):
        load(cut)


def test_a_batch_where_a_run_is_needed_names_a_run(small):
    first = min(file.parent for file in small.glob("*/DONE"))
    with pytest.raises(ResultsError, match=f"the folder of a batch, not the folder of a run; a run in it is {first}$"):
        load_run(small)
    with pytest.raises(InputError, match=r"is the folder of a batch; its study is .*study\.toml"):
        scenario.load(small)
