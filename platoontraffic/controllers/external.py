"""The seat of a law that is outside of the simulation: an environment, or a program that steps it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import MAX_HEADWAY, Decision, Known, Law, Sensed
from platoontraffic.controllers.policy import group_target
from platoontraffic.lidar import LidarModel
from platoontraffic.vehicles.motion import NotNegative, Twist


class Given(NamedTuple):
    """What the seat was given at the last decision, as in `Sensed`, for the program that drives it."""

    truth: Known | None
    messages: Known | None


@dataclass(frozen=True)
class External(Law):
    """Stands still, but for the commands that `Simulation.step` is given for it.

    Its target, from which lock is measured, is the nearest group of returns within a view straight ahead.
    """

    view: Annotated[float, Field(gt=0, le=math.tau, alias="view_rad")] = math.radians(23.0)  # of its target
    # Distance from laser to rear that it is to keep, for the spacing error: at rest; None: none.
    stand_off: Annotated[NotNegative | None, Field(alias="stand_off_m")] = None
    headway: Annotated[NotNegative, Field(alias="headway_s", le=MAX_HEADWAY)] = 0.0  # what it grows by with the speed
    # Other members that whoever drives it observes.
    observes: Annotated[tuple[Literal["truth", "messages", "leader"], ...], Field(alias="needs")] = ()

    def __post_init__(self) -> None:
        if self.needs == {"leader"}:
            raise ValueError("needs: 'leader' must stand beside 'truth' or 'messages', which say how it is known")

    @property
    def needs(self) -> frozenset[str]:
        return frozenset(self.observes)

    def __call__(self, sensed: Sensed, memory: Given | None, dt: float) -> Decision:
        still = np.zeros(sensed.speed.size)
        given = Given(sensed.truth, sensed.messages) if self.observes else None
        return Decision(Twist(still, still), given, group_target(sensed.scan, self._beams_in_view(sensed.scan.model)))

    def _beams_in_view(self, lidar: LidarModel) -> tuple[int, int]:
        """The first one, and the one after the last."""
        if (key := ("view", self.view)) not in lidar.kept:
            ahead = np.abs(lidar.angles + lidar.mount.yaw) <= self.view / 2 * (1 + 1e-9)
            beams = np.flatnonzero(ahead)
            lidar.kept[key] = (int(beams[0]), int(beams[-1]) + 1) if len(beams) else (0, 0)
        return lidar.kept[key]

    def desired_distance(self, speed):
        """Distance from laser to rear that it is to keep [m]; NaN: none."""
        return (np.nan if self.stand_off is None else self.stand_off) + self.headway * speed
