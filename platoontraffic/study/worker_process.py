"""One worker process, seen from its parent: jobs go in, what it says comes out, and limits are kept.

Whatever a law does to its process, the parent never waits for it without an end: it reads what the process says in
threads, and looks in short intervals whether the process lives, how long its run has taken and how much memory it has.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from platoontraffic.branches.process import ONE_THREAD
from platoontraffic.study import process_tree
from platoontraffic.study.silence import Job, Outcome, Pulse

LAST_WORDS = 20_000  # length of the end of a process's stderr that is kept [bytes]
WATCH = 0.25  # interval of looks at a silent process [s]
GRACE = 1.0  # time to die after the last answer, or to say where a run hangs [s]
START = 300.0  # longest time in which a process starts [s]; it may lie on a slow file system


class Stopped(Exception):
    """A worker process ended, or was stopped, before it gave an outcome."""

    def __init__(
        self, why: str, words: str = "", again: bool = True, from_outside: bool = False, took: float | None = None
    ) -> None:
        """
        why          : one line
        words        : end of its stderr
        again        : its run may do better in a new process
        from_outside : a signal has killed it, or the machine is short of something
        took         : wall time of its run until a limit was reached [s]; None: no limit was
        """
        super().__init__(why)
        self.why, self.words, self.again, self.from_outside, self.took = why, words, again, from_outside, took


class WorkerProcess:
    """A process of `worker`. A subprocess, because dask's workers may not have children by multiprocessing."""

    def __init__(self, census: process_tree.Census) -> None:
        """raises: Stopped if the system starts no process"""
        # The descriptors of jobs and answers are kept before libsumo, which may print, is imported, and a law cannot
        # read jobs as its input; modules are found as in this process.
        code = (
            "import os, sys; jobs, answers, null = os.dup(0), os.dup(1), os.open(os.devnull, os.O_RDONLY)\n"
            "os.dup2(null, 0); os.close(null); os.dup2(2, 1)\n"
            f"sys.path[:] = {sys.path!r}\n"
            f"from platoontraffic.study.worker import main; main(jobs, answers, {os.getpid()})"
        )
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-X", "faulthandler", "-c", code],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=ONE_THREAD | os.environ,
                start_new_session=True,  # a signal that a law sends to its group is not for the batch
            )
        except OSError as error:
            raise Stopped(f"no process can be started: {error.strerror}", from_outside=True) from None
        self._census = census
        self._answers: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()  # None: there will be no more
        self._words = bytearray()
        threading.Thread(target=self._read_answers, daemon=True).start()
        self._reader = threading.Thread(target=self._read_words, daemon=True)
        self._reader.start()
        self.used = False  # has executed a run

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def wait_until_started(self) -> None:
        """raises: Stopped if it does not start"""
        until = time.monotonic() + START
        try:
            while self._answer() is None:
                if time.monotonic() > until:
                    raise Stopped(f"the process of the run took {START:g} s")
        except Stopped as stopped:
            stopped.why += " before it had started"
            raise

    def run(self, job: Job, pulse: Pulse) -> Outcome:
        """raises: Stopped"""
        self._words.clear()
        began, used, self.used = time.monotonic(), self.used, True
        with contextlib.suppress(OSError):  # it has died, as the next answer tells
            self._process.stdin.write(json.dumps(job).encode() + b"\n")
            self._process.stdin.flush()
        while True:
            answer = self._answer() or {}
            if "outcome" in answer:
                return answer["outcome"]
            if "simulated" in answer:
                pulse.beat(answer["simulated"])
                continue
            pulse.check()
            try:
                check_limits(job, time.monotonic() - began, lambda: self._census.memory(self._process.pid))
            except Stopped as stopped:
                # Time is the run's own; memory may be what earlier runs have left in the process.
                again = stopped.again and used
                raise Stopped(stopped.why, self._where(), again, took=stopped.took) from None

    def close(self) -> None:
        """Kill it and what it has started."""
        if os.name == "nt":
            self._process.kill()
        else:
            process_tree.end(self._process.pid)
        with contextlib.suppress(subprocess.TimeoutExpired):  # it waits for a disk that does not answer
            self._process.wait(GRACE)

    def _answer(self) -> dict[str, Any] | None:
        """What it says next; None: nothing in the next moment. raises: Stopped if it has ended, or cannot answer"""
        try:
            answer = self._answers.get(timeout=WATCH)
        except queue.Empty:
            # A process that the dead one has started may hold its answers open.
            if self.alive or not self._answers.empty():
                return None
            answer = None
        if answer is not None:
            return answer
        try:
            code = self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            raise Stopped("the process of the run closed its connection to the batch", self._last_words()) from None
        raise Stopped(f"the process of the run died of {_cause(code)}", self._last_words(), from_outside=code < 0)

    def _where(self) -> str:
        """Where its threads are, as it says on request."""
        if os.name != "nt":
            self._process.send_signal(signal.SIGUSR2)  # see `worker.main`
        return self._last_words()

    def _last_words(self) -> str:
        self._reader.join(GRACE)
        return self._words.decode("utf-8", errors="replace")

    def _read_answers(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in self._process.stdout:
                self._answers.put(json.loads(line))
        self._answers.put(None)

    def _read_words(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            while some := self._process.stderr.read1():
                self._words += some
                del self._words[:-LAST_WORDS]


def check_limits(job: Job, took: float, memory: Callable[[], float]) -> None:
    """raises: Stopped if a run has taken more time [s] or memory [MB] than its job allows"""
    if job["timeout_s"] and took > job["timeout_s"]:
        raise Stopped(f"timeout after {job['timeout_s']:g} s", again=False, took=took)
    if job["memory_mb"] and memory() > job["memory_mb"]:
        raise Stopped(f"memory above {job['memory_mb']:g} MB", took=took)


def _cause(code: int) -> str:
    """Name of an exit code, or of minus the number of a signal."""
    try:
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:  # one without a name
        return f"signal {-code}"
