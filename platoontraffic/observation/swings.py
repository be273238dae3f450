"""Which of two vehicles has swung its rear into the other, by turning about its front bumper.

SUMO's vehicles keep their front bumper on the line of their lane and point along it: at a sharp bend or kink the rear
sweeps across the road at once. The rear axle of a vehicle on wheels follows the front along a tractrix, the curve of a
point that is drawn at a fixed distance and does not slip sideways. A vehicle has swung into another one if the two
would not touch had its rear followed its front, and would not within GOES_ON either if both went straight on. It is the
cause if the other is on its own side of the road; inside a junction and on a one-way road, on a lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import shapely

AXLE = 0.77  # distance of a rear axle behind the front bumper [lengths]: that of the car in `vehicles.bicycle`
SWUNG = 0.5  # least displacement of the rear bumper by which a vehicle has swung [m]
AT_ONCE = 2.0  # motion of a front sideways in one step that is a lane change at once; at kinks it is less [m]
GOES_ON = 2.0  # time for which the rest of the contact is foreseen [s]
TIMES = 21  # instants of that


class Outline(NamedTuple):
    """The footprint of a vehicle, by the middle of its front bumper [m], [rad]."""

    x: float
    y: float
    heading: float
    length: float
    width: float

    def moved(self, dx: float, dy: float) -> shapely.Polygon:
        along = np.array([math.cos(self.heading), math.sin(self.heading)])
        left, front = np.array([-along[1], along[0]]) * self.width / 2, np.array([self.x + dx, self.y + dy])
        rear = front - along * self.length
        return shapely.Polygon([front + left, rear + left, rear - left, front - left])


class Course(NamedTuple):
    """A vehicle up to a contact: its front bumper and heading at k instants, (k,), and its size [m]."""

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    length: float
    width: float

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, heading: np.ndarray, length: float, width: float) -> Course:
        """By the centres of its footprint, (k,)."""
        return cls(x + length / 2 * np.cos(heading), y + length / 2 * np.sin(heading), heading, length, width)

    def outline(self) -> Outline:
        """At the last instant."""
        return Outline(*(float(values[-1]) for values in self[:3]), self.length, self.width)

    def trailed(self) -> Outline:
        """The same with the heading that it would have if its rear axle had followed its front."""
        return self.outline()._replace(heading=trailing(self.x, self.y, float(self.heading[0]), AXLE * self.length))

    def jumps(self) -> bool:
        """It was put sideways in one step."""
        return bool(np.any(np.abs(sideways(self.x, self.y, self.heading)) > AT_ONCE))


def sideways(x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Motion of front bumpers (k,) to the left from each instant to the next, across the mean heading [m], (k - 1,)."""
    mean = heading[:-1] + ((np.diff(heading) + np.pi) % (2 * np.pi) - np.pi) / 2
    return np.diff(y) * np.cos(mean) - np.diff(x) * np.sin(mean)


def trailing(x: np.ndarray, y: np.ndarray, heading: float, axle: float) -> float:
    """Heading of a tractrix after its front end has been at points (k,) [rad].

    heading : at the first point [rad]
    axle    : length of the tractrix [m]
    """
    dx, dy = math.cos(heading), math.sin(heading)
    for step_x, step_y in zip(np.diff(x).tolist(), np.diff(y).tolist(), strict=True):
        size = math.hypot(step_x, step_y)
        if size == 0.0:
            continue
        # Exact for a straight step: the tangent of half the angle to it shrinks by exp(-size / axle).
        course = math.atan2(step_y, step_x)
        angle = 2 * math.atan(math.tan(_wrapped(math.atan2(dy, dx) - course) / 2) * math.exp(-size / axle))
        dx, dy = math.cos(course + angle), math.sin(course + angle)
    return math.atan2(dy, dx)


def swung(time: np.ndarray, courses: Sequence[Course], on_own_side: Callable[[int], bool]) -> int | None:
    """Which of two vehicles that touch now, 0 or 1, has swung into the other; None: neither.

    time        : of the instants of both [s], (k,)
    on_own_side : of a vehicle, whether it is on its own side of the road now
    """
    real = [course.outline() for course in courses]
    trailed = [course.trailed() for course in courses]
    by = [_apart(*pair) for pair in zip(real, trailed, strict=True)]
    which = int(np.argmax(by))
    other = 1 - which
    if by[which] < SWUNG or courses[which].jumps() or not on_own_side(other):
        return None
    velocity = [np.array([np.diff(course.x)[-1], np.diff(course.y)[-1]]) / (time[-1] - time[-2]) for course in courses]
    closing = velocity[other] - velocity[which]
    bodies = trailed[which].moved(0, 0), [real[other].moved(*(closing * t)) for t in np.linspace(0, GOES_ON, TIMES)]
    return None if shapely.intersects(*bodies).any() else which


def _apart(one: Outline, other: Outline) -> float:
    """Distance of the rear bumpers of two outlines with one front [m]."""
    return 2 * one.length * abs(math.sin((one.heading - other.heading) / 2))


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi
