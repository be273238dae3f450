"""What the README says is true: its commands, its example, its picture."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic.cli.main import app
from platoontraffic.cli.net_sources import run_program
from platoontraffic.sumo.programs import program
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


@pytest.mark.slow
@pytest.mark.sumo
def test_your_own_follower_in_twenty_lines_runs(tmp_path, monkeypatch):
    law = blocks("python")[0]
    (scenario,) = [block for block in blocks("toml") if "my_follower" in block]
    assert len(law.strip().splitlines()) <= 20
    (tmp_path / "my_follower.py").write_text(law)
    (tmp_path / "mine.toml").write_text(scenario)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["run", "mine.toml", "-q"])
    assert (done.exit_code, done.stderr) == (0, "mine: its plug-ins run code, of my_follower.py\n")
    header, row = ((Path(done.stdout.strip()) / "summary.csv").read_text()).splitlines()
    values = dict(zip(header.split(","), row.split(","), strict=True))
    assert (values["collisions"], float(values["lock_on_ratio_min"])) == ("0", 1)


@pytest.mark.sumo
def test_the_simulation_prints_what_stands_below_it():
    (code,) = [block for block in blocks("python") if "instant.measures.gap" in block]
    (shown,) = re.findall(rf"{re.escape(code)}```\n\n((?:    .*\n)+)", README)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == re.sub("^    ", "", shown, flags=re.MULTILINE)


def test_prove_prints_what_stands_below_it():
    command, shown = re.search(r"^    platoontraffic (prove .*)\n\n((?:    .*\n)+)", README, re.MULTILINE).groups()
    done = CliRunner().invoke(app, command.split())
    assert " ".join(done.stdout.split()) == " ".join(shown.split())


@pytest.mark.sumo
def test_commands_of_a_step_replace_those_of_a_law():
    (code,) = [block for block in blocks("python") if "simulation.step(" in block]
    stands = "assert instant.fleet.motion.speed[0] == 0 and len(instant.fleet) == 10"
    subprocess.run([sys.executable, "-c", code + stands], capture_output=True, text=True, check=True)


FLOWS = "".join(
    f'<flow id="{a}{b}" begin="0" end="600" period="{period}" from="{a}" to="{b}" departSpeed="max"/>'
    for a, b, period in (("A1B1", "D1E1", 8), ("E2D2", "B2A2", 8), ("C0C1", "C3C4", 10), ("D4D3", "D1D0", 10),
                         ("B4B3", "D0E0", 12))
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.sumo
@pytest.mark.parametrize("seed", [1, 2])
def test_a_platoon_in_three_lines_arrives_in_a_town_with_traffic(tmp_path, monkeypatch, seed):
    pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo: pip install platoontraffic[gui]")
    (lines,) = [block for block in blocks("toml") if "A2B2" in block]
    assert len(lines.strip().splitlines()) == 1 + 3
    (make,) = re.findall(r"^    netgenerate (.*)$", README, re.MULTILINE)
    (drive,) = re.findall(r"^    platoontraffic (run city/run.sumocfg --platoon .*)$", README, re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    Path("city").mkdir()
    made = run_program(program("netgenerate"), *make.split(), folder=tmp_path)
    assert made.returncode == 0, made.stderr
    Path("city/flows.rou.xml").write_text(f"<routes>{FLOWS}</routes>")
    files = '<net-file value="city.net.xml"/><route-files value="flows.rou.xml"/>'
    Path("city/run.sumocfg").write_text(f"<configuration><input>{files}</input></configuration>")
    Path("platoon.toml").write_text(lines)
    done = CliRunner().invoke(app, [*drive.split(), "-q", "--seed", str(seed)])
    assert (done.exit_code, done.stderr) == (0, "")
    events = pd.read_csv(Path(done.stdout.strip()) / "events.csv")
    assert not events.kind.isin(["collision", "red_light", "failed_to_yield", "off_road", "stranded"]).any()
    assert sorted(events.vehicle_id[events.kind == "arrived"]) == [f"platoon.{i}" for i in range(5)]


def test_the_metric_is_the_example():
    (code,) = [block for block in blocks("python") if "TimeHeadwayShare" in block]
    assert code in (ROOT / "docs/examples/time_headway_share.py").read_text(encoding="utf-8")


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


def test_the_contents_lead_to_headings():
    headings = re.findall(r"^##+ (.*)$", re.sub(r"```.*?```", "", README, flags=re.DOTALL), re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    links = re.findall(r"\]\(#([^)]+)\)", README)
    assert links
    assert set(links) <= anchors


@pytest.mark.parametrize("file", ["README.md", "lidar/README.md", "analysis/README.md", "CONTRIBUTING.md"])
def test_links_and_pictures_are_there(file):
    for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / file).read_text(encoding="utf-8")):
        assert target.startswith("https://") or (ROOT / file).parent.joinpath(target).exists(), target
