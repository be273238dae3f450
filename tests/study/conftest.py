from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from platoontraffic import shipped
from tests.support import bad_laws
from tests.support.batches import LAW, TINY
from tests.support.runs import run


@pytest.fixture
def tiny(tmp_path, compiled) -> Callable[..., Path]:
    """Writes a study of short runs; its base has followers with a law if one is given."""

    def write(gains: int = 2, replications: int = 2, how: str = "") -> Path:
        base, key = "paper_loop", "heading_gain_per_s"
        values = [float(gain) for gain in range(1, gains + 1)]
        if how:
            base, key = "base.toml", "gain"
            (tmp_path / "law.py").write_text(LAW.format(how=how))
            text = shipped.scenarios()["paper_loop"].read_text()
            (tmp_path / base).write_text(text.replace('law = "repaired"', 'law = "law:Law"'))
        text = TINY.format(base=base, replications=replications, key=key, values=values)
        (tmp_path / "tiny.toml").write_text(text)
        return tmp_path / "tiny.toml"

    return write


@pytest.fixture(scope="session")
def compiled(tmp_path_factory) -> None:
    """A run has compiled what runs of batches need; that would take long within limits of time, and run by run."""
    run(tmp_path_factory.mktemp("compiled") / "run", "paper_loop", "run.duration_s=0.5", "platoon.size=2")


@pytest.fixture
def bad(tmp_path, compiled) -> Callable[..., Path]:
    """Writes a study of short runs, each with one of these laws of `support.bad_laws`."""

    def write(*kinds: str, replications: int = 1) -> Path:
        shutil.copy(bad_laws.__file__, tmp_path)
        text = shipped.scenarios()["paper_loop"].read_text()
        (tmp_path / "base.toml").write_text(text.replace('law = "repaired"', 'law = "bad_laws:Bad"'))
        text = TINY.format(base="base.toml", replications=replications, key="kind", values=list(kinds))
        text = text.replace("[grid]", "[zip]") + f"platoon.follower.tag = {list(range(len(kinds)))}\n"
        (tmp_path / "bad.toml").write_text(text)
        return tmp_path / "bad.toml"

    return write


@pytest.fixture
def killed() -> Iterator[list[subprocess.Popen]]:
    """Processes that are killed at the end of the test."""
    processes: list[subprocess.Popen] = []
    yield processes
    for process in processes:
        process.kill()
        process.communicate()
