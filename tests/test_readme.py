"""What the README says is true: its commands, its example, its picture."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from platoontraffic.cli.main import app
from tests.support import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_there_is_one_command_to_run_and_one_to_test():
    run, test = (block.strip() for block in blocks("sh")[:2])
    assert run.startswith("python3 -m venv .venv && ")
    assert run.endswith("platoontraffic run paper_loop")
    assert test.startswith("python3 -m venv .venv && ")
    assert test.endswith("pytest")


@pytest.mark.sumo
def test_your_own_follower_in_twenty_lines_runs(tmp_path, monkeypatch):
    law = blocks("python")[0]
    (scenario,) = [block for block in blocks("toml") if "my_follower" in block]
    assert len(law.strip().splitlines()) <= 20
    (tmp_path / "my_follower.py").write_text(law)
    (tmp_path / "mine.toml").write_text(scenario)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["run", "mine.toml", "-q"])
    assert (done.exit_code, done.stderr) == (0, "")
    header, row = ((Path(done.stdout.strip()) / "summary.csv").read_text()).splitlines()
    values = dict(zip(header.split(","), row.split(","), strict=True))
    assert (values["collisions"], values["lock_on_ratio_min"]) == ("0", "1")


def test_the_study_is_one(tmp_path):
    (text,) = [block for block in blocks("toml") if "base =" in block]
    (tmp_path / "mine.toml").write_text(text)
    done = CliRunner().invoke(app, ["batch", str(tmp_path / "mine.toml"), "--dry-run"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert "330 runs" in done.stdout


def test_ten_lines_draw_a_scan(tmp_path, monkeypatch):
    text = (ROOT / "lidar/README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len([line for line in code.splitlines() if line]) <= 10
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "scan.png").stat().st_size > 5000


@pytest.mark.parametrize("file", ["README.md", "lidar/README.md", "analysis/README.md", "CONTRIBUTING.md"])
def test_links_and_pictures_are_there(file):
    for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / file).read_text(encoding="utf-8")):
        assert target.startswith("https://") or (ROOT / file).parent.joinpath(target).exists(), target
