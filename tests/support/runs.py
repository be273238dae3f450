"""Whole runs, for tests."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from platoontraffic import scenario, simulation
from platoontraffic.recording import run as run_into

# In the first corner of the loop: the leader turns on the spot, all followers go round. Two members, one corner.
ONE_CORNER = ("run.duration_s=70", "platoon.size=3")


def run(folder: Path, name: str | Path, *changes: str, seed: int | None = None, members=lambda m: m) -> Path:
    """Run a scenario into `folder`; `members` may change the tuple of deployed members."""
    prepared = simulation.prepare(scenario.load(name, changes, seed))
    return run_into(replace(prepared, members=members(prepared.members)), folder)


def forget_sizes(folder: Path) -> None:
    """As in results before version 0.4.5: tables that a test has changed are read, not refused as damaged."""
    file = folder / "datapackage.json"
    package = json.loads(file.read_text(encoding="utf-8"))
    for resource in package["resources"]:
        resource.pop("bytes", None)
    file.write_text(json.dumps(package), encoding="utf-8")
