"""Routes: the lanes that members mean to drive, and what a driver knows of the road ahead.

Everything is done for all rows of a fleet at once: the lines of all routes stand one behind the other in one array,
each at a station of its own.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidar.pose import wrap
from platoontraffic.controllers import RouteAhead
from platoontraffic.network import Line
from platoontraffic.polyline import Polyline

# What a law is given, in vehicle lengths: close together at first, for steering, then out to where a car at 40 m/s
# that brakes at 3.5 m/s2 comes to stand, close enough that no bend falls between two points.
REACH = np.concatenate([np.arange(0, 6, 0.25), np.arange(6, 50.1, 0.5)])
BEND = 1.5  # half the length over which curvature is taken: lanes are polylines, and a corner of one is no bend
GRID = 8  # curvatures in a vehicle length


@dataclass(frozen=True, eq=False)
class Route:
    """Edges to drive, and the centre line of their lanes; made by `along`."""

    edges: tuple[str, ...]
    line: Polyline  # an open one goes on straight beyond `length`
    length: float  # [m]
    limit: np.ndarray  # of speed, from each point of the line on [m/s], (k,)
    lines: tuple[Line, ...]  # where it meets junctions

    @classmethod
    def along(
        cls, edges: Sequence[str], points: np.ndarray, limit: np.ndarray, lines: Sequence[Line] = (), closed=False
    ) -> Route:
        """points (k, 2) [m], limit (k,) and lines as in `Network.route_lanes`."""
        points, limit = np.asarray(points, dtype=float), np.asarray(limit, dtype=float)
        steps = np.hypot(*np.diff(points, axis=0).T)
        length = float(steps.sum())
        if closed:
            if np.array_equal(points[0], points[-1]):
                points, limit = points[:-1], limit[:-1]
            line, limit = Polyline(points, closed=True), np.concatenate([limit, limit, limit[:1]])
            return cls(tuple(edges), line, line.length, limit, tuple(lines))
        onward = points[-1] + (points[-1] - points[-2]) / steps[-1] * max(length, 1.0)
        limit = np.append(limit, limit[-1])
        return cls(tuple(edges), Polyline(np.vstack([points, onward])), length, limit, tuple(lines))

    @property
    def closed(self) -> bool:
        return self.line.closed

    def lines_about(self, station: float) -> tuple[Line | None, Line | None, float]:
        """The last line passed, the next one ahead, and the way to that [m]; None and inf where there is none."""
        here = station % self.length if self.closed else station
        ahead = bisect.bisect_left(self.lines, here, key=lambda line: line.station)
        passed = self.lines[ahead - 1] if ahead or (self.closed and self.lines) else None
        if ahead < len(self.lines):
            return passed, self.lines[ahead], self.lines[ahead].station - here
        if self.closed and self.lines:
            return passed, self.lines[0], self.lines[0].station + self.length - here
        return passed, None, np.inf


class Routes:
    """The routes of some vehicles, and where these are on them. Rows (n,)."""

    def __init__(self, routes: Sequence[Route], length: np.ndarray) -> None:
        """length: of the vehicles [m], (n,)."""
        kinds = list(dict.fromkeys(zip(map(id, routes), length.tolist(), strict=True)))
        chosen = {id(route): route for route in routes}
        which = np.array([kinds.index(kind) for kind in zip(map(id, routes), length.tolist(), strict=True)])
        lines = [chosen[key].line for key, _ in kinds]
        spans = np.array([line.stations[-1] for line in lines])
        bases = np.concatenate([[0.0], np.cumsum(spans[:-1] + 1.0)])
        self._length = length
        self._base, self._span = bases[which], spans[which]
        self._stations = np.concatenate([line.stations + base for line, base in zip(lines, bases, strict=True)])
        self._points = np.concatenate([line.points for line in lines])
        self._limits = np.concatenate([chosen[key].limit for key, _ in kinds])
        grids = [_curvature(line, size) for line, (_, size) in zip(lines, kinds, strict=True)]
        self._grid = np.concatenate([grid + base for (grid, _), base in zip(grids, bases, strict=True)])
        self._curvature = np.concatenate([curvature for _, curvature in grids])
        self._closed = np.array([route.closed for route in routes])
        self._end = np.array([route.length for route in routes])

    def project(self, x: np.ndarray, y: np.ndarray, near: np.ndarray, window: np.ndarray) -> np.ndarray:
        """Stations (n,) of the nearest points within `window` (n,) of stations `near`, as Polyline.project."""
        turn = np.where(self._closed, self._end, np.inf)
        near = np.where(self._closed, np.mod(near, turn), near)
        near = np.where(self._closed & (near < self._end / 2), near + self._end, near)
        first_of, last_of = (np.searchsorted(self._stations, s) for s in (self._base, self._base + self._span))
        first = np.searchsorted(self._stations, self._base + np.maximum(near - window, 0.0), side="right") - 1
        last = np.searchsorted(self._stations, self._base + np.minimum(near + window, self._span) + 1e-9)
        first, last = np.clip(first, first_of, last_of - 1), np.minimum(last, last_of)
        k = first[:, None] + np.arange(max(int((last - first).max()), 1))
        k = np.minimum(k, np.maximum(last, first + 1)[:, None] - 1)  # a short row repeats its last piece
        start, step = self._points[k], self._points[k + 1] - self._points[k]
        size = self._stations[k + 1] - self._stations[k]
        from_start = np.stack([x, y], axis=-1)[:, None, :] - start
        along = np.clip((from_start * step).sum(axis=-1) / size, 0, size)
        away = from_start - step * (along / size)[..., None]
        nearest = (away**2).sum(axis=-1).argmin(axis=1)
        rows = np.arange(len(k))
        return self._stations[k[rows, nearest]] + along[rows, nearest] - self._base

    def ahead(self, station: np.ndarray, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> RouteAhead:
        """What lies ahead of stations (n,), as seen from poses of the driven axle."""
        distance = REACH * self._length[:, None]
        there = station[:, None] + distance
        turn = np.where(self._closed, self._end, np.inf)[:, None]
        there = np.where(self._closed[:, None], np.mod(there, turn), np.minimum(there, self._span[:, None]))
        there += self._base[:, None]
        east, north = (np.interp(there, self._stations, self._points[:, i]) for i in (0, 1))
        east, north = east - x[:, None], north - y[:, None]
        cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
        points = np.stack([east * cos + north * sin, north * cos - east * sin], axis=-1)
        limit = self._limits[np.searchsorted(self._stations, there, side="right") - 1]
        curvature = np.interp(there, self._grid, self._curvature)
        return RouteAhead(distance, points, limit, curvature)

    def left(self, station: np.ndarray) -> np.ndarray:
        """Way to the end of the route [m], (n,); inf on a closed one."""
        return np.where(self._closed, np.inf, self._end - station)


def _curvature(line: Polyline, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Stations (g,) and curvature there, to the left [1/m]: change of heading over 2 BEND vehicle lengths."""
    half, end = BEND * length, line.stations[-1]
    stations = np.linspace(0, end, max(int(np.ceil(end / length * GRID)), 1) + 1)
    behind, here, before = (line.at(s if line.closed else np.clip(s, 0, end)) for s in
                            (stations - half, stations, stations + half))  # fmt: skip
    one, two = here - behind, before - here
    whole = (np.hypot(*one.T) > half / 2) & (np.hypot(*two.T) > half / 2)  # not where an open line begins or ends
    turn = wrap(np.arctan2(two[:, 1], two[:, 0]) - np.arctan2(one[:, 1], one[:, 0]))
    return stations, np.where(whole, turn / half, 0.0)
