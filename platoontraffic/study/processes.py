"""Worker processes: one run after another in each; whatever happens to a process costs only its present run."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from platoontraffic.errors import InputError, RunError
from platoontraffic.study.process_tree import Census
from platoontraffic.study.silence import Job, Outcome, Pulse, Say
from platoontraffic.study.worker_process import Stopped, WorkerProcess

if TYPE_CHECKING:
    from platoontraffic.study.warm_ups import WarmUps

# Processes that may end in a row before they have started; the batch ends with the last one. A machine that is short of
# memory kills some. Where all end by themselves, the installation is broken.
STARTS, BROKEN_STARTS = 6, 2
PAUSE = 0.25  # pause after the first of these, doubled after each further one [s]

SILENT = "platoontraffic-silent"  # topic of dask: runs that make no progress, as `Silence`


class Workers:
    """Processes of `worker`, reused for further runs. Several threads may call `run` at a time."""

    def __init__(self) -> None:
        self._idle: list[WorkerProcess] = []
        self._all: set[WorkerProcess] = set()
        self._closed = threading.Event()
        self._one_has_started = False
        self._lock = threading.Lock()
        self._census = Census()
        self._warm_ups: WarmUps | None = None  # made when it is needed: it imports libsumo

    def run(self, job: Job, say: Say) -> Outcome:
        """The outcome of a run. It is tried once more, in a new process, if its process died, or if it failed in a
        process that an earlier run may have damaged.

        say: called when the run makes no progress

        raises: RunError if no process can be started
        """
        if job["warm_up"] and (outcome := self._run_warm(job, say)):
            return outcome
        for attempt in range(2):
            process = self._started(new=attempt > 0)
            pulse, used, began = Pulse(job["id"], say), process.used, time.monotonic()
            try:
                outcome = process.run(job, pulse)
                again = used and "error" in outcome and not outcome["stop"]
            except Stopped as stopped:
                outcome, again = _failed(stopped, began), stopped.again
                self._end(process)
            else:
                self._end(process) if again else self._idle.append(process)
            finally:
                pulse.end()
            if not again:
                break
        return outcome

    def _run_warm(self, job: Job, say: Say) -> Outcome | None:
        """The outcome of a run that shares its warm-up; None if it failed, and is to be tried by itself."""
        from platoontraffic.study.warm_ups import WarmUps

        with self._lock:
            if self._closed.is_set():
                raise RunError("stopped")
            self._warm_ups = self._warm_ups or WarmUps(self._census)
        pulse, began = Pulse(job["id"], say), time.monotonic()
        try:
            outcome = self._warm_ups.run(job, pulse)
        except Stopped as stopped:
            return None if stopped.again else _failed(stopped, began)
        except InputError:
            return None
        finally:
            pulse.end()
        return None if "error" in outcome and not outcome["stop"] else outcome

    def close(self) -> None:
        with self._lock:
            self._closed.set()
            if self._warm_ups:
                self._warm_ups.close()
            for process in list(self._all):  # threads that notice change it
                process.close()

    def _started(self, new: bool) -> WorkerProcess:
        """A process that waits for a job. raises: RunError if none can be started"""
        starts = 0
        while True:
            try:
                process = self._start(new)
            except Stopped as stopped:
                starts += 1
                broken = not (stopped.from_outside or self._one_has_started)
                if starts >= (BROKEN_STARTS if broken else STARTS):
                    last = stopped.words.strip().rpartition("\n")[2]
                    raise RunError(f"{stopped.why}{f': {last}' if last else ''} ({starts} times in a row)") from None
                self._closed.wait(PAUSE * 2**starts)
            else:
                self._one_has_started = True
                return process

    def _start(self, new: bool) -> WorkerProcess:
        """An idle process, or a new one if none is idle or a new one is wanted. raises: Stopped"""
        with self._lock:
            if self._closed.is_set():
                raise RunError("stopped")
            while self._idle and not new:
                process = self._idle.pop()
                if process.alive:
                    return process
                self._end(process)
            process = WorkerProcess(self._census)
            self._all.add(process)
        try:
            process.wait_until_started()
        except Stopped:
            self._end(process)
            raise
        return process

    def _end(self, process: WorkerProcess) -> None:
        process.close()
        self._all.discard(process)


def _failed(stopped: Stopped, began: float) -> Outcome:
    """The outcome of a run that was stopped. began: when its process was given the job, for one without a limit"""
    took = time.monotonic() - began if stopped.took is None else stopped.took
    return {"error": stopped.why, "traceback": stopped.words, "stop": False, "wall_s": round(took, 3)}


_of_this_process = Workers()  # shared by the threads of a dask worker


def run_in_a_process(job: Job) -> Outcome:
    """Run in a process of this dask worker: libsumo holds one simulation per process, and may kill the process."""
    from distributed import get_worker

    worker = get_worker()
    return _of_this_process.run(job, lambda silence: worker.log_event(SILENT, tuple(silence)))
