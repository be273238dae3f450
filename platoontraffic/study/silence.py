"""Runs that make no progress: when to name them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

# A run that has made no step for so long is named, and again whenever this time has doubled [s]. The first step of a
# new installation compiles for a minute, or more where many processes do so.
SILENCE = 120.0

Job = dict[str, Any]  # argument of `worker.attempt`
Outcome = dict[str, Any]  # result of `worker.attempt`


class Silence(NamedTuple):
    """A run that makes no progress."""

    id: str
    seconds: float  # wall time without a step; 0: it goes on, or has ended
    simulated: float | None  # time that it has reached [s]; None: it has made no step yet


Say = Callable[[Silence], None]  # may be called from any thread


class Pulse:
    """The progress of one run, by what is heard of it."""

    def __init__(self, run_id: str, say: Say) -> None:
        self._id, self._say = run_id, say
        self._simulated: float | None = None
        self._heard, self._due = time.monotonic(), SILENCE

    def beat(self, simulated: float | None) -> None:
        """The run has reached this time [s]."""
        self._simulated, self._heard = simulated, time.monotonic()
        self.end()

    def check(self) -> None:
        """Name the run if it is due."""
        if time.monotonic() - self._heard >= self._due:
            self._say(Silence(self._id, self._due, self._simulated))
            self._due *= 2

    def end(self) -> None:
        if self._due > SILENCE:
            self._say(Silence(self._id, 0.0, self._simulated))
        self._due = SILENCE
