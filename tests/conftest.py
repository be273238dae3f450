from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from platoontraffic import scenario, simulation

# Shells start what they put into the background with SIGINT ignored, and that is inherited; tests send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# In the first corner of the loop: the leader turns on the spot, all followers go round. Two members, one corner.
ONE_CORNER = ("run.duration_s=70", "platoon.size=3")


def run(folder: Path, name: str | Path, *changes: str, seed: int | None = None, members=lambda m: m) -> Path:
    """Run a scenario into `folder`; `members` may change the tuple of deployed members."""
    prepared = simulation.prepare(scenario.load(name, changes, seed))
    return simulation.simulate(replace(prepared, members=members(prepared.members)), folder)


@pytest.fixture(scope="session")
def one_corner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of three robots through one corner."""
    return run(tmp_path_factory.mktemp("results") / "one_corner", "paper_loop", *ONE_CORNER)


@pytest.fixture
def scenario_file(tmp_path: Path) -> Callable[..., Path]:
    """Writes the paper's loop as a scenario file, with some text replaced."""

    def write(*replacements: tuple[str, str], name: str = "mine.toml") -> Path:
        from platoontraffic import data

        text = data.scenarios()["paper_loop"].read_text(encoding="utf-8")
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new, 1)
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        return file

    return write
