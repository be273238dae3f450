"""The Intelligent Driver Model as a follower; its equations and source are in `idm`.

The defaults are those of the source, table I. Small deviations from the steady gap s at a speed v follow with

    f_s = 2 a s*^2 / s^3        f_v = -a (4 v^3 / v0^4 + 2 s* T / s^2)        f_r = a s* v / (s^2 sqrt(a b))

per gap, own speed and the gap's rate r. Without a lag a string damps slow waves exactly if f_s <= f_v^2 / 2 - f_v f_r
(M. Treiber, A. Kesting, Traffic Flow Dynamics, 2013, 15.4.2, with f_v at a constant r).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers import idm
from platoontraffic.controllers.field import FieldLaw, Own
from platoontraffic.controllers.law import MAX_HEADWAY, Known, Linear
from platoontraffic.vehicles.motion import NotNegative, Positive

LEAST_GAP = 0.1  # to which a shorter gap is taken [m]


@dataclass(frozen=True)
class IntelligentDriver(FieldLaw):
    """The Intelligent Driver Model (Treiber, Hennecke, Helbing 2000)."""

    desired_speed: Annotated[Positive, Field(alias="desired_speed_mps")] = 120 / 3.6  # v0
    time_headway: Annotated[Positive, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 1.6  # T
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 0.73  # a
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 1.67  # b
    standstill: Annotated[NotNegative, Field(alias="standstill_m")] = 2.0  # s0

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead = known.predecessor
        desired = idm.desired_gap(
            own.speed, -ahead.relative_speed, self.standstill, self.time_headway, self.acceleration, self.braking
        )
        free = idm.free_road(own.speed, self.desired_speed)
        return idm.acceleration(desired, np.maximum(ahead.gap, LEAST_GAP), self.acceleration, free)

    def desired_distance(self, speed):
        """The gap at which a steady speed has no acceleration [m]; NaN from the desired speed on."""
        free = idm.free_road(np.asarray(speed, float), self.desired_speed)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(free > 0, (self.standstill + self.time_headway * speed) / np.sqrt(free), np.nan)

    def linear(self, speed: float, place: int) -> Linear:
        a, wanted = self.acceleration, self.standstill + self.time_headway * speed
        gap = float(self.desired_distance(speed))
        by_gap = 2 * a * wanted**2 / gap**3
        by_speed = -a * (4 * speed**3 / self.desired_speed**4 + 2 * wanted * self.time_headway / gap**2)
        by_rate = a * wanted * speed / (gap**2 * np.sqrt(a * self.braking))
        return Linear(gap=by_gap, speed=by_speed - by_rate, ahead_speed=by_rate)
