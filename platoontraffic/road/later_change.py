"""A lane change later or sooner on its lane, a shorter one, or one on an edge beyond.

A vehicle without room for its lane change drives on and looks for room there, as on a slip road. The slower it is, the
less road the change takes. Where its lane leads on to the next edge of its route it may change there. In a queue it
changes where it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.lane_routes import (
    BETWEEN,
    CHANGE_AFTER,
    CHANGING,
    ENOUGH_ROOM,
    Change,
    Line,
    change_length,
    changes_length,
)
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.vehicles.motion import VehicleModel
from platoontraffic.vehicles.records import changed

AT_LEAST = 1.0  # by which a change must become later, to be worth another route [vehicle lengths]
SHORTER = 0.75  # share of its length to which it must shrink otherwise
NEAR = 5.0  # distance by which rounding changes stations, at most [m]
JOIN = 2.0  # distance before the old change over which the new line takes over from the old one [vehicle lengths]
LEAD_IN = 1.2  # least length of an edge before a change that is sooner [vehicle lengths]: else it bends too sharply
SPACING = 0.5  # of points there [m]
STRAIGHT = 4.0  # length of a straight on which the given line takes over from the new one again [vehicle lengths] ...
NO_BEND = 0.01  # ... and by which the line turns there over a vehicle length, at most [rad]


class _Onward(NamedTuple):
    """A route from the edge of a lane change on, or from the edge before it, with another change."""

    route: Route
    before: int  # number of its lines before the change
    entered: float  # station where the edge of the change begins [m]
    takes_over: float = math.inf  # station of the given route where it ends, on a straight [m]; inf: both end there
    rest: tuple[Line, ...] = ()  # of the given route from there on


def with_later_change(
    route: Route, change: Line, by: float, network: Network, model: VehicleModel, longest: float = math.inf
) -> Route | None:
    """The route with one of its lane changes, and the next ones on its edge, later by a distance [m], or by less where
    its lane ends.

    longest: greatest length of that change over one lane [m]
    returns: a route whose stations before the change are those of the given one; None on a loop, or where there is no
             room for it
    """
    lane, width, begin = _place_of(change, network)
    changes = _changes_from(route.lines, change)
    target, across = index_of(changes[-1].onto), changes[-1].station + changes[-1].across - change.station
    whole = changes_length(width, longest, _lanes_crossed(changes), len(changes))
    later = min(begin + by, begin + change.to_end - whole - model.length)  # so that it comes to the line straight
    is_worth_it = later >= begin + AT_LEAST * model.length or (later >= begin and whole < SHORTER * across)
    if route.closed or not is_worth_it:
        return None
    first = Change(0, lane, target)
    i = route.lines.index(change)
    onward = _onward(route, i, first, network, model, later - CHANGE_AFTER * width, longest)
    join = min(JOIN * model.length, begin / 2)
    ends = change.station - join, onward.route.lines[onward.before].station - (later - begin) - join
    return _changed_from(route, i, onward, *ends, join, model)


def with_sooner_change(route: Route, change: Line, by: float, network: Network, model: VehicleModel) -> Route | None:
    """The route with one of its lane changes, and the next ones on its edge, sooner by a distance [m], and as short as
    they can be.

    returns: a route whose stations before that place are those of the given one; None on a loop, near the begin of the
             edge, before the vehicle is straight on its lane after another change, or where it would hardly be sooner
    """
    lane, width, begin = _place_of(change, network)
    changes, length, i = _changes_from(route.lines, change), begin + change.to_end, route.lines.index(change)
    begin -= by
    if route.closed or begin < LEAD_IN * model.length:
        return None
    last = route.lines[i - 1] if i else None
    if last and last.state == CHANGING and change.station - by < last.station + last.across + BETWEEN * width:
        return None
    latest_begin = length - changes_length(width, 0.0, _lanes_crossed(changes), len(changes))
    position = begin if begin > latest_begin else begin - CHANGE_AFTER * width  # after which the first one begins there
    first = Change(0, lane, index_of(changes[-1].onto))
    onward = _onward(route, i, first, network, model, position, 0.0)
    join = min(JOIN * model.length, begin / 2)
    ends = change.station - by - join, onward.route.lines[onward.before].station - join
    sooner = _changed_from(route, i, onward, *ends, join, model)
    return sooner if sooner.lines[i].station < change.station - by / 2 else None


def latest(route: Route, change: Line, width: float, length: float) -> float:
    """By how much a lane change, and the next ones on its edge, as short as they can be, may be later [m]; at least 0.

    width, length : of the lane, and of the vehicle [m]
    """
    changes = _changes_from(route.lines, change)
    shortest = changes_length(width, 0.0, _lanes_crossed(changes), len(changes))
    return max(change.to_end - shortest - length, 0.0)


def longest_later(route: Route, change: Line, by: float, width: float, length: float) -> float:
    """Greatest length over one lane that a change may have if it is later by a distance [m]; arguments as of `latest`.

    A longer one would end beyond the lane's end.
    """
    spare = latest(route, change, width, length) - by
    return change_length(width, 0.0) + max(spare, 0.0) / _lanes_crossed(_changes_from(route.lines, change))


def with_change_beyond(route: Route, change: Line, network: Network, model: VehicleModel) -> Route | None:
    """The route without one of its lane changes, and the next ones on its edge, and with others beyond instead.

    returns: as of `with_later_change`; None also where its lane does not lead on, or there would be less room for each
             lane that is crossed, and less than ENOUGH_ROOM
    """
    if route.closed:
        return None
    lane, _, begin = _place_of(change, network)
    i = route.lines.index(change)
    try:
        onward = _onward(route, i, Change(0, lane, lane), network, model)
    except InputError:
        return None
    lines = *onward.route.lines[onward.before :], *onward.rest
    firsts = _first_changes(lines)
    room = min((first.to_end / _lanes_crossed(_changes_from(lines, first)) for first in firsts), default=math.inf)
    if room < min(change.to_end / _lanes_crossed(_changes_from(route.lines, change)), ENOUGH_ROOM):
        return None
    join = min(JOIN * model.length, begin / 2)
    ends = change.station - join, onward.entered + begin - join
    return _changed_from(route, i, onward, *ends, join, model)


def with_other_lane(
    route: Route, station: float, onto: int, network: Network, model: VehicleModel, longest: float = math.inf
) -> Route | None:
    """The route by which the edge at a station is left from another lane.

    It changes to that lane there, if it is on another one. Beyond the edge it changes lanes as rarely as it can.

    station : in no lane change [m]
    onto    : index of the lane from which it leaves the edge
    longest : greatest length of the change over one lane [m]
    returns : a route whose stations until there are those of the given one; that one itself where it leaves the edge
              so; None on a loop, on the last edge, near the begin of the edge, where there is no room for the change,
              or where that lane does not lead on
    """
    i = next((k for k, line in enumerate(route.lines) if line.station >= station), len(route.lines))
    end = next((line for line in route.lines[i:] if line.state != CHANGING), None)
    if route.closed or end is None:
        return None
    if route.lines[i] is end and index_of(end.lane) == onto:
        return route
    here = route.lines[i]._replace(station=station, to_end=end.station - station)
    lane, width, begin = _place_of(here, network)
    lanes = abs(onto - lane)
    spare = here.to_end - model.length - changes_length(width, 0.0, lanes, lanes) if lanes else math.inf
    if spare < 0 or begin < LEAD_IN * model.length:
        return None
    if lanes:
        longest = min(longest, change_length(width, 0.0) + spare / lanes)
    position = begin - CHANGE_AFTER * width  # after which the change begins there
    try:
        onward = _onward(route, i, Change(0, lane, onto), network, model, position, longest)
    except InputError:
        return None
    join = min(JOIN * model.length, begin / 2)
    return _changed_from(route, i, onward, station - join, onward.entered + begin - join, join, model)


def _place_of(change: Line, network: Network) -> tuple[int, float, float]:
    """Index and width of the lane on which a change begins, and where it begins on that [m]."""
    edge, lane = edge_of(change.lane), index_of(change.lane)
    line = network.route_line((edge,), lane)
    begin = float(np.hypot(*np.diff(line, axis=0).T).sum()) - change.to_end
    return lane, network.lane_width(edge, lane), max(begin, SPACING)  # on a very short edge, changes are longer than it


def _changes_from(lines: Sequence[Line], change: Line) -> list[Line]:
    """A lane change, and the next ones on its edge to the same side."""
    side = index_of(change.onto) - index_of(change.lane)
    onward = takewhile(lambda line: line.state == CHANGING, lines[lines.index(change) :])
    return list(takewhile(lambda line: (index_of(line.onto) - index_of(line.lane)) * side > 0, onward))


def _lanes_crossed(changes: list[Line]) -> int:
    return sum(abs(index_of(change.onto) - index_of(change.lane)) for change in changes)


def _first_changes(lines: Sequence[Line]) -> Iterator[Line]:
    """The first lane change on each edge."""
    for before, line in zip((None, *lines), lines, strict=False):
        if line.state == CHANGING and (before is None or before.state != CHANGING):
            yield line


def _onward(
    route: Route,
    i: int,
    first: Change,
    network: Network,
    model: VehicleModel,
    position: float = 0.0,
    longest: float = math.inf,
) -> _Onward:
    """A route from the edge of a route's i-th line on, with another lane change there, up to where it is that route
    again.

    It begins with the edge before, if there is one, so that the bend between the two is rounded as on the given route,
    and makes the changes before on its edge as well, so that its line comes from there as the given one does.

    first: the lane change there, with the edge's number from there
    """
    lines = route.lines[:i]
    earlier = list(takewhile(lambda line: line.state == CHANGING, reversed(lines)))[::-1]
    junctions = [line for line in lines if line.state != CHANGING]
    entered = junctions[-1].station + junctions[-1].across if junctions else 0.0
    earlier = [line._replace(station=line.station - entered) for line in earlier]
    lane = index_of(earlier[0].lane) if earlier else first.lane
    before = len(junctions[-1:])
    start = index_of(junctions[-1].lane) if junctions else lane
    edges, first = route.edges[len(junctions) - before :], first._replace(edge=before, lane=lane)
    onward = Route.along(edges, *network.route_lanes(edges, start, False, position, first, longest, earlier))
    entered = onward.lines[0].station + onward.lines[0].across if before else 0.0
    known = before + len(earlier)
    takes_over = _straight_beyond(route, onward, model.length)
    if takes_over == math.inf:
        return _Onward(onward.drivable_by(model), known, entered)
    # To make a line drivable takes long: only as much of it as is new.
    rest = tuple(line for line in route.lines if line.station > takes_over)
    ((x, y),) = route.line.at(np.array([takes_over]))
    end, _ = onward.line.project(x, y, takes_over - _offset(route, onward), NEAR)
    count = int(np.searchsorted(onward.line.stations, end - 1e-3))
    points = np.concatenate([onward.line.points[:count], onward.line.at(np.array([end]))])
    limit = np.append(onward.limit[:count], onward.limit[count - 1])
    part = Route.along(edges, points, limit, onward.lines[: len(onward.lines) - len(rest)])
    return _Onward(part.drivable_by(model), known, entered, takes_over, rest)


def _straight_beyond(route: Route, onward: Route, length: float) -> float:
    """Station of a route at the end of a straight beyond which another one has the same lanes [m]; inf: there is none.

    length: of the vehicle [m]
    """
    same = _same_at_the_end(route, onward)
    if not same:  # they may end on different lanes
        return math.inf
    offset = _offset(route, onward)
    ends = [line.station + line.across for line in route.lines[: len(route.lines) - same]]
    ends += [line.station + line.across + offset for line in onward.lines[: len(onward.lines) - same]]
    stations, curvature = route.curvature(length)
    bends = stations[np.abs(curvature) * length > NO_BEND]
    begins = np.maximum(np.append(0.0, bends), max(ends, default=0.0))
    straights = np.append(bends, route.length) - begins
    long = begins[straights > STRAIGHT * length]
    return float(long[0] + STRAIGHT * length) if len(long) else math.inf


def _same_at_the_end(route: Route, onward: Route) -> int:
    """Number of lines, from the last one back, that are the same on two routes to one place."""
    pairs = zip(reversed(route.lines), reversed(onward.lines), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0]._replace(station=pair[1].station) == pair[1], pairs))


def _offset(route: Route, onward: Route) -> float:
    """By how much stations of a route are greater than those of another one where they have become the same [m]."""
    same = _same_at_the_end(route, onward)
    return route.lines[-same].station - onward.lines[-same].station


def _changed_from(
    route: Route, i: int, onward: _Onward, end: float, near: float, join: float, model: VehicleModel
) -> Route:
    """A route with another one from before its i-th line on; arguments as of `_spliced`."""
    new = _spliced(route, i, onward.route, onward.before, end, near, join)
    if onward.takes_over == math.inf:
        return new
    back, over = (STRAIGHT - 1) * model.length, JOIN * model.length
    kept = len(route.lines) - len(onward.rest)
    return _spliced(new, len(new.lines), route, kept, new.length - back, onward.takes_over - back, over)


def _spliced(route: Route, i: int, onward: Route, k: int, end: float, near: float, join: float) -> Route:
    """A route up to a station before its i-th line [m], then another one, in which that line is the k-th.

    Each line is smoothed by itself, so they lie some centimetres apart where one goes over into the other.

    near : about where that station is on the other one [m]
    join : length over which one goes over into the other [m]
    """
    ((x, y),) = route.line.at(np.array([end]))
    begin, _ = onward.line.project(x, y, near, NEAR)
    along = np.linspace(0.0, join, math.ceil(join / SPACING) + 1)
    share = along / join
    weight = (share - np.sin(2 * math.pi * share) / (2 * math.pi))[:, None]  # without a jump in curvature at its ends
    joint = (1 - weight) * route.line.at(end + along) + weight * onward.line.at(begin + along)
    kept = int(np.searchsorted(route.line.stations, end - 1e-3))
    first, stop = np.searchsorted(onward.line.stations, [begin + join + 1e-3, onward.length * (1 + 1e-12)])
    points = np.concatenate([route.line.points[:kept], joint, onward.line.points[first:stop]])
    limit = np.concatenate([route.limit[:kept], np.repeat(route.limit[kept - 1], len(joint)), onward.limit[first:stop]])
    lines = [line._replace(station=line.station + end - begin) for line in onward.lines[k:]]
    later = Route.along(route.edges, points, limit, [*route.lines[:i], *lines], walled=route.walled)
    return changed(later, speed_factor=route.speed_factor, top_speed=route.top_speed)
