"""Cooperative adaptive cruise control at a constant spacing, by messages of the predecessor and of the leader.

R. Rajamani, Vehicle Dynamics and Control, 2nd ed. 2012, eq. (7.39), as it drove in the demonstration of California PATH
(R. Rajamani, H.-S. Tan, B. K. Law, W.-B. Zhang, IEEE Trans. Control Systems Technology 8 (2000) 695):

    u = (1 - C1) a_ahead + C1 a_leader - (2 xi - C1 q) w e' - q w C1 (v - v_leader) - w^2 e
    e = s0 - gap        e' = v - v_ahead        q = xi + sqrt(xi^2 - 1)

The gains are those of the demonstration: C1 = 0.5, xi = 1, w = 0.2 rad/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import Feed, FieldLaw, Own
from platoontraffic.controllers.law import Known, Linear
from platoontraffic.vehicles.motion import Positive


@dataclass(frozen=True)
class PathFollower(FieldLaw):
    """Constant spacing by messages of predecessor and leader (Rajamani, eq. 7.39)."""

    uses_leader: ClassVar[bool] = True

    feed: Feed = "messages"
    spacing: Annotated[Positive, Field(alias="spacing_m")] = 5.0  # s0
    leader_weight: Annotated[float, Field(ge=0, lt=1)] = 0.5  # C1
    damping: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 1.0  # xi
    bandwidth: Annotated[Positive, Field(alias="bandwidth_radps")] = 0.2  # w

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead, leader, gains = known.predecessor, known.leader, self.linear(0.0, 1)
        accelerations = gains.ahead_acceleration * ahead.acceleration + gains.leader_acceleration * leader.acceleration
        by_speed = gains.ahead_speed * ahead.relative_speed + gains.leader_speed * leader.relative_speed
        return accelerations + by_speed + gains.gap * (ahead.gap - self.spacing)

    def desired_distance(self, speed):
        return self.spacing + 0.0 * speed

    def linear(self, speed: float, place: int) -> Linear:
        c, w, q = self.leader_weight, self.bandwidth, self.damping + math.sqrt(self.damping**2 - 1)
        ahead, leader = (2 * self.damping - c * q) * w, q * w * c
        return Linear(gap=w * w, speed=-ahead - leader, ahead_speed=ahead, ahead_acceleration=1 - c,
                      leader_speed=leader, leader_acceleration=c)  # fmt: skip
