"""Draws the pictures of the manual again.

    python docs/draw_pictures.py                         # all but the slow ones: some minutes
    python docs/draw_pictures.py paper_loop what_holds   # these; --list says what there is

Runs are in results/ and are not repeated when they exist. Pictures of a browser need Chromium and playwright (extra
dev). `gui.png` is a photograph of the window of `platoontraffic run corridor_platoon --gui`, made by hand.
"""

from __future__ import annotations

import argparse
import base64
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
PICTURES = TOP / "docs" / "pictures"
PHONE = {"viewport": {"width": 390, "height": 780}, "device_scale_factor": 1.5, "is_mobile": True, "has_touch": True}


def python(*words: object) -> str:
    """What a Python program of the project prints."""
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, cwd=TOP, check=True, stdout=subprocess.PIPE, text=True).stdout


def run(scenario: str) -> Path:
    """The folder of a run with its replay."""
    return TOP / python("-m", "platoontraffic", "run", scenario, "--replay", "-q").splitlines()[-1]


def plotted(scenario: str) -> Callable[[Path], object]:
    return lambda to: python("-m", "platoontraffic", "plot", run(scenario), "--to", to)


def replayed(scenario: str, link: str, keys: str = "", **context) -> Callable[[Path], None]:
    """link: time and member; keys: that are pressed then."""

    def draw(to: Path) -> None:
        sys.path.insert(0, str(TOP))
        from tests.support.browser import chromium, until

        with chromium() as browser:
            tab = browser.new_context(**({"viewport": {"width": 1280, "height": 860}} | context)).new_page()
            tab.goto(f"{(run(scenario) / 'replay.html').as_uri()}#{link}")
            until(tab, "window.replay?.drawn")
            for key in keys.split():
                tab.keyboard.press(key)
            tab.wait_for_timeout(500)
            tab.screenshot(path=to)

    return draw


def benchmark(name: str) -> Callable[[Path], object]:
    return lambda to: python(f"tests/benchmarks/{name}.py", "--picture", to)


def first_example(to: Path) -> None:
    """The picture that the first example of the laser's page draws."""
    text = (TOP / "lidar" / "README.md").read_text(encoding="utf-8")
    example = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "example.py"
        file.write_text(f"import matplotlib\nmatplotlib.use('Agg')\n{example.replace('scan.png', str(to))}")
        python(file)


def of_notebook(name: str) -> Callable[[Path], object]:
    """The first picture among the outputs that a notebook has."""

    def draw(to: Path) -> None:
        cells = json.loads((TOP / "analysis" / "notebooks" / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
        shown = (output.get("data", {}) for cell in cells for output in cell.get("outputs", []))
        to.write_bytes(base64.b64decode(next("".join(data["image/png"]) for data in shown if "image/png" in data)))

    return draw


DRAWN = {
    "paper_loop": plotted("paper_loop"),
    "corridor_platoon": plotted("corridor_platoon"),
    "replay": replayed("corridor_platoon", "t=167.3&member=platoon.1"),
    "replay_phone": replayed("paper_loop", "t=60&member=robot.1", "Home", color_scheme="dark", **PHONE),
    "cut_in": replayed("corridor_cut_in", "t=9.6&member=platoon.2"),
    "lidar_scan": first_example,
    "penetration": of_notebook("6_penetration"),
}
SLOW = {name: benchmark(name) for name in ("paper_at_car_size", "what_holds", "what_sensors_hold")}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="pictures; default: all that take no long benchmark")
    parser.add_argument("--list", action="store_true", help="print the names, draw nothing")
    given = parser.parse_args()
    known = DRAWN | SLOW
    if unknown := set(given.names).difference(known):
        parser.error(f"no such picture: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    for name in given.names or (known if given.list else DRAWN):
        print(name, flush=True)
        if not given.list:
            known[name](PICTURES / f"{name}.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
