"""`run --branch-at`: what it refuses, and what it leaves."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from platoontraffic.branches.process import can_fork
from platoontraffic.cli import branches
from platoontraffic.cli.main import app

HEADWAY = "platoon.follower.time_headway_s=2"


def run(tmp_path: Path, *arguments: str):
    short = ["run.duration_s=4", "platoon.size=2", "--out", str(tmp_path)]
    return CliRunner().invoke(app, ["run", "corridor_tracking", *short, *arguments])


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["--then", HEADWAY], "--then: needs --branch-at"),
        (["--branch-at", "2"], "--branch-at: needs --then"),
        (["--branch-at", "2", "--then", "nonsense"], "--then 1: 'nonsense': must be key=value"),
        (["--branch-at", "2", "--then", HEADWAY, "--then", "platoon.size=3"], "--then 2: platoon.0.size: does not"),
        (
            ["--branch-at", "2", "--then", f"{HEADWAY}; {HEADWAY}"],
            f"--then 1: '{HEADWAY}': the same key as --then 1, '{HEADWAY}'; must be given once",
        ),
        (["--branch-at", "2.03", "--then", HEADWAY], "--branch-at: branch.at_s: 2.03: must be a multiple"),
        (["--branch-at", "9", "--then", HEADWAY], "--branch-at: branch.at_s: 9: must be before the end"),
        (["--branch-at", "2", "--then", "platoon.follower.law=sumo"], "law: SUMO drives it, or would"),
        (["--branch-at", "2", "--then", "platoon.follower.time_hedway_s=2"], "did you mean 'time_headway_s'?"),
        (["--branch-at", "2", "--then", HEADWAY, "--gui"], "--gui: not with --branch-at"),
        (["branch.at_s=1", f"branch.then.{HEADWAY}", "--branch-at", "2", "--then", HEADWAY], "has a branch at 1 s"),
    ],
)  # fmt: skip
def test_what_cannot_branch_is_said_in_a_line(arguments: list[str], fault: str, tmp_path: Path) -> None:
    done = run(tmp_path, *arguments)
    assert done.exit_code == 2
    assert fault in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.sumo
@pytest.mark.skipif(not can_fork, reason="this system cannot copy a process")
def test_branches_are_the_same_with_and_without_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = (
        "--branch-at",
        "2",
        "--then",
        HEADWAY,
        "--then",
        "platoon.follower.law=repaired; platoon.follower.lidar.noise=none",
    )
    copied = run(tmp_path / "copied", *arguments)
    assert copied.exit_code == 0, copied.stderr
    assert "gap_mean [m]" in copied.stdout  # the unit was taken for markup
    assert "…" not in copied.stdout
    monkeypatch.setattr(branches, "can_fork", False)
    whole = run(tmp_path / "whole", *arguments, "--json")
    assert whole.exit_code == 0, whole.stderr
    folders = [Path(one["folder"]) for one in json.loads(whole.stdout)["folders"]]
    assert [folder.name for folder in folders] == [Path(line).name for line in copied.stdout.splitlines()[-3:]]
    for folder in folders:
        for name in ("trajectories.csv", "events.csv", "metrics.csv", "summary.csv", "config.toml"):
            other = tmp_path / "copied" / "corridor_tracking" / folder.name / name
            assert (folder / name).read_bytes() == other.read_bytes()
    again = run(tmp_path / "copied", *arguments)
    assert "not repeated without --force" in again.stderr
