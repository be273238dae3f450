"""The paper's leader: Algorithm 1 of Soni & Hu."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import Decision, Law, Sensed
from platoontraffic.controllers.reactive_rules import ACTIONS, SECTORS
from platoontraffic.vehicles.motion import Positive, Twist


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
        from platoontraffic.controllers.reactive_kernel import rules  # importing numba takes half a second

        scan, model = sensed.scan, sensed.scan.model
        numbers = np.empty(len(scan.ranges), dtype=np.intp)
        rules(scan.ranges, model.range_min, model.range_max, SECTORS.index(self.sector), numbers)
        drive, angular = ACTIONS[numbers - 1].T
        to_the_left = -angular if self.positive_turn == "clockwise" else angular
        return Decision(Twist(drive * self.speed, to_the_left * self.turn_rate))
