"""Adaptive cruise control as it is sold, which amplifies.

V. Milanés, S. E. Shladover, "Modeling cooperative and autonomous adaptive cruise control dynamic responses using
experimental data", Transportation Research Part C 48 (2014) 285: for a production car's system they fitted

    u = k1 (gap - s0 - h v) + k2 (v_ahead - v)        k1 = 0.23 1/s2, k2 = 0.07 1/s

with s0 = 0; the driver sets h to 1.1, 1.6 or 2.2 s. Without a lag no frequency grows exactly if k1 h^2 + 2 k2 h >= 2
(|G|^2 <= 1 of G = (k2 s + k1) / (s^2 + (k1 h + k2) s + k1)), so from h = 2.66 s on: every setting amplifies, as those
of all seven cars of G. Gunter et al., "Are commercially implemented adaptive cruise control systems string stable?",
IEEE Trans. Intelligent Transportation Systems 22 (2021) 6992, doi 10.1109/TITS.2020.3000682.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import FieldLaw, Own
from platoontraffic.controllers.law import MAX_HEADWAY, Known, Linear
from platoontraffic.vehicles.motion import NotNegative, Positive


@dataclass(frozen=True)
class CommercialAcc(FieldLaw):
    """Adaptive cruise control of a production car (Milanés, Shladover 2014)."""

    time_headway: Annotated[Positive, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 1.6  # h
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s2")] = 0.23  # k1
    speed_gain: Annotated[Positive, Field(alias="speed_gain_per_s")] = 0.07  # k2
    standstill: Annotated[NotNegative, Field(alias="standstill_m")] = 2.0  # s0

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead = known.predecessor
        error = ahead.gap - self.desired_distance(own.speed)
        return self.distance_gain * error + self.speed_gain * ahead.relative_speed

    def desired_distance(self, speed):
        return self.standstill + self.time_headway * speed

    def linear(self, speed: float, place: int) -> Linear:
        k1, k2 = self.distance_gain, self.speed_gain
        return Linear(gap=k1, speed=-k1 * self.time_headway - k2, ahead_speed=k2)
