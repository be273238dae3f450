"""The paper's leader: Algorithm 1 of Soni & Hu."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from platoontraffic.controllers.base import Decision, Sensed, per_vehicle
from platoontraffic.vehicle import Positive, Twist


def rule(front: float, front_left: float, front_right: float) -> int:
    """Number of the rule of Algorithm 1 that applies, by the smallest range [m] in three of the five sectors.

    The rules stand in the paper's order. Rule 5 can never apply, since rule 1 takes all its cases; rule 7 can hold for
    ever, for example with front > 2 and front_left < 1.
    """
    if front > 1 and front_left > 1 and front_right > 0.5:
        return 1
    if front < 2 and front_left < 3 and front_right > 0.5:
        return 2
    if front < 1 and front_left < 1 and front_right < 1:
        return 3
    if front < 1 and front_left > 1 and front_right < 1:
        return 4
    if front_right > 0.7 and front > 1 and front_left > 1:
        return 5
    if front_right < 0.5 and front > 1 and front_left > 1:
        return 6
    return 7


# Rule -> (drive, angular) as printed, in units of `speed` and `turn_rate`.
ACTIONS = {1: (1, 0), 2: (1, 0), 3: (0, -1), 4: (0, -1), 5: (0, +1), 6: (0, -1), 7: (0, 0)}


@dataclass(frozen=True)
class ReactiveLeader:
    """Keeps to the right lane and turns left at walls, by five sectors of its scan (Algorithm 1).

    The sign of the turn: the text has the robot turn *left* at a wall, and the rules print an angular velocity of
    -0.1 there. So the paper's positive angular velocity is clockwise, against the convention of robotics (REP 103,
    positive to the left) that holds everywhere else in this project. `positive_turn` is the one place that says so.
    """

    speed: Annotated[Positive, Field(alias="speed_mps")] = 0.1
    turn_rate: Annotated[Positive, Field(alias="turn_rate_radps")] = 0.1
    positive_turn: Literal["clockwise", "counterclockwise"] = "clockwise"

    @per_vehicle
    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        ranges = sensed.scan.filled()
        n = len(ranges)
        front_right, front, front_left = (ranges[n * i // 5 : n * (i + 1) // 5].min() for i in (1, 2, 3))
        drive, angular = ACTIONS[rule(front, front_left, front_right)]
        to_the_left = -angular if self.positive_turn == "clockwise" else angular
        return Decision(Twist(drive * self.speed, to_the_left * self.turn_rate))
