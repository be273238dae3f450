"""A way round a body that stands on a part of the path: the line of a route, shifted beside it for a while.

The shift over a distance L is d (u - sin(2 pi u) / 2 pi) with u = s / L. Its curvature d 2 pi / L^2 sin(2 pi u) is
continuous and zero at both ends, so steering follows it; L is so long that no place is sharper than the vehicle can
steer. The way is one whose swept area, rectangles of the body along the line, is free of all returns of its laser by a
clearance, and lies within an area that the vehicle may use.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.pose import wrap
from platoontraffic.road import way_round_kernel
from platoontraffic.road.route import Route
from platoontraffic.vehicles.records import changed

MOST, LEAST, STEP = 2.6, 0.2, 0.1  # shifts that are tried [m]
CLEARANCES = 0.3, 0.14  # to all returns, on each side; the smaller one if there is no way with the larger one [m]
JUST = tuple(one + 0.01 for one in CLEARANCES)  # beyond the least shift that is needed: also tried [m]
ALONGSIDE = 1.5  # a return beside the body, and as far ahead of it and behind, may be within the clearance [m] ...
BESIDE = 0.03  # ... if the way does not come nearer to it by more than this [m]
KEPT_FREE = 0.2  # a body that is nearer to the path of the own one, on either side, stands in the way [m]
SPEED = 2.0  # greatest speed beside the body [m/s]
LOCK = 1.1  # least radius of the way [turning radii]
# Lengths of coming back, in multiples of the shortest on a straight road. If the shortest that can be steered is free,
# the longest free one is driven: by the shortest, the front of a car comes 0.8 m over to the other side of its route.
STRETCHED = 1.0, 1.5, 2.2
SPACING = 0.25  # of the poses that are checked [m]
REACH = 8.0  # distance ahead in which a body is looked for that stands in the way [m]
LONGEST_BODY = 13.0  # ... and how far beyond it is followed [m]
SAME_BODY = 1.5  # greatest distance along the path between returns from one body [m]
DEPTH = 5.0  # of a body at least, since a laser sees its near side only [m]
SHORTEST = 0.8  # of a shift [vehicle lengths]
GONE_ASIDE = 0.1  # offset from the route beyond which it has begun to go round [m]
ON_LINE = 1.0, 0.15  # offset [m] and off-heading [rad] up to which a way begins at a place
JOINED = 3.0  # distance before its begin from which the route leads straight to it [m]


class Body(NamedTuple):
    """A vehicle's size and steering, floats."""

    length: float  # [m]
    width: float
    axle: float  # the driven one, ahead of the centre [m]
    turning_radius: float  # [m]


class Plan(NamedTuple):
    """How a way is made of a route."""

    route: Route  # without the way
    begins: float  # station at which the way begins [m]
    offset: float  # of its begin, to the left of the route [m]
    length: float  # along the route, of going aside [m]
    returns: float  # distance from the begin at which it begins to come back [m]


class Way(NamedTuple):
    """A way round a body."""

    route: Route  # with the way in it
    ends: float  # station on that route at which the way ends [m]
    shift: float  # to the left [m]
    met: int  # the first return of the body, by its number
    plan: Plan


class Blocked(NamedTuple):
    """Where a body stands in the path."""

    distance: float  # along the route [m]; inf: nowhere
    least: float  # shift with which a way passes what is there [m]
    met: int  # a return of it, by its number; -1: none


@dataclass(frozen=True, eq=False)
class _Section:
    """Places along a line, from the driven axle on."""

    distance: np.ndarray  # (k,) [m]
    points: np.ndarray  # (k, 2)

    @cached_property
    def facing(self) -> tuple[np.ndarray, np.ndarray]:
        """Cosine and sine of the heading, (k,) each."""
        return way_round_kernel.facing(self.points)

    @property
    def heading(self) -> np.ndarray:
        cos, sin = self.facing
        return np.arctan2(sin, cos)

    @property
    def curvature(self) -> np.ndarray:
        steps = np.hypot(*np.gradient(self.points, axis=0).T)
        return np.gradient(np.unwrap(self.heading)) / np.maximum(steps, 1e-9)

    def shifted(self, offset: np.ndarray | float) -> _Section:
        """With places moved to the left, (k,) or all alike [m]."""
        cos, sin = self.facing
        return _Section(self.distance, self.points + (offset * np.array([-sin, cos])).T)


class _Planned(NamedTuple):
    section: _Section  # the shifted line
    end: float  # distance at which it is back on the route [m]
    plan: Plan


def blocked_at(route: Route, station: float, body: Body, returns: np.ndarray) -> Blocked:
    """Where returns cover the path of the body.

    station : of the driven axle
    returns : of the laser, (k, 2) [m]

    Gives where one is within `KEPT_FREE` of the body, at most `REACH` ahead.
    """
    section = _ahead(route, station, REACH)
    touches = _touches(section, body, returns, _kept(section, body, returns, KEPT_FREE))
    touched = touches.any(axis=1)
    if not touched.any():
        return Blocked(math.inf, 0.0, -1)
    first = touched.argmax()
    aside = _places(section, returns[touches[first]])[1]
    least = body.width / 2 + min(float(aside.max()), -float(aside.min()))
    return Blocked(float(section.distance[first]), least, int(touches[first].argmax()))


def way_round(
    route: Route,
    station: float,
    pose: tuple[float, float, float],
    body: Body,
    returns: np.ndarray,
    may_use: Callable[[float, np.ndarray], bool],
    most: float = MOST,
) -> Way | None:
    """The way with the least shift; None if there is none.

    station : of the driven axle, which is at rest
    pose    : x, y of that axle [m], its heading [rad]
    returns : of the laser (k, 2) [m]
    may_use : whether the vehicle may go there; given the shift to the left [m] and the places of the body's corners on
              the way (k, 4, 2)
    most    : greatest shift [m]
    """
    if route.closed:
        return None
    here = _ahead(route, station, 1.0)
    (x, y), heading = here.points[0], here.heading[0]
    offset = math.cos(heading) * (pose[1] - y) - math.sin(heading) * (pose[0] - x)
    if abs(offset) > min(ON_LINE[0], station / JOINED) or abs(wrap(pose[2] - heading)) > ON_LINE[1]:
        return None
    begin, section = here.shifted(offset), _ahead(route, station, REACH + LONGEST_BODY)
    stands = _touches(section, body, returns, _kept(begin, body, returns, KEPT_FREE))
    touched = stands.any(axis=1)
    if touched[0] or not touched[section.distance <= REACH].any():
        return None
    met = int(stands[touched.argmax()].argmax())
    passed, right, left = _extent(section, body, returns[stands.any(axis=0)])
    need = {1: body.width / 2 + left, -1: body.width / 2 - right}
    sizes = {*np.arange(LEAST, most + STEP / 2, STEP).tolist(), *(need[side] + one for side in need for one in JUST)}
    shifts = [side * one for one, side in product(sorted(sizes), need) if max(LEAST, need[side]) <= one <= most]
    if not shifts:
        return None
    bend = _sharpest(_ahead(route, station, passed + 3 * body.length))
    ways: dict[float, list[_Planned]] = {}
    for clearance in (_kept(begin, body, returns, one) for one in CLEARANCES):
        for shift in shifts:
            if shift not in ways:
                ways[shift] = [*_ways(route, station, offset, body, shift, passed, bend)]
            found = None
            for way in ways[shift]:
                touched = _touches(way.section, body, returns, clearance)
                if touched.any() or not may_use(shift, corners(way.section, body)):
                    break
                found = way
            if found:
                return _made(found, shift, met)
    return None


def blocked_return(way: Way, station: float, body: Body, returns: np.ndarray) -> float:
    """Station of a way's route at which a return is within `KEPT_FREE` of the body; inf: none, or it is coming back.

    station : of the driven axle, on the way's route
    returns : (k, 2) [m]
    """
    if station > way.plan.begins + way.plan.returns:
        return math.inf
    touched = _on_return(way, station, body, returns).any(axis=1)
    return station + SPACING * float(touched.argmax()) if touched.any() else math.inf


def is_free_without(way: Way, without: Route, station: float, body: Body, returns: np.ndarray) -> bool:
    """Whether a vehicle on a way could go on without it: nothing is on the route as it was.

    Once it has gone aside, only where something is on the way: the body may be beside it, where no laser looks.

    station, body, returns : as of `blocked_return`
    """
    ((x, y),) = way.route.line.at(np.array([station]))
    there, _ = without.line.project(x, y, station, REACH)
    aside = math.dist((x, y), without.line.at(np.array([there]))[0])
    if aside > GONE_ASIDE and blocked_at(way.route, station, body, returns).distance == math.inf:
        return False
    return blocked_at(without, there, body, returns).distance == math.inf


def with_later_return(
    way: Way, station: float, body: Body, returns: np.ndarray, may_use: Callable[[float, np.ndarray], bool]
) -> Way | None:
    """The way beside a further body that stands where it would come back, and was hidden when it was planned.

    station, body, returns : as of `blocked_return`, which is finite
    may_use                : as of `way_round`
    returns                : None if there is no such way
    """
    plan, driven = way.plan, station - way.plan.begins
    there = returns[_on_return(way, station, body, returns).any(axis=0)]
    passed, *_ = _extent(_ahead(plan.route, plan.begins, driven + REACH + LONGEST_BODY), body, there)
    length = _aside(_sharpest(_ahead(plan.route, plan.begins + passed, 3 * body.length)), body, way.shift)
    later = _shifted(plan._replace(returns=passed), body, way.shift, length)
    if not later:
        return None
    left = later.section.distance >= driven
    rest = _Section(later.section.distance[left], later.section.points[left])
    if _touches(rest, body, returns, _kept(rest, body, returns, CLEARANCES[1])).any():
        return None
    return _made(later, way.shift, way.met) if may_use(way.shift, corners(rest, body)) else None


def _on_return(way: Way, station: float, body: Body, returns: np.ndarray) -> np.ndarray:
    """Whether each return is within `KEPT_FREE` of the body at each place of the rest of a way, (k, returns)."""
    rest = _ahead(way.route, station, way.ends - station + body.length / 2)
    return _touches(rest, body, returns, _kept(rest, body, returns, KEPT_FREE))


def _made(way: _Planned, shift: float, met: int) -> Way:
    plan = way.plan
    return Way(*_spliced(plan, way.section, way.end), shift, met, plan)


def corners(section: _Section, body: Body) -> np.ndarray:
    """Of the body at each place of its driven axle, (k, 4, 2) [m]."""
    cos, sin = section.facing
    ahead = np.array([0.5, 0.5, -0.5, -0.5]) * body.length - body.axle
    aside = np.array([0.5, -0.5, -0.5, 0.5]) * body.width
    x = section.points[:, :1] + cos[:, None] * ahead - sin[:, None] * aside
    y = section.points[:, 1:] + sin[:, None] * ahead + cos[:, None] * aside
    return np.stack([x, y], axis=-1)


def farthest_aside(route: Route, station: float, corners: np.ndarray, side: float) -> float:
    """Greatest distance of the body's corners from the route, on one side of it [m].

    station : of the driven axle
    corners : as of `corners`
    side    : 1: to the left, -1: to the right
    """
    section = _ahead(route, station, REACH + LONGEST_BODY)
    return float((side * _places(section, corners.reshape(-1, 2))[1]).max())


def _ahead(route: Route, station: float, distance: float) -> _Section:
    places = np.arange(0.0, distance + SPACING, SPACING)
    return _Section(places, route.line.at(station + places))


def _kept(section: _Section, body: Body, returns: np.ndarray, clearance: float) -> np.ndarray:
    """The clearance, or less for returns close beside the body at the begin of a section [m], (returns,)."""
    (x, y), (cos, sin) = (returns - section.points[0]).T, (part[0] for part in section.facing)
    ahead, aside = cos * x + sin * y + body.axle, cos * y - sin * x
    away = np.abs(aside) - body.width / 2
    close = (away > 0) & (np.abs(ahead) < body.length / 2 + ALONGSIDE)
    return np.where(close, np.clip(away - BESIDE, 0.0, clearance), clearance)


def _touches(section: _Section, body: Body, returns: np.ndarray, clearance: np.ndarray) -> np.ndarray:
    """Whether each return is within its clearance (returns,) of the body at each place, (k, returns)."""
    half = body.length / 2, body.width / 2, body.axle
    return way_round_kernel.touches(section.points, *section.facing, half, returns, clearance)


def _extent(section: _Section, body: Body, returns: np.ndarray) -> tuple[float, float, float]:
    """The first of the bodies that returns (k, 2) are from, along the path.

    returns: distance at which the own rear is past it; its greatest offsets to the right and to the left [m]
    """
    along, aside = _places(section, returns)
    order = np.argsort(along, kind="stable")
    gaps = np.flatnonzero(np.diff(along[order]) > SAME_BODY)
    first = order[: gaps[0] + 1] if len(gaps) else order
    end = max(float(along[first].max()), float(along[first].min()) + DEPTH)
    return end + body.length / 2 + body.axle, float(aside[first].min()), float(aside[first].max())


def _places(section: _Section, returns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of returns (k, 2): distances along a section, and offsets to the left of it, (k,) each [m]."""
    cos, sin = section.facing
    away = np.hypot(returns[:, None, 0] - section.points[:, 0], returns[:, None, 1] - section.points[:, 1])
    k = away.argmin(axis=1)
    x, y = (returns - section.points[k]).T
    return section.distance[k] + cos[k] * x + sin[k] * y, cos[k] * y - sin[k] * x


def _ways(
    route: Route, station: float, offset: float, body: Body, shift: float, passed: float, bend: float
) -> Iterator[_Planned]:
    """The ways that may begin to come back at a distance [m] and can be steered, the shortest one first.

    bend: sharpest of the route there [1/m]
    """
    aside, back = _aside(bend, body, shift - offset), _aside(bend, body, shift)
    plan = Plan(route, station, offset, aside, max(passed, aside))
    for longer in STRETCHED:
        way = _shifted(plan, body, shift, longer * back)
        if way and _sharpest(way.section) <= max(bend, 1 / body.turning_radius):
            yield way


def _sharpest(section: _Section) -> float:
    """Greatest curvature [1/m]."""
    return float(np.abs(section.curvature).max())


def _aside(bend: float, body: Body, shift: float) -> float:
    """The least length of a shift that can be steered where the route has no sharper bend [m].

    Where it nearly has the vehicle's own, that of a shift beside the bend.
    """
    least = 1 / (LOCK * body.turning_radius)
    reserve = max(least - bend, least / 4)
    return max(math.sqrt(2 * math.pi * abs(shift) / reserve), SHORTEST * body.length)


def _shifted(plan: Plan, body: Body, shift: float, length: float) -> _Planned | None:
    """length: of coming back [m]"""
    end = plan.returns + length
    if plan.begins + end > plan.route.length:
        return None
    ahead = _ahead(plan.route, plan.begins, end + body.length / 2)
    aside, back = _eased(ahead.distance / plan.length), _eased((ahead.distance - plan.returns) / length)
    return _Planned(ahead.shifted(plan.offset + (shift - plan.offset) * aside - shift * back), end, plan)


def _eased(share: np.ndarray) -> np.ndarray:
    share = np.clip(share, 0.0, 1.0)
    return share - np.sin(2 * math.pi * share) / (2 * math.pi)


def _spliced(plan: Plan, section: _Section, end: float) -> tuple[Route, float]:
    """The route with a way in it that ends at a distance [m], and the station there; those behind it are the same."""
    route, station = plan.route, plan.begins
    line, kept = route.line, max(int(np.searchsorted(route.line.stations, station - JOINED)), 1)
    on_way = section.distance <= end
    points, distance = section.points[on_way], section.distance[on_way]
    stop, first = np.searchsorted(line.stations, [route.length * (1 + 1e-12), station + end + SPACING])
    last = max(stop, first + 1)  # the end of the route, or a point of the straight line beyond
    limits = route.limit[np.searchsorted(line.stations, station + distance, side="right") - 1]
    points = np.concatenate([line.points[:kept], points, line.points[first:last]])
    beside = distance <= plan.returns
    limits[beside] = np.minimum(limits[beside], SPEED)
    limit = np.concatenate([route.limit[:kept], limits, route.limit[first:last]])
    before = line.stations[kept - 1]
    joined = before + math.dist(line.points[kept - 1], section.points[0])
    driven = joined + np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(section.points[on_way], axis=0).T))])
    here, there = np.array([before, *(station + distance)]), np.array([before, *driven])
    lines = [one._replace(station=_moved(one.station, here, there)) for one in route.lines]
    found = Route.along(route.edges, points, limit, lines, walled=route.walled)
    found = changed(found, speed_factor=route.speed_factor, top_speed=route.top_speed)
    return found, float(driven[-1])


def _moved(station: float, here: np.ndarray, there: np.ndarray) -> float:
    """A station of the route, on the route with the way in it [m].

    here, there: stations of places on both, the first where the way is joined to the route, the last where it ends (k,)
    """
    if station < here[0]:
        return station
    return float(np.interp(station, here, there)) + max(station - float(here[-1]), 0.0)
