"""Plug-ins of a scenario are code: it is said before they run, and they can be refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from platoontraffic.cli.main import app

LAW = """
from pathlib import Path
from platoontraffic.controllers.reactive import ReactiveLeader
Path(__file__).with_name("was_here").touch()
class Mine(ReactiveLeader): pass
"""


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def file(tmp_path: Path, scenario_file) -> Path:
    (tmp_path / "follow.py").write_text(LAW)
    return scenario_file(('law = "reactive"', 'law = "follow:Mine"'))


@pytest.fixture
def study(tmp_path: Path, file: Path) -> Path:
    text = f'base = "{file.name}"\nset.run.duration_s = 1\ngrid.platoon.size = [1, 2]\n'
    (tmp_path / "study.toml").write_text(text)
    return tmp_path / "study.toml"


def said(folder: Path) -> str:
    return f"mine: its plug-ins run code, of {folder / 'follow.py'}\n"


def test_check_and_dry_run_say_it_once(tmp_path: Path, file: Path, study: Path):
    assert call("check", file).stderr.count(said(tmp_path)) == 1
    assert call("run", file, "--dry-run").stderr.count(said(tmp_path)) == 1
    assert call("check", study).stderr.count(said(tmp_path)) == 1


@pytest.mark.parametrize("command", [("check",), ("run",), ("run", "--dry-run"), ("batch",)])
def test_no_plugins_refuses_them_before_they_run(command: tuple[str, ...], tmp_path: Path, file: Path, study: Path):
    done = call(*command, study if command == ("batch",) else file, "--no-plugins")
    at = f"{file}:17: platoon.0.leader.law"
    assert f"{at}: 'follow:Mine': runs code of {tmp_path / 'follow.py'}, which --no-plugins forbids" in done.stderr
    assert done.exit_code == 2
    assert not (tmp_path / "was_here").exists()


def test_sensors_metrics_and_modules_elsewhere_are_code_too(tmp_path: Path, scenario_file):
    file = scenario_file(
        ("[run]", '[record]\nmetrics = ["json:JSONDecoder"]\n[run]'),
        ('law = "reactive"', 'law = "reactive"\nsensors = { radar = "../radar.py:Radar" }'),
    )
    lines = call("check", file, "--no-plugins").stderr.splitlines()
    assert [line.partition(": ")[2].partition(": runs")[0] for line in lines] == [
        "platoon.0.leader.sensors.radar: '../radar.py:Radar'",
        "record.metrics.0: 'json:JSONDecoder'",
    ]


def test_shipped_laws_are_not_said():
    assert call("check", "paper_loop", "--no-plugins").exit_code == 0


@pytest.mark.sumo
def test_only_the_first_run_of_a_file_says_it(tmp_path: Path, file: Path):
    arguments = ("run", file, "run.duration_s=1", "-q", "--out", tmp_path / "out")
    assert said(tmp_path) in call(*arguments).stderr
    assert call(*arguments, "--force").stderr == ""
    (tmp_path / "follow.py").write_text(LAW + "# changed\n")
    assert said(tmp_path) in call(*arguments).stderr
