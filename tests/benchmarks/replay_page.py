"""What a replay weighs and costs: `python tests/benchmarks/replay_page.py`; frames need Chromium and playwright."""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
from platoontraffic.replay import page
from tests.support.browser import chromium, until
from tests.support.made_runs import made_run

CASES = {
    "5 min, 150 vehicles, 5 lidars": {"members": 5, "others": 145, "seconds": 300.0, "scans_every": 0.3},
    "10 min, 500 vehicles, 5 lidars": {"members": 5, "others": 495, "seconds": 600.0, "scans_every": 0.5},
    "1 min, 1,000 vehicles": {"members": 5, "others": 995, "seconds": 60.0},
}


def frames(file: Path) -> tuple[float, int]:
    """Frames a second while playing, and vehicles on the map, the whole road in view."""
    with chromium() as browser:
        tab = browser.new_page(viewport={"width": 1440, "height": 900})
        tab.goto(file.as_uri())
        until(tab, "window.replay?.drawn")
        tab.keyboard.press("0")
        tab.keyboard.press("Space")
        tab.wait_for_timeout(500)
        before, began = tab.evaluate("[replay.frames, performance.now()]")
        tab.wait_for_timeout(5000)
        after, ended, drawn = tab.evaluate("[replay.frames, performance.now(), replay.drawn]")
        return (after - before) / (ended - began) * 1000, drawn["traffic"] + sum(m["seen"] for m in drawn["members"])


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, case in CASES.items():
            run = made_run(Path(folder) / name, **case)
            began, cpu = time.perf_counter(), time.process_time()
            file = page(run, run / "replay.html")
            took = f"{time.perf_counter() - began:.1f} s ({time.process_time() - cpu:.1f} s of CPU)"
            rate, seen = frames(file)
            print(
                f"{name}: {file.stat().st_size / 1e6:.2f} MB, made in {took}; {rate:.0f} frames/s with {seen} in view"
            )
    print(f"at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
