"""Paths along lanes, with stations, and prescribed speeds along them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from platoontraffic.geometry.polyline import Polyline
from platoontraffic.road.route import Route

BEFORE = 200.0  # length of the straight before an open path, where the rear of a platoon may start [m]
SEARCH_WINDOW = 50.0  # stations searched on each side of a known one [m]


@dataclass(frozen=True)
class SpeedProfile:
    """A speed that stays `first` until `brakes_at`, and then falls at a constant rate to `last`."""

    first: float  # [m/s]
    brakes_at: float = math.inf  # [s]
    rate: float = 4.0  # deceleration [m/s2]
    last: float = 0.0  # not above `first` [m/s]

    @property
    def ends(self) -> float:
        """Time when the speed reaches `last` [s]."""
        return self.brakes_at + (self.first - self.last) / self.rate

    def at(self, time: float) -> float:
        """The speed [m/s]."""
        return max(self.first - self.rate * max(time - self.brakes_at, 0.0), min(self.last, self.first))

    def distance(self, time: float) -> float:
        """The distance driven since time 0 [m]."""
        steady = self.first * min(time, self.brakes_at)
        if time <= self.brakes_at:
            return steady
        braking = min(time, self.ends) - self.brakes_at
        return steady + (self.first - self.rate * braking / 2) * braking + self.last * max(time - self.ends, 0.0)


class PathLine:
    """The line of a route, with stations; an open one is prolonged straight before its begin and beyond its end."""

    def __init__(self, route: Route) -> None:
        self.closed, self.length = route.closed, route.length
        points = route.line.points
        self._back = 0.0 if route.closed else BEFORE
        if route.closed:
            self._line = route.line
        else:
            ahead = (points[1] - points[0]) / np.hypot(*(points[1] - points[0]))
            self._line = Polyline(np.vstack([points[0] - BEFORE * ahead, points]))
        self._from, self._limit = route.line.stations, route.limit

    def project(self, x: float, y: float, near: float | None = None) -> tuple[float, float]:
        """Station of the nearest point, within SEARCH_WINDOW of `near` if given, and the offset to the left [m]."""
        window = np.inf if near is None else SEARCH_WINDOW
        station, offset = self._line.project(x, y, (near or 0.0) + self._back, window)
        return station - self._back, offset

    def ahead(self, station: float, other: float) -> float:
        """Distance from one station to another [m]; negative if the other is behind."""
        distance = other - station
        return distance if not self.closed else (distance + self.length / 2) % self.length - self.length / 2

    def pose(self, station: float, offset: float, length: float) -> tuple[float, float, float]:
        """x, y and heading of a vehicle of the given length, with its centre at a station and offset to the left."""
        here, behind, before = self._line.at(self._back + station + length * np.array([0.0, -0.3, 0.3]))
        heading = math.atan2(*(before - behind)[::-1])
        return here[0] - offset * math.sin(heading), here[1] + offset * math.cos(heading), heading

    def limit(self, station: float) -> float:
        """The speed limit [m/s]."""
        here = station % self.length if self.closed else station
        k = np.searchsorted(self._from, here, side="right") - 1
        return float(self._limit[np.clip(k, 0, len(self._limit) - 1)])
