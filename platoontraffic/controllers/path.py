"""A leader on a given path, the other leader of the paper ("a leader robot has a predefined path")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from platoontraffic.controllers.base import Decision, Sensed
from platoontraffic.vehicle import Positive, Twist

NOWHERE = 1e9  # range of a beam that met nothing: farther than any distance to stop at [m]


@dataclass(frozen=True)
class PathLeader:
    """Pure pursuit of its route's lanes at constant speed; stops for what stands in its way.

    The turn is the arc through the point of the path one lookahead away (R. C. Coulter, Implementation of the pure
    pursuit path tracking algorithm, CMU-RI-TR-92-01, 1992): yaw rate = 2 v y / (x^2 + y^2). On a circle it is exact.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route"})

    speed: Annotated[Positive, Field(alias="speed_mps")] = 0.1
    lookahead: Annotated[Positive, Field(alias="lookahead_m")] = 0.15
    stop_distance: Annotated[float, Field(ge=0, alias="stop_distance_m")] = 0.35  # from the laser
    half_width: Annotated[Positive, Field(alias="half_width_m")] = 0.10  # of the strip that must be free

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        x, y, last = self._aim(sensed.route)
        ranges, angles = sensed.scan.filled(no_return=NOWHERE), sensed.scan.model.angles
        ahead, aside = ranges * np.cos(angles), ranges * np.sin(angles)
        blocked = ((np.abs(aside) < self.half_width) & (ahead < self.stop_distance) & (ahead > 0)).any(axis=1)
        arrived = last & (x < 1e-3)
        speed = np.where(blocked | arrived, 0.0, self.speed)
        return Decision(Twist(speed, 2 * speed * y / np.maximum(x**2 + y**2, 1e-6)))

    def _aim(self, route: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first point of the path at least one lookahead away, or its last.

        x ahead of the driven axle, y to the left, and whether no point was that far away; (n,) each.
        """
        away = np.hypot(route[..., 0], route[..., 1]) >= self.lookahead
        last = ~away.any(axis=1)
        aim = route[np.arange(len(route)), np.where(last, -1, away.argmax(axis=1))]
        return aim[:, 0], aim[:, 1], last
