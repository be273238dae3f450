"""Print SHA-256 of the tables that eight shipped scenarios leave, to compare two checkouts byte for byte.

    .venv/bin/python tests/benchmarks/same_bytes.py [--write FILE | --against FILE]

`events` is the whole file, `events, no detail` that file without the column of prose. Run it in one checkout with
--write, in the other with --against: lines that differ from FILE are marked.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
RUNS = {
    "paper_loop": ["run.duration_s=70"],
    "lab_obstacles": ["run.duration_s=50"],
    "corridor_cut_in": [],
    "corridor_manoeuvres": ["run.duration_s=115"],
    "highway_merge": ["run.duration_s=20"],
    "highway_tracking": ["run.duration_s=20"],
    "bends_platoon": ["run.duration_s=30"],
    "ring_platoon": ["run.duration_s=30"],
}


def run(name: str, results: Path) -> Path:
    """Folder of a run by the package of this checkout, in a process of its own."""
    words = ["run", name, *RUNS[name], "--out", str(results), "-q"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "platoontraffic", *words]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return Path(done.stdout.splitlines()[-1])


def without_detail(events: bytes) -> bytes:
    rows = list(csv.reader(io.StringIO(events.decode(), newline="")))
    text = io.StringIO(newline="")
    kept = [column for column, name in enumerate(rows[0]) if name != "detail"]
    csv.writer(text).writerows([row[column] for column in kept] for row in rows)
    return text.getvalue().encode()


def sums(folder: Path) -> Iterator[tuple[str, str]]:
    events = (folder / "events.csv").read_bytes()
    for what, data in (
        ("trajectories", (folder / "trajectories.csv").read_bytes()),
        ("events", events),
        ("events, no detail", without_detail(events)),
        ("metrics", (folder / "metrics.csv").read_bytes()),
    ):
        yield what, hashlib.sha256(data).hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    files = parser.add_mutually_exclusive_group()
    files.add_argument("--write", type=Path, metavar="FILE")
    files.add_argument("--against", type=Path, metavar="FILE")
    given = parser.parse_args()
    before = json.loads(given.against.read_text(encoding="utf-8")) if given.against else None
    found = {}
    with tempfile.TemporaryDirectory() as results:
        for name in RUNS:
            for what, digest in sums(run(name, Path(results))):
                key = f"{name} {what}"
                found[key] = digest
                mark = "" if before is None or before.get(key) == digest else "  DIFFERS"
                print(f"{digest}  {key}{mark}", flush=True)
    if given.write:
        given.write.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
