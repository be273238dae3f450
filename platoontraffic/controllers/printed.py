"""The paper's follower: Algorithm 2 of Soni & Hu, exactly as printed.

Where the text is open, every reading is a named option; the default is the one taken by this project. The polar angle
theta has straight ahead at pi/2 (x to the right, y forward), since the printed `angvel = theta - 90` must vanish there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lidar import LaserScan
from platoontraffic.controllers.base import NO_TARGET, Decision, Sensed, Target, per_vehicle
from platoontraffic.vehicle import Positive, Twist

EDGE_STEP = 0.5  # neighbouring ranges, and neighbouring points, of an edge differ by more [m]
SUFFICIENT_DISTANCE = 0.1  # [m]
SPEED_GAIN = (np.pi / 2) / (2 * np.sin(np.pi / 4))  # straight ahead v = 1.1107 D [1/s]
FAR = 1e9  # stands for infinity where neighbours are subtracted [m]


class Middle(NamedTuple):
    """The middle of the predecessor's rear in the paper's polar coordinates."""

    distance: float
    theta: float  # polar angle; straight ahead at pi/2


def points(scan: LaserScan, ranges: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Returns of some beams (m,) as points (m, 2), x to the right and y forward of the laser."""
    theta = scan.angle_min + scan.angle_increment * beams + np.pi / 2
    return ranges[beams, None] * np.column_stack([np.cos(theta), np.sin(theta)])


def edges(scan: LaserScan, ranges: np.ndarray, rule: str = "absolute") -> np.ndarray:
    """Indices i of the edges between beam i and beam i + 1: lines 1-16 of Algorithm 2."""
    step = np.diff(ranges)
    found = np.flatnonzero((np.abs(step) if rule == "absolute" else step) > EDGE_STEP)
    width = np.hypot(*(points(scan, ranges, found + 1) - points(scan, ranges, found)).T)
    return found[width > EDGE_STEP]


def middle(scan: LaserScan, ranges: np.ndarray, first: int, last: int) -> Middle:
    """Midway between the returns of two beams: lines 17-19 and 21."""
    x, y = points(scan, ranges, np.array([first, last])).mean(axis=0)
    return Middle(float(np.hypot(x, y)), float(np.arctan2(y, x)))


def arc_speed(distance: float, theta: float) -> float:
    """Lines 23-24: r = D / (2 sin(theta/2)), v = r theta."""
    return distance * theta / (2 * np.sin(theta / 2))


@dataclass(frozen=True)
class PrintedFollower:
    """Follows the middle between the first two edges of the scan (Algorithm 2).

    Straight ahead this is a constant-time-headway law: v = 1.1107 D, headway 0.900 s, no stand-off.
    """

    edge: Literal["absolute", "signed"] = "absolute"  # signed, as printed: range[i+1] - range[i] > 0.5
    no_return: Literal["range_max", "infinity"] = "range_max"  # the value of a beam that met nothing
    yaw_unit: Literal["rad", "deg"] = "rad"  # deg: theta - 90 in degrees taken as rad/s
    angle_in_speed: Literal["polar", "bearing"] = "polar"  # theta in lines 23-24
    on_loss: Literal["stop", "hold"] = "stop"  # with fewer than two edges
    heading_gain: Annotated[Positive, Field(alias="heading_gain_per_s")] = 1.0
    sufficient_distance: Annotated[float, Field(ge=0, alias="sufficient_distance_m")] = SUFFICIENT_DISTANCE

    @per_vehicle
    def __call__(self, sensed: Sensed, memory: Twist | None, dt: float) -> Decision:
        found = self.find(sensed.scan)
        if found is None:
            twist = memory if memory is not None and self.on_loss == "hold" else Twist(0.0, 0.0)
            return Decision(twist, twist, NO_TARGET)
        distance, theta = found
        bearing = theta - np.pi / 2
        twist = Twist(0.0, 0.0)
        if distance > self.sufficient_distance:
            gain = self.heading_gain * (np.degrees(1) if self.yaw_unit == "deg" else 1)
            speed = arc_speed(distance, theta if self.angle_in_speed == "polar" else _not_zero(bearing))
            twist = Twist(speed, gain * bearing)
        return Decision(twist, twist, Target(distance, bearing))

    def find(self, scan: LaserScan) -> Middle | None:
        """Lines 1-19: the middle between the second point of the first edge and the first point of the second."""
        ranges = scan.filled(no_return=FAR if self.no_return == "infinity" else None)
        found = edges(scan, ranges, self.edge)
        return middle(scan, ranges, found[0] + 1, found[1]) if len(found) >= 2 else None

    def desired_distance(self, speed):
        """Distance from laser to rear at which a steady speed is kept straight ahead [m]."""
        return speed / (SPEED_GAIN if self.angle_in_speed == "polar" else 1.0)


def _not_zero(angle: float) -> float:
    """theta / sin(theta / 2) has the limit 2 at zero."""
    return angle if abs(angle) > 1e-9 else 1e-9
