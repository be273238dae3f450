"""Whole runs, for tests."""

from __future__ import annotations

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
