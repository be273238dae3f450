"""A process that runs one simulation after another: jobs are lines of JSON on stdin, outcomes lines on stdout.

It ends as soon as the process that gives the jobs has ended, in the middle of a run if need be.
"""

from __future__ import annotations

import errno
import faulthandler
import json
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from platoontraffic import scenario
from platoontraffic.branches.host import die_with
from platoontraffic.errors import InputError, RunError
from platoontraffic.observation.instant import Instant
from platoontraffic.recording import Warm, run
from platoontraffic.results import provenance
from platoontraffic.results import recorder as recording
from platoontraffic.road.network import Network
from platoontraffic.simulation import prepare
from platoontraffic.study.folder_lock import Lock, share_of
from platoontraffic.study.silence import Job, Outcome

# Errors of the disk stop the batch: every other run would fail in the same way.
OF_THE_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.ENOTDIR, errno.EFBIG, errno.EIO}

BEAT = 1.0  # least interval at which a run says what time it has reached [s]


class Heartbeat:
    """A watcher of a run that says now and then what time it has reached."""

    def __init__(self, say: Callable[[float], None]) -> None:
        self._say, self._due = say, 0.0

    def show(self, instant: Instant) -> None:
        now = time.monotonic()
        if now >= self._due:
            self._due = now + BEAT
            self._say(instant.time)


def attempt(
    job: Job, say: Callable[[float], None], network: Network | None = None, warm: Warm | None = None
) -> Outcome:
    """Execute one run; returns its outcome.

    job     : base, changes (fields of `scenario.Change`), seed, id (of the run), folder, command_line
    say     : called now and then with the simulated time [s]
    network : of the run, if it was read before
    warm    : SUMO after the run's warm-up, if it is in this process
    returns : wall_s and, if it failed, error (one line), traceback, stop (whether every other run would fail as well),
              disk (whether because of the disk)
    """
    began = time.perf_counter()
    sys.argv[1:] = job["command_line"]  # for the run's provenance
    outcome: dict[str, Any] = {}
    try:
        changes = [scenario.Change(*change) for change in job["changes"]]
        checked = scenario.load(job["base"], changes, job["seed"])
        folder = Path(job["folder"])
        if provenance.run_id(checked) != job["id"]:
            what = "a file of the scenario, or the program, is not what it was when the batch was started"
            outcome = {"error": f"{job['base']}: {what}; start it again", "traceback": "", "stop": True, "disk": False}
        elif not recording.is_done(folder):
            run(prepare(checked, network), folder, [Heartbeat(say)], warm=warm)
    except Exception as error:
        cause = error.__cause__ if isinstance(error, RunError) else error
        stop = isinstance(cause, OSError) and cause.errno in OF_THE_DISK
        outcome = {"error": _one_line(error), "traceback": traceback.format_exc(), "stop": stop, "disk": stop}
    return outcome | {"wall_s": round(time.perf_counter() - began, 3)}


def main(jobs: int, answers: int, parent: int) -> None:
    """
    jobs    : descriptor that jobs are read from; stdin is empty here
    answers : descriptor for answers; descriptor 1 is stderr here, so that prints of SUMO or a law are no answers
    parent  : process that gives the jobs
    """
    for name in ("SIGINT", "SIGHUP"):  # they reach all processes of a terminal; the parent decides
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if os.name != "nt":
        faulthandler.register(signal.SIGUSR2)  # the parent asks where a run hangs
    die_with(parent)  # the thread that reads jobs notices, too, unless compiled code keeps all others waiting
    if os.name != "nt":
        os.register_at_fork(after_in_child=lambda: die_with(os.getppid()))  # what a law forks dies with this process
    out = os.fdopen(answers, "w", encoding="utf-8")

    def tell(**answer: Any) -> None:
        print(json.dumps(answer), file=out, flush=True)

    def beat(simulated: float) -> None:
        with suppress(OSError):  # a law may have closed it; the parent then ends this process
            tell(simulated=simulated)

    waiting: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(jobs, waiting), daemon=True).start()
    tell(started=True)
    while True:
        job = waiting.get()
        with alone(Path(job["lock"]), job["id"]):
            outcome = attempt(job, beat)
        try:
            tell(outcome=outcome)
        except OSError:
            threading.Event().wait()  # likewise


@contextmanager
def alone(file: Path, run_id: str) -> Iterator[None]:
    """Wait until no other process executes this run: a dask worker goes on with its run when its batch is killed."""
    with closing(Lock(file)) as lock:
        while not lock.take(share_of(run_id), 1):
            time.sleep(0.2)
        yield


def _listen(jobs: int, waiting: queue.SimpleQueue[Job]) -> None:
    try:
        with os.fdopen(jobs, encoding="utf-8") as lines:
            for line in lines:
                waiting.put(json.loads(line))
    finally:  # also if a law has closed or replaced the descriptor
        os._exit(0)


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, InputError | RunError) else f"{type(error).__name__}: {text}"
