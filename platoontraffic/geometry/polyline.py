"""Lines with a station (arc length) on them: a given route, and the path that a vehicle has driven."""

from __future__ import annotations

import numpy as np


class Polyline:
    """Points (k, 2) joined by straight lines; station 0 at the first point.

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
        self._points = np.vstack([points, points[1:]]) if closed else points
        self._station = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self._points, axis=0).T))])
        self._size = len(self._points)

    @property
    def points(self) -> np.ndarray:
        """(k, 2); those of a closed line are laid out twice."""
        return self._points[: self._size]

    @property
    def stations(self) -> np.ndarray:
        """Of the points, (k,)."""
        return self._station[: self._size]

    @property
    def end(self) -> float:
        """Station of the last point."""
        return float(self._station[self._size - 1])

    def append(self, x: float, y: float) -> None:
        """Lengthen an open line to a further point; a point that is there already adds nothing."""
        last_x, last_y = self._points[self._size - 1]
        step = np.hypot(x - last_x, y - last_y)
        if step == 0:
            return
        if self._size == len(self._points):
            self._points = np.concatenate([self._points, np.empty_like(self._points)])
            self._station = np.concatenate([self._station, np.empty_like(self._station)])
        self._points[self._size] = x, y
        self._station[self._size] = self._station[self._size - 1] + step
        self._size += 1

    def retract(self, x: float, y: float) -> None:
        """Shorten an open line to the point on it nearest to x, y: its end has been driven backwards."""
        near = self.end - np.hypot(*(self._points[self._size - 1] - (x, y)))
        station, _ = self.project(x, y, near, window=self.end - near + 1e-9)
        point = self.at(np.array([station]))[0]
        self._size = max(int(np.searchsorted(self._station[: self._size], station)), 1)
        self.append(*point)

    def project(self, x: float, y: float, near: float, window: float) -> tuple[float, float]:
        """Station of the nearest point among those within `window` of station `near`, and the offset to the left."""
        if self.closed and window < np.inf:
            near = near % self.length + (self.length if near % self.length < self.length / 2 else 0)
        station = self._station[: self._size]
        first = max(np.searchsorted(station, near - window, side="right") - 1, 0)
        last = min(np.searchsorted(station, near + window) + 1, self._size)
        first = min(first, max(last - 2, 0))
        points = self._points[first:last]
        step = np.diff(points, axis=0)
        length = np.hypot(*step.T)
        from_start = np.array([x, y]) - points[:-1]
        along = np.clip((from_start * step).sum(axis=1) / length, 0, length)
        away = from_start - step * (along / length)[:, None]
        nearest = int(np.argmin((away**2).sum(axis=1)))
        offset = step[nearest, 0] * from_start[nearest, 1] - step[nearest, 1] * from_start[nearest, 0]
        distance = float(np.hypot(*away[nearest]))
        return float(station[first + nearest] + along[nearest]), float(np.copysign(distance, offset))

    def at(self, station: np.ndarray) -> np.ndarray:
        """Points (m, 2) at stations (m,); before and after an open line, its ends."""
        if self.closed:
            station = np.mod(station, self.length)
        known = self._station[: self._size]
        return np.column_stack([np.interp(station, known, self._points[: self._size, i]) for i in (0, 1)])
