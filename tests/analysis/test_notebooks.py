"""The notebooks run from a clean kernel, on small results of the studies behind them, and end in a figure."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import tomli_w

from platoontraffic import shipped
from tests.support import ROOT

NOTEBOOKS = {file.stem: file for file in sorted((ROOT / "analysis/notebooks").glob("*.ipynb"))}

# Studies that a notebook reads, and what makes a run of them short.
STUDIES = {
    "2_paper_readings": {"paper_readings": ("run.duration_s=2",), "paper_follower": ("run.duration_s=2",)},
    "3_speed_and_radius": {"speed_and_radius": ("run.duration_s=2",)},
    "4_effect_on_traffic": {
        "effect_on_traffic": (
            "sumo.warm_up_s=20",
            "run.duration_s=20",
            *(f"platoon.{i}.start.time_s={2 * i}" for i in range(6)),
        )
    },
    "5_yardsticks": {
        "yardsticks": ("run.duration_s=30",),
        "cut_ins": ("run.duration_s=6",),
        "price_of_sensing": ("run.duration_s=30",),
        "price_of_sensing_branches": ("run.duration_s=30",),
    },
    "6_penetration": {
        "penetration": ("sumo.warm_up_s=60", "run.duration_s=40"),
        "capacity": ("run.duration_s=120",),
    },
    "7_learned_follower": {},  # makes its own runs
}
FEW = 2  # values of a key, and seeds


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("results")


def call(*arguments: object) -> None:
    command = [sys.executable, "-m", "platoontraffic", *map(str, arguments), "-q"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def small(study: str, folder: Path) -> Path:
    """A shipped study with few values of every key, and few seeds."""
    table = tomllib.loads(shipped.studies()[study].read_text(encoding="utf-8"))
    table.pop("leave_out", None)
    if "replications" in table:
        table["replications"] = FEW
    zips = table.get("zip", [])
    for axes in [table.get("grid", {}), *(zips if isinstance(zips, list) else [zips])]:
        _shorten(axes)
    file = folder / f"{study}.toml"
    file.write_text(tomli_w.dumps(table), encoding="utf-8")
    return file


def _shorten(table: dict) -> None:
    for key, value in table.items():
        if isinstance(value, list):
            table[key] = value[:FEW]
        else:
            _shorten(value)


def test_notebooks_are_there_for_every_question():
    assert list(NOTEBOOKS) == ["1_one_run", *STUDIES]


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_outputs_are_kept_of_whole_runs_and_studies_and_nothing_tells_of_a_machine(name):
    text = NOTEBOOKS[name].read_text(encoding="utf-8")
    notebook = json.loads(text)
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in code[1:])
    assert all(cell["execution_count"] is None for cell in code)
    assert all(cell["metadata"] == {} for cell in notebook["cells"])
    assert set(notebook["metadata"]) == {"kernelspec", "language_info"}
    assert notebook["metadata"]["language_info"] == {"name": "python"}
    assert not re.search(r"/(home|root|tmp|opt|work|Users)/", text)
    assert len(text) < 300_000


@pytest.mark.parametrize("name", STUDIES)
def test_its_studies_are_shipped_and_named_in_it(name):
    text = NOTEBOOKS[name].read_text(encoding="utf-8")
    for study in STUDIES[name]:
        assert study in shipped.studies()
        assert f"platoontraffic batch {study}" in text


@pytest.mark.slow
@pytest.mark.sumo
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_runs_from_a_clean_kernel_and_ends_in_a_figure(name, results, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason='pip install -e ".[notebooks]"')
    nbformat = pytest.importorskip("nbformat", reason='pip install -e ".[notebooks]"')
    pytest.importorskip("ipykernel", reason='pip install -e ".[notebooks]"')
    if name == "1_one_run":
        changes = ("run.duration_s=15", "record.traffic_every_s=1")
        call("run", "corridor_platoon", *changes, "--out", results)
    for study, changes in STUDIES.get(name, {}).items():
        call("batch", small(study, tmp_path), *changes, "--out", results, "-j", 1)

    monkeypatch.setenv("PLATOONTRAFFIC_RESULTS", str(results))
    monkeypatch.setenv("DRIVES", str(FEW))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]))
    notebook = nbformat.read(NOTEBOOKS[name], as_version=4)
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute(cwd=tmp_path)
    shown = [output.get("data", {}) for output in notebook.cells[-1].outputs]
    assert any("image/png" in data for data in shown)
