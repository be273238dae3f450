"""Runs of a batch that make no progress are named on stderr, and in the bar while it lasts."""

from __future__ import annotations

import importlib.util
from io import StringIO

import pytest
from rich.console import Console

from platoontraffic.cli import progress
from platoontraffic.study.batch import Progress
from platoontraffic.study.silence import Silence

LAWS = ("reactive", "mine:Law")


@pytest.fixture
def terminal(monkeypatch) -> StringIO:
    text = StringIO()
    console = Console(file=text, force_terminal=True, color_system=None, width=200, highlight=False)
    monkeypatch.setattr(progress, "err", console)
    return text


def test_a_run_without_progress_is_a_line_on_stderr_even_if_quiet(capsys):
    with progress.batch_progress("study", 3, quiet=True) as watcher:
        watcher.silent(Silence("a-s1", 60.0, None), LAWS)
        watcher.silent(Silence("a-s1", 0.0, 0.1), LAWS)
        watcher.silent(Silence("[b]-s1", 120.0, 12.34), LAWS)
    assert capsys.readouterr().err == (
        "a-s1: no progress for 60 s: has not made its first step; laws: reactive, mine:Law\n"
        "[b]-s1: no progress for 2 min: has not made a step after 12.3 s simulated; laws: reactive, mine:Law\n"
    )


def test_the_bar_names_runs_while_they_make_no_progress(terminal):
    with progress.batch_progress("study", 3, quiet=False) as watcher:
        watcher.progress(Progress(4, 0, 1, 0, 1))
        watcher.silent(Silence("a-s1", 60.0, 12.34), LAWS)
        watcher._bar.refresh()
        assert "1 of 4, 0 s left; no progress: a-s1 (60 s)" in terminal.getvalue()
        terminal.truncate(0)
        watcher.silent(Silence("a-s1", 0.0, 12.5), LAWS)
        watcher._bar.refresh()
        assert "no progress" not in terminal.getvalue()


KERNELS = """
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def half(x):
    return x / 2


@compiled
def double(x):
    return 2 * x
"""


def test_a_line_says_that_kernels_are_compiled_but_not_where_they_are_kept(terminal, tmp_path):
    file = tmp_path / "kernels.py"
    file.write_text(KERNELS, encoding="utf-8")

    def told() -> str:
        terminal.truncate(0)
        progress.say_when_compiling(quiet=False)
        spec = importlib.util.spec_from_file_location("kernels", file)
        kernels = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(kernels)
        assert kernels.half(3.0) + kernels.double(3.0) == 7.5
        return terminal.getvalue().strip("\0")

    assert told() == "compiling kernels, once on this machine: takes half a minute or more\n"
    assert told() == ""


def test_nobody_is_told_of_compilation_if_quiet(terminal, monkeypatch):
    monkeypatch.setattr("platoontraffic.lidar.compiled.when_compiling", lambda tell: tell())
    progress.say_when_compiling(quiet=True)
    assert terminal.getvalue() == ""
