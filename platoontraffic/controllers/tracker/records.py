"""Records and constants that the tracker shares with its compiled kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

X, Y, HEADING, SPEED, ACCELERATION, CURVATURE = range(6)  # elements of a track's state

OVERHANG = 1.0  # assumed distance from a vehicle's rear axle to its rear [m]; cars have 0.8 to 1.2
UNKNOWN_SPEED = 5.0  # least standard deviation of the speed of a new predecessor, which is taken for the own [m/s]
HIDDEN = 0.25  # time after which a vehicle that has cut in takes the place of a predecessor that it hides [s]
CUTS_IN = 0.5  # share of the own speed from which an obstacle on the strip is a vehicle that drives ahead [1]


class Hiding(NamedTuple):
    """The first obstacle on the strip, which may hide the predecessor, arrays (n,)."""

    distance: np.ndarray  # from the laser [m]; inf: there is none
    speed: np.ndarray  # [m/s]; NaN: not known
    acceleration: np.ndarray  # [m/s2]


class Laser(NamedTuple):
    """Mount, resolution and noise of the scanners."""

    forward: np.ndarray  # of the own driven axle [m], (n,)
    left: float  # of the own driven axle [m]
    yaw: float  # of the forward direction, to the left [rad]
    increment: float  # angle from beam to beam [rad]
    sigma: float  # standard deviation of a range at no distance [m]
    sigma_per_metre: float  # growth of that with distance


class Groups(NamedTuple):
    """Columns of `lidar.segments.Segments`, with the same names and meanings: g groups of all n scans."""

    offset: np.ndarray
    first: np.ndarray
    last: np.ndarray
    count: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    line_heading: np.ndarray
    line_distance: np.ndarray
    line_rms: np.ndarray
    corner: np.ndarray
    leg_heading: np.ndarray
    leg_lengths: np.ndarray
    corner_rms: np.ndarray
    convex: np.ndarray


class Sighting(NamedTuple):
    """The predecessors in one scan."""

    rear: np.ndarray  # distance [m] and bearing [rad] of the rear's centre from the laser, (n, 2); NaN: not seen
    beams: np.ndarray  # first and last beam on the predecessor, (n, 2); -1: not seen

    @classmethod
    def none(cls, n: int) -> Sighting:
        rear, beams = np.empty((n, 2)), np.empty((n, 2), dtype=np.intp)
        rear.fill(np.nan)
        beams.fill(-1)
        return cls(rear, beams)

    def without(self, rows: np.ndarray) -> Sighting:
        """The same without some rows, (n,) bool."""
        return Sighting(np.where(rows[:, None], np.nan, self.rear), np.where(rows[:, None], -1, self.beams))
