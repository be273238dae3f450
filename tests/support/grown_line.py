"""One line that grows and shrinks, in plain numpy: the oracle for compiled paths."""

from __future__ import annotations

import numpy as np


class GrownLine:
    """Points joined by straight lines; station 0 is at the first point."""

    def __init__(self, points: np.ndarray) -> None:
        """points: (2 or more, 2), no two in a row equal."""
        self._points = [np.array(point, dtype=float) for point in points]

    @property
    def _stations(self) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self._points, axis=0).T))])

    @property
    def end(self) -> float:
        """Station of the last point."""
        return float(self._stations[-1])

    def append(self, x: float, y: float) -> None:
        """Extend the line to a further point; a point equal to the last one adds nothing."""
        if (x, y) != tuple(self._points[-1]):
            self._points.append(np.array([x, y]))

    def retract(self, x: float, y: float) -> None:
        """Shorten the line to its point nearest to x, y, searched as far back as x, y is from its end."""
        away = np.hypot(*(self._points[-1] - (x, y)))
        station, _ = self.project(x, y, self.end - away, window=away + 1e-9)
        station = min(max(station, 0.0), self.end)
        point = self.at(station)
        del self._points[max(int(np.searchsorted(self._stations, station)), 1) :]
        self.append(*point)

    def project(self, x: float, y: float, near: float, window: float) -> tuple[float, float]:
        """Station of the nearest point, and the offset to the left, among pieces within `window` of `near`.

        Before its first point and beyond its last the line goes straight on.
        """
        stations, starts, step = self._stations, np.array(self._points[:-1]), np.diff(self._points, axis=0)
        length = np.diff(stations)
        away = (x, y) - starts
        along = np.clip((away * step).sum(axis=1) / length, 0, length)
        distance = np.hypot(*(away - step * (along / length)[:, None]).T)
        reached = (stations[:-1] < near + window) & (stations[1:] > near - window)
        reached |= ~reached.any() & (np.arange(len(step)) == (0 if near + window <= 0 else len(step) - 1))
        k = int(np.argmin(np.where(reached, distance, np.inf)))
        side = step[k, 0] * away[k, 1] - step[k, 1] * away[k, 0]
        if k == 0 and (behind := float((away[0] * step[0]).sum() / length[0])) < 0:
            return behind, float(side / length[0])
        beyond = float((away[-1] * step[-1]).sum() / length[-1]) - length[-1]
        if k == len(step) - 1 and beyond > 0:
            return self.end + beyond, float(side / length[-1])
        return float(stations[k] + along[k]), float(np.copysign(distance[k], side))

    def at(self, station: float) -> np.ndarray:
        """The point at a station, (2,)."""
        return np.array([np.interp(station, self._stations, column) for column in np.transpose(self._points)])
