"""Runs of a batch that make no progress are named on stderr, and in the bar while it lasts."""

from __future__ import annotations

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
    with progress.batch_progress("study", quiet=True) as watcher:
        watcher.silent(Silence("a-s1", 60.0, None), LAWS)
        watcher.silent(Silence("a-s1", 0.0, 0.1), LAWS)
        watcher.silent(Silence("[b]-s1", 120.0, 12.34), LAWS)
    assert capsys.readouterr().err == (
        "a-s1: no progress for 60 s: has not made its first step; laws: reactive, mine:Law\n"
        "[b]-s1: no progress for 2 min: has not made a step after 12.3 s simulated; laws: reactive, mine:Law\n"
    )


def test_the_bar_names_runs_while_they_make_no_progress(terminal):
    with progress.batch_progress("study", quiet=False) as watcher:
        watcher.progress(Progress(4, 0, 1, 0, 1))
        watcher.silent(Silence("a-s1", 60.0, 12.34), LAWS)
        watcher._bar.refresh()
        assert "1 of 4, 0 s left; no progress: a-s1 (60 s)" in terminal.getvalue()
        terminal.truncate(0)
        watcher.silent(Silence("a-s1", 0.0, 12.5), LAWS)
        watcher._bar.refresh()
        assert "no progress" not in terminal.getvalue()
