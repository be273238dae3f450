"""The paths that many vehicles have driven, and stations along them.

What `Polyline` is for one line, here for all rows at once, compiled and of bounded size: points too close together
to matter are left out, and the oldest points are forgotten.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import project
from platoontraffic.lidar.compiled import compiler

END = 1e-9  # within that distance of its last point a place is at the end of a path [m]
CORNER = 0.1  # tangent of the change of direction above which a point is a corner, and kept

compiled = compiler(__file__, polyline.__file__)


class DrivenPaths:
    """One path per vehicle, from its first position to its present one; vehicles are addressed by number, (m,).

    The last point of a path is the vehicle's position; the earlier ones are at least `spacing` apart, or a tenth of
    that at corners. Stations count from the first point ever added, and keep their values when it is forgotten.
    """

    def __init__(self, spacing: np.ndarray, capacity: int = 2048) -> None:
        """spacing: of each path [m], (count,); capacity: points in a path; a full one drops its older half."""
        self.spacing = np.asarray(spacing, dtype=float)
        self._points = np.empty((len(self.spacing), capacity, 3))  # x, y, station; untouched, it takes no memory
        self._size = np.zeros(len(self.spacing), dtype=np.intp)

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, sizes and spacings of all paths, for kernels."""
        return self._points, self._size, self.spacing

    def extend(self, spacing: np.ndarray) -> None:
        """Further paths, with the numbers that come next."""
        self.spacing, used = np.append(self.spacing, spacing), len(self._size)
        self._size = np.append(self._size, np.zeros(len(spacing), dtype=np.intp))
        if len(self._size) <= len(self._points):
            return
        points, self._points = self._points, np.empty((2 * len(self._size), *self._points.shape[1:]))
        for k in range(used):  # not whole: what is untouched takes no memory
            self._points[k, : self._size[k]] = points[k, : self._size[k]]

    def begin(self, number: np.ndarray, from_x, from_y, x, y) -> None:
        """Start paths (anew) with a straight piece from one point to another, arrays (m,)."""
        self._points[number, 0] = np.column_stack([from_x, from_y, np.zeros(len(number))])
        self._size[number] = 1
        self.drive(number, x, y, np.zeros(len(number), dtype=bool))

    def drive(self, number: np.ndarray, x, y, backwards: np.ndarray) -> None:
        """Extend paths to points, arrays (m,); where `backwards` (bool), shorten them to the nearest point instead."""
        extend(self.arrays, number, x, y, backwards)

    def end(self, number: np.ndarray) -> np.ndarray:
        """Stations of the last points [m], (m,)."""
        return self._points[number, self._size[number] - 1, 2]

    def project(self, number: np.ndarray, x, y, near, window) -> tuple[np.ndarray, np.ndarray]:
        """Stations of the nearest points within `window` of stations `near`, and offsets to the left [m]; arrays (m,).

        Both are NaN where the nearest point has been forgotten. Behind its first point and beyond its last a path goes
        straight on; stations are negative there, or greater than `end`.
        """
        station, offset = np.empty(len(number)), np.empty(len(number))
        _project_all(self._points, self._size, number, x, y, near, window, station, offset)
        return station, offset


@compiled
def extend(paths, number, x, y, backwards):
    """`DrivenPaths.drive`"""
    points, size, spacing = paths
    for i in range(len(number)):
        k = number[i]
        if backwards[i]:
            size[k] = _retracted(points[k], size[k], x[i], y[i])
        else:
            size[k] = _appended(points[k], size[k], x[i], y[i], spacing[k])


@compiled
def _appended(path, size, x, y, spacing):
    """Extend a path to a further point; returns its new size."""
    if size > 1 and _is_redundant(path[size - 2], path[size - 1], x, y, spacing):
        size -= 1
    step = _distance(path[size - 1], x, y)
    if step == 0.0:
        return size
    if size == len(path):
        half = size // 2
        size -= half
        for i in range(size):
            for k in range(3):  # one by one: numba takes seconds to compile an assignment of arrays
                path[i, k] = path[half + i, k]
    path[size, 0], path[size, 1], path[size, 2] = x, y, path[size - 1, 2] + step
    return size + 1


@compiled
def _is_redundant(before, last, x, y, spacing):
    """Whether the last point is close to the one before it, and is no corner on the way to the next."""
    ax, ay, bx, by = last[0] - before[0], last[1] - before[1], x - last[0], y - last[1]
    size = math.sqrt(ax * ax + ay * ay)
    corner = abs(ax * by - ay * bx) > CORNER * (ax * bx + ay * by)
    return size < spacing and not (corner and size >= spacing / 10)


@compiled
def _retracted(path, size, x, y):
    """Shorten a path to its point nearest to x, y, searched as far back as x, y is from its end; its new size."""
    end, away = path[size - 1, 2], _distance(path[size - 1], x, y)
    station, _ = _project(path, size, x, y, end - away, away + 1e-9)
    station = min(station, end)
    last = size - 1
    while last > 0 and path[last - 1, 2] >= station:
        last -= 1
    if last > 0:
        before, after = path[last - 1], path[last]
        share = (station - before[2]) / (after[2] - before[2])
        after[0] = before[0] + share * (after[0] - before[0])
        after[1] = before[1] + share * (after[1] - before[1])
        after[2] = station
    return last + 1


@compiled
def _project_all(points, size, number, x, y, near, window, station, offset):
    for i in range(len(number)):
        station[i], offset[i] = located(points, size, number[i], x[i], y[i], near[i], window[i])


@compiled
def located(points, size, k, x, y, near, window):
    """Station on path k, and offset from it, as of `DrivenPaths.project`."""
    first = points[k, 0, 2]  # above 0 if something has been forgotten
    if first == 0.0 or near + window > first:
        station, aside = _project(points[k], size[k], x, y, near, window)
        if first == 0.0 and station == 0.0 and size[k] > 1:
            return _behind(points[k], x, y, aside)
        if size[k] > 1 and station >= end_of(points, size, k) - END:
            return _beyond(points[k], size[k], x, y, aside)
        if first == 0.0 or station > first:
            return station, aside
    return math.nan, math.nan


@compiled
def _behind(path, x, y, aside):
    """Station and offset of a position on the first piece of a path, prolonged backwards; 0 and `aside` if it is not
    behind the first point."""
    ahead_x, ahead_y, dx, dy = path[1, 0] - path[0, 0], path[1, 1] - path[0, 1], x - path[0, 0], y - path[0, 1]
    piece = math.hypot(ahead_x, ahead_y)
    along = (dx * ahead_x + dy * ahead_y) / piece
    return (along, (ahead_x * dy - ahead_y * dx) / piece) if along < 0.0 else (0.0, aside)


@compiled
def _beyond(path, size, x, y, aside):
    """Station and offset of a position on the last piece of a path, prolonged; its end and `aside` if it is not beyond
    the last point."""
    before, last = path[size - 2], path[size - 1]
    ahead_x, ahead_y, dx, dy = last[0] - before[0], last[1] - before[1], x - last[0], y - last[1]
    piece = math.hypot(ahead_x, ahead_y)
    along = (dx * ahead_x + dy * ahead_y) / piece
    return (last[2] + along, (ahead_x * dy - ahead_y * dx) / piece) if along > 0.0 else (last[2], aside)


@compiled
def end_of(points, size, k):
    """Station of the last point of path k [m]."""
    return points[k, size[k] - 1, 2]


@compiled
def _project(path, size, x, y, near, window):
    """`polyline.project` onto a path, which may be a single point."""
    if size == 1:
        return path[0, 2], _distance(path[0], x, y)
    return project(path[:size], path[:size, 2], x, y, near, window)


@compiled
def _distance(point, x, y):
    dx, dy = x - point[0], y - point[1]
    return math.sqrt(dx * dx + dy * dy)
