"""Worker processes, seen from their parent: one run after another in each; a death costs only one run."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any

from platoontraffic.errors import RunError

# A simulation has one thread; further threads of its libraries would only compete with the processes beside it.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
LAST_WORDS = 20_000  # length of the end of a dead process's stderr that is kept [bytes]

Job = dict[str, Any]  # argument of `worker.attempt`
Outcome = dict[str, Any]  # result of `worker.attempt`


class Died(Exception):
    """A worker process ended in the middle of a run."""

    def __init__(self, code: int, words: str, started: bool) -> None:
        """code: exit code, or minus the number of a signal; words: end of its stderr; started: it had answered"""
        super().__init__(words)
        self.started = started
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        self.how = f"the process of the run died of {name}"


class Workers:
    """Processes of `worker`, reused for further runs. Several threads may call `run` at a time."""

    def __init__(self) -> None:
        self._idle: list[_Process] = []
        self._all: set[_Process] = set()
        self._closed = False
        self._lock = threading.Lock()

    def run(self, job: Job) -> Outcome:
        """The outcome of a run. If the process dies, the run is tried once more in a new process.

        An earlier run may have damaged the old process, or something else may have killed it.

        raises: RunError if no process can be started
        """
        began = time.monotonic()
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
    """A process of `worker`. A subprocess, because dask's workers may not have children by multiprocessing."""

    def __init__(self) -> None:
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        # stdout is kept for answers before libsumo, which may print, is imported; modules are found as in this process.
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
        with contextlib.suppress(OSError, ValueError):  # the process has died or was closed
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
        """The end of its stderr."""
        self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, self._words.tell() - LAST_WORDS))
        return self._words.read().decode("utf-8", errors="replace")


_of_this_process = Workers()  # shared by the threads of a dask worker


def run_in_a_process(job: Job) -> Outcome:
    """Run in a process of this dask worker: libsumo holds one simulation per process, and may kill the process."""
    return _of_this_process.run(job)
