"""A line whose curvature changes gradually, as steering can.

A line of arcs and straights cannot be driven fast: where its curvature jumps, a vehicle must be slow enough to steer.
Drivers begin to steer before a bend, and cut it a little. So the line p is replaced by the q that minimises

    sum |q - p|^2 + w sum |third differences of q|^2

(E. T. Whittaker, On a new method of graduation, Proc. Edinburgh Mathematical Society 41, 1922): the third differences
are the rate of the curvature. Each place gets the greatest weight w with which it stays near the line.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from platoontraffic.lidar.compiled import compiler
from platoontraffic.road.drivable_line import LOCK, drivable, spread, stations_of
from platoontraffic.road.turning import tight_turns

EASING = 0.28  # greatest displacement [vehicle widths]: 0.5 m for a car, which has 0.7 m beside it in its lane
WIDEST = 1.5  # greatest width of the average that easing amounts to [vehicle lengths]: w is its 6th power, in points
LEVELS = 10  # widths that are tried
TAIL = 16.0  # beyond so many widths a point has no influence
ABOVE_LOCK = 1.02  # greatest curvature [of the lock, or of the line before]: averages make tight arcs a little tighter
TOTAL = 1.6  # greatest distance from the given line beyond the least [tolerances]: 0.8 m for a car; `prove` allows 1 m
SAME = 1e-6  # distance of places that count as one [m]
WIDER = 1.05  # radius of the arcs that are eased where the line has arcs at full lock [radius there]

compiled = compiler(__file__)


def eased(
    points: np.ndarray,
    stations: np.ndarray,
    given: np.ndarray,
    lock: float,
    tolerance: float,
    widest: float,
    spacing: float,
    closed: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """The eased line, as `drivable` returns it.

    points, stations : of the line as `drivable` returns it, (m, 2), (m,) [m]
    given            : points of the lane line that `stations` are along (k, 2) [m]
    lock             : curvature that is not exceeded where the line does not [1/m]
    tolerance        : greatest displacement [m]
    widest           : greatest width of the average [m]
    spacing          : of the points [m]
    """
    even = spread(np.column_stack([points, stations]), spacing)
    line, stations = even[:, :2], even[:, 2]
    least = tight_turns([given], 1 / (LOCK * lock)).least_offset(stations)  # without the reserve, as `prove` has it
    lane = np.column_stack([np.interp(stations, stations_of(given), column) for column in given.T])
    around = math.ceil(widest / spacing)  # points
    reach = math.ceil(TAIL * widest / spacing)
    sharpest = ABOVE_LOCK * np.maximum(lock, _curvature(_onward(line, 1, closed)))
    off_before = _off(line - lane, line)

    def eased_from(begun: np.ndarray) -> np.ndarray:
        """The line, eased: where there is room, averages of another one that begins beside it."""
        onward = _onward(begun, reach, closed)
        smooth, level = [line], np.zeros(len(line))
        for k in range(1, LEVELS + 1):
            smooth.append(_graduated(onward, (k / LEVELS * widest / spacing) ** 6)[reach : len(onward) - reach])
            off = _off(smooth[k] - lane, smooth[k])
            near = (off <= least + TOTAL * tolerance) & (_off(smooth[k] - line, smooth[k]) <= tolerance)
            level[(near | (off <= off_before)) & (level == k - 1)] = k
        for _ in range(5 * LEVELS):  # a place may become sharp as its neighbours are eased less
            found = _blended(smooth, level, around, closed)
            sharp = _curvature(_onward(found, 1, closed)) > sharpest
            if not (sharp & (level > 0)).any():
                break
            level[sharp] = np.maximum(level[sharp] - 1, 0)
        found[[0, -1]] = found[0] if closed else line[[0, -1]]
        return found

    found = eased_from(line)
    if _curvature(line).max(initial=0.0) > lock / WIDER:
        # Averages make an arc sharper in its middle. One that begins gradually, within the lock, lies farther inside.
        wider, along = drivable(given, lock / WIDER, spacing, closed)
        other = eased_from(np.column_stack([np.interp(stations, along, column) for column in wider.T]))
        found = _easier(found, other, around // 3, closed)  # half a vehicle's length, as laws average curvature
    return found, stations


def _easier(one: np.ndarray, other: np.ndarray, around: int, closed: bool) -> np.ndarray:
    """Of two lines (m, 2), stretch by stretch where they differ, the one whose curvature changes more gradually.

    around: number of points over which curvature is averaged
    """
    differ = np.hypot(*(one - other).T) > SAME
    ends = np.flatnonzero(np.diff(differ, prepend=False, append=False)).reshape(-1, 2)
    if closed and differ[0]:
        ends = np.array([(0, len(one))])
    found, (steep, its) = one.copy(), (_steepness(line, around, closed) for line in (one, other))
    for first, last in ends:
        if its[first:last].max() < steep[first:last].max():
            found[first:last] = other[first:last]
    return found


def _steepness(line: np.ndarray, around: int, closed: bool) -> np.ndarray:
    """Change of the curvature, averaged over some points, from each point of a line to the next."""
    curvature = _onward(_curvature(_onward(line, 1, closed)), around, closed)
    means = np.convolve(curvature, np.full(around, 1 / around), mode="same")
    return np.abs(np.diff(means, append=means[-1]))[around : len(means) - around]


def _blended(smooth: list[np.ndarray], level: np.ndarray, around: int, closed: bool) -> np.ndarray:
    """At each place a mean of two of the lines: nowhere a higher level than the places around allow, without steps."""
    level = sliding_window_view(_onward(level, 2 * around, closed), 2 * around + 1).min(axis=1)
    bell = np.hanning(2 * around + 3)[1:-1]
    level = np.convolve(level, bell / bell.sum(), mode="valid")
    below, place = np.minimum(level.astype(int), LEVELS - 1), np.arange(len(level))
    share, lines = (level - below)[:, None], np.stack(smooth)
    return lines[below, place] * (1 - share) + lines[below + 1, place] * share


def _onward(values: np.ndarray, count: int, closed: bool) -> np.ndarray:
    """Values (m,) or points (m, 2) with `count` more at each end.

    Those of a closed line are the next lap's; an open one is turned half about its end, so that this stays in place.
    """
    sides = [(count, count)] + [(0, 0)] * (values.ndim - 1)
    if closed:
        return np.pad(values[:-1], [(count, count + 1), *sides[1:]], mode="wrap")
    return np.pad(values, sides, mode="reflect", reflect_type="odd" if values.ndim > 1 else "even")


def _curvature(points: np.ndarray) -> np.ndarray:
    """At the inner ones of points (m, 2), without sign [1/m]."""
    one, two = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    turn = np.arctan2(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0], (one * two).sum(axis=1))
    return np.abs(turn) / np.maximum((np.hypot(*one.T) + np.hypot(*two.T)) / 2, 1e-9)


def _off(displacement: np.ndarray, line: np.ndarray) -> np.ndarray:
    """The part of displacements (m, 2) across a line (m, 2), without sign [m]."""
    along = np.gradient(line, axis=0)
    across = along[:, 0] * displacement[:, 1] - along[:, 1] * displacement[:, 0]
    return np.abs(across) / np.maximum(np.hypot(*along.T), 1e-12)


@compiled
def _graduated(points, weight):
    """The q of the sum above for points (m, 2): (1 + w D^T D) q = p, by L d L^T with three subdiagonals."""
    n = len(points)
    solution, pivot, below = points.copy(), np.zeros(n), np.zeros((n, 4))
    third = (-1.0, 3.0, -3.0, 1.0)
    for i in range(n):
        for k in range(min(3, i), -1, -1):  # element (i, i - k)
            element = 1.0 if k == 0 else 0.0
            for first in range(max(i - 3, 0), min(i - k, n - 4) + 1):  # third differences that both take part in
                element += weight * third[i - first] * third[i - k - first]
            for j in range(max(i - 3, 0), i - k):
                element -= below[i, i - j] * below[i - k, i - k - j] * pivot[j]
            if k == 0:
                pivot[i] = element
            else:
                below[i, k] = element / pivot[i - k]
    for c in range(points.shape[1]):
        for i in range(n):
            for k in range(1, min(3, i) + 1):
                solution[i, c] -= below[i, k] * solution[i - k, c]
        for i in range(n):
            solution[i, c] /= pivot[i]
        for i in range(n - 2, -1, -1):
            for k in range(1, min(3, n - 1 - i) + 1):
                solution[i, c] -= below[i + k, k] * solution[i + k, c]
    return solution
