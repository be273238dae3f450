"""Routes of members, and the road ahead of them as their drivers know it.

All rows of a fleet are handled at once: the lines of all routes are in one array, one behind another. Stations of each
count from a base station of its own.
"""

from __future__ import annotations

import bisect
import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from platoontraffic.controllers import RouteAhead
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import Polyline, project
from platoontraffic.lidar.compiled import compiler
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.drivable_line import LOCK, SPACING, drivable, turns
from platoontraffic.road.eased_line import WIDTH, corridor_of, eased
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.vehicles.motion import VehicleModel

# Distances of the points ahead that a law is given [vehicle lengths]: dense at first, for steering; then as far as a
# car at 40 m/s that brakes at 3.5 m/s2 needs to stop, dense enough that no bend falls between two points.
REACH = np.concatenate([np.arange(0, 6, 0.25), np.arange(6, 50.1, 0.5)])
POINTS = len(REACH)
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
        """The route on a line that a vehicle can drive: rounded by `drivable_line`, and eased by `eased_line`."""
        count = np.searchsorted(self.line.stations, self.length * (1 + 1e-12), side="right")
        points, limit = self.line.points[:count], self.limit[:count]
        given = self.line.stations[:count]
        lock = 1 / max(LOCK * model.turning_radius, SPACING * model.length)
        spacing = SPACING * model.length
        rounded, stations = drivable(points, lock, spacing, self.closed)
        if np.isfinite(model.curvature_rate):
            sizes = *corridor_of(model.width), WIDTH * model.length, spacing, model.length / 2 - model.axle
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

    def limit_at(self, station: float) -> float:
        """The speed limit at a station [m/s]."""
        return float(self.limit[max(int(np.searchsorted(self.line.stations, station, side="right")) - 1, 0)])

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

    def __init__(self, routes: Sequence[Route], length: np.ndarray, known: Routes | None = None) -> None:
        """
        length : of the vehicles [m], (n,)
        known  : routes of which many are the same: what is laid out for them is not laid out again
        """
        # Vehicles that differ in their speeds alone have the same line.
        of_row = [(route.line, size) for route, size in zip(routes, length.tolist(), strict=True)]
        kinds = dict(zip(of_row, routes, strict=True))
        self._routes = tuple(routes)
        self._layout = known._layout if known and known._layout.has_room_for(len(kinds)) else _Layout()
        self._layout.add(kinds)
        places = np.array([self._layout.places[kind] for kind in of_row]).reshape(-1, 3, 2)
        self._points_of, self._grid_of, self._changes_of = np.ascontiguousarray(places.transpose(1, 0, 2))
        self._length, self._shortest = length, float(length.min())
        self._span = np.array([line.stations[-1] for line, _ in of_row])
        self._base = _bases(self._points_of[:, 0], self._span)
        self._shifted = self._layout.shifted
        self._closed = np.array([route.closed for route in routes])
        self.walled = np.array([route.walled for route in routes])  # a wall closes the road at the end of the route
        self._end = np.array([route.length for route in routes])
        self._last = np.where(self._closed, np.inf, self._end)  # station at which it ends
        self._factor, self._top_speed = np.array([(route.speed_factor, route.top_speed) for route in routes]).T

    def with_one(self, k: int, route: Route) -> Routes:
        """The same with another route in row k. (All of a thousand rows again take 4 ms.)"""
        routes, kind = (*self._routes[:k], route, *self._routes[k + 1 :]), (route.line, float(self._length[k]))
        if not self._layout.has_room_for(len(np.unique(self._base))):
            return Routes(routes, self._length, self)
        self._layout.add({kind: route})
        new = copy.copy(self)
        new._routes, new._shifted = routes, self._layout.shifted
        ends = route.length, np.inf if route.closed else route.length
        for name, value in zip(
            ("_points_of", "_grid_of", "_changes_of", "_span", "_closed", "walled", "_end", "_last", "_factor",
             "_top_speed"),
            (*self._layout.places[kind], route.line.stations[-1], route.closed, route.walled, *ends,
             route.speed_factor, route.top_speed),
            strict=True,
        ):  # fmt: skip
            values = getattr(self, name).copy()
            values[k] = value
            setattr(new, name, values)
        new._base = _bases(new._points_of[:, 0], new._span)
        return new

    def project(self, x: np.ndarray, y: np.ndarray, near: np.ndarray, window: np.ndarray) -> np.ndarray:
        """Stations (n,) of the nearest points within `window` (n,) of stations `near`, as Polyline.project."""
        routes, station = (self._base, self._points_of, self._closed, self._end), np.empty(len(x))
        _project(self._layout.lines[:2], routes, x, y, near, window, station)
        return station

    def ahead(
        self,
        station: np.ndarray,
        x: np.ndarray,
        y: np.ndarray,
        heading: np.ndarray,
        rows: np.ndarray | None = None,
        reach: float = np.inf,
    ) -> RouteAhead:
        """The road ahead of stations (m,), in the frames of driven axles at poses (m,).

        rows  : of the routes, (m,); by default all
        reach : distance up to which it is needed [m]; `REACH` at most
        """
        rows = np.arange(len(station)) if rows is None else rows
        shape = len(station), min(int(REACH.searchsorted(reach / self._shortest)) + 1, POINTS)
        ahead = RouteAhead(np.empty(shape), np.empty((*shape, 2)), *np.empty((2, *shape)), np.zeros(shape))
        routes = self._length, self._closed, self._end, self._span, self._base, self._factor, self._top_speed
        places, layout = (self._points_of, self._grid_of, self._changes_of), self._layout
        poses = x, y, np.cos(heading), np.sin(heading)
        _look_ahead(rows, station, poses, routes, places, layout.lines, layout.grids, layout.changes, self._shifted,
                    ahead)  # fmt: skip
        return ahead

    def left(self, station: np.ndarray) -> np.ndarray:
        """Distance to the end of the route [m], (n,); inf on a closed one."""
        return self._last - station


class _Layout:
    """Arrays of routes one behind another, with room for more.

    places  : by line and length of the vehicle [m]: first and last + 1 of its rows in lines, grids and changes
    lines   : stations (k,) [m], points (k, 2) [m], and limits (k,) [m/s]
    grids   : stations and curvature there, (k,) each
    changes : stations and distance from the first lane there, (k,) each
    """

    def __init__(self) -> None:
        self.places: dict[tuple[Polyline, float], tuple[tuple[int, int], ...]] = {}
        self.lines = np.empty(0), np.empty((0, 2)), np.empty(0)
        self.grids = self.changes = np.empty(0), np.empty(0)
        self._used = 0, 0, 0  # rows of each

    def has_room_for(self, lines: int) -> bool:
        """Whether so many lines are half of all, or more: else it is time to forget the others."""
        return len(self.places) < 2 * lines

    @property
    def shifted(self) -> bool:
        """Some route changes lanes."""
        return bool(self.changes[1][: self._used[-1]].any())

    def add(self, routes: Mapping[tuple[Polyline, float], Route]) -> None:
        """Lay out those that are not yet here. Places of the others stay."""
        new = [(kind, route) for kind, route in routes.items() if kind not in self.places]
        if not new:
            return
        parts = [
            [(line.stations, line.points, route.limit) for (line, _), route in new],
            [route.curvature(size) for (_, size), route in new],
            [route.lane_changes for _, route in new],
        ]
        ends = [np.cumsum([used, *(len(one[0]) for one in of)]) for used, of in zip(self._used, parts, strict=True)]
        spans = (zip(end[:-1].tolist(), end[1:].tolist(), strict=True) for end in ends)
        self.places.update(zip((kind for kind, _ in new), zip(*spans, strict=True), strict=True))
        self.lines, self.grids, self.changes = (
            tuple(_extended(array, used, more) for array, more in zip(arrays, zip(*of, strict=True), strict=True))
            for arrays, used, of in zip((self.lines, self.grids, self.changes), self._used, parts, strict=True)
        )
        self._used = tuple(int(end[-1]) for end in ends)


def _bases(first: np.ndarray, span: np.ndarray) -> np.ndarray:
    """Base stations of rows [m], (n,): 1 m behind the end of the line before, by the order in which lines come first.

    first : first point of each row's line, among those of all
    span  : length of each row's line [m]
    """
    _, row, line = np.unique(first, return_index=True, return_inverse=True)
    order = np.argsort(row)
    bases = np.empty(len(row))
    bases[order] = np.concatenate([[0.0], np.cumsum(span[row[order]][:-1] + 1.0)])
    return bases[line]


def _extended(array: np.ndarray, used: int, more: Sequence[np.ndarray]) -> np.ndarray:
    """An array with more rows behind those that are used: itself, if it has room; else a copy with twice as many."""
    size = used + sum(map(len, more))
    if size > len(array):
        array, old = np.empty((2 * size if used else size, *array.shape[1:])), array
        array[:used] = old[:used]
    np.concatenate(more, out=array[used:size])
    return array


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
        about += base[i]
        # Only what lies within the window: a whole line takes longer to copy than the rest.
        low = first + min(_last(stations[first:stop], base[i], about - window[i]), stop - first - 2)
        high = low + 2
        while high < stop and stations[high - 1] + base[i] < about + window[i]:
            high += 1
        there, _ = project(points[low:high], stations[low:high] + base[i], x[i], y[i], about, window[i])
        station[i] = there - base[i]


@compiled
def _look_ahead(rows, station, poses, routes, places, lines, grids, changes, shifted, ahead):
    """Fill in `RouteAhead` as of `Routes.ahead`.

    poses   : x, y [m], cosine and sine of the heading, (m,)
    routes  : vehicle length, whether it is closed, its length, that of its line, base station, factor on its limits,
              top speed, (n,) each
    places  : of each row's in lines, grids and changes: the first and the one after the last, (n, 2) each
    lines, grids, changes : as of `_Layout`
    shifted : a route changes lanes
    """
    x, y, cos, sin = poses
    length, closed, end, span, base, factor, top_speed = routes
    points_of, grid_of, changes_of = places
    for i in range(len(rows)):
        r = rows[i]
        (first, stop), (grid_first, grid_stop), (change_first, change_stop) = points_of[r], grid_of[r], changes_of[r]
        stations, points, limits = lines[0][first:stop], lines[1][first:stop], lines[2][first:stop]
        grid, curvature = grids[0][grid_first:grid_stop], grids[1][grid_first:grid_stop]
        changed, aside = changes[0][change_first:change_stop], changes[1][change_first:change_stop]
        begin, spacing = base[r], grid[-1] / (len(grid) - 1)  # the grid is even
        k = change = -1
        before, piece, slope_x, slope_y = np.inf, -1, 0.0, 0.0
        for j in range(ahead.distance.shape[1]):
            distance = REACH[j] * length[r]
            there = station[i] + distance
            there = (there % end[r] if closed[r] else min(there, span[r])) + begin
            if there < before:  # the first, or a new lap
                k, change = _last(stations, begin, there), _last(changed, begin, there)
            before = there
            while k + 1 < len(stations) and stations[k + 1] + begin <= there:
                k += 1
            ahead.distance[i, j], ahead.limit[i, j] = distance, min(factor[r] * limits[k], top_speed[r])
            ahead.curvature[i, j] = between_even(curvature, spacing, there - begin)
            if shifted:
                while change + 1 < len(changed) and changed[change + 1] + begin <= there:
                    change += 1
                ahead.aside[i, j] = _between(changed, begin, aside, change, there)
            here = stations[k] + begin
            if k != piece and k + 1 < len(stations):  # divisions take as long as all else
                size, piece = stations[k + 1] + begin - here, k
                slope_x, slope_y = (points[k + 1, 0] - points[k, 0]) / size, (points[k + 1, 1] - points[k, 1]) / size
            along = there - here if k + 1 < len(stations) else 0.0
            east, north = points[k, 0] + slope_x * along - x[i], points[k, 1] + slope_y * along - y[i]
            ahead.points[i, j, 0] = east * cos[i] + north * sin[i]
            ahead.points[i, j, 1] = north * cos[i] - east * sin[i]


@compiled
def between_even(values, spacing, there):
    """As np.interp, of values at 0, `spacing`, 2 `spacing` and so on."""
    along = max(there / spacing, 0.0) if spacing > 0.0 else 0.0
    k = min(int(along), len(values) - 2)
    return values[k] + (values[k + 1] - values[k]) * min(along - k, 1.0)


@compiled
def _last(stations, base, there):
    """The last one of stations, from a base, that is not beyond a station; the first, if all are."""
    low, high = 0, len(stations)
    while low < high:
        middle = (low + high) // 2
        if stations[middle] + base <= there:
            low = middle + 1
        else:
            high = middle
    return max(low - 1, 0)


@compiled
def _between(stations, base, values, k, there):
    """As np.interp, where the k-th one of stations, from a base, is the last one that is not beyond."""
    here = stations[k] + base
    if there <= here or k + 1 == len(stations) or values[k] == values[k + 1]:
        return values[k]
    return (values[k + 1] - values[k]) / (stations[k + 1] + base - here) * (there - here) + values[k]


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
