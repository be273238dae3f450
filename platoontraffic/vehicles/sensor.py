"""Sensors of a scenario's own, beside lasers and odometry."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np


class Sensor:
    """A sensor: a frozen dataclass of its parameters, called for all vehicles that carry it.

    `rate` may be a field, so that a scenario can set it.
    """

    rate: float = 10.0  # measurements a second [Hz]; the interval must be whole steps
    reach: float = math.inf  # greatest distance from the vehicle's centre of anything it measures [m]

    def __call__(self, surroundings: Any, rows: np.ndarray) -> Any:
        """The measurements of n vehicles: an array (n, ...), or a NamedTuple or dataclass of such arrays.

        surroundings : the world at this instant, see `world.sensing.Surroundings`
        rows         : of the vehicles that measure, in its fleet and its traffic, (n,)
        """
        raise NotImplementedError


class NamedSensor(NamedTuple):
    """A sensor by the name that the scenario gives it, by which laws ask for it."""

    name: str
    sensor: Sensor
