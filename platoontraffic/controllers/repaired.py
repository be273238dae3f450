"""The paper's follower with three repairs, which make it drive as the paper's Fig. 6 shows.

The repairs of Algorithm 2 can be switched off one by one; without all three the law is the printed one.

nearest_group   The predecessor is the nearest group of neighbouring returns, not the part of the scan between the first
                two steps of 0.5 m. The printed edges exist only while it is nearer than range_max - 0.5 m.
visible_middle  The border of the field of view counts as an end of the predecessor: the middle is that of its visible
                part. As printed both rear corners must be seen, which fails nearer than width / (2 tan 11.5 deg).
stand_off       v = 1.1107 (D - stand_off). As printed the distance kept at 0.1 m/s is 0.09 m, where the laser is
                blind.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import Decision, Law, Linear, Sensed, Target
from platoontraffic.controllers.printed import (
    SPEED_GAIN,
    SUFFICIENT_DISTANCE,
    Middle,
    edges,
    first_two,
    middle,
)
from platoontraffic.lidar import ScanBatch
from platoontraffic.vehicles.motion import Positive, Twist


@dataclass(frozen=True)
class RepairedFollower(Law):
    """Follows the middle of the visible part of the nearest group of returns, at a stand-off."""

    nearest_group: bool = True  # the predecessor is the nearest group of returns; see above
    visible_middle: bool = True  # the border of the view counts as an end of the predecessor
    stand_off: Annotated[float, Field(ge=0, alias="stand_off_m")] = 0.45  # laser to rear at rest
    heading_gain: Annotated[Positive, Field(alias="heading_gain_per_s")] = 1.0  # yaw rate by bearing
    # Neighbouring beams (0.03 deg apart) on one robot differ by millimetres, robot and wall by decimetres.
    group_step: Annotated[Positive, Field(alias="group_step_m")] = 0.1

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        distance, theta = self.find(sensed.scan)
        twist = Twist(*np.empty((2, distance.size)))
        sufficient = SUFFICIENT_DISTANCE if self.stand_off == 0 else -np.inf
        _kernel().commands(distance, theta, self.stand_off, sufficient, self.heading_gain, *twist)
        return Decision(twist, target=Target(distance, theta - np.pi / 2))

    def find(self, scan: ScanBatch) -> Middle:
        """The middle between the first and the last return of the predecessor."""
        if self.nearest_group:
            return self.nearest_middle(scan, (0, scan.model.samples))
        ranges, ends = self._between_edges(scan)
        if not self.visible_middle:
            first, last = ends
            ends = np.where((first > 0) & (last < scan.model.samples - 1), ends, -1)
        return middle(scan.model, ranges, ends)

    def nearest_middle(self, scan: ScanBatch, view: tuple[int, int]) -> Middle:
        """The middle between the first and the last return of the nearest run of neighbouring returns.

        view: first beam that counts, and the one after the last
        """
        model, n = scan.model, scan.ranges.shape[0]
        x, y = np.empty((2, n))
        fan = float(model.angle_min), float(model.angle_increment)
        _kernel().middles(scan.ranges, view, model.range_min, self.group_step, not self.visible_middle, fan, x, y)
        return Middle(np.hypot(x, y), np.arctan2(y, x))

    def nearest(self, scan: ScanBatch) -> tuple[np.ndarray, np.ndarray]:
        """Ranges (n, k), and the first and last beam of the run of neighbouring returns around the nearest, (2, n)."""
        ranges = np.empty(scan.ranges.shape)
        ends = np.empty((2, ranges.shape[0]), dtype=np.intp)
        _kernel().nearest_groups(scan.ranges, scan.model.range_min, self.group_step, ranges, ends)
        return ranges, ends

    def _between_edges(self, scan: ScanBatch) -> tuple[np.ndarray, np.ndarray]:
        """Ranges (n, k), and the first and last beam between the first two edges of Algorithm 2, (2, n).

        The borders of the view count as edges if `visible_middle` is set.
        """
        ranges = scan.filled()
        n, k = ranges.shape
        first, second = first_two(*edges(scan.model, ranges), n)
        if not self.visible_middle:
            return ranges, np.where(second < 0, -1, (first + 1, second))
        rows, none = np.arange(n), first < 0
        whole = none & (scan.ranges < np.inf).all(axis=1)  # every beam has a return, or is blocked
        # A first edge outwards, away from the robot, is the far end of an object that the border cuts.
        out = ranges[rows, first + 1] > ranges[rows, first]
        return ranges, np.stack(
            [
                np.select([whole, none, out], [0, -1, 0], first + 1),
                np.select([whole, none, out, second < 0], [k - 1, -1, first, k - 1], second),
            ]
        )

    def desired_distance(self, speed):
        """Distance from laser to rear that holds a steady speed straight ahead [m]."""
        return self.stand_off + speed / SPEED_GAIN

    def linear(self, speed: float, place: int) -> Linear:
        return Linear(gap=SPEED_GAIN, commands="speed")


@cache
def _kernel():
    """Imported when it is first used: importing numba takes half a second."""
    from platoontraffic.controllers import repaired_kernel

    return repaired_kernel
