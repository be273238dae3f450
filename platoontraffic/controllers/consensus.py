"""Consensus on positions and speed, by messages of the predecessor and of the leader, or of all members ahead.

S. Santini, A. Salvi, A. S. Valente, A. Pescapè, M. Segata, R. Lo Cigno, "A consensus-based approach for platooning with
intervehicular communications and its validation in realistic scenarios", IEEE Trans. Vehicular Technology 66 (2017)
1985, eq. (6):

    u = -b (v - v_leader) - 1/d sum over j of k_j (x - x_j + s_j + h_j v_leader)

over the d members j that it hears, with s_j and h_j of all vehicles up to j. Positions in messages are taken forward by
their age at the speed sent, the paper's term of the delay. The gains are those of its validation in Plexe, by a mass of
1000 kg: b = 1.8 1/s; k = 0.86 1/s2 for the predecessor and 0.08 for the leader, 0.46 for a predecessor that leads;
h = 0.8 s and 15 m for each vehicle. There k is 0 for all others; their gain, where it hears all, is not published.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from platoontraffic.controllers.field import Feed, FieldLaw, Own
from platoontraffic.controllers.law import MAX_HEADWAY, Known, Linear
from platoontraffic.vehicles.motion import NotNegative, Positive


@dataclass(frozen=True)
class ConsensusFollower(FieldLaw):
    """Consensus on positions and speed by messages of predecessor and leader (Santini et al. 2017).

    hears           "leader": predecessor and leader; "all": all members ahead. One between that is not heard is left
                    out of the mean.

    Distances beyond the predecessor are taken straight, and all vehicles between as long as the own one.
    """

    uses_leader: ClassVar[bool] = True

    feed: Feed = "messages"
    hears: Literal["leader", "all"] = "leader"
    speed_gain: Annotated[Positive, Field(alias="speed_gain_per_s")] = 1.8  # b
    predecessor_gain: Annotated[Positive, Field(alias="predecessor_gain_per_s2")] = 0.86  # k
    leader_gain: Annotated[NotNegative, Field(alias="leader_gain_per_s2")] = 0.08  # k
    member_gain: Annotated[NotNegative, Field(alias="member_gain_per_s2")] = 0.08  # k of those between
    only_gain: Annotated[Positive, Field(alias="only_gain_per_s2")] = 0.46  # k, where the predecessor leads
    time_headway: Annotated[NotNegative, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 0.8  # h
    standstill: Annotated[NotNegative, Field(alias="standstill_m")] = 15.0  # s

    @property
    def needs(self) -> frozenset[str]:
        return super().needs | ({"members"} if self.hears == "all" else set())

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        ahead, leader, place = known.predecessor, known.leader, known.place
        each = self.desired_distance(leader.speed)
        to_ahead = ahead.gap - each
        to_leader = leader.gap - place * each - (place - 1) * own.length
        errors, heard = self.predecessor_gain * to_ahead + self.leader_gain * to_leader, 2
        if known.members is not None:
            far, between = known.ahead, (known.ahead > 1) & (known.ahead < place[:, None]) & ~known.members.lost
            to_members = known.members.gap - far * each[:, None] - (far - 1) * own.length[:, None]
            errors = errors + self.member_gain * np.where(between, to_members, 0.0).sum(axis=1)
            heard = 2 + between.sum(axis=1)
        mean = np.where(place <= 1, self.only_gain * to_ahead, errors / heard)
        return self.speed_gain * leader.relative_speed + mean

    def desired_distance(self, speed):
        return self.standstill + self.time_headway * speed

    def linear(self, speed: float, place: int) -> Linear:
        b, h = self.speed_gain, self.time_headway
        if place <= 1:
            return Linear(gap=self.only_gain, speed=-b, leader_speed=b - self.only_gain * h)
        heard = place if self.hears == "all" else 2
        ahead, leader = self.predecessor_gain / heard, self.leader_gain / heard
        member = self.member_gain / heard if heard > 2 else 0.0
        vehicles = ahead + leader * place + member * sum(range(2, place))  # that the gaps count, by their gains
        return Linear(gap=ahead, speed=-b, leader_gap=leader, leader_speed=b - vehicles * h, member_gap=member)
