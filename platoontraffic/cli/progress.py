"""Progress bars on stderr, only if that is a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from platoontraffic.cli.printing import duration_text

if TYPE_CHECKING:
    from platoontraffic.run import Watcher
    from platoontraffic.simulation import Instant
    from platoontraffic.study import batch

REFRESH = 0.1  # shortest time between two updates of a bar [s]

err = Console(stderr=True, highlight=False)


class RunBar:
    """A watcher that shows the simulated time of a run as a bar."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar, self._task, self._updated = bar, task, 0.0

    def show(self, instant: Instant) -> None:
        now = time.monotonic()
        if now - self._updated > REFRESH:
            self._bar.update(self._task, completed=instant.time)
            self._updated = now


@contextmanager
def run_progress(duration: float, name: str, quiet: bool) -> Iterator[Sequence[Watcher]]:
    """The watchers of a run of at most `duration` simulated seconds; none if stderr is no terminal, or if quiet."""
    if quiet or not err.is_terminal:
        yield ()
        return
    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of at most {task.total:.0f} s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=err, transient=True) as bar:
        yield (RunBar(bar, bar.add_task(name, total=duration)),)


@contextmanager
def batch_progress(name: str, quiet: bool) -> Iterator[Callable[[batch.Progress], None]]:
    """A function that shows the progress of a batch; the time left is estimated from the runs that ended in it."""
    if quiet or not err.is_terminal:
        yield lambda progress: None
        return
    columns = [TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[status]}"), TimeElapsedColumn()]
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(name, total=None, status="the first runs have started")
        began = time.monotonic()

        def show(at: batch.Progress) -> None:
            ended = at.done + at.failed
            left = (time.monotonic() - began) / at.ended_now * (at.runs - ended)
            failed = f", {at.failed} failed" if at.failed else ""
            status = f"{ended} of {at.runs}{failed}, {duration_text(left)} left"
            bar.update(task, total=at.runs, completed=ended, status=status)

        yield show


def say(line: str) -> None:
    """A line on stderr, also under --quiet."""
    err.print(line, soft_wrap=True, markup=False)


def show_stage(stage: str) -> None:
    """Show the stage that a benchmark has reached, in place of the previous one."""
    if err.is_terminal:
        print(f"\r\x1b[K{stage}", end="", file=sys.stderr, flush=True)
