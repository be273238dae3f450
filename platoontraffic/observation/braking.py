"""Emergency brakes and jerk."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from platoontraffic.observation.step import Step
from platoontraffic.observation.thresholds_kernel import brakes_hard
from platoontraffic.vehicles.motion import FULL_SIZE
from platoontraffic.world.events import EMERGENCY_BRAKING, Event


class Braking:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, length: np.ndarray) -> None:
        """length: of each member, (N,) [m]"""
        self._full_size = length >= FULL_SIZE
        self._time: float | None = None  # one step before [s]
        self._acceleration = np.zeros(len(length))  # one step before [m/s2]
        self.jerk = np.zeros(len(length))  # change of the acceleration over the last step [m/s3]
        self._hard = np.zeros(len(length), dtype=bool)  # one step before

    def begin(self, step: Step, new: np.ndarray) -> None:
        """Members in the rows `new`, (m,), have just entered the road: their jerk is 0 then."""
        self._acceleration[step.fleet.number[new]] = step.fleet.motion.acceleration[new]

    def observe(self, step: Step) -> Iterator[Event]:
        """emergency_brake"""
        number, acceleration = step.fleet.number, step.fleet.motion.acceleration
        dt = 0.0 if self._time is None else step.traffic.time - self._time
        self._time, begins = step.traffic.time, np.empty(number.size, dtype=bool)
        own = self._full_size, self._acceleration, self.jerk, self._hard
        if brakes_hard(number, acceleration, dt, EMERGENCY_BRAKING, *own, begins):
            for i in begins.nonzero()[0]:
                yield step.event("emergency_brake", i)
