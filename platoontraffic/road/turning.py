"""How far a vehicle must leave a line because it cannot turn as sharply as the line does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from platoontraffic.lidar.compiled import compiler

LONGEST = math.pi  # of the stretches that are looked at [turning radii]: a half turn at full lock
FULL_TURN_BACK = 2.0  # offset of a half turn, by the difference of the radii
STRAIGHT = 1e-6  # turns below this are those of rounded coordinates [rad]

compiled = compiler(__file__)


@dataclass(frozen=True, eq=False)
class TightTurns:
    """Stretches of lines that turn more sharply than a vehicle can; arrays (n,), in the order of the lines.

    The stretches of one line are in the order of their begin; of two that overlap neither has the greater offset
    everywhere.
    """

    line: np.ndarray  # index of the line
    start: np.ndarray  # station of the first point that turns [m]
    end: np.ndarray  # same of the last; equal to `start` in a corner
    angle: np.ndarray  # turn between the lines before and after, positive to the left [rad]
    offset: np.ndarray  # least distance between the line and the vehicle's path [m]
    before: np.ndarray  # distance before `start` and beyond `end` within which the path leaves the line [m]

    def __len__(self) -> int:
        return len(self.line)

    def least_offset(self, station: np.ndarray, line: int = 0) -> np.ndarray:
        """The greatest offset of all stretches of a line that a vehicle at stations (k,) [m] drives, (k,) [m]."""
        least = np.zeros(len(station))
        for i in np.flatnonzero(self.line == line):
            here = (station >= self.start[i] - self.before[i]) & (station <= self.end[i] + self.before[i])
            least[here] = np.maximum(least[here], self.offset[i])
        return least


def tight_turns(lines: Sequence[np.ndarray], radius: float) -> TightTurns:
    """Where lines turn more sharply than a vehicle of turning radius R: at each point the worst stretch about it.

    A stretch of length l that turns by theta is taken for an arc of radius r = l / theta; in a corner r is 0. The arc
    of radius R that touches the same two tangents passes the middle of the stretch at a distance of

        (R - r) (sec(theta / 2) - 1)

    and leaves the tangents (R - r) tan(theta / 2) before and after it. Where the line turns back the tangents do not
    meet: a half turn ends a = 2 (R - r) aside, which bounds the first factor, sec(theta / 2) - 1, by 2, and
    tan(theta / 2) by sqrt(8); two arcs of radius R lead back within sqrt(a (4 R - a)). Turns to both sides within a
    stretch are added with their signs; stretches are up to pi R long, and any part of one is a stretch too, so that a
    swerve does not cancel.

    lines  : points of each line, (k, 2) [m]; k >= 2
    radius : R, of the path of the driven axle [m]
    """
    lines = [np.asarray(line, dtype=float)[:, :2] for line in lines]
    if not lines:
        return TightTurns(np.zeros(0, dtype=int), *np.zeros((5, 0)))
    points = np.concatenate(lines)
    ends = np.cumsum([len(line) for line in lines])
    first = np.concatenate([[0], ends[:-1]])
    which, station, turn = _turns(points, first, ends)
    worst, offset = _worst(which, station, turn, float(radius))
    chosen = np.unique(worst[offset > 0], axis=0)
    start, end = chosen.T
    summed = np.concatenate([[0.0], np.cumsum(turn)])
    angle = summed[end + 1] - summed[start]
    length = station[end] - station[start]
    lacking, secant = radius - length / np.abs(angle), np.minimum(_secant(angle), FULL_TURN_BACK + 1)
    aside, before = lacking * (secant - 1), lacking * np.sqrt(secant**2 - 1)
    comes_back = np.where(secant == FULL_TURN_BACK + 1, np.sqrt(aside * (4 * radius - aside)), 0.0)
    return TightTurns(
        which[start], station[start], station[end], angle, aside, np.maximum(before, comes_back)
    )  # fmt: skip


def _secant(angle: np.ndarray) -> np.ndarray:
    """Of half of an angle; inf from a half turn on."""
    return 1 / np.maximum(np.cos(np.minimum(np.abs(angle), math.pi) / 2), 1e-9)


def _turns(points: np.ndarray, first: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points at which lines turn: index of the line, station [m] and angle [rad], (n,).

    points      : of all lines, (k, 2)
    first, ends : index of each line's first point, and of the one after its last
    """
    of_line = np.repeat(np.arange(len(first)), ends - first)
    steps = np.diff(points, axis=0)
    size = np.where(np.diff(of_line) == 0, np.hypot(*steps.T), 0.0)
    along = np.concatenate([[0.0], np.cumsum(size)])
    pieces = np.flatnonzero(size > 0)  # by their first point; pieces without length have no direction
    heading = np.arctan2(steps[pieces, 1], steps[pieces, 0])
    turn = np.remainder(np.diff(heading) + math.pi, math.tau) - math.pi
    at, before = pieces[1:], pieces[:-1]
    real = (of_line[at] == of_line[before]) & (np.abs(turn) > STRAIGHT)
    at = at[real]
    return of_line[at], along[at] - along[first[of_line[at]]], turn[real]


@compiled
def _worst(line, station, turn, radius):
    """The worst stretch about each point that turns: its first and last such point (n, 2), and its offset (n,) [m].

    line, station, turn : index of the line, station [m] and angle [rad] of the points, (n,)
    """
    n = len(turn)
    worst, offset = np.zeros((n, 2), dtype=np.int64), np.zeros(n)
    for i in range(n):
        angle, j = 0.0, i
        while j < n and line[j] == line[i] and station[j] - station[i] <= LONGEST * radius:
            angle += turn[j]
            size = abs(angle)
            if size > 0.0:
                lacking = radius - (station[j] - station[i]) / size
                aside = FULL_TURN_BACK
                if size < math.pi:
                    aside = min(1 / math.cos(size / 2) - 1, FULL_TURN_BACK)
                if lacking > 0.0 and aside > 0.0:
                    for k in range(i, j + 1):
                        if lacking * aside > offset[k]:
                            offset[k] = lacking * aside
                            worst[k, 0], worst[k, 1] = i, j
            j += 1
    return worst, offset
