"""Print what a batch costs: over a loop in one process, and against one process; and what reading 1,000 runs costs.

    .venv/bin/python tests/benchmarks/batch.py [SECONDS]

SECONDS: of wall time that a run should take about, for the second; default 5. Nothing else should work meanwhile.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

from platoontraffic import scenario, simulation
from platoontraffic.analysis import load
from platoontraffic.recording import run as run_into
from platoontraffic.study import batch, study


def written(folder: Path, name: str, duration: float, runs: int) -> study.Study:
    text = f'base = "paper_loop"\nreplications = {runs}\n[set]\nrun.duration_s = {duration}\nplatoon.size = 5\n'
    (folder / f"{name}.toml").write_text(text)
    return study.load(folder / f"{name}.toml")


def timed(function, *arguments, **options) -> float:
    began = time.perf_counter()
    function(*arguments, **options)
    return time.perf_counter() - began


def in_a_loop(loaded: study.Study, folder: Path) -> None:
    for run in loaded.runs:
        prepared = simulation.prepare(scenario.load(run.base, run.changes, run.seed))
        run_into(prepared, folder / run.id)


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    try:
        warm = written(folder, "warm", 0.5, 2)
        in_a_loop(warm, folder / "warm")
        short = written(folder, "short", 0.5, 30)
        loop = timed(in_a_loop, short, folder / "loop") / 30
        own = timed(batch.run, short, folder / "short", slots=1) / 30
        print(f"overhead of a run: {own - loop:.3f} s (batch {own:.3f} s, loop in one process {loop:.3f} s)")

        one_second = timed(in_a_loop, written(folder, "second", 10.0, 1), folder / "second") / 10
        duration = round(float(sys.argv[1] if len(sys.argv) > 1 else 5) / one_second)
        long = written(folder, "long", float(duration), 8)
        one = timed(batch.run, long, folder / "one", slots=1)
        two = timed(batch.run, long, folder / "two", slots=2)
        print(f"8 runs of {one / 8:.1f} s: one process {one:.1f} s, two {two:.1f} s, {one / two:.2f} times as fast")

        thousand = written(folder, "thousand", 0.5, 1000)
        for run in thousand.runs:
            shutil.copytree(folder / "short" / short.runs[0].id, folder / "thousand" / run.id)
        (folder / "thousand" / "study.toml").write_text(thousand.text(folder / "thousand"))
        tables = timed(batch.run, thousand, folder / "thousand")
        reading = timed(load, folder / "thousand")
        metrics = timed(load(folder / "thousand").table, "metrics")
        trajectories = timed(load(folder / "thousand").table, "trajectories")
        print(f"1000 runs: a batch with nothing to do {tables:.2f} s, load {reading:.2f} s, "
              f"all metrics {metrics:.2f} s, all trajectories {trajectories:.2f} s")  # fmt: skip
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
