"""Which of two vehicles entered the other's lane: measured across the road, from the poses of both alone.

Two vehicles are in line while the offset between them, across the mean of their headings, is less than the mean of
their widths. The move of a vehicle across the road is the change of its distance from the border of the drivable area,
along its right normal (or its left one, where that to the right is not continuous), so that a bend moves nobody; a
vehicle that SUMO puts sideways at once moves by that, at its front bumper, which SUMO keeps on the lane's line. The one
that moved more towards the other, from LANE_CHANGE_TIME before they came in line on, entered the other's lane. Of two
whose corners touch before they are in line, one that SUMO has just put sideways did so.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.observation.swings import AT_ONCE, Course, sideways
from platoontraffic.world.events import APPEARANCE_BLAME, LANE_CHANGE_BLAME, LANE_CHANGE_TIME
from platoontraffic.world.traffic import TrafficSnapshot

FASTEST = 3.0  # lateral speed; the border that changes faster has an opening there [m/s]
MOVED = 0.5  # least move of a vehicle that entered the other's lane [m]
STANDS = 0.05  # greatest motion of a vehicle that stands [m]
BORDER = 50.0  # distance up to which the border is looked for [m]
SAME_DIRECTION = 0.5  # least cosine between two headings in one direction


class Entry(NamedTuple):
    """One of two vehicles has come into the other's lane."""

    vehicle: str
    time: float  # at which they came in line [s]
    gap: float  # between their bumpers then, along the road [m]; negative: abreast


class Poses(NamedTuple):
    """Of one vehicle at k instants, (k,)."""

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray


class Together(NamedTuple):
    """Two vehicles at the last instants at which both were there."""

    time: np.ndarray  # (k,)
    poses: list[Poses]  # of each
    length: np.ndarray  # of each, (2,)
    width: np.ndarray


class LaneEntries:
    """Remembers where all vehicles were."""

    def __init__(self, drivable: shapely.Geometry) -> None:
        self._drivable = drivable
        self._past: deque[TrafficSnapshot] = deque()

    @cached_property
    def _border(self) -> shapely.Geometry:
        return self._drivable.boundary

    def observe(self, traffic: TrafficSnapshot) -> None:
        self._past.append(traffic)
        while self._past[0].time < traffic.time - LANE_CHANGE_BLAME - LANE_CHANGE_TIME - 1e-6:
            self._past.popleft()

    def of(self, one: str, other: str) -> Entry | None:
        """The last one of two vehicles that touch now; None if they have been in line for LANE_CHANGE_BLAME, are not
        now and nobody was just put sideways, do not head in one direction, or if neither moved."""
        both = self.together(one, other)
        if len(both.time) < 2:
            return None
        moves = lambda poses, length: self._moves(both.time, poses, length)  # noqa: E731
        return entry(both.time, both.poses, (one, other), (both.length, both.width), moves)

    def appeared(self, name: str) -> bool:
        """Whether a vehicle that is there now was not there at some time since APPEARANCE_BLAME before."""
        now = self._past[-1]
        recent = (traffic for traffic in self._past if traffic.time > now.time - APPEARANCE_BLAME - 1e-6)
        return name in now.ids and any(name not in traffic.ids for traffic in recent)

    def is_new(self, name: str) -> bool:
        """Whether a vehicle that is there now was not there one step before."""
        return len(self._past) > 1 and name not in self._past[-2].ids

    def has_stood(self, name: str, duration: float) -> bool:
        """Whether a vehicle has been there for a time [s], and no part of it has moved by more than STANDS since."""
        end = self._past[-1].time
        first = next((k for k, one in enumerate(self._past) if one.time > end - duration - 1e-6), 0)
        recent = list(self._past)[first:]
        if end - recent[0].time < duration - 1e-6 or any(name not in one.ids for one in recent):
            return False
        rows = [(one, one.ids.index(name)) for one in recent]
        x, y, heading = np.array([(one.x[k], one.y[k], one.heading[k]) for one, k in rows]).T
        now, row = rows[-1]
        turned = np.abs(np.angle(np.exp(1j * (heading - heading[-1])))) * now.length[row] / 2
        return bool((np.hypot(x - x[-1], y - y[-1]) + turned <= STANDS).all())

    def together(self, one: str, other: str) -> Together:
        """The remembered instants of both up to now, without a break."""
        both = []
        for traffic in reversed(self._past):
            if one not in traffic.ids or other not in traffic.ids:
                break
            both.append((traffic, traffic.ids.index(one), traffic.ids.index(other)))
        both.reverse()
        time = np.array([traffic.time for traffic, *_ in both])
        poses = [
            Poses(*np.array([(t.x[row[n]], t.y[row[n]], t.heading[row[n]]) for t, *row in both]).reshape(-1, 3).T)
            for n in (0, 1)
        ]
        now, *rows = both[-1] if both else (self._past[-1], [], [])
        return Together(time, poses, now.length[rows], now.width[rows])

    def _moves(self, time: np.ndarray, poses: Poses, length: float) -> np.ndarray:
        """Moves of a vehicle to its left from each instant to the next, across the road [m], (k - 1,)."""
        right, left = (self._to_border(poses, side) for side in (-1, 1))
        limit = FASTEST * np.diff(time)
        by_right, by_left = np.diff(right), -np.diff(left)
        front = Course.of(*poses, length, 0.0)
        aside = sideways(front.x, front.y, front.heading)
        with np.errstate(invalid="ignore"):
            moves = np.where(np.abs(by_right) < limit, by_right, np.where(np.abs(by_left) < limit, by_left, 0.0))
        return np.where(np.abs(aside) > AT_ONCE, aside, moves)

    def _to_border(self, poses: Poses, side: int) -> np.ndarray:
        """Distance of the border to the left (1) or right (-1) [m], (k,); NaN beyond BORDER."""
        dx, dy = -side * np.sin(poses.heading) * BORDER, side * np.cos(poses.heading) * BORDER
        ends = np.stack([[poses.x, poses.y], [poses.x + dx, poses.y + dy]]).transpose(2, 0, 1)
        met = shapely.intersection(shapely.linestrings(ends), self._border)
        return shapely.distance(shapely.points(poses.x, poses.y), met)


def entry(time: np.ndarray, poses: Sequence[Poses], names: Sequence[str], size, moves) -> Entry | None:
    """As `LaneEntries.of`; time (k,) and the poses of both up to now, size: lengths and widths, moves: of one by its
    poses and its length [m]."""
    (a, b), (length, width) = poses, size
    dx, dy = b.x - a.x, b.y - a.y
    mean = np.arctan2(np.sin(a.heading) + np.sin(b.heading), np.cos(a.heading) + np.cos(b.heading))
    along, aside = dx * np.cos(mean) + dy * np.sin(mean), dy * np.cos(mean) - dx * np.sin(mean)
    across = np.cos(b.heading - a.heading) < SAME_DIRECTION
    apart = np.flatnonzero((np.abs(aside) >= width.mean()) | across)
    if not len(apart):
        return None
    came, last = apart[-1] + 1, len(time) - 1
    if came <= last:
        first, least = np.searchsorted(time, time[came] - LANE_CHANGE_TIME - 1e-6), MOVED
    elif not across[last]:  # only their corners touch
        came, first, least = last, last - 1, AT_ONCE
    else:
        return None
    if time[last] - time[came] > LANE_CHANGE_BLAME - 1e-6:
        return None
    towards = math.copysign(1.0, aside[apart[-1]])  # the second vehicle was to the left of the first one
    moved = [towards * moves(a, length[0])[first:].sum(), -towards * moves(b, length[1])[first:].sum()]
    which = int(np.argmax(moved))
    if moved[which] < least:
        return None
    return Entry(names[which], float(time[came]), float(abs(along[came]) - length.mean()))
