"""What every law is given and gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.lidar import LaserScan, ScanBatch
from platoontraffic.vehicles.motion import Drive, Twist


class Body(NamedTuple):
    """A vehicle's own size: floats, or arrays (n,)."""

    length: np.ndarray  # of the footprint [m]
    width: np.ndarray
    axle: np.ndarray  # the driven one, ahead of the centre [m]; negative: behind it


class RouteAhead(NamedTuple):
    """The given route from beside the driven axle on: rows (n, ...) of k points, or one vehicle's row."""

    distance: np.ndarray  # of the points, along the route [m], (n, k); from 0 on, close together at first
    points: np.ndarray  # as seen from the driven axle, x forward, y to the left [m], (n, k, 2)
    limit: np.ndarray  # of speed, from each point on [m/s], (n, k)
    curvature: np.ndarray  # of the route, to the left [1/m], (n, k)


CLOSED_BY = ("", "light", "right of way", "lane change", "no room behind the junction")


class Signals(NamedTuple):
    """The next stop line on the given route: rows (n,), or one vehicle's row."""

    distance: np.ndarray  # from the front bumper [m]; inf: there is none
    open: np.ndarray  # lights, right of way and the queue behind the junction let this vehicle pass now, bool
    minor: np.ndarray  # it has to give way there, bool
    changing: np.ndarray  # closed, but it need not be stopped for by who cannot in comfort (yellow), bool
    reason: np.ndarray  # why it is closed, or would be: an index of CLOSED_BY


@dataclass(frozen=True)
class Sensed:
    """What a law is given: rows (n, ...), or one vehicle's row."""

    scan: ScanBatch | LaserScan
    speed: np.ndarray  # own, by odometry [m/s], (n,)
    yaw_rate: np.ndarray  # own, to the left [rad/s], (n,)
    body: Body | None = None
    route: RouteAhead | None = None  # to those that declare it in `needs`
    signals: Signals | None = None  # same
    leads: np.ndarray | None = None  # told to follow nobody, bool (n,)

    def row(self, i: int) -> Sensed:
        body, route, signals = (
            record and type(record)(*(values[i] for values in record))
            for record in (self.body, self.route, self.signals)
        )
        leads = None if self.leads is None else bool(self.leads[i])
        return Sensed(self.scan[i], float(self.speed[i]), float(self.yaw_rate[i]), body, route, signals, leads)


class Target(NamedTuple):
    """What a law takes for its predecessor: floats or arrays (n,); NaN where it sees none."""

    distance: np.ndarray  # from the laser [m]
    bearing: np.ndarray  # from the laser's forward direction, to the left [rad]


NO_TARGET = Target(np.nan, np.nan)


class Decision(NamedTuple):
    """A command; what to remember; and what was taken for the predecessor, from which lock-on is measured.

    What is remembered is None, or arrays, lists, NamedTuples or dataclasses of them, with one row a vehicle: vehicles
    that arrive are taken out of it. A law that remembers a path to drive may tell it, for those who watch, by a method
    `remembered_path(memory)`: points as seen from the driven axle, x forward, y to the left [m], (n, k, 2); NaN where
    there are fewer.
    """

    command: Twist | Drive
    memory: Any = None
    target: Target = NO_TARGET


def per_vehicle(law: Callable) -> Callable:
    """Lift a law's `__call__` written for one vehicle (a `LaserScan`, floats) to rows."""

    @wraps(law)
    def over_rows(self, sensed: Sensed, memory, dt: float) -> Decision:
        rows = range(len(sensed.speed))
        memories = memory or [None] * len(rows)
        decisions = [law(self, sensed.row(i), memories[i], dt) for i in rows]
        commands = [d.command for d in decisions]
        return Decision(
            type(commands[0])(*np.array(commands, dtype=float).T),
            [d.memory for d in decisions],
            Target(*np.array([d.target for d in decisions], dtype=float).T),
        )

    return over_rows
