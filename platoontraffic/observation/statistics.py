"""Statistics of measured values over all steps of a run, whatever is recorded of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.observation import statistics_kernel as kernel
from platoontraffic.observation.step import Step


class Statistic(NamedTuple):
    """One member's values of one quantity over all steps at which it had a value."""

    steps: float  # number of these steps
    mean: float
    rms: float  # root mean square
    least: float
    most: float


class Statistics:
    """State of all members of the run, by their number: arrays (N, ...)."""

    def __init__(self, n: int) -> None:
        self._tallies = np.zeros((n, kernel.COLUMNS, 5))
        self._tallies[..., kernel.LEAST], self._tallies[..., kernel.MOST] = np.inf, -np.inf
        self._before = np.full((n, 3), np.nan)  # x, y [m], turned [rad] one step before
        self._time = np.nan  # then [s]
        self.values = np.empty(0, kernel.VALUES)  # of the last step, records (n,) in the fleet's order
        self.numbers = np.empty((0, kernel.COLUMNS))  # the same, with a column for each quantity

    def observe(self, step: Step, **measured: np.ndarray) -> None:
        """measured: the fields of `statistics_kernel.Seen` that are not the fleet's"""
        fleet, motion, n = step.fleet, step.fleet.motion, step.fleet.number.size
        own = motion.x, motion.y, motion.turned, motion.speed, motion.acceleration, motion.yaw_rate, *fleet.radio
        seen = kernel.Seen(step.fleet.number, fleet.predecessor, *own, **measured)
        self.numbers = np.empty((n, kernel.COLUMNS))
        self.values = np.ndarray(n, kernel.VALUES, self.numbers)  # the same memory
        kernel.observe(
            tuple(seen), self._before, step.traffic.time - self._time, self.values, self.numbers, self._tallies
        )
        self._time = step.traffic.time

    def of(self, number: int) -> dict[str, Statistic]:
        """Statistics of a member, by name in QUANTITIES; without those of which it never had a value."""
        found: dict[str, Statistic] = {}
        for name, tally in zip(kernel.QUANTITIES, self._tallies[number].tolist(), strict=True):
            count, total, squares, least, most = tally
            if count:
                found[name] = Statistic(count, total / count, (squares / count) ** 0.5, least, most)
        return found
