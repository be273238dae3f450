"""The paper's follower: Algorithm 2 of Soni & Hu, exactly as printed.

Where the text is ambiguous, every reading is a named option; the default is the one that this project takes. The polar
angle theta is pi/2 straight ahead (x to the right, y forward): the printed `angvel = theta - 90` must vanish there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers.law import Decision, Law, Linear, Sensed, Target
from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.vehicles.motion import Positive, Twist

EDGE_STEP = 0.5  # neighbouring ranges, and neighbouring points, of an edge differ by more [m]
SUFFICIENT_DISTANCE = 0.1  # [m]
SPEED_GAIN = (np.pi / 2) / (2 * np.sin(np.pi / 4))  # straight ahead v = 1.1107 D [1/s]
NEARLY_ZERO = 1e-9  # stands for an angle of zero, at which theta / sin(theta / 2) has the limit 2 [rad]
FAR = 1e9  # stands for infinity where neighbours are subtracted [m]


class Middle(NamedTuple):
    """The middle of the predecessor's rear in the paper's polar coordinates. Arrays (n,); NaN where none is seen."""

    distance: np.ndarray  # from the laser [m]
    theta: np.ndarray  # polar angle [rad]; pi/2 straight ahead


def points(model: LidarModel, ranges: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Returns of some beams, ranges [m] and beams (...), as points (2, ...): x to the right, y forward of the laser."""
    theta = model.angle_min + model.angle_increment * beams + np.pi / 2
    return ranges * np.array([np.cos(theta), np.sin(theta)])


def edges(model: LidarModel, ranges: np.ndarray, rule: str = "absolute") -> tuple[np.ndarray, np.ndarray]:
    """Scans s and beams i, in order, with an edge between beam i and beam i + 1: lines 1-16 of Algorithm 2.

    ranges : of all scans [m], (n, k)
    rule   : "absolute" or "signed": the edges are steps of either sign, or those outwards only
    """
    step = np.diff(ranges)
    s, i = np.nonzero((np.abs(step) if rule == "absolute" else step) > EDGE_STEP)
    width = np.hypot(*(points(model, ranges[s, i + 1], i + 1) - points(model, ranges[s, i], i)))
    wide = width > EDGE_STEP
    return s[wide], i[wide]


def first_edges(scans: np.ndarray, beams: np.ndarray, n: int, most: int) -> np.ndarray:
    """The first edges of each of n scans, (most, n); -1 where a scan has fewer.

    scans, beams : of all edges, in order, (m,)
    """
    place = np.arange(len(scans)) - np.searchsorted(scans, scans)  # of an edge among those of its scan
    counts = place < most
    first = np.full((most, n), -1)
    first[place[counts], scans[counts]] = beams[counts]
    return first


def first_two(scans: np.ndarray, beams: np.ndarray, n: int) -> np.ndarray:
    """The first two edges of each of n scans, (2, n); see `first_edges`."""
    return first_edges(scans, beams, n, 2)


def last_edge(scans: np.ndarray, beams: np.ndarray, n: int) -> np.ndarray:
    """The last edge of each of n scans, (n,); -1 where a scan has none."""
    last = np.full(n, -1)
    last[scans] = beams  # of several the last one stays
    return last


def middle(model: LidarModel, ranges: np.ndarray, ends: np.ndarray) -> Middle:
    """Midway between the returns of two beams: lines 17-19 and 21.

    ranges : of all scans [m], (n, k)
    ends   : the two beams of each scan, (2, n); -1: none
    """
    returns = np.where(ends < 0, np.nan, ranges[np.arange(ranges.shape[0]), ends])
    (first_x, last_x), (first_y, last_y) = points(model, returns, ends)
    x, y = (first_x + last_x) / 2, (first_y + last_y) / 2
    return Middle(np.hypot(x, y), np.arctan2(y, x))


def arc_speed(distance: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Lines 23-24: r = D / (2 sin(theta/2)), v = r theta [m/s]. Arrays (n,), or numbers."""
    theta = theta + NEARLY_ZERO * (theta == 0)
    return distance * theta / (2 * np.sin(theta / 2))


@dataclass(frozen=True)
class PrintedFollower(Law):
    """Follows the middle between the first two edges of the scan (Algorithm 2).

    Straight ahead this is a constant-time-headway law: v = 1.1107 D, headway 0.900 s, no stand-off.

    The middle is one of two points; `between` says which:
        first_two  the second point of the first edge, and the first point of the second: the ends of the first body
        last_edge  both points of the last edge: lines 13 and 14 overwrite x1 and x2 in each turn of the loop
        offsets    x1[i + 1] and x2[i + 2] with i = 0: the first point of the second edge, the second of the third
    The frame of theta:
        x_right    straight ahead is 90 degrees
        x_forward  straight ahead is 0, as in the laser's own frame (REP 103): theta - 90 then turns to the right
    """

    edge: Literal["absolute", "signed"] = "absolute"  # signed, as printed: range[i+1] - range[i] > 0.5
    no_return: Literal["range_max", "infinity"] = "range_max"  # the range of a beam without a return
    yaw_unit: Literal["rad", "deg"] = "rad"  # deg: theta - 90 in degrees taken as rad/s
    angle_in_speed: Literal["polar", "bearing"] = "polar"  # theta in lines 23-24
    between: Literal["first_two", "last_edge", "offsets"] = "first_two"  # lines 13 to 18: see above
    frame: Literal["x_right", "x_forward"] = "x_right"  # of theta: see above
    on_loss: Literal["stop", "hold"] = "stop"  # with too few edges; hold: line 20 has no "else"
    heading_gain: Annotated[Positive, Field(alias="heading_gain_per_s")] = 1.0  # yaw rate by bearing
    # It stands where the target is nearer.
    sufficient_distance: Annotated[float, Field(ge=0, alias="sufficient_distance_m")] = SUFFICIENT_DISTANCE

    def __call__(self, sensed: Sensed, memory: Twist | None, dt: float) -> Decision:
        distance, polar = self.find(sensed.scan)
        bearing = polar - np.pi / 2
        theta = polar if self.frame == "x_right" else bearing
        not_zero = np.where(np.abs(bearing) > NEARLY_ZERO, bearing, NEARLY_ZERO)
        speed = arc_speed(distance, theta if self.angle_in_speed == "polar" else not_zero)
        gain = self.heading_gain * (np.degrees(1) if self.yaw_unit == "deg" else 1)
        twist = np.where(distance > self.sufficient_distance, (speed, gain * (theta - np.pi / 2)), 0.0)
        if self.on_loss == "hold" and memory is not None:
            twist = np.where(np.isnan(distance), memory, twist)
        twist = Twist(*twist)
        return Decision(twist, twist, Target(distance, bearing))

    def find(self, scan: ScanBatch) -> Middle:
        """Lines 1-19: the middle between two points; the polar angle is pi/2 straight ahead, whatever the frame."""
        ranges = scan.filled(no_return=FAR if self.no_return == "infinity" else None)
        found = edges(scan.model, ranges, self.edge)
        if self.between == "last_edge":
            last = last_edge(*found, len(scan))
            ends = np.where(last < 0, -1, (last, last + 1))
        elif self.between == "offsets":
            _, second, third = first_edges(*found, len(scan), 3)
            ends = np.where(third < 0, -1, (second, third + 1))
        else:
            first, second = first_two(*found, len(scan))
            ends = np.where(second < 0, -1, (first + 1, second))
        return middle(scan.model, ranges, ends)

    def desired_distance(self, speed):
        """Distance from laser to rear that holds a steady speed straight ahead [m]."""
        return speed / self._speed_gain

    def linear(self, speed: float, place: int) -> Linear:
        return Linear(gap=self._speed_gain, commands="speed")

    @property
    def _speed_gain(self) -> float:
        """Straight ahead [1/s]."""
        return SPEED_GAIN if self.angle_in_speed == "polar" and self.frame == "x_right" else 1.0
