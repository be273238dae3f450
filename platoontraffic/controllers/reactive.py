"""The paper's leader: Algorithm 1 of Soni & Hu."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import Decision, Law, Sensed
from platoontraffic.vehicles.motion import Positive, Twist


def rule(front: np.ndarray, front_left: np.ndarray, front_right: np.ndarray) -> np.ndarray:
    """Number of the rule of Algorithm 1 that applies, by the ranges [m] of three of the five sectors, (n,).

    The rules are in the paper's order. Rule 5 never applies, since rule 1 takes all its cases; rule 7 can apply for
    ever, for example with front > 2 and front_left < 1.
    """
    rules = [
        (front > 1) & (front_left > 1) & (front_right > 0.5),
        (front < 2) & (front_left < 3) & (front_right > 0.5),
        (front < 1) & (front_left < 1) & (front_right < 1),
        (front < 1) & (front_left > 1) & (front_right < 1),
        (front_right > 0.7) & (front > 1) & (front_left > 1),
        (front_right < 0.5) & (front > 1) & (front_left > 1),
    ]
    number = np.full(np.shape(front), 7)
    for i in range(len(rules), 0, -1):  # the first that applies stays
        number[rules[i - 1]] = i
    return number


# (drive, angular) of rules 1 to 7 as printed, in units of `speed` and `turn_rate`.
ACTIONS = np.array([(1, 0), (1, 0), (0, -1), (0, -1), (0, +1), (0, -1), (0, 0)])

# Range of a sector from those of its beams, (n, k) -> (n,).
SECTORS = {
    "smallest": lambda ranges: np.minimum.reduce(ranges, axis=1),
    "mean": lambda ranges: ranges.mean(axis=1),
    "middle": lambda ranges: ranges[:, ranges.shape[1] // 2],
}


@dataclass(frozen=True)
class ReactiveLeader(Law):
    """Keeps to the right lane and turns left at walls, by five sectors of its scan (Algorithm 1).

    The sign of the turn: the text has the robot turn *left* at a wall, and the rules print an angular velocity of
    -0.1 there. So the paper's positive angular velocity is clockwise, against the convention of robotics (REP 103,
    positive to the left) that holds everywhere else in this project. `positive_turn` is the one place that says so.
    """

    speed: Annotated[Positive, Field(alias="speed_mps")] = 0.1  # forward
    turn_rate: Annotated[Positive, Field(alias="turn_rate_radps")] = 0.1  # at a wall
    positive_turn: Literal["clockwise", "counterclockwise"] = "clockwise"  # of the rules
    sector: Literal["smallest", "mean", "middle"] = "smallest"  # range of a sector; the text does not say which

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        ranges = sensed.scan.filled()
        k = sensed.scan.model.samples
        value = SECTORS[self.sector]
        front_right, front, front_left = [value(ranges[:, k * i // 5 : k * (i + 1) // 5]) for i in (1, 2, 3)]
        drive, angular = ACTIONS[rule(front, front_left, front_right) - 1].T
        to_the_left = -angular if self.positive_turn == "clockwise" else angular
        return Decision(Twist(drive * self.speed, to_the_left * self.turn_rate))
