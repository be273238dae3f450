"""The paper's follower with what it needs to do what the paper's Fig. 6 shows.

Three repairs of Algorithm 2, each switchable; with all of them off the law is the printed one.

nearest_group   The predecessor is the nearest group of neighbouring returns, not what lies between the first two steps
                of 0.5 m. The printed edges exist only while the predecessor is nearer than range_max - 0.5 m.
visible_middle  The border of the field of view counts as an end of the predecessor: its middle is that of the part in
                sight. As printed both rear corners must be seen, which fails nearer than width / (2 tan 11.5 deg).
stand_off       v = 1.1107 (D - stand_off). As printed the wanted distance at 0.1 m/s is 0.09 m, where the laser is
                blind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from lidar import LaserScan
from platoontraffic.controllers.base import Decision, Sensed, Target, per_vehicle
from platoontraffic.controllers.printed import (
    SPEED_GAIN,
    SUFFICIENT_DISTANCE,
    Middle,
    arc_speed,
    edges,
    middle,
)
from platoontraffic.vehicle import Positive, Twist


@dataclass(frozen=True)
class RepairedFollower:
    """Follows the middle of the visible part of the nearest group of returns, at a stand-off."""

    nearest_group: bool = True
    visible_middle: bool = True
    stand_off: Annotated[float, Field(ge=0, alias="stand_off_m")] = 0.45
    heading_gain: Annotated[Positive, Field(alias="heading_gain_per_s")] = 1.0
    # Neighbouring beams (0.03 deg apart) on one robot differ by millimetres, robot and wall by decimetres.
    group_step: Annotated[Positive, Field(alias="group_step_m")] = 0.1

    @per_vehicle
    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        found = self.find(sensed.scan)
        if found is None:
            return Decision(Twist(0.0, 0.0))
        distance, theta = found
        bearing = theta - np.pi / 2
        target = Target(distance, bearing)
        if self.stand_off == 0 and distance <= SUFFICIENT_DISTANCE:
            return Decision(Twist(0.0, 0.0), target=target)
        speed = arc_speed(max(distance - self.stand_off, 0.0), theta)
        return Decision(Twist(speed, self.heading_gain * bearing), target=target)

    def find(self, scan: LaserScan) -> Middle | None:
        """The middle between the first and the last return of the predecessor, or None."""
        ranges = scan.filled()
        span = self._nearest_group(scan, ranges) if self.nearest_group else self._between_edges(scan, ranges)
        if span is None:
            return None
        first, last = span
        if not self.visible_middle and (first == 0 or last == len(ranges) - 1):
            return None
        return middle(scan, ranges, first, last)

    def _nearest_group(self, scan: LaserScan, ranges: np.ndarray) -> tuple[int, int] | None:
        """First and last beam of the run of neighbouring returns around the nearest one."""
        beams = np.flatnonzero(~np.isnan(scan.ranges))  # a lost return tells nothing, and parts nothing
        met, ranges = returned(scan)[beams], ranges[beams]
        if not met.any():
            return None
        nearest = int(np.argmin(np.where(met, ranges, np.inf)))
        breaks = np.flatnonzero((np.abs(np.diff(ranges)) > self.group_step) | ~met[1:] | ~met[:-1])
        after = np.searchsorted(breaks, nearest)
        first = 0 if after == 0 else breaks[after - 1] + 1
        last = len(ranges) - 1 if after == len(breaks) else breaks[after]
        return int(beams[first]), int(beams[last])

    def _between_edges(self, scan: LaserScan, ranges: np.ndarray) -> tuple[int, int] | None:
        """First and last beam between the first two edges of Algorithm 2, borders of the view counted if wanted."""
        found = edges(scan, ranges)
        if self.visible_middle:
            if len(found) == 0:
                return (0, len(ranges) - 1) if returned(scan).all() else None
            # A first edge that steps out, away from the robot, is the far end of something cut by the border.
            if ranges[found[0] + 1] > ranges[found[0]]:
                return 0, int(found[0])
            last = found[1] if len(found) > 1 else len(ranges) - 1
            return int(found[0]) + 1, int(last)
        return (int(found[0]) + 1, int(found[1])) if len(found) >= 2 else None

    def desired_distance(self, speed):
        """Distance from laser to rear at which a steady speed is kept straight ahead [m]."""
        return self.stand_off + speed / SPEED_GAIN


def returned(scan: LaserScan) -> np.ndarray:
    """Which beams met something, be it too close to be measured, (k,)."""
    return ~(np.isposinf(scan.ranges) | np.isnan(scan.ranges))
