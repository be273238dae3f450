"""Runs of a batch with the same warm-up: one process drives it, and a fork of that process goes on as each run."""

from __future__ import annotations

import threading
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from platoontraffic.branches.process import Process
from platoontraffic.errors import RunError
from platoontraffic.study import process_tree
from platoontraffic.study.silence import Job, Outcome, Pulse
from platoontraffic.study.worker_process import WATCH, Stopped, check_limits

# Not imported here: it imports libsumo, of which this process has no need.
WARM_ROAD = "platoontraffic.study.warm_road:WarmRoad"


class WarmUps:
    """The processes with SUMO after a warm-up. Several threads may call `run` at a time."""

    def __init__(self, census: process_tree.Census) -> None:
        self._census = census
        self._processes: dict[str, Process] = {}
        self._folders: dict[str, TemporaryDirectory] = {}
        self._runs: Counter[str] = Counter()  # ended ones
        self._locks: dict[str, threading.Lock] = {}
        self._lock = threading.Lock()
        self._failed: set[str] = set()  # warm-ups that failed: their runs are run by themselves
        self._closed = False

    def run(self, job: Job, pulse: Pulse) -> Outcome:
        """The outcome of a run whose job has a `warm_up`. raises: Stopped; the run may do better in its own process"""
        key = job["warm_up"]["key"]
        with self._lock:
            lock = self._locks.setdefault(key, threading.Lock())
        try:
            with lock:
                process = self._warm(key, job, pulse)
                try:
                    fork = process.fork(job)
                except RunError:
                    self._failed.add(key)
                    raise
            try:
                return self._run(fork, job, pulse)
            finally:
                if not fork.closed:  # else its id may be that of another process
                    process_tree.end(fork.pid)
                    fork.close()
        except RunError as error:  # of the warm-up's process, or of the fork
            raise Stopped(str(error)) from None
        finally:
            with self._lock:
                self._runs[key] += 1
                last = self._runs[key] == job["warm_up"]["runs"]
            if last:
                self._end(key)

    def close(self) -> None:
        """Kill all processes, and with them their forks."""
        with self._lock:
            self._closed = True
        for key, process in list(self._processes.items()):
            process.kill()
            self._end(key)

    def _warm(self, key: str, job: Job, pulse: Pulse) -> Process:
        """The process after the warm-up. raises: RunError, InputError"""
        if key in self._failed:
            raise RunError("its warm-up has failed before")
        if key in self._processes:
            return self._processes[key]
        with self._lock:
            if self._closed:
                raise RunError("stopped")
            folder = self._folders[key] = TemporaryDirectory(prefix="platoontraffic-", ignore_cleanup_errors=True)
            process = self._processes[key] = Process(quiet=True)
        began = time.monotonic()
        try:
            process.send("hold", WARM_ROAD, job, Path(folder.name))
            while not process.speaks(WATCH):
                pulse.check()
                check_limits(job, time.monotonic() - began, lambda: self._census.memory(process.pid))
            process.answer()
        except BaseException:
            self._failed.add(key)
            process.kill()
            raise
        return process

    def _run(self, fork: Process, job: Job, pulse: Pulse) -> Outcome:
        began = time.monotonic()
        fork.send("run", job)
        while True:
            if fork.speaks(WATCH):
                kind, value = fork.word()
                if kind == "said":
                    pulse.beat(value)
                elif kind == "failed":
                    raise Stopped(f"{type(value).__name__}: {value}")
                else:
                    return value
            pulse.check()
            check_limits(job, time.monotonic() - began, lambda: self._census.memory(fork.pid))

    def _end(self, key: str) -> None:
        if process := self._processes.pop(key, None):
            process.close()
        if folder := self._folders.pop(key, None):
            folder.cleanup()
