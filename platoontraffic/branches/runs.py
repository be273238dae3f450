"""A recorded run and its branches: one process until the branch, then a fork of it for each."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import wait
from pathlib import Path
from typing import NamedTuple

from platoontraffic import scenario as scenarios
from platoontraffic.branches.host import Say
from platoontraffic.branches.process import Process
from platoontraffic.errors import InputError, RunError
from platoontraffic.observation.instant import Instant
from platoontraffic.recording import Recording
from platoontraffic.results.recorder import UNFINISHED
from platoontraffic.scenario import Change, Scenario
from platoontraffic.simulation import prepare
from platoontraffic.world.prepared import branched

BEAT = 0.1  # least simulated time from one word on it to the next [s]


class Source(NamedTuple):
    """What a scenario is loaded from, as of `scenario.load`, in another process."""

    scenario: str
    changes: tuple[str, ...] = ()
    seed: int | None = None
    platoons: str | None = None
    for_replay: bool = False


class Branch(NamedTuple):
    """A run that goes on as another one at the branch."""

    changes: tuple[Change, ...]  # of the key `branch`
    folder: Path  # of its results


class Ended(NamedTuple):
    """How a run ended: its folder, or what it raised."""

    folder: Path
    error: Exception | None = None


def check_has_no_branch(scenario: Scenario) -> None:
    """raises: InputError if the scenario itself changes at a time: a run has one branch"""
    if branch := scenario.spec.branch:
        what = f"the scenario has a branch at {branch.at_s:g} s itself; must have none to be branched"
        raise InputError(scenario.fault(("branch",), what))


def run_branches(
    source: Source,
    folder: Path,
    at: float,
    branches: Sequence[Branch],
    slots: int,
    *,
    replace: bool = False,
    say: Callable[[str], None] = lambda text: None,
    reached: Callable[[float], None] = lambda simulated: None,
) -> list[Ended]:
    """Run a scenario once until a time [s], and from there on as it is and as each branch; how each of them ended.

    folder  : results of the run without a branch
    slots   : runs at a time
    replace : replace the results of equal runs
    say     : called with lines that the user should see
    reached : called with the simulated time of all processes together [s]

    raises: what the run raises before the branch; KeyboardInterrupt. What is recorded is kept as `Recording` says.
    """
    try:
        with ExitStack() as stack:
            trunk = stack.enter_context(_closed(Process.holding(_Recorded, source, folder, sys.argv[1:])))
            trunk.call("advance", at, heard=reached)
            runs, failed = [(trunk, folder)], []
            for one in branches:
                try:
                    runs.append((stack.enter_context(_closed(trunk.fork(*one))), one.folder))
                except (RunError, InputError) as error:
                    failed.append(Ended(one.folder, error))
            return [*_finished(runs, slots, replace, say, reached), *failed]
    except KeyboardInterrupt as error:
        for one in (folder, *(branch.folder for branch in branches)):
            if (kept := one.with_name(one.name + UNFINISHED)).exists():
                error.add_note(f"what was recorded until then is kept in {kept}")
        raise


@contextmanager
def _closed(process: Process) -> Iterator[Process]:
    try:
        yield process
    finally:
        process.close()


def _finished(
    runs: Sequence[tuple[Process, Path]],
    slots: int,
    replace: bool,
    say: Callable[[str], None],
    reached: Callable[[float], None],
) -> list[Ended]:
    """Let each process run to its end, some at a time; in the order of `runs`."""
    waiting, busy, ended = list(runs), {}, {}
    try:
        while waiting or busy:
            while waiting and len(busy) < slots:
                process, folder = waiting.pop(0)
                try:
                    process.send("finish", replace)
                    busy[process] = folder
                except RunError as error:
                    ended[folder] = Ended(folder, error)
            for process in wait(list(busy)):
                try:
                    kind, value = process.word()
                except RunError as error:
                    kind, value = "failed", error
                if kind == "said":
                    say(value) if isinstance(value, str) else reached(value)
                else:
                    folder = busy.pop(process)
                    ended[folder] = Ended(folder, value if kind == "failed" else None)
    except KeyboardInterrupt:
        for process in busy:
            process.interrupt()
        raise
    return [ended[folder] for _, folder in runs]


class _Recorded:
    """The run inside the process."""

    def __init__(self, source: Source, folder: Path, command_line: list[str]) -> None:
        sys.argv[1:] = command_line  # for the run's provenance
        scenario = scenarios.load(source.scenario, source.changes, source.seed, source.platoons, to_branch=True)
        self._prepared = prepare(scenario.for_replay() if source.for_replay else scenario)
        self._recording: Recording | None = Recording(self._prepared, folder, forkable=True)

    def advance(self, say: Say, until: float) -> None:
        self._recording.advance([_Beats(say)], until)

    def forked(self, changes: Sequence[Change], folder: Path) -> None:
        self._prepared = branched(self._prepared, self._prepared.scenario.branched(changes))
        self._recording.goes_on_as(self._prepared, folder)

    def finish(self, say: Say, replace: bool) -> None:
        recording, self._recording = self._recording, None
        recording.advance([_Beats(say)])
        recording.finish(replace, say)

    def close(self) -> None:
        if self._recording:
            self._recording.abandon()


class _Beats:
    """A watcher that says how much time has been simulated since its last word [s]."""

    def __init__(self, say: Say) -> None:
        self._say, self._said = say, None

    def show(self, instant: Instant) -> None:
        if self._said is None:
            self._said = instant.time
        if instant.ended or instant.time >= self._said + BEAT:
            self._say(instant.time - self._said)
            self._said = instant.time
