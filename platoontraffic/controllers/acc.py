"""Adaptive cruise control with a constant time headway.

R. Rajamani, Vehicle Dynamics and Control, 2nd ed. 2012, eq. (6.18); the law is that of P. Ioannou, C. Chien,
"Autonomous intelligent cruise control", IEEE Trans. Vehicular Technology 42 (1993) 657:

    u = (r + lambda e) / h        e = gap - s0 - h v        r: the gap's rate, predecessor's speed minus own

With a first-order lag T of the acceleration no frequency grows exactly if h >= 2 T, whatever lambda (Rajamani, 6.6:
|G|^2 <= 1 is lambda^2 h + (h - 2 T (1 + lambda h)) w^2 + h T^2 w^4 >= 0); with a delay D besides, if h >= 2 (T + D)
(L. Xiao, S. Darbha, F. Gao, "Stability of string of adaptive cruise control vehicles with parasitic delays and lags",
IEEE ITSC 2008).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import FieldLaw, Own, constant_headway
from platoontraffic.controllers.law import MAX_HEADWAY, Known, Linear
from platoontraffic.vehicles.motion import NotNegative, Positive


@dataclass(frozen=True)
class ConstantTimeHeadway(FieldLaw):
    """Adaptive cruise control with a constant time headway (Rajamani, eq. 6.18)."""

    time_headway: Annotated[Positive, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 1.5  # beyond the standstill gap
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s")] = 0.1  # lambda
    standstill: Annotated[NotNegative, Field(alias="standstill_m")] = 2.0  # s0

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        return constant_headway(own, known.predecessor, self.time_headway, self.distance_gain, self.standstill)

    def desired_distance(self, speed):
        return self.standstill + self.time_headway * speed

    def linear(self, speed: float, place: int) -> Linear:
        h, gain = self.time_headway, self.distance_gain
        return Linear(gap=gain / h, speed=-1 / h - gain, ahead_speed=1 / h)
