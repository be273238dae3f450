"""Polylines with stations (arc length along the line), and the nearest place on one.

Kernels of other files that call these functions name this file too: `compiler(__file__, polyline.__file__)`.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def beside(points, k, x, y, size, low, high, whole):
    """The place nearest to a point on the piece from points[k] to points[k + 1], in metres or as a share of the piece.

    points    : (m, 2) or more columns, of which the first two are x and y [m]
    size      : length of the piece for metres [m], its square for a share [m2]
    low, high : limits of the result; 0.0 and `whole` keep to the piece, -inf and inf prolong it
    whole     : the result at points[k + 1]: length of the piece [m], or 1.0
    returns   : distance along the piece [m] or share; squared distance [m2]; step x offset [m2], positive to the left
    """
    step_x, step_y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
    from_x, from_y = x - points[k, 0], y - points[k, 1]
    along = min(max((from_x * step_x + from_y * step_y) / size, low), high) if size > 0.0 else 0.0
    share = along / whole if size > 0.0 else 0.0
    away_x, away_y = from_x - step_x * share, from_y - step_y * share
    return along, away_x * away_x + away_y * away_y, step_x * from_y - step_y * from_x


@compiled
def nearest(points, first, last, x, y, low, high):
    """The place nearest to a point on the pieces that start at points[first] .. points[last - 1].

    low, high : limits of the share on the first and on the last piece: 0.0 and 1.0; -inf and inf prolong the line
    returns   : the piece, by its first point, and the share of it; squared distance and side as from `beside`.
                Pieces without length are left out; if all are, the squared distance is inf
    """
    piece, share, shortest, side = first, 0.0, math.inf, 0.0
    for k in range(first, last):
        step_x, step_y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        size = step_x * step_x + step_y * step_y
        if size == 0.0:
            continue
        least, most = low if k == first else 0.0, high if k == last - 1 else 1.0
        part, away, left = beside(points, k, x, y, size, least, most, 1.0)
        if away < shortest:
            piece, share, shortest, side = k, part, away, left
    return piece, share, shortest, side


@compiled
def project(points, stations, x, y, near, window):
    """The place nearest to a point, among the pieces that lie within `window` of station `near` or reach into it.

    points, stations : (m, 2 or more), and lengths along them (m,) [m]; m is at least 2
    returns          : its station [m]; the point's distance from it [m], positive to the left
    """
    first = min(max(_count(stations, near - window) - 1, 0), len(stations) - 2)
    station, shortest, side = stations[first], math.inf, 0.0
    for k in range(first, len(stations) - 1):
        if k > first and not stations[k] < near + window:
            break
        length = stations[k + 1] - stations[k]
        along, away, left = beside(points, k, x, y, length, 0.0, length, length)
        if away < shortest:
            station, shortest, side = stations[k] + along, away, left
    return station, math.copysign(math.sqrt(shortest), side)


@compiled
def left_of(points):
    """Unit vectors to the left of a line through points (k, 2), k >= 2, at each of them (k, 2)."""
    left = np.empty(points.shape)
    for k in range(len(points)):
        before, beyond = max(k - 1, 0), min(k + 1, len(points) - 1)
        dx = (points[beyond, 0] - points[before, 0]) / (beyond - before)
        dy = (points[beyond, 1] - points[before, 1]) / (beyond - before)
        length = max(math.hypot(dx, dy), 1e-9)
        left[k, 0], left[k, 1] = -dy / length, dx / length
    return left


@compiled
def _count(stations, station):
    """The number of stations up to the given one; stations (m,) rise."""
    low, high = 0, len(stations)
    while low < high:
        middle = (low + high) // 2
        if stations[middle] <= station:
            low = middle + 1
        else:
            high = middle
    return low


class Polyline:
    """Points (k, 2) joined by straight lines; station 0 is at the first point.

    closed: the last point joins the first, and stations wrap round.
    """

    def __init__(self, points: np.ndarray, closed: bool = False) -> None:
        points = np.asarray(points, dtype=float)
        if closed:
            points = np.vstack([points, points[:1]])
        steps = np.hypot(*np.diff(points, axis=0).T)
        points = points[np.concatenate([[True], steps > 0])]
        self.closed = closed
        self.length = float(steps.sum())
        # A closed line is laid out twice, so that no window has to wrap.
        self.points = np.vstack([points, points[1:]]) if closed else points  # (m, 2)
        self.stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))])  # (m,)

    def project(self, x: float, y: float, near: float, window: float) -> tuple[float, float]:
        """Station of the nearest point among those within `window` of station `near`, and the offset to the left."""
        if self.closed and window < np.inf:
            near = near % self.length + (self.length if near % self.length < self.length / 2 else 0)
        return project(self.points, self.stations, float(x), float(y), float(near), float(window))

    def at(self, station: np.ndarray) -> np.ndarray:
        """Points (m, 2) at stations (m,); before and after an open line, its ends."""
        if self.closed:
            station = np.mod(station, self.length)
        return np.column_stack([np.interp(station, self.stations, self.points[:, i]) for i in (0, 1)])
