"""A process that runs one simulation after another: jobs are lines of JSON on stdin, outcomes lines on stdout.

It ends as soon as the process that gives the jobs has ended, in the middle of a run if need be.
"""

from __future__ import annotations

import errno
import json
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from platoontraffic import scenario
from platoontraffic.errors import InputError, RunError
from platoontraffic.results import provenance
from platoontraffic.results import recorder as recording
from platoontraffic.run import run
from platoontraffic.simulation import prepare
from platoontraffic.study.folder_lock import Lock, share_of

# Errors of the disk stop the batch: every other run would fail in the same way.
OF_THE_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.ENOTDIR, errno.EFBIG, errno.EIO}


def attempt(job: dict[str, Any]) -> dict[str, Any]:
    """Execute one run; returns its outcome.

    job     : base, changes (fields of `scenario.Change`), seed, id (of the run), folder, command_line
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
            run(prepare(checked), folder)
    except Exception as error:
        cause = error.__cause__ if isinstance(error, RunError) else error
        stop = isinstance(cause, OSError) and cause.errno in OF_THE_DISK
        outcome = {"error": _one_line(error), "traceback": traceback.format_exc(), "stop": stop, "disk": stop}
    return outcome | {"wall_s": round(time.perf_counter() - began, 3)}


def main(stdout: int) -> None:
    """stdout: a descriptor for answers; descriptor 1 is stderr here, so that prints of SUMO or a law are no answers"""
    for name in ("SIGINT", "SIGHUP"):  # they reach all processes of a terminal; the parent decides
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    answers = os.fdopen(stdout, "w", encoding="utf-8")
    jobs: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    print("{}", file=answers, flush=True)  # the process has started
    while True:
        job = jobs.get()
        with _alone(Path(job["lock"]), job["id"]):
            outcome = attempt(job)
        print(json.dumps(outcome), file=answers, flush=True)


@contextmanager
def _alone(file: Path, run_id: str) -> Iterator[None]:
    """Wait until no other process executes this run: a dask worker goes on with its run when its batch is killed."""
    with closing(Lock(file)) as lock:
        while not lock.take(share_of(run_id), 1):
            time.sleep(0.2)
        yield


def _listen(jobs: queue.SimpleQueue) -> None:
    for line in sys.stdin:
        jobs.put(json.loads(line))
    os._exit(0)


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, InputError | RunError) else f"{type(error).__name__}: {text}"
