"""Runs that share a warm-up: the tables of runs that do not, whatever happens to the process that is copied."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from platoontraffic import shipped
from platoontraffic.branches.process import can_fork
from platoontraffic.study import batch, process_tree, study, warm_ups

pytestmark = [pytest.mark.sumo, pytest.mark.skipif(not can_fork, reason="this system cannot copy a process")]

STUDY = """
name = "warm"
base = "town.toml"
seeds = [1, 2]
set = { run.duration_s = 3, sumo.warm_up_s = 30, record.sumo = ["trips"] }
grid = { platoon.follower.time_headway_s = [1.0, 2.0] }
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A study of four runs with two warm-ups, in the shipped town."""
    text = shipped.scenarios()["grid_platoons"].read_text()
    (tmp_path / "town.toml").write_text("[[platoon]]".join(text.split("[[platoon]]")[:2]))
    (tmp_path / "warm.toml").write_text(STUDY)
    return tmp_path / "warm.toml"


def tables(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file() and file.name not in (".lock", "runs.csv"))
    return {str(file.relative_to(folder)): file.read_bytes() for file in files if file.name != "provenance.json"}


@pytest.fixture
def copies(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Processes of runs that were copied from that of a warm-up."""
    pids: list[int] = []

    class Counted(warm_ups.Process):
        def fork(self, *arguments):
            fork = super().fork(*arguments)
            pids.append(fork.pid)
            return fork

    monkeypatch.setattr(warm_ups, "Process", Counted)
    return pids


def test_tables_are_those_without_sharing(file: Path, tmp_path: Path, copies: list[int]) -> None:
    loaded = study.load(file)
    assert {warm_up: len(runs) for warm_up, runs in batch.shared_warm_ups(loaded.runs, "processes").items()} == {
        run.warm_up: 2 for run in loaded.runs
    }
    batch.run(loaded, tmp_path / "shared", slots=2)
    batch.run(loaded, tmp_path / "apart", executor="serial")
    assert len(copies) == 4
    assert tables(tmp_path / "shared") == tables(tmp_path / "apart")


def test_another_configuration_is_another_warm_up(file: Path) -> None:
    net = shipped.networks()["grid"]
    text = net.with_name("grid.sumocfg").read_text().replace('value="grid.', f'value="{net.parent}/grid.')
    text = text.replace(",grid.", f",{net.parent}/grid.")
    for name, scale in (("a", 1.0), ("b", 0.5)):
        scaled = text.replace("<processing>", f'<processing><scale value="{scale}"/>')
        file.with_name(f"{name}.sumocfg").write_text(scaled)
    town = file.with_name("town.toml")
    town.write_text(town.read_text().replace('net = "grid"', 'config = "a.sumocfg"'))
    file.write_text(STUDY.replace("grid = {", 'grid = { sumo.config = ["a.sumocfg", "b.sumocfg"],'))
    runs = study.load(file).runs
    assert len(runs) == 8
    assert len({run.warm_up for run in runs}) == 4


def test_a_run_whose_process_is_killed_is_repeated(file: Path, tmp_path: Path, copies: list[int]) -> None:
    def kill() -> None:
        while len(copies) < 1:
            time.sleep(0.01)
        os.kill(copies[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    report = batch.run(study.load(file), tmp_path / "out", slots=1)
    killer.join()
    assert report.progress.done == 4
    assert len(copies) == 4


def test_runs_whose_warm_up_dies_are_run_by_themselves(file: Path, tmp_path: Path, monkeypatch) -> None:
    def dies(self, key, job, pulse):
        process = warm_ups.Process(quiet=True)
        process.kill()
        return process

    monkeypatch.setattr(warm_ups.WarmUps, "_warm", dies)
    assert batch.run(study.load(file), tmp_path / "out", slots=2).progress.done == 4


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")
def test_a_killed_batch_leaves_no_process(file: Path, tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from platoontraffic.study import batch, study; "
        f"batch.run(study.load({str(file)!r}, ['run.duration_s=600']), Path({str(tmp_path / 'out')!r}), slots=2)"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as process:
        until = time.monotonic() + 60
        while len(list((tmp_path / "out").glob("*.partial"))) < 2 and time.monotonic() < until:
            time.sleep(0.1)
        started = process_tree._tree(process.pid, process_tree._living()) - {process.pid}
        process.kill()
    assert len(started) >= 4  # two warm-ups and their runs
    while started & process_tree._living().keys() and time.monotonic() < until:
        time.sleep(0.1)
    assert not started & process_tree._living().keys()
