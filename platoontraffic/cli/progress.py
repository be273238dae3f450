"""Progress bars on stderr, only if that is a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from platoontraffic.cli.printing import duration_text
from platoontraffic.errors import counted

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from platoontraffic.simulation import Instant
    from platoontraffic.study import batch
    from platoontraffic.study.silence import Silence

REFRESH = 0.1  # shortest time between two updates of a bar [s]

err = Console(stderr=True, highlight=False, markup=False)


class RunBar:
    """A watcher that shows the simulated time of a run as a bar."""

    def __init__(self, bar: Progress, name: str, duration: float) -> None:
        self._bar, self._name, self._updated = bar, name, 0.0
        self._task = bar.add_task(f"{name}: starts", total=duration)

    def show(self, instant: Instant) -> None:
        self.reach(instant.time)

    def reach(self, time_: float) -> None:
        """Show a simulated time [s]."""
        now = time.monotonic()
        if not self._updated:
            self._bar.update(self._task, description=self._name)
        if now - self._updated > REFRESH:
            self._bar.update(self._task, completed=time_)
            self._updated = now


@contextmanager
def run_progress(duration: float, name: str, quiet: bool) -> Iterator[Sequence[RunBar]]:
    """The watchers of a run of at most `duration` simulated seconds; none if stderr is no terminal, or if quiet."""
    if quiet or not err.is_terminal:
        yield ()
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of at most {task.total:.0f} s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=err, transient=True) as bar:
        yield (RunBar(bar, name, duration),)


class BatchLines:
    """A watcher of a batch that says on stderr which tables are replaced, and which runs make no progress."""

    def __init__(self) -> None:
        self._silent: dict[str, float] = {}  # runs without progress, and for how long [s]

    def progress(self, at: batch.Progress) -> None:
        pass

    def replaces_tables(self, folder: Path, lost: int) -> None:
        what = f"its tables have {counted(lost, 'run')} not of this study; the tables are replaced, no run is removed"
        say(f"{folder}: {what}")

    def silent(self, silence: Silence, laws: Sequence[str]) -> None:
        self._silent.pop(silence.id, None)
        if silence.seconds:
            self._silent[silence.id] = silence.seconds
            at = "its first step" if silence.simulated is None else f"a step after {silence.simulated:.1f} s simulated"
            what = f"no progress for {duration_text(silence.seconds)}: has not made {at}; laws: {', '.join(laws)}"
            err.print(f"{silence.id}: {what}", soft_wrap=True, markup=False)


class BatchBar(BatchLines):
    """The same with a bar; the time left is estimated from the runs that ended in this batch."""

    def __init__(self, bar: Progress, task: TaskID, runs: int) -> None:
        super().__init__()
        self._bar, self._task, self._began = bar, task, time.monotonic()
        self._status = f"0 of {runs}, the first have started"
        self._show()

    def progress(self, at: batch.Progress) -> None:
        ended = at.done + at.failed
        left = (time.monotonic() - self._began) / at.ended_now * (at.runs - ended)
        failed = f", {at.failed} failed" if at.failed else ""
        self._status = f"{ended} of {at.runs}{failed}, {duration_text(left)} left"
        self._bar.update(self._task, total=at.runs, completed=ended)
        self._show()

    def silent(self, silence: Silence, laws: Sequence[str]) -> None:
        super().silent(silence, laws)
        self._show()

    def _show(self) -> None:
        silent = [f"{run} ({duration_text(seconds)})" for run, seconds in self._silent.copy().items()]
        stuck = f"; no progress: {', '.join(silent)}" if silent else ""
        self._bar.update(self._task, status=self._status + stuck)


@contextmanager
def batch_progress(name: str, runs: int, quiet: bool) -> Iterator[BatchLines]:
    """The watcher of a batch of so many runs; with a bar unless stderr is no terminal, or quiet."""
    if quiet or not err.is_terminal:
        yield BatchLines()
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = [TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[status]}"), TimeElapsedColumn()]
    with Progress(*columns, console=err, transient=True) as bar:
        yield BatchBar(bar, bar.add_task(name, total=None, status=""), runs)


def say(line: str) -> None:
    """A line on stderr, also under --quiet."""
    err.print(line, soft_wrap=True, markup=False)


def say_when_compiling(quiet: bool) -> None:
    """A line on stderr when kernels are compiled, as they are once on a machine; none if that is no terminal, or if
    quiet."""
    if quiet or not err.is_terminal:
        return
    from platoontraffic.lidar.compiled import when_compiling

    when_compiling(lambda: say("compiling kernels, once on this machine: takes half a minute or more"))


def show_stage(stage: str) -> None:
    """Show the stage that a benchmark has reached, in place of the previous one."""
    if err.is_terminal:
        print(f"\r\x1b[K{stage}", end="", file=sys.stderr, flush=True)
