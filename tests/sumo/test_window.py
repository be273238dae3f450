"""A run in sumo-gui leaves the same files as one without; a closed window or a dead sumo-gui ends it properly."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from itertools import count
from math import inf
from pathlib import Path

import pytest
from typer.testing import CliRunner

from platoontraffic import scenario, simulation
from platoontraffic.cli.main import app
from platoontraffic.errors import RunError
from platoontraffic.recording import run as run_into
from platoontraffic.sumo.window import Window

SHORT = ("run.duration_s=4", "sumo.warm_up_s=60", "record.scans_every_s=0.5", "record.traffic_every_s=0.5")
MOVES = {"provenance.json"}  # has wall times

needs_xvfb = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs Xvfb: apt install xvfb")


@pytest.fixture
def display(monkeypatch) -> Iterator[str]:
    """A display without a screen."""
    pytest.importorskip("sumo", reason="sumo-gui comes with eclipse-sumo: pip install platoontraffic[gui]")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x800x24"], pass_fds=[write], stderr=subprocess.DEVNULL
    )
    os.close(write)
    with os.fdopen(read) as answer:
        name = f":{answer.readline().strip()}"
    monkeypatch.setenv("DISPLAY", name)
    yield name
    server.terminate()
    server.wait()


def watched(folder: Path, name: str, *changes: str, pace: float = inf) -> Path:
    prepared = simulation.prepare(scenario.load(name, changes))
    window = Window(prepared.members, prepared.scene.solids, pace)
    return run_into(prepared, folder, window=window)


def after_steps(n: int, act: Callable[[Window], None], monkeypatch) -> None:
    shown, steps = Window.show, count()

    def show(self, *arguments) -> None:
        shown(self, *arguments)
        if next(steps) == n:
            act(self)

    monkeypatch.setattr(Window, "show", show)


def close_window(window: Window) -> None:
    """Closes the window by its keyboard shortcut: without a window manager it has no button."""
    names = subprocess.run(["xdotool", "search", "--name", "SUMO"], capture_output=True, text=True).stdout
    for number in names.split():
        subprocess.run(["xdotool", "windowfocus", number, "key", "ctrl+q"], capture_output=True)


@pytest.mark.slow
@pytest.mark.sumo
@needs_xvfb
@pytest.mark.parametrize(
    ("name", "changes"),
    [("corridor_platoon", SHORT), ("paper_loop", ("run.duration_s=5",)), ("ring_platoon", ("run.duration_s=5",))],
)
def test_files_are_the_same_with_a_window_and_without(name, changes, display, tmp_path):
    shown = watched(tmp_path / "shown", name, *changes)
    hidden = run_into(simulation.prepare(scenario.load(name, changes)), tmp_path / "hidden")
    files = {file.name for file in hidden.iterdir()} - MOVES
    assert {file.name for file in shown.iterdir()} - MOVES == files
    for file in sorted(files):
        assert (shown / file).read_bytes() == (hidden / file).read_bytes(), file


@pytest.mark.slow
@pytest.mark.sumo
@needs_xvfb
def test_a_window_shows_each_step_for_its_simulated_time(display, tmp_path):
    watched(tmp_path / "warm", "paper_loop", "run.duration_s=1")
    begun = time.monotonic()
    watched(tmp_path / "run", "paper_loop", "run.duration_s=3", pace=1.0)
    assert time.monotonic() - begun >= 3.0


@pytest.mark.slow
@pytest.mark.sumo
@needs_xvfb
@pytest.mark.skipif(shutil.which("xdotool") is None, reason="needs xdotool: apt install xdotool")
def test_a_closed_window_interrupts_the_run_and_keeps_its_results(display, tmp_path, monkeypatch):
    after_steps(60, close_window, monkeypatch)
    arguments = ["run", "paper_loop", "run.duration_s=30", "--gui", "-q", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 130
    assert done.stderr.startswith("the window was closed\n")
    (kept,) = (tmp_path / "paper_loop").iterdir()
    assert kept.name.endswith(".unfinished")
    assert (kept / "trajectories.csv").read_text().count("\n") > 5


@pytest.mark.slow
@pytest.mark.sumo
@needs_xvfb
def test_a_sumo_gui_that_dies_is_an_error(display, tmp_path, monkeypatch):
    after_steps(20, lambda window: window._process.kill(), monkeypatch)
    with pytest.raises(RunError, match="SUMO failed"):
        watched(tmp_path / "run", "paper_loop", "run.duration_s=60")


@pytest.mark.slow
@pytest.mark.sumo
@needs_xvfb
def test_input_that_sumo_refuses_is_reported_in_its_words(display, tmp_path):
    routes = tmp_path / "x.rou.xml"
    routes.write_text('<routes><vehicle id="a" depart="0"><route edges="nope"/></vehicle></routes>')
    arguments = ["run", "paper_loop", f'sumo.routes=["{routes}"]', "--gui", "--out", str(tmp_path / "results")]
    done = CliRunner().invoke(app, arguments)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "edge 'nope'" in done.stderr
    assert not (tmp_path / "results").exists()


def test_a_window_without_eclipse_sumo_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    done = CliRunner().invoke(app, ["run", "paper_loop", "--gui", "--out", str(tmp_path / "results")])
    assert (done.exit_code, done.stderr.count("\n")) == (3, 1)
    assert "pip install platoontraffic[gui]" in done.stderr
    assert not (tmp_path / "results").exists()


def test_a_window_without_a_display_is_an_error(monkeypatch, tmp_path):
    pytest.importorskip("sumo", reason="sumo-gui comes with eclipse-sumo: pip install platoontraffic[gui]")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    done = CliRunner().invoke(app, ["run", "paper_loop", "--gui", "--out", str(tmp_path / "results")])
    assert (done.exit_code, done.stderr.count("\n")) == (3, 1)
    assert "needs a display" in done.stderr


@pytest.mark.sumo
@needs_xvfb  # a machine without an X server's library cannot start sumo-gui
def test_a_window_on_a_display_that_does_not_exist_is_an_error(monkeypatch, tmp_path):
    pytest.importorskip("sumo", reason="sumo-gui comes with eclipse-sumo: pip install platoontraffic[gui]")
    monkeypatch.setenv("DISPLAY", ":987")
    done = CliRunner().invoke(app, ["run", "paper_loop", "--gui", "--out", str(tmp_path / "results")])
    assert (done.exit_code, done.stderr.count("\n")) == (3, 1)
    assert "there is none at :987" in done.stderr
    assert list((tmp_path / "results").rglob("*")) == []
