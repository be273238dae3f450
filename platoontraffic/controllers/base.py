"""What every law is given and gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from lidar import LaserScan, ScanBatch
from platoontraffic.vehicle import Twist


@dataclass(frozen=True)
class Sensed:
    """What a law is given: rows (n, ...), or one vehicle's row."""

    scan: ScanBatch | LaserScan
    speed: np.ndarray  # own, by odometry [m/s], (n,)
    yaw_rate: np.ndarray  # own, to the left [rad/s], (n,)
    route: np.ndarray | None = None  # (n, k, 2) points of the given path ahead; see `Fleet.decided`

    def row(self, i: int) -> Sensed:
        route = None if self.route is None else self.route[i]
        return Sensed(self.scan[i], float(self.speed[i]), float(self.yaw_rate[i]), route)


class Target(NamedTuple):
    """What a law takes for its predecessor: floats or arrays (n,); NaN where it sees none."""

    distance: np.ndarray  # from the laser [m]
    bearing: np.ndarray  # from the laser's forward direction, to the left [rad]


NO_TARGET = Target(np.nan, np.nan)


class Decision(NamedTuple):
    """A command; what to remember; and what was taken for the predecessor, from which lock-on is measured."""

    twist: Twist
    memory: Any = None
    target: Target = NO_TARGET


def per_vehicle(law: Callable) -> Callable:
    """Lift a law's `__call__` written for one vehicle (a `LaserScan`, floats) to rows."""

    @wraps(law)
    def over_rows(self, sensed: Sensed, memory, dt: float) -> Decision:
        rows = range(len(sensed.speed))
        memories = memory or [None] * len(rows)
        decisions = [law(self, sensed.row(i), memories[i], dt) for i in rows]
        return Decision(
            Twist(*np.array([d.twist for d in decisions], dtype=float).T),
            [d.memory for d in decisions],
            Target(*np.array([d.target for d in decisions], dtype=float).T),
        )

    return over_rows
