"""A batch: the missing runs of a study, many at a time, in worker processes.

The folder alone holds the state of the runs: done, failed or waiting. A batch can therefore be killed at any moment and
started again: the folder of a run is complete or absent, and a worker process that dies costs only its present run.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import NamedTuple, Protocol

from platoontraffic.branches.process import can_fork
from platoontraffic.errors import InputError, RunError, kind_of
from platoontraffic.results.recorder import UNFINISHED, is_done
from platoontraffic.results.reseeded import copy_with_seed
from platoontraffic.study.batch_folder import (
    DONE,
    FAILED,
    LOCK,
    PATIENCE,
    WAITING,
    claimed,
    failure,
    note_failure,
    read_json,
    state,
    tidy,
)
from platoontraffic.study.executors import Submit, executor_of, undisturbed
from platoontraffic.study.folder_lock import Lock
from platoontraffic.study.process_tree import PROC
from platoontraffic.study.silence import Job, Outcome, Silence
from platoontraffic.study.study import Run, Study
from platoontraffic.study.tables import lost_rows, write_tables

# Rough time of a run, of a step, and of a member in a step [s]; only for estimates. Runs of ten shipped studies,
# three of them in traffic on a highway, take 0.5 to 1.6 times the CPU time that these give.
RUN_COST, STEP_COST, MEMBER_COST = 0.2, 3e-4, 1e-4

TABLES_PERIOD = 60.0  # interval at which the tables are rewritten while the batch runs [s]
TABLES_SHARE = 1 / 20  # greatest share of the batch's time that writing them takes
FINAL_PATIENCE = 3600.0  # longest wait at the end for shards that write the tables [s]


class Shard(NamedTuple):
    """Part number `number` of `of` parts, counted from 1."""

    number: int = 1
    of: int = 1


class Progress(NamedTuple):
    """Numbers of runs of a batch, or of its shard."""

    runs: int
    earlier: int  # done before the batch began
    done: int  # including the earlier ones
    failed: int
    ended_now: int  # done or failed since the batch began


class Limits(NamedTuple):
    """What a run may take; None: anything. A run that takes more is stopped, and fails."""

    timeout: float | None = None  # wall time [s]
    memory: float | None = None  # of the run's process and all that it has started [MB]


class Watcher(Protocol):
    """Something that shows a batch while it lasts."""

    def progress(self, at: Progress) -> None:
        """Called after each run."""

    def replaces_tables(self, folder: Path, lost: int) -> None:
        """Called before the first run if the tables in the folder have so many runs that are not of this study."""

    def silent(self, silence: Silence, laws: Sequence[str]) -> None:
        """Called from any thread when a run makes no progress, and when it does so again or has ended."""


@dataclass(frozen=True)
class Report:
    """The outcome of a batch."""

    progress: Progress
    failures: dict[str, str]  # id -> error


def run(
    study: Study,
    folder: Path,
    executor: str = "processes",
    slots: int = 1,
    shard: Shard | None = None,
    retry_failed: bool = False,
    limits: Limits | None = None,
    watcher: Watcher | None = None,
) -> Report:
    """Run the missing runs of a study; all runs and their tables are then in `folder`.

    executor     : "processes"; "serial", in this process; "dask", a cluster for this batch; "dask:ADDRESS", a running
                   cluster
    slots        : runs at a time; a running cluster decides itself
    retry_failed : repeat failed runs
    limits       : of each run; not for "serial", which cannot stop a run

    raises: InputError, MissingError, RunError, KeyboardInterrupt; finished runs are kept in all cases
    """
    limits = limits or Limits()
    _check_limits(limits, executor)
    laws = {run.id: run.laws for run in study.runs}

    def say(silence: Silence) -> None:
        if watcher and silence.id in laws:
            watcher.silent(silence, laws[silence.id])

    block, mine = study.block(*(shard or Shard())), part_of(study, shard or Shard())
    chosen = {run.id for run in mine}
    with _one_line(folder), claimed(study, folder, block) as lock:
        if watcher and (lost := lost_rows(study, folder)):
            watcher.replaces_tables(folder, lost)
        before = {run.id: state(folder, run.id) for run in mine}
        to_do = [run for run in mine if before[run.id] in wanted(retry_failed)]
        counts = Counter(before.values())
        if retry_failed:
            del counts[FAILED]
        earlier, ended = counts[DONE], 0
        tidy(folder, lock, chosen, ".partial")
        tidy(folder, lock, {run.id for run in to_do}, UNFINISHED)
        with (
            _left_in_order(study, folder, lock, mine),
            executor_of(executor if to_do else "serial", slots, say) as where,
        ):
            write = _now_and_then(study, folder, lock)
            simulated = without_equals(study, folder, to_do)
            ids = {run.id for run in simulated}
            shares = shared_warm_ups(simulated, executor)
            jobs = (_job(run, folder, limits, shares) for run in _in_order(simulated, shares, slots))
            equals = [run for run in to_do if run.id not in ids]
            rest = (_job(run, folder, limits, {}) for run in equals if not is_done(folder / run.id))
            for new in chain(
                _ended(jobs, folder, *where), _copied(study, folder, equals), _ended(rest, folder, *where)
            ):
                counts[new] += 1
                ended += 1
                if watcher:
                    watcher.progress(Progress(len(mine), earlier, counts[DONE], counts[FAILED], ended))
                write()
        states = {run.id: state(folder, run.id) for run in mine}
        failures = {run_id: failure(folder, run_id)["error"] for run_id, at in states.items() if at == FAILED}
    done = sum(at == DONE for at in states.values())
    return Report(Progress(len(mine), earlier, done, len(failures), ended), failures)


def part_of(study: Study, shard: Shard) -> list[Run]:
    """The runs of a shard, in the order of the study."""
    block = study.block(*shard)
    chosen = {run.id for run in study.shuffled()[block.start : block.stop]}
    return [run for run in study.runs if run.id in chosen]


def wanted(retry_failed: bool) -> tuple[str, ...]:
    """States of the runs that a batch runs."""
    return (WAITING, FAILED) if retry_failed else (WAITING,)


def estimate(study: Study, folder: Path, runs: Sequence[Run]) -> tuple[float, str]:
    """Time of all runs, one after another [s], and the basis of the estimate."""
    done = [run for run in study.runs if is_done(folder / run.id)]
    if done:
        spent = sum(read_json(folder / run.id / "provenance.json")["wall_s"] for run in done)
        per_step = spent / sum(run.steps for run in done)
        return sum(RUN_COST + per_step * run.steps for run in runs), f"from the {len(done)} finished runs"
    cost = sum(RUN_COST + run.steps * (STEP_COST + MEMBER_COST * run.members) for run in runs)
    return cost, "rough, without background traffic"


def without_equals(study: Study, folder: Path, to_do: Sequence[Run]) -> list[Run]:
    """The runs to simulate: of runs that can differ in nothing but the seed one, or none if one of them is done."""
    points = {run.point for run in study.runs if not run.random and is_done(folder / run.id)}
    simulated = []
    for run in to_do:
        if run.random or run.point not in points:
            simulated.append(run)
            points.add(run.point)
    return simulated


def _copied(study: Study, folder: Path, runs: Sequence[Run]) -> Iterator[str]:
    """Give each run the results of an equal one; yields DONE for each. Runs without a finished equal are left."""
    done = {run.point: folder / run.id for run in study.runs if not run.random and is_done(folder / run.id)}
    for run in runs:
        if run.point in done and not os.path.lexists(folder / run.id):
            copy_with_seed(done[run.point], folder / run.id, run.seed)
            yield DONE


def shared_warm_ups(to_do: Sequence[Run], executor: str) -> dict[str, list[Run]]:
    """The runs that share a warm-up with others, by its id: it is simulated once, and copied for each of them."""
    shares: dict[str, list[Run]] = {}
    for run in to_do if can_fork and executor == "processes" else ():
        if run.warm_up:
            shares.setdefault(run.warm_up, []).append(run)
    return {warm_up: runs for warm_up, runs in shares.items() if len(runs) > 1}


def _in_order(to_do: Sequence[Run], shares: Mapping[str, Sequence[Run]], slots: int) -> list[Run]:
    """As many warm-ups at a time as runs: no run waits for a warm-up while another one could begin."""
    groups = list(shares.values())
    taken = [zip_longest(*groups[i : i + slots]) for i in range(0, len(groups), slots)]
    return [run for rows in taken for row in rows for run in row if run] + [
        run for run in to_do if run.warm_up not in shares
    ]


def _check_limits(limits: Limits, executor: str) -> None:
    """raises: InputError if they cannot be kept"""
    for name, limit in zip(("--timeout", "--memory"), limits, strict=True):
        if limit is not None and not 0 < limit < math.inf:
            raise InputError(f"{name}: {limit:g}: must be positive and finite")
        if limit is not None and executor == "serial":
            raise InputError(f"{name}: not with the executor serial, which cannot stop a run; -j 1 runs one at a time")
    if limits.memory is not None and not (PROC / "self" / "status").is_file():
        raise InputError("--memory: not on this system: memory is read from /proc, as Linux has it")


def _ended(to_do: Iterable[Job], folder: Path, submit: Submit, window: int) -> Iterator[str]:
    """Execute jobs; yields the state of each when it ends. window: number of runs that are submitted at a time"""
    to_come = iter(to_do)
    running: dict[Future[Outcome], str] = {}
    while True:
        for job in islice(to_come, window - len(running)):
            running[submit(job)] = job["id"]
        if not running:
            return
        # Without a timeout Ctrl-C has no effect on Windows until a run ends.
        for future in wait(running, timeout=1.0, return_when=FIRST_COMPLETED).done:
            run_id, outcome = running.pop(future), _outcome(future)
            if outcome.get("stop"):
                raise (RunError if outcome["disk"] else InputError)(outcome["error"])
            if "error" in outcome and not is_done(folder / run_id):  # it may finish while its process is stopped
                note_failure(folder, run_id, outcome)
            yield state(folder, run_id)


def _job(run: Run, folder: Path, limits: Limits, shares: Mapping[str, Sequence[Run]]) -> Job:
    together = shares.get(run.warm_up)
    return {
        "base": run.base,
        "changes": [list(change) for change in run.changes],
        "seed": run.seed,
        "id": run.id,
        "folder": str((folder / run.id).resolve()),
        "lock": str((folder / LOCK).resolve()),
        "command_line": sys.argv[1:],
        "timeout_s": limits.timeout,
        "memory_mb": limits.memory,
        "warm_up": {"key": run.warm_up, "runs": len(together)} if together else None,
    }


def _outcome(future: Future[Outcome]) -> Outcome:
    """The outcome of a run that ended. raises: RunError if the executor failed, not the run"""
    try:
        return future.result()
    except RunError:
        raise
    except CancelledError:
        raise RunError("the dask scheduler is gone") from None
    except Exception as error:
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        if type(error).__name__ == "KilledWorker":  # the run killed several workers of dask
            return {"error": what, "traceback": "", "wall_s": 0.0}
        raise RunError(what) from error


def _now_and_then(study: Study, folder: Path, lock: Lock) -> Callable[[], None]:
    """A function that writes the tables if the last time was long enough ago."""
    due = time.monotonic()  # the first ones at once, for a report of a batch that goes on

    def write() -> None:
        nonlocal due
        began = time.monotonic()
        if began >= due:
            write_tables(study, folder, lock, patience=0)
            due = time.monotonic() + max(TABLES_PERIOD, (time.monotonic() - began) / TABLES_SHARE)

    return write


@contextlib.contextmanager
def _left_in_order(study: Study, folder: Path, lock: Lock, mine: Sequence[Run]) -> Iterator[None]:
    """However the batch ends, remove leftovers from its folder and write the tables of the finished runs."""
    ids = {run.id for run in mine}
    try:
        yield
    except BaseException as error:
        with undisturbed(), contextlib.suppress(OSError, InputError):  # the first error is the one to report
            tidy(folder, lock, ids, ".partial")
            write_tables(study, folder, lock, PATIENCE)
        there = sum(is_done(folder / run.id) for run in mine)  # some may have ended since the last look
        error.add_note(f"{there} of {len(mine)} runs are done; started again, the batch goes on from there")
        raise
    tidy(folder, lock, ids, ".partial")
    write_tables(study, folder, lock, FINAL_PATIENCE)


@contextlib.contextmanager
def _one_line(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise kind_of(error)(f"{error.filename or folder}: {error.strerror or error}") from error
