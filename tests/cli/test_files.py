"""What commands read and write in a folder of results: whole files, and nothing outside of it."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.testing import CliRunner

from platoontraffic.analysis.writing import replacing, write
from platoontraffic.cli.main import app
from platoontraffic.results.data_package import data_package
from tests.support.made_runs import made_batch, made_run

try:
    import resource
except ImportError:  # Windows
    resource = None

# Arguments of a command after the folder -> the files and folders that it writes.
WRITTEN = {
    ("report",): ["report.html", *(f"report-{name}.{kind}" for name in ("road", "strips") for kind in ("png", "svg"))],
    ("replay",): ["replay.html"],
    ("plot",): ["plot.png"],
    ("export", "--to", "fcd"): ["fcd.xml"],
    ("export", "--to", "mcap"): ["rosbag"],
    ("export",): ["trajectories.parquet", "events.parquet", "metrics.parquet", "vehicles.parquet"],
}
EXTRAS = {("export",): "pyarrow", ("export", "--to", "mcap"): "rosbags"}


def call(command: tuple[str, ...], folder: Path) -> subprocess.CompletedProcess[str]:
    """A command in this process: to start one takes longer than most commands."""
    if command in EXTRAS:  # libsumo, which other tests import, and pyarrow do not go together
        return process(command, folder)
    done = CliRunner().invoke(app, [command[0], str(folder), *command[1:]])
    return subprocess.CompletedProcess(command, done.exit_code, done.stdout, done.stderr)


def process(command: tuple[str, ...], folder: Path, **options) -> subprocess.CompletedProcess[str]:
    if command in EXTRAS and not find_spec(EXTRAS[command]):
        pytest.skip(f"needs {EXTRAS[command]}: pip install platoontraffic[parquet,ros]")
    line = [sys.executable, "-m", "platoontraffic", command[0], str(folder), *command[1:]]
    return subprocess.run(line, capture_output=True, text=True, **options)


def files(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.fixture
def run(tmp_path) -> Path:
    folder = made_run(tmp_path / "run", seconds=2.0, others=2)
    tables = [r for r in data_package("made", "", traffic=True)["resources"] if (folder / r["path"]).suffix == ".csv"]
    tables = [r | {"schema": {"fields": []}} for r in tables if r["name"] in ("trajectories", "events", "metrics")]
    (folder / "datapackage.json").write_text(json.dumps({"resources": tables}))
    return folder


@pytest.mark.parametrize("command", WRITTEN, ids=" ".join)
def test_a_link_in_the_place_of_an_output_is_replaced(run, tmp_path, command):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "mine").write_text("mine")
    for name in WRITTEN[command]:
        (run / name).symlink_to(outside if name == "rosbag" else outside / "mine")
    done = call(command, run)
    assert (done.returncode, done.stderr) == (0, "")
    assert files(outside) == {"mine": b"mine"}
    there = [name for name in WRITTEN[command] if name != "vehicles.parquet"]
    assert not any((run / name).is_symlink() for name in there)
    assert all((run / name).exists() for name in there)


@pytest.mark.parametrize("name", ["../outside/secret", "/etc/secret", "a/../../outside/secret", "link"])
def test_a_table_outside_of_the_folder_is_refused_in_one_line(run, tmp_path, name):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "secret.csv").write_text("password\n1234\n")
    (run / "link.csv").symlink_to(outside / "secret.csv")
    table = {"name": name, "format": "csv", "schema": {"fields": []}}
    (run / "datapackage.json").write_text(json.dumps({"resources": [table]}))
    done = call(("export",), run)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "leads out of the folder" in done.stderr
    assert list(files(outside)) == ["secret.csv"]
    assert not list(run.glob("*.parquet"))


@pytest.mark.parametrize("name", ["trajectories.csv", "traffic.csv", "scans.npz", "scene.geojson", "datapackage.json"])
def test_a_link_to_a_file_outside_of_the_folder_is_not_read(run, tmp_path, name):
    (run / name).rename(tmp_path / name)
    (run / name).symlink_to(tmp_path / name)
    done = call(("replay",), run)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "leads out of the folder" in done.stderr


def test_a_link_to_a_file_inside_of_the_folder_is_read(run):
    (run / "trajectories.csv").rename(run / "moved.csv")
    (run / "trajectories.csv").symlink_to("moved.csv")
    assert call(("replay",), run).returncode == 0


def test_runs_of_a_batch_outside_of_its_folder_are_refused(tmp_path):
    made_run(tmp_path / "elsewhere", seconds=2.0, others=2)
    batch = made_batch(tmp_path / "batch", {"platoon.size": [2]}, seeds=1, failed=0, waiting=0)
    for name in ("runs.csv", "summary.csv"):
        table = batch / name
        table.write_text(table.read_text().replace("run0-s1", "../elsewhere"))
    tables = [{"name": name, "format": "csv", "schema": {"fields": []}} for name in ("runs", "summary")]
    (batch / "datapackage.json").write_text(json.dumps({"resources": tables}))
    done = call(("export",), batch)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "leads out of the folder" in done.stderr


@pytest.mark.skipif(resource is None, reason="limits of POSIX")
@pytest.mark.parametrize("command", WRITTEN, ids=" ".join)
def test_a_full_disk_leaves_every_file_as_it_was(run, command):
    for name in WRITTEN[command]:
        if name != "rosbag":
            (run / name).write_text("old")
    before = files(run)
    done = process(command, run, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512)))
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "cannot be written: " in done.stderr
    assert "File too large" in done.stderr
    assert files(run) == before


@pytest.mark.parametrize("to", ["no/such/folder/page.html", "run", f"{'a' * 300}.html"])
def test_a_place_that_cannot_be_is_bad_input(run, tmp_path, to):
    done = call(("replay", "--to", str(tmp_path / to)), run)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "cannot be written" in done.stderr


def test_a_page_can_be_written_to_a_pipe(run):
    piped = process(("replay", "--to", "/dev/stdout"), run).stdout
    assert piped.startswith("<!doctype html>")
    assert piped.endswith("/dev/stdout\n")


def test_an_error_while_a_file_is_written_leaves_the_old_one(tmp_path):
    file = write(tmp_path / "file", b"old")
    with contextlib.suppress(KeyboardInterrupt), replacing(file) as new:
        new.write_text("half")
        raise KeyboardInterrupt
    assert files(tmp_path) == {"file": b"old"}


@pytest.mark.skipif(os.name == "nt", reason="links of POSIX")
def test_a_name_as_long_as_a_name_may_be_is_written(tmp_path):
    assert write(tmp_path / ("a" * 251 + ".png"), b"new").read_bytes() == b"new"
