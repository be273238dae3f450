"""Consensus on positions and speed, by messages of the predecessor and of the leader.

S. Santini, A. Salvi, A. S. Valente, A. Pescapè, M. Segata, R. Lo Cigno, "A consensus-based approach for platooning with
intervehicular communications and its validation in realistic scenarios", IEEE Trans. Vehicular Technology 66 (2017)
1985, eq. (6):

    u = -b (v - v_leader) - 1/d sum over j of k_j (x - x_j + s_j + h_j v_leader)

over leader and predecessor, d of them. Positions in messages are taken forward by their age at the speed sent, which is
the paper's term of the delay. The gains are those of its validation in Plexe, by a mass of 1000 kg: b = 1.8 1/s;
k = 0.86 1/s2 for the predecessor and 0.08 for the leader, 0.46 for a predecessor that leads; h = 0.8 s and 15 m for
each vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import Feed, FieldLaw, Own
from platoontraffic.controllers.law import Known, Linear
from platoontraffic.vehicles.motion import NotNegative, Positive


@dataclass(frozen=True)
class ConsensusFollower(FieldLaw):
    """Consensus on positions and speed by messages of predecessor and leader (Santini et al. 2017).

    The distance to the leader is taken straight, and all vehicles between as long as the own one.
    """

    uses_leader: ClassVar[bool] = True

    feed: Feed = "messages"
    speed_gain: Annotated[Positive, Field(alias="speed_gain_per_s")] = 1.8  # b
    predecessor_gain: Annotated[Positive, Field(alias="predecessor_gain_per_s2")] = 0.86  # k
    leader_gain: Annotated[NotNegative, Field(alias="leader_gain_per_s2")] = 0.08  # k
    only_gain: Annotated[Positive, Field(alias="only_gain_per_s2")] = 0.46  # k, where the predecessor leads
    time_headway: Annotated[NotNegative, Field(alias="time_headway_s")] = 0.8  # h
    standstill: Annotated[NotNegative, Field(alias="standstill_m")] = 15.0  # s

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead, leader, place = known.predecessor, known.leader, known.place
        each = self.desired_distance(leader.speed)
        to_ahead = ahead.gap - each
        to_leader = leader.gap - place * each - (place - 1) * own.length
        both = (self.predecessor_gain * to_ahead + self.leader_gain * to_leader) / 2
        return self.speed_gain * leader.relative_speed + np.where(place <= 1, self.only_gain * to_ahead, both)

    def desired_distance(self, speed):
        return self.standstill + self.time_headway * speed

    def linear(self, speed: float, place: int) -> Linear:
        b, h = self.speed_gain, self.time_headway
        if place <= 1:
            return Linear(gap=self.only_gain, speed=-b, leader_speed=b - self.only_gain * h)
        ahead, leader = self.predecessor_gain / 2, self.leader_gain / 2
        return Linear(gap=ahead, speed=-b, leader_gap=leader, leader_speed=b - (ahead + leader * place) * h)
