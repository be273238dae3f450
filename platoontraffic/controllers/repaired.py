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
from typing import Annotated

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import Decision, Law, Sensed, Target
from platoontraffic.controllers.printed import (
    SPEED_GAIN,
    SUFFICIENT_DISTANCE,
    Middle,
    arc_speed,
    edges,
    first_two,
    middle,
)
from platoontraffic.lidar import ScanBatch
from platoontraffic.vehicles.motion import Positive, Twist


@dataclass(frozen=True)
class RepairedFollower(Law):
    """Follows the middle of the visible part of the nearest group of returns, at a stand-off."""

    nearest_group: bool = True
    visible_middle: bool = True
    stand_off: Annotated[float, Field(ge=0, alias="stand_off_m")] = 0.45
    heading_gain: Annotated[Positive, Field(alias="heading_gain_per_s")] = 1.0
    # Neighbouring beams (0.03 deg apart) on one robot differ by millimetres, robot and wall by decimetres.
    group_step: Annotated[Positive, Field(alias="group_step_m")] = 0.1

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        distance, theta = self.find(sensed.scan)
        bearing = theta - np.pi / 2
        speed = arc_speed(np.maximum(distance - self.stand_off, 0.0), theta)
        sufficient = SUFFICIENT_DISTANCE if self.stand_off == 0 else -np.inf
        twist = np.where(distance > sufficient, (speed, self.heading_gain * bearing), 0.0)
        return Decision(Twist(*twist), target=Target(distance, bearing))

    def find(self, scan: ScanBatch) -> Middle:
        """The middle between the first and the last return of the predecessor."""
        ranges, ends = self._nearest_group(scan) if self.nearest_group else self._between_edges(scan)
        if not self.visible_middle:
            first, last = ends
            ends = np.where((first > 0) & (last < scan.model.samples - 1), ends, -1)
        return middle(scan.model, ranges, ends)

    def _nearest_group(self, scan: ScanBatch) -> tuple[np.ndarray, np.ndarray]:
        """Ranges (n, k), and the first and last beam of the run of neighbouring returns around the nearest, (2, n)."""
        n, k = scan.ranges.shape
        # All scans in one line, a miss before each and after the last, so that no run reaches into the next scan.
        table = np.full((n + 1, k + 1), np.inf)
        table[:n, 1:] = scan.ranges
        table[table == -np.inf] = scan.model.range_min
        line = table.ravel()
        lost = np.isnan(line)  # an erroneous return ends no group: it repeats the return before it
        again = before(lost)
        line[lost] = line[again]

        nearest = table[:n].argmin(axis=1)
        met = np.flatnonzero(nearest)  # scans with a return; in the others the miss before them is the nearest
        with np.errstate(invalid="ignore"):  # from miss to miss inf - inf is NaN, which is no step
            step = np.diff(line)
        breaks = np.flatnonzero(np.abs(step, out=step) > self.group_step)
        begins = met * (k + 1)
        after = np.searchsorted(breaks, begins + nearest[met])
        first, last = breaks[after - 1] + 1, breaks[after]
        trailing = lost[last]
        last[trailing] = again[np.searchsorted(np.flatnonzero(lost), last[trailing])]

        ends = np.full((2, n), -1)
        ends[:, met] = (first, last) - begins - 1
        return table[:n, 1:], ends

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


def before(lost: np.ndarray) -> np.ndarray:
    """Index of the last sound return before each lost one, (m,).

    lost : mask of the lost returns of a line, (k,); the first return is sound
    """
    places = np.flatnonzero(lost)
    begins = np.diff(places, prepend=-1) > 1  # of a run of lost returns
    return np.maximum.accumulate(np.where(begins, places, 0)) - 1
