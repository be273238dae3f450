"""Batches of short runs, for tests, and the processes of batches."""

from __future__ import annotations

import contextlib
import csv
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from typer.testing import CliRunner

from platoontraffic.cli.main import app

COMMAND = [sys.executable, "-m", "platoontraffic", "batch"]

TINY = """
base = "{base}"
replications = {replications}
[set]
run.duration_s = 0.5
platoon.size = 2
platoon.follower.lidar.noise = "utm30lx"
[grid]
platoon.follower.{key} = {values}
"""

# A law that executes the line `how` at one of its gains.
LAW = """
import os
import signal
import time
from dataclasses import dataclass

from platoontraffic import Decision, Twist, per_vehicle

@dataclass(frozen=True)
class Law:
    gain: float = 1.0

    @per_vehicle
    def __call__(self, sensed, memory, dt):
        if self.gain == 3.0:
            {how}
        return Decision(Twist(0.0, 0.0))
"""
DIES = "os.kill(os.getpid(), signal.SIGSEGV)"


def call(*arguments: object, within: Sequence[str] = (), **options) -> subprocess.CompletedProcess:
    """A batch that has ended; within: a command that executes another."""
    words = [*within, *COMMAND, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=600, **options)


def invoked(*arguments: object) -> subprocess.CompletedProcess:
    """The same, in this process: to start one takes seconds. Runs have their own processes, except with `serial`."""
    done = CliRunner().invoke(app, ["batch", *map(str, arguments)])
    return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)


def started(*arguments: object, within: Sequence[str] = ()) -> subprocess.Popen:
    words = [*within, *COMMAND, *map(str, arguments)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def tables(folder: Path) -> tuple[list[list[str]], bytes, bytes]:
    """Rows of runs.csv without their wall times; bytes of the other two tables."""
    with (folder / "runs.csv").open(newline="") as file:
        runs = [row[:-1] for row in csv.reader(file)]
    return runs, (folder / "summary.csv").read_bytes(), (folder / "datapackage.json").read_bytes()


def statuses(folder: Path) -> list[str]:
    return [row[1] for row in tables(folder)[0][1:]]


def done(folder: Path) -> dict[str, int]:
    return {file.parent.name: file.stat().st_mtime_ns for file in folder.glob("*/DONE")}


def until(true: Callable[[], object], deadline: float = 60) -> None:
    end = time.monotonic() + deadline
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    own = [child for child, parent in parents().items() if parent == pid]
    return [child for child in own if alive(child) and "platoontraffic.study.worker" in words_of(child)]


def parents() -> dict[int, int]:
    """The parent of each process. (`ps` is missing in small images.)"""
    found = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            found[int(file.parent.name)] = int(file.read_text().rpartition(")")[2].split()[1])
    return found


def words_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def workers_below(pid: int) -> list[int]:
    """Those below a process, at whatever depth."""
    parent_of = parents()
    below, found = {pid}, []
    while new := {child for child, parent in parent_of.items() if parent in below} - below:
        below |= new
        found += [child for child in new if "platoontraffic.study.worker" in words_of(child)]
    return found
