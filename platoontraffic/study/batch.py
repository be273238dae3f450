"""A batch: the runs of a study that are not there yet, many at a time, each in a process of its own.

What is done, failed or waiting is said by the folder alone, so that a batch may be killed at any moment and started
again: a run's folder is there whole or not at all, and a process that dies in a run costs only that run.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from platoontraffic.errors import InputError, MissingError, RunError
from platoontraffic.results.metrics import column
from platoontraffic.results.recorder import UNFINISHED, as_json, is_done
from platoontraffic.scenario import Spec
from platoontraffic.study.folder_lock import SHARES, TABLES, Lock, share_of
from platoontraffic.study.study import Run, Study

STUDY, LOCK = "study.toml", ".lock"
FAILURE = "failure.json"  # in RUN.unfinished: what the run failed of
DONE, FAILED, WAITING = "done", "failed", "waiting"

# What a run, a step and a member in a step cost about [s]; only for an estimate.
A_RUN, A_STEP, A_MEMBER = 0.2, 4e-4, 2.5e-4

PATIENCE = 5.0  # so long is waited for another batch that begins or writes its tables [s]
TABLES_EVERY = 60.0  # for those who look at them meanwhile [s]
FEW_AT_ONCE = 256  # runs that a dask scheduler is given at a time

# A simulation has one thread; further ones of its libraries would only compete with the processes beside it.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

Job = dict[str, Any]  # what `worker.attempt` takes
Outcome = dict[str, Any]  # and what it returns
Submit = Callable[[Job], "Future[Outcome]"]


class Shard(NamedTuple):
    """Part `number`, counted from 1, of `of`."""

    number: int = 1
    of: int = 1


class Progress(NamedTuple):
    """How far a batch, or its shard, is."""

    runs: int
    earlier: int  # done before it began
    done: int  # these among them
    failed: int
    ended_now: int  # done or failed since it began


@dataclass(frozen=True)
class Report:
    """What a batch came to."""

    progress: Progress
    failures: dict[str, str]  # id -> error


def run(
    study: Study,
    folder: Path,
    executor: str = "processes",
    slots: int = 1,
    shard: Shard | None = None,
    retry_failed: bool = False,
    tell: Callable[[Progress], None] = lambda progress: None,
) -> Report:
    """Do what is to be done of a study; leaves its runs and their tables in `folder`.

    executor : "processes"; "serial", in this one; "dask", a cluster for this batch; "dask:ADDRESS", one that runs
    slots    : runs at a time, where no running cluster decides

    raises: InputError, MissingError, RunError, KeyboardInterrupt; whatever it is, runs that are done are kept
    """
    block = study.block(*(shard or Shard(1, 1)))
    chosen = {run.id for run in study.shuffled()[block.start : block.stop]}
    mine = [run for run in study.runs if run.id in chosen]
    with _one_line(folder), _claimed(study, folder, block) as lock:
        states = {run.id: state(folder, run.id) for run in mine}
        counts = Counter(states.values())
        earlier, ended = counts[DONE], 0
        wanted = (WAITING, FAILED) if retry_failed else (WAITING,)
        to_do = [run for run in mine if states[run.id] in wanted]
        if retry_failed:
            del counts[FAILED]
        _tidy(folder, lock, chosen, ".partial")
        _tidy(folder, lock, {run.id for run in to_do}, UNFINISHED)
        due = time.monotonic() + TABLES_EVERY
        try:
            with _executor(executor if to_do else "serial", slots) as (submit, window):
                for new in _driven(to_do, folder, submit, window):
                    counts[new] += 1
                    ended += 1
                    tell(Progress(len(mine), earlier, counts[DONE], counts[FAILED], ended))
                    if time.monotonic() > due:
                        began = time.monotonic()
                        write_tables(study, folder, lock, patience=0)
                        due = time.monotonic() + max(TABLES_EVERY, 20 * (time.monotonic() - began))
        except BaseException as error:
            with _undisturbed(), contextlib.suppress(OSError, InputError):  # the first trouble is the one to tell
                _tidy(folder, lock, chosen, ".partial")
                write_tables(study, folder, lock, PATIENCE)
            there = sum(is_done(folder / run.id) for run in mine)  # some perhaps since it was looked
            error.add_note(f"{there} of {len(mine)} runs are done; started again, the batch goes on from there")
            raise
        _tidy(folder, lock, chosen, ".partial")
        write_tables(study, folder, lock, patience=3600)
        failures = {run.id: failure(folder, run.id)["error"] for run in mine if state(folder, run.id) == FAILED}
    return Report(Progress(len(mine), earlier, counts[DONE], len(failures), ended), failures)


def state(folder: Path, run_id: str) -> str:
    """DONE, FAILED or WAITING."""
    if is_done(folder / run_id):
        return DONE
    return FAILED if (folder / (run_id + UNFINISHED) / FAILURE).is_file() else WAITING


def failure(folder: Path, run_id: str) -> dict[str, Any]:
    """error (one line), traceback, wall_s"""
    return _read_json(folder / (run_id + UNFINISHED) / FAILURE)


def estimate(study: Study, folder: Path, runs: Sequence[Run]) -> tuple[float, str]:
    """Time that runs take one after the other [s], and what that is judged by."""
    done = [run for run in study.runs if is_done(folder / run.id)]
    if done:
        spent = sum(_read_json(folder / run.id / "provenance.json")["wall_s"] for run in done)
        per_step = spent / sum(run.steps for run in done)
        return sum(A_RUN + per_step * run.steps for run in runs), f"by the {len(done)} runs that are done"
    return sum(A_RUN + run.steps * (A_STEP + A_MEMBER * run.members) for run in runs), "roughly, without SUMO's traffic"


def _driven(to_do: list[Run], folder: Path, submit: Submit, window: int) -> Iterator[str]:
    """Do the runs; yields DONE or FAILED as one after the other ends."""
    to_come = iter(to_do)
    running: dict[Future[Outcome], Run] = {}
    while True:
        for run in islice(to_come, window - len(running)):
            job = {
                "base": run.base,
                "changes": [list(change) for change in run.changes],
                "seed": run.seed,
                "id": run.id,
                "folder": str((folder / run.id).resolve()),
                "lock": str((folder / LOCK).resolve()),
                "command_line": sys.argv[1:],
            }
            running[submit(job)] = run
        if not running:
            return
        # Without a timeout Ctrl-C would have to wait on Windows.
        for future in wait(running, timeout=1.0, return_when=FIRST_COMPLETED).done:
            run, outcome = running.pop(future), _outcome(future)
            if outcome.get("stop"):
                raise InputError(outcome["error"])
            if "error" in outcome:
                _note_failure(folder, run.id, outcome)
            yield FAILED if "error" in outcome else DONE


def _outcome(future: Future[Outcome]) -> Outcome:
    """raises: RunError if it is not the run that failed, but what was to run it"""
    try:
        return future.result()
    except RunError:
        raise
    except CancelledError:
        raise RunError("the dask scheduler has gone") from None
    except Exception as error:
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        if type(error).__name__ == "KilledWorker":  # dask tried it on several workers, and all of them died
            return {"error": what, "traceback": "", "wall_s": 0.0}
        raise RunError(what) from error


def _note_failure(folder: Path, run_id: str, outcome: Outcome) -> None:
    """Beside what the run recorded, which is left in its folder to be looked at."""
    kept = folder / (run_id + UNFINISHED)
    if not kept.exists():
        for partial in folder.glob(f"{run_id}.*.partial"):  # of a process that died
            partial.replace(kept)
            break
    kept.mkdir(exist_ok=True)
    with _replacing(kept / FAILURE) as file:
        file.write(as_json(outcome))


def _tidy(folder: Path, lock: Lock, ids: Collection[str], suffix: str) -> None:
    """Remove what earlier attempts of these runs left; not what somebody is still at, as dask without its client."""
    for entry in os.scandir(folder):
        run_id = entry.name.partition(".")[0]
        if entry.name.endswith(suffix) and run_id in ids and lock.take(share_of(run_id), 1):
            shutil.rmtree(entry.path, ignore_errors=True)
            lock.release(share_of(run_id), 1)


# Tables


def write_tables(study: Study, folder: Path, lock: Lock, patience: float) -> None:
    """runs.csv and summary.csv, of what is there at this moment; in study order, however the batch got there.

    patience: for shards that do this at the same time [s]: who comes last must have looked last
    """
    until = time.monotonic() + patience
    while not lock.take(TABLES, 1):
        if time.monotonic() > until:
            return
        time.sleep(0.1)
    try:
        states = [state(folder, run.id) for run in study.runs]
        with _replacing(folder / "runs.csv") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(["id", "status", "seed", *study.keys, "error", "wall_s"])
            for run, its in zip(study.runs, states, strict=True):
                error, wall = "", ""
                if its == DONE:
                    wall = _read_json(folder / run.id / "provenance.json").get("wall_s", "")
                elif its == FAILED:
                    what = failure(folder, run.id)
                    error, wall = what["error"], what["wall_s"]
                rows.writerow([run.id, its, run.seed, *map(_cell, run.values.values()), error, wall])
        done = [run for run, its in zip(study.runs, states, strict=True) if its == DONE]
        columns = list(dict.fromkeys(name for run in done for name in _metrics(folder / run.id)))
        with _replacing(folder / "summary.csv") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(["id", "seed", *study.keys, *columns])
            for run in done:
                metrics = _metrics(folder / run.id)
                values = [metrics.get(name, "") for name in columns]
                rows.writerow([run.id, run.seed, *map(_cell, run.values.values()), *values])
        with _replacing(folder / "datapackage.json") as file:
            file.write(as_json(_datapackage(study, columns, _units(folder / done[0].id) if done else {})))
    finally:
        lock.release(TABLES, 1)


def _metrics(run_folder: Path) -> dict[str, str]:
    """Column -> value of a run's summary.csv, without what tells which run it is."""
    file = run_folder / "summary.csv"
    try:
        names, values = csv.reader(file.read_text(encoding="utf-8").splitlines())
        row = zip(names, values, strict=True)
    except (OSError, ValueError):
        raise InputError(f"{file}: is missing or damaged; without {run_folder} the run is repeated") from None
    own = {"scenario", *Spec.model_fields}
    return {name: value for name, value in row if "." not in name and name not in own}


def _units(run_folder: Path) -> dict[str, str]:
    with (run_folder / "metrics.csv").open(encoding="utf-8", newline="") as file:
        return {column(row["scope"], row["metric"], row["unit"]): row["unit"] for row in csv.DictReader(file)}


def _datapackage(study: Study, metrics: list[str], units: dict[str, str]) -> dict[str, Any]:
    def field(name: str, type: str, meaning: str, unit: str = "") -> dict[str, str]:
        return {"name": name, "type": type, "unit": unit, "description": meaning}

    run = field("id", "string", "the run, and the folder where it is")
    seed = field("seed", "integer", "of the run")
    varied = [field(key, "any", "key of the scenario") for key in study.keys]
    status = field("status", "string", f"{DONE}, {FAILED} or {WAITING}")
    error, wall = field("error", "string", "why it failed"), field("wall_s", "number", "time that it took", "s")
    values = [field(name, "number", "metric of the run; see metrics.py", units.get(name, "")) for name in metrics]
    tables = {"runs": [run, status, seed, *varied, error, wall], "summary": [run, seed, *varied, *values]}
    resources = [
        {"name": name, "path": f"{name}.csv", "format": "csv", "schema": {"fields": fields, "missingValues": [""]}}
        for name, fields in tables.items()
    ]
    return {"name": study.name.lower(), "title": study.table["title"] or study.name, "resources": resources}


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value


def _read_json(file: Path) -> dict[str, Any]:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(f"{file}: is missing or damaged; without {file.parent} the run is repeated") from None


@contextlib.contextmanager
def _replacing(file: Path) -> Iterator[TextIO]:
    """A file that is there as it was, or whole."""
    new = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with new.open("w", encoding="utf-8", newline="") as opened:
            yield opened
        new.replace(file)
    except BaseException:
        new.unlink(missing_ok=True)
        raise


# Who works on a folder


@contextlib.contextmanager
def _claimed(study: Study, folder: Path, block: range) -> Iterator[Lock]:
    """The folder of this study, with these of its runs to oneself: part i of the lock is for run i of `shuffled`.

    raises: InputError if it is of something else, or somebody is at work on them
    """
    _check_folder(study, folder)
    folder.mkdir(parents=True, exist_ok=True)
    text, file = study.text(folder), folder / STUDY
    until = time.monotonic() + PATIENCE
    with contextlib.closing(Lock(folder / LOCK)) as lock:
        while True:
            if lock.take(block.start, len(block)):
                if file.is_file() and file.read_text(encoding="utf-8") == text:
                    break
                lock.release(block.start, len(block))
            if lock.take(0, len(SHARES)):  # nobody works on the study as it was
                _check_folder(study, folder)
                with _replacing(file) as opened:
                    opened.write(text)
                lock.release(0, len(SHARES))
                continue
            if time.monotonic() > until:
                raise InputError(f"{folder}: another batch is at work there; wait for it, or stop it")
            time.sleep(0.1)
        yield lock


def _check_folder(study: Study, folder: Path) -> None:
    """raises: InputError if something else than this study is there"""
    if not folder.exists():
        return
    file = folder / STUDY
    if not file.is_file():
        if any(entry.name != LOCK and not entry.name.startswith(f".{STUDY}.") for entry in os.scandir(folder)):
            raise InputError(f"{folder}: is there, and not the folder of a batch; must be empty, or another: --out")
        return
    try:
        there = tomllib.loads(file.read_text(encoding="utf-8"))
        name, base = there["name"], Path(there["base"]).name
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file}: is no study of a batch: {' '.join(str(error).split())}") from None
    if (name, base) != (study.name, Path(study.base).name):
        this = f"{study.name!r} on {Path(study.base).name!r}"
        raise InputError(f"{folder}: is of another study, {name!r} on {base!r}; for {this} it must be another: --out")


@contextlib.contextmanager
def _one_line(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{error.filename or folder}: {error.strerror or error}") from error


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """A second Ctrl-C waits until things are in order."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# Who runs them


@contextlib.contextmanager
def _executor(name: str, slots: int) -> Iterator[tuple[Submit, int]]:
    """A function that starts a run, and how many it should be given at a time."""
    if name == "serial":
        yield _at_once, 1
    elif name == "processes":
        workers, threads = Workers(), ThreadPoolExecutor(slots)
        try:
            yield partial(threads.submit, workers.run), 2 * slots
        finally:
            with _undisturbed():
                workers.close()
                threads.shutdown(cancel_futures=True)
    else:
        with _dask(name.partition(":")[2], slots) as client:
            yield partial(client.submit, run_in_a_process), FEW_AT_ONCE


def _at_once(job: Job) -> Future[Outcome]:
    from platoontraffic.study.worker import attempt

    future: Future[Outcome] = Future()
    future.set_result(attempt(job))
    return future


@contextlib.contextmanager
def _dask(address: str, slots: int) -> Iterator[Any]:
    """An executor on a cluster: on the one at an address, or on one of its own, of so many processes."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingError('dask is not installed: pip install "platoontraffic[cluster]"') from None
    with contextlib.ExitStack() as stack:
        if address:
            try:
                client = stack.enter_context(Client(address, timeout=10))
            except (OSError, ValueError) as error:
                what = " ".join(str(error).split())
                raise InputError(f"--executor: {address}: no dask scheduler can be reached: {what}") from None
        else:
            cluster = LocalCluster(n_workers=slots, threads_per_worker=1, dashboard_address=None)
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            with _undisturbed():
                executor.shutdown(wait=False)


def run_in_a_process(job: Job) -> Outcome:
    """What a dask worker does, in whichever of its threads: libsumo holds one simulation a process, and may die."""
    return _of_this_process.run(job)


class Died(Exception):
    def __init__(self, code: int, words: str, started: bool) -> None:
        super().__init__(words)
        self.started = started
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        self.how = f"the process of the run died of {name}"


class Workers:
    """Processes of `worker`, kept for further runs while they live; `run` may be called by many threads at a time."""

    def __init__(self) -> None:
        self._idle: list[_Process] = []
        self._all: set[_Process] = set()
        self._closed = False
        self._lock = threading.Lock()

    def run(self, job: Job) -> Outcome:
        """raises: RunError if no process can be started"""
        began = time.monotonic()
        # Who dies is tried once more, in a new process: what an earlier run has left in the old one, or whoever killed
        # it from outside, is not of this run.
        for attempt in range(2):
            process = self._process(new=attempt > 0)
            try:
                outcome = process.run(job)
            except Died as error:
                process.close()
                self._all.discard(process)
                if not error.started and attempt > 0:
                    last = str(error).strip().rpartition("\n")[2]
                    raise RunError(f"{error.how} before it had started: {last}") from None
                died = error
            else:
                self._idle.append(process)
                return outcome
        wall = round(time.monotonic() - began, 3)
        return {"error": died.how, "traceback": str(died), "stop": False, "wall_s": wall}

    def close(self) -> None:
        with self._lock:
            self._closed = True
            for process in list(self._all):
                process.close()

    def _process(self, new: bool) -> _Process:
        with self._lock:
            if self._closed:
                raise RunError("stopped")
            if self._idle and not new:
                return self._idle.pop()
            process = _Process()
            self._all.add(process)
            return process


class _Process:
    """A process of `worker`. A subprocess, as those of a dask worker may not have children by multiprocessing."""

    def __init__(self) -> None:
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        # stdout is taken before libsumo is imported, which may print; modules are found where this process finds them.
        code = (
            "import os, sys; stdout = os.dup(1); os.dup2(2, 1)\n"
            f"sys.path[:] = {sys.path!r}\n"
            "from platoontraffic.study.worker import main; main(stdout)"
        )
        self._process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._words,
            encoding="utf-8",
            env=ONE_THREAD | os.environ,
        )
        self._started = False

    def run(self, job: Job) -> Outcome:
        """raises: Died"""
        answer = ""
        with contextlib.suppress(OSError, ValueError):  # it has died, or was closed
            if not self._started:
                self._started = self._process.stdout.readline() != ""
            self._words.seek(0)
            self._words.truncate()
            self._process.stdin.write(json.dumps(job) + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        if not answer.endswith("\n"):
            raise Died(self._process.wait(), self._last_words(), self._started)
        return json.loads(answer)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()

    def _last_words(self) -> str:
        """What it said on stderr, at the most its last 20 kB."""
        self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, self._words.tell() - 20_000))
        return self._words.read().decode("utf-8", errors="replace")


_of_this_process = Workers()  # in a dask worker: its threads share it
