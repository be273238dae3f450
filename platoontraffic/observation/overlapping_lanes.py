"""Contacts where lanes of two directions overlap: the road is the cause, not one of two that keep to their lanes.

Networks have such places where roads with kinks are narrower than their lanes. Two vehicles in the middles of their
lanes touch there, as SUMO's own cars do. The road is the cause of a contact if the two would touch at this instant if
each were in the middle of its lane, at its place along that, and if neither is off that middle, towards the other one,
by more than `KEEPS`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, Point
from shapely.ops import substring

from platoontraffic.observation.swings import Outline

KEEPS = 0.25  # greatest distance of a corner, towards the other one, from where it is in the middle of a lane [widths]
NEARBY = 0.1  # from a place on a lane to those by which its direction is found [m]


class OnLane(NamedTuple):
    """A vehicle, and the lane that it is on."""

    middle: LineString
    outline: Outline

    def in_the_middle(self) -> shapely.Geometry:
        """Its footprint if the middles of its bumpers, and all between, were in the middle of the lane.

        Less of it where the lane ends.
        """
        x, y, heading, length, width = self.outline
        rear = Point(x - length * math.cos(heading), y - length * math.sin(heading))
        part = substring(self.middle, *sorted(map(self.middle.project, (rear, Point(x, y)))))
        return part.buffer(width / 2, cap_style="flat")

    def off_towards(self, x: float, y: float) -> float:
        """Greatest distance of a corner, to the side of a place, from where it is in the middle of the lane [m]."""
        corners = shapely.get_coordinates(self.outline.moved(0, 0))
        return max(self._aside(corner, (x, y)) for corner in corners) - self.outline.width / 2

    def _aside(self, corner: np.ndarray, place: Sequence[float]) -> float:
        along = self.middle.project(Point(corner))
        foot, before, after = (
            np.array(self.middle.interpolate(min(max(along + by, 0.0), self.middle.length)).coords[0])
            for by in (0.0, -NEARBY, NEARBY)
        )
        (dx, dy), size = after - before, float(np.hypot(*(after - before)))
        left = np.array([-dy, dx]) / size
        return float((corner - foot) @ left) * math.copysign(1.0, float((np.array(place) - foot) @ left))

    def keeps_from(self, other: OnLane) -> bool:
        """Whether it is in the middle of its lane, or farther from the other one."""
        x, y = shapely.get_coordinates(other.outline.moved(0, 0).centroid)[0]
        return self.off_towards(x, y) <= KEEPS * self.outline.width


def is_caused_by_road(one: OnLane, other: OnLane) -> bool:
    """Of two vehicles that touch now, on lanes of two directions."""
    if not shapely.intersects(one.in_the_middle(), other.in_the_middle()):
        return False
    return one.keeps_from(other) and other.keeps_from(one)
