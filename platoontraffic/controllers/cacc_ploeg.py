"""Cooperative adaptive cruise control with a time gap and the predecessor's desired acceleration.

J. Ploeg, N. van de Wouw, H. Nijmeijer, "Lp string stability of cascaded systems: application to vehicle platooning",
IEEE Trans. Control Systems Technology 22 (2014) 786, sections IV and V, with their gains kp, kd and kdd = 0:

    h u' = -u + kp e + kd e' + u_ahead        e = gap - s0 - h v        e' = v_ahead - v - h a

For homogeneous vehicles and messages without delay the speed of a predecessor is followed by 1 / (1 + h s), whatever
the lag. A delay of the messages needs a least time gap: theirs is 0.67 s for 0.15 s, where 0.1 s is the lag; without
u_ahead 3.16 s = sqrt(2 / kp).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import Feed, FieldLaw, Own, filtered
from platoontraffic.controllers.law import MAX_HEADWAY, Known, Linear
from platoontraffic.vehicles.motion import NotNegative, Positive


@dataclass(frozen=True)
class PloegFollower(FieldLaw):
    """Cooperative adaptive cruise control with the predecessor's desired acceleration (Ploeg 2014).

    By scan, the predecessor's estimated acceleration stands for the desired one.
    """

    feed: Feed = "messages"
    time_headway: Annotated[Positive, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 0.7  # h
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s2")] = 0.2  # kp
    speed_gain: Annotated[Positive, Field(alias="speed_gain_per_s")] = 0.7  # kd
    feed_forward: bool = True  # of the predecessor's desired acceleration
    standstill: Annotated[NotNegative, Field(alias="standstill_m")] = 2.0  # s0

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead, h = known.predecessor, self.time_headway
        error = ahead.gap - self.standstill - h * own.speed
        rate = ahead.relative_speed - h * own.acceleration
        forward = ahead.demand if self.feed_forward else 0.0
        return filtered(self.distance_gain * error + self.speed_gain * rate + forward, last, h, dt)

    def desired_distance(self, speed):
        return self.standstill + self.time_headway * speed

    def linear(self, speed: float, place: int) -> Linear:
        kp, kd, h = self.distance_gain, self.speed_gain, self.time_headway
        return Linear(gap=kp, speed=-kp * h - kd, acceleration=-kd * h, ahead_speed=kd,
                      ahead_demand=float(self.feed_forward), lag=h)  # fmt: skip
