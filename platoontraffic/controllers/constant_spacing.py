"""A constant distance by the gap alone: the counterexample of string stability.

P. Seiler, A. Pant, K. Hedrick, "Disturbance propagation in vehicle strings", IEEE Trans. Automatic Control 49 (2004)
1835, section III, with their gains:

    K(s) = (2 s + 1) / (0.05 s + 1)        0.05 u' + u = e + 2 e'        e = gap - s0

For a vehicle 1 / (s^2 (0.1 s + 1)) they give |T| = 1.21 at the most, at 0.93 rad/s. No K damps every frequency: the
integral of log|T| / w^2 over all w is 0 or more (their theorem 1), since K has no more to measure than the gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import FieldLaw, Own, filtered
from platoontraffic.controllers.law import Known, Linear
from platoontraffic.vehicles.motion import Positive


@dataclass(frozen=True)
class ConstantSpacing(FieldLaw):
    """A constant distance by the gap and its rate alone, which amplifies (Seiler, Pant, Hedrick 2004)."""

    spacing: Annotated[Positive, Field(alias="spacing_m")] = 5.0  # s0
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s2")] = 1.0  # of the gap
    speed_gain: Annotated[Positive, Field(alias="speed_gain_per_s")] = 2.0  # of its rate
    filter: Annotated[Positive, Field(alias="filter_s")] = 0.05  # of the command

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead = known.predecessor
        by_gap = self.distance_gain * (ahead.gap - self.spacing)
        return filtered(by_gap + self.speed_gain * ahead.relative_speed, last, self.filter, dt)

    def desired_distance(self, speed):
        return self.spacing + 0.0 * speed

    def linear(self, speed: float, place: int) -> Linear:
        return Linear(self.distance_gain, -self.speed_gain, ahead_speed=self.speed_gain, lag=self.filter)
