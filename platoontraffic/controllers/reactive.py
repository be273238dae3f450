"""The paper's leader: Algorithm 1 of Soni & Hu."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import Decision, Law, Sensed
from platoontraffic.controllers.reactive_rules import SECTORS
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
        scan, model, n = sensed.scan, sensed.scan.model, sensed.speed.size
        twist, to_the_left = Twist(*np.empty((2, n))), -1 if self.positive_turn == "clockwise" else 1
        limits, rates = (model.range_min, model.range_max), (self.speed, self.turn_rate, to_the_left)
        _kernel().commands(scan.ranges, limits, SECTORS.index(self.sector), rates, *twist)
        return Decision(twist)


@cache
def _kernel():
    """Imported when it is first used: importing numba takes half a second."""
    from platoontraffic.controllers import reactive_kernel

    return reactive_kernel
