"""Routes of members, and the road ahead of them as their drivers know it.

All rows of a fleet are handled at once: the lines of all routes are concatenated in one array, each from a base
station of its own.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from platoontraffic.controllers import RouteAhead
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import Polyline, project
from platoontraffic.lidar.compiled import compiler
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.drivable_line import LOCK, SPACING, drivable, turns
from platoontraffic.road.eased_line import EASING, WIDEST, eased
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.vehicles.motion import VehicleModel

# Distances of the points ahead that a law is given [vehicle lengths]: dense at first, for steering; then as far as a
# car at 40 m/s that brakes at 3.5 m/s2 needs to stop, dense enough that no bend falls between two points.
REACH = np.concatenate([np.arange(0, 6, 0.25), np.arange(6, 50.1, 0.5)])
BEND = 0.5  # half the length over which curvature is measured [vehicle lengths]
GRID = 8  # stored curvatures per vehicle length

compiled = compiler(__file__, polyline.__file__)


@dataclass(frozen=True, eq=False)
class Route:
    """Edges to drive, and the centre line of their lanes; constructed by `along`."""

    edges: tuple[str, ...]
    line: Polyline  # an open one continues straight beyond `length`
    length: float  # [m]
    limit: np.ndarray  # speed limit from each point of the line on [m/s], (k,)
    lines: tuple[Line, ...]  # stop lines and lane changes
    walled: bool = False  # a wall closes the road at its end
    speed_factor: float = 1.0  # of the one that drives it: times the limits
    top_speed: float = np.inf  # that it drives [m/s]

    @classmethod
    def along(
        cls,
        edges: Sequence[str],
        points: np.ndarray,
        limit: np.ndarray,
        lines: Sequence[Line] = (),
        closed: bool = False,
        walled: bool = False,
    ) -> Route:
        """The route along points (k, 2) [m], with limit (k,) and lines as from `Network.route_lanes`."""
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
        return cls(tuple(edges), Polyline(np.vstack([points, onward])), length, limit, tuple(lines), walled)

    def drivable_by(self, model: VehicleModel) -> Route:
        """The route on a line that a vehicle can drive: rounded by `drivable_line`, and eased for its steering rate."""
        count = np.searchsorted(self.line.stations, self.length * (1 + 1e-12), side="right")
        points, limit = self.line.points[:count], self.limit[:count]
        given = self.line.stations[:count]
        lock = 1 / max(LOCK * model.turning_radius, SPACING * model.length)
        spacing = SPACING * model.length
        rounded, stations = drivable(points, lock, spacing, self.closed)
        if np.isfinite(model.curvature_rate):
            sizes = EASING * model.width, WIDEST * model.length, spacing
            rounded, stations = eased(rounded, stations, points, lock, *sizes, closed=self.closed)
        limit = limit[np.clip(np.searchsorted(given, stations, side="right") - 1, 0, count - 1)]
        kept = turns(rounded) | (np.diff(limit, prepend=limit[0]) != 0)
        rounded, stations, limit = rounded[kept], stations[kept], limit[kept]
        own = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rounded, axis=0).T))])
        lines = [line._replace(station=float(np.interp(line.station, stations, own))) for line in self.lines]
        return Route.along(self.edges, rounded, limit, lines, self.closed, self.walled)

    @property
    def closed(self) -> bool:
        return self.line.closed

    def curvature(self, length: float) -> tuple[np.ndarray, np.ndarray]:
        """Stations [m] and curvature there [1/m], as a vehicle of a length [m] is given it."""
        if length not in self._curvatures:
            self._curvatures[length] = _curvature(self.line, length)
        return self._curvatures[length]

    @cached_property
    def _curvatures(self) -> dict[float, tuple[np.ndarray, np.ndarray]]:
        return {}

    @cached_property
    def _line_stations(self) -> list[float]:
        return [line.station for line in self.lines]

    @cached_property
    def lane_changes(self) -> tuple[np.ndarray, np.ndarray]:
        """Stations [m], and distance of the route there from the lane on which it began, to the left [m]."""
        at, aside = [0.0], [0.0]
        for line in (line for line in self.lines if line.state == CHANGING):
            at += [line.station, line.station + line.across]
            aside += [aside[-1], aside[-1] + line.aside]
        return np.array([*at, self.line.stations[-1]]), np.array([*aside, aside[-1]])

    def lines_about(self, station: float, reach: float) -> tuple[Line | None, float, list[tuple[Line, float]]]:
        """The last stop line before a station, the distance since it [m], and the next lines with the distance to each.

        Without a line before it None and inf. The next line, and further ones within `reach` [m].
        """
        lines, closed = self.lines, self.line.closed
        here = station % self.length if closed else station
        ahead = bisect.bisect_left(self._line_stations, here)
        passed, over = None, np.inf
        if ahead or (closed and lines):
            passed = lines[ahead - 1]
            over = here - passed.station + (0.0 if ahead else self.length)
        found: list[tuple[Line, float]] = []
        for lap, onward in ((0.0, lines[ahead:]), (self.length, lines[:ahead] if closed else ())):
            for line in onward:
                distance = line.station + lap - here
                if found and distance >= reach:
                    return passed, over, found
                found.append((line, distance))
        return passed, over, found


class Routes:
    """The routes of some vehicles; rows (n,)."""

    def __init__(self, routes: Sequence[Route], length: np.ndarray) -> None:
        """length: of the vehicles [m], (n,)"""
        # Vehicles that differ in their speeds alone have the same line.
        of_row = [(id(route.line), size) for route, size in zip(routes, length.tolist(), strict=True)]
        kinds = {kind: number for number, kind in enumerate(dict.fromkeys(of_row))}
        chosen = {id(route.line): route for route in routes}
        which = np.array([kinds[kind] for kind in of_row])
        lines = [chosen[key].line for key, _ in kinds]
        spans = np.array([line.stations[-1] for line in lines])
        bases = np.concatenate([[0.0], np.cumsum(spans[:-1] + 1.0)])
        self._length = length
        self._base, self._span = bases[which], spans[which]
        stops = np.cumsum([len(line.points) for line in lines])
        self._points_of = np.column_stack([np.concatenate([[0], stops[:-1]]), stops])[which]
        self._stations = np.concatenate([line.stations + base for line, base in zip(lines, bases, strict=True)])
        self._points = np.concatenate([line.points for line in lines])
        self._limits = np.concatenate([chosen[key].limit for key, _ in kinds])
        grids = [chosen[key].curvature(size) for key, size in kinds]
        self._grid = np.concatenate([grid + base for (grid, _), base in zip(grids, bases, strict=True)])
        self._curvature = np.concatenate([curvature for _, curvature in grids])
        shifts = [chosen[key].lane_changes for key, _ in kinds]
        self._changes = np.concatenate([at + base for (at, _), base in zip(shifts, bases, strict=True)])
        self._aside = np.concatenate([aside for _, aside in shifts])
        self._shifted = bool(self._aside.any())
        self._closed = np.array([route.closed for route in routes])
        self.walled = np.array([route.walled for route in routes])  # a wall closes the road at the end of the route
        self._end = np.array([route.length for route in routes])
        self._last = np.where(self._closed, np.inf, self._end)  # station at which it ends
        self._factor, self._top_speed = np.array([(route.speed_factor, route.top_speed) for route in routes]).T

    def project(self, x: np.ndarray, y: np.ndarray, near: np.ndarray, window: np.ndarray) -> np.ndarray:
        """Stations (n,) of the nearest points within `window` (n,) of stations `near`, as Polyline.project."""
        routes, station = (self._base, self._points_of, self._closed, self._end), np.empty(len(x))
        _project((self._stations, self._points), routes, x, y, near, window, station)
        return station

    def ahead(
        self, station: np.ndarray, x: np.ndarray, y: np.ndarray, heading: np.ndarray, rows: np.ndarray | None = None
    ) -> RouteAhead:
        """The road ahead of stations (m,), in the frames of driven axles at poses (m,).

        rows: of the routes, (m,); by default all
        """
        rows = np.arange(len(station)) if rows is None else rows
        shape = len(station), len(REACH)
        ahead = RouteAhead(np.empty(shape), np.empty((*shape, 2)), *np.empty((2, *shape)), np.zeros(shape))
        routes = self._length, self._closed, self._end, self._span, self._base, self._factor, self._top_speed
        lines, grid = (self._stations, self._points, self._limits), (self._grid, self._curvature)
        poses = x, y, np.cos(heading), np.sin(heading)
        _look_ahead(rows, station, poses, routes, lines, grid, (self._changes, self._aside), self._shifted, ahead)
        return ahead

    def left(self, station: np.ndarray) -> np.ndarray:
        """Distance to the end of the route [m], (n,); inf on a closed one."""
        return self._last - station


@compiled
def _project(lines, routes, x, y, near, window, station):
    """Fill in the stations (n,) of `Routes.project`.

    lines  : stations (k,) and points (k, 2) of all routes
    routes : of each row's: base station, first point and the one after its last, (n, 2), whether it is closed, length
    """
    stations, points = lines
    base, points_of, closed, end = routes
    for i in range(len(x)):
        first, stop = points_of[i]
        about = near[i]
        if closed[i]:
            about = about % end[i]
            if about < end[i] / 2:
                about += end[i]
        there, _ = project(points[first:stop], stations[first:stop], x[i], y[i], about + base[i], window[i])
        station[i] = there - base[i]


@compiled
def _look_ahead(rows, station, poses, routes, lines, grid, changes, shifted, ahead):
    """Fill in `RouteAhead` as of `Routes.ahead`.

    poses   : x, y [m], cosine and sine of the heading, (m,)
    routes  : vehicle length, whether it is closed, its length, that of its line, base station, factor on its limits,
              top speed, (n,) each
    lines   : stations, points and limits of all routes
    grid    : stations and curvature there; changes: stations and distance from the first lane there
    shifted : a route changes lanes
    """
    x, y, cos, sin = poses
    length, closed, end, span, base, factor, top_speed = routes
    stations, points, limits = lines
    for i in range(len(rows)):
        r = rows[i]
        k = bend = change = -1
        before = np.inf
        for j in range(len(REACH)):
            distance = REACH[j] * length[r]
            there = station[i] + distance
            there = (there % end[r] if closed[r] else min(there, span[r])) + base[r]
            if there < before:  # the first, or a new lap
                k, bend, change = _last(stations, there), _last(grid[0], there), _last(changes[0], there)
            before = there
            while k + 1 < len(stations) and stations[k + 1] <= there:
                k += 1
            while bend + 1 < len(grid[0]) and grid[0][bend + 1] <= there:
                bend += 1
            ahead.distance[i, j], ahead.limit[i, j] = distance, min(factor[r] * limits[k], top_speed[r])
            ahead.curvature[i, j] = _between(grid[0], grid[1], bend, there)
            if shifted:
                while change + 1 < len(changes[0]) and changes[0][change + 1] <= there:
                    change += 1
                ahead.aside[i, j] = _between(changes[0], changes[1], change, there)
            east, north = points[k, 0], points[k, 1]
            if there != stations[k] and k + 1 < len(stations):
                size, along = stations[k + 1] - stations[k], there - stations[k]
                east += (points[k + 1, 0] - east) / size * along
                north += (points[k + 1, 1] - north) / size * along
            east, north = east - x[i], north - y[i]
            ahead.points[i, j, 0] = east * cos[i] + north * sin[i]
            ahead.points[i, j, 1] = north * cos[i] - east * sin[i]


@compiled
def _last(stations, there):
    """The last one of stations that is not beyond a station; the first, if all are."""
    return max(np.searchsorted(stations, there, side="right") - 1, 0)


@compiled
def _between(stations, values, k, there):
    """As np.interp, where the k-th one is the last station that is not beyond."""
    if there <= stations[k] or k + 1 == len(stations):
        return values[k]
    return (values[k + 1] - values[k]) / (stations[k + 1] - stations[k]) * (there - stations[k]) + values[k]


def _curvature(line: Polyline, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Stations [m] and curvature there, positive to the left [1/m], (g,): change of heading over 2 BEND lengths."""
    half, end = BEND * length, line.stations[-1]
    stations = np.linspace(0, end, max(int(np.ceil(end / length * GRID)), 1) + 1)
    behind, here, before = (line.at(s if line.closed else np.clip(s, 0, end)) for s in
                            (stations - half, stations, stations + half))  # fmt: skip
    one, two = here - behind, before - here
    whole = (np.hypot(*one.T) > half / 2) & (np.hypot(*two.T) > half / 2)  # false near the ends of an open line
    turn = wrap(np.arctan2(two[:, 1], two[:, 0]) - np.arctan2(one[:, 1], one[:, 0]))
    return stations, np.where(whole, turn / half, 0.0)
