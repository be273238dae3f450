"""Where the path of a member through a junction meets those of vehicles and people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import NamedTuple

import numpy as np

from platoontraffic.geometry.polyline import left_of
from platoontraffic.lidar.compiled import compiler
from platoontraffic.road.drivable_line import stations_of
from platoontraffic.road.gap_acceptance import FIRST_MARGIN, Pace
from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.reads import Once
from platoontraffic.vehicles.bicycle import CARS, Car
from platoontraffic.vehicles.motion import CAR_LENGTH

# Indices of fields of a link as SUMO returns it, and their number; via: first lane inside the junction, "" if none.
LINK_ONTO, LINK_OPEN, LINK_VIA, LINK_STATE, LINK_LENGTH, LINK_FIELDS = 0, 2, 4, 5, 7, 8

# States of links, as SUMO writes them.
PRIORITY = "GMO"  # gives way to no vehicle; O is a light that is off
RED, YELLOW = "ru", "yY"
MINOR = "mswo="  # gives way; = to vehicles from the right
STOP = "sw"  # gives way, after it has stood at the line
ALL_STOP = "w"  # in the order in which vehicles have stood
EQUAL = "=w"  # two vehicles may each have to give way to the other
ZIPPER = "Z"  # in the order of arrival

APART = 0.8  # distance of two paths at which vehicles pass each other with a margin [lane widths]: 2.6 m in streets
TOUCHES = 0.5  # distance of a front bumper from a path at which a vehicle there would touch it [lane widths]
SWUNG = 0.3  # distance of a corner or side from a car beside at which it is in that one's way, as both may be askew [m]
SUMO_LENGTH = 5.0  # of SUMO's own cars [m]
SUMO_CAR = "sumo car"  # the kind of a car that is longer than `CARS["car"]`, but no longer than SUMO's own
# Vehicles for which conflicts are found, by kind; a kind is judged by one that is as long, or longer.
KINDS = {"car": CARS["car"], SUMO_CAR: CARS["van"], "van": CARS["van"], "truck": CARS["truck"]}
LONG = KINDS.keys() - {"car", SUMO_CAR}  # kinds whose bodies swing over paths that do not meet their own
FRONT, BODY = (0.0,), (0.0, 0.25, 0.5, 0.75, 1.0)  # places of points on the sides of a body [shares, from its front]
SAMPLED = 0.08  # distance of the points at which paths are compared [lane widths]: 0.25 m
SHARP = 0.5  # curvature of a path below which no front swings out over another lane [of that at its full lock]
ABOUT = 15.0  # distance before and beyond a junction from which a vehicle's path through it is rounded [m]
REACH = 3.0  # the same for a long vehicle: its body may be over the oncoming lane for so far [lengths]
MOST_APPROACHES = 8  # paths to a line that are compared: round small blocks there are any number
TAIL = 2.0  # part of the lane beyond the junction at which merging paths are compared [lane widths]
SLOWEST = Pace(0.0, 1.5, 6.0)  # of members: it decides how far ahead foes are looked for
SAME_POINT = 1e-6  # distance of points of a line that count as one [m]
ROUNDED = 1e-9  # share by which a squared distance may be wrong, amply

compiled = compiler(__file__)


class Crossing(NamedTuple):
    """A place in a junction where two paths meet; distances from the line of each [m].

    Two paths have several of them if the own vehicle fits between, as where the other path is a U-turn.
    """

    before: str  # lane from which the foe comes
    via: tuple[str, ...]  # its lanes inside the junction
    own: tuple[float, float]  # where the own path meets the other one, and where they part
    its: tuple[float, float]
    merges: bool  # onto the same lane
    first: bool  # the foe has priority, or nobody has
    waits: float  # where it may wait midway; inf: nowhere
    fastest: float  # speed limit inside the junction [m/s]
    touches: float = math.inf  # where the own front begins to be in the foe's way; inf: nowhere
    swings: bool = False  # the paths do not meet on the network, but the own body swings out over the foe's
    blocks: float = math.inf  # where the front of a car that may wait midway begins to be in the own way; inf: nowhere


class Walk(NamedTuple):
    """A pedestrian crossing over the path; distances from the line [m]."""

    edge: str
    own: tuple[float, float]
    points: np.ndarray  # of the own path there, (k, 2) [m]
    apart: float  # distance from those at which a person does not matter [m]


class Sampled(NamedTuple):
    """Points of a line at equal distances."""

    stations: np.ndarray  # (k,) [m]
    points: np.ndarray  # (k, 2) [m]


Span = tuple[float, float]  # the first and the last station of a stretch of a line [m]


class Place(NamedTuple):
    """Where two lines are less than a distance from each other."""

    own: Span
    its: Span
    own_line: Sampled  # all of it; but if there are several such places, the line there, and a little farther
    its_line: Sampled


class Paths(Once):
    """Paths through junctions, sampled: by lanes inside, lane beyond, and distance of the points [m].

    Those of a junction meet one another, so each is asked for by the lines of many.

    links: from each lane, the lanes inside the junction and the lane beyond
    """

    def __init__(self, sumo: Client) -> None:
        super().__init__(lambda key: _sampled(_path(*key[:2], sumo), key[2]))
        self.links = Once(lambda before: [*_links(before, sumo)])


class JudgedLine(Line):
    """A line of a junction as vehicles of one kind come to it, at station 0; there is one object for each.

    state: equal where the network gives nobody priority

    Much is looked up by it in each step, and to compare so many fields takes long: it is equal to itself only.
    """

    __hash__ = object.__hash__
    __eq__ = object.__eq__
    __ne__ = object.__ne__

    @classmethod
    def of(cls, line: Line, kind: str, network: Network) -> JudgedLine:
        state = line.state if network.unregulated.isdisjoint(line.via) else EQUAL[0]
        return cls(*line._replace(station=0.0, state=state, kind=kind))


@dataclass(frozen=True, eq=False)
class Conflicts:
    """What a stop line must be judged by; constant during a run."""

    entering: tuple[tuple[str, float], ...]  # priority lanes, and the distance from each one's end to the junction [m]
    crossings: tuple[Crossing, ...]
    walks: tuple[Walk, ...]
    waits: float  # where the own path may wait midway [m]; inf: nowhere
    swings: bool = False  # the own front swings out over paths to the lanes beside its own
    narrow: tuple[Crossing, ...] = ()  # paths apart from the own one for SUMO, but too close for two cars
    swung_over: tuple[Crossing, ...] = ()  # paths over which a body longer than SUMO's own cars swings

    @cached_property
    def lanes(self) -> tuple[str, ...]:
        """The lanes inside the junction of all paths that cross."""
        return tuple(dict.fromkeys(via for one in self.crossings for via in one.via))

    @cached_property
    def last_with_priority(self) -> float:
        """Where the own front comes to the last path with priority, beyond the line [m]; -inf: there is none."""
        return _last_met(one for one in (*self.crossings, *self.narrow) if one.first)

    @cached_property
    def last_of_others(self) -> float:
        """The same of paths without priority."""
        return _last_met(one for one in (*self.crossings, *self.narrow) if not one.first)

    @cached_property
    def by_path(self) -> dict[str, list[Crossing]]:
        """The crossings with each path, by its first lane inside the junction."""
        found: dict[str, list[Crossing]] = {}
        for one in self.crossings:
            found.setdefault(one.via[0], []).append(one)
        return found

    @cached_property
    def waited_on(self) -> tuple[Crossing, ...]:
        """Paths on which vehicles wait midway, where they are in the way."""
        return tuple(one for one in self.crossings if not one.merges and one.its[0] < one.waits < math.inf)

    @classmethod
    def at(cls, line: Line, network: Network, sumo: Client, paths: Paths | None = None) -> Conflicts:
        """paths: kept for the next lines"""
        lane, paths = sumo.lane, Paths(sumo) if paths is None else paths
        foes = {*lane.getFoes(line.lane, line.onto)}  # lanes of the links with priority, and lanes inside
        width = lane.getWidth(line.lane)
        own, model = paths[line.via, line.onto, SAMPLED * width], KINDS[line.kind]
        front = _front_along(own, model.width / 2)
        crossings: list[Crossing] = []
        inner = {name for via in line.via for name in lane.getInternalFoes(via)} - set(line.via)
        unregulated = not network.unregulated.isdisjoint(line.via)  # SUMO knows no foes there
        if unregulated:
            inner |= network.unregulated.intersection(network.inside_with(line.via[0])) - set(line.via)
        for before in sorted({network.entered_from[name] for name in inner if name in network.entered_from}):
            if unregulated and before == line.lane:
                continue
            for via, onto in paths.links[before]:
                if inner.isdisjoint(via) or (before == line.lane and via == line.via):
                    continue
                its = paths[via, onto, SAMPLED * width]
                waits = lane.getLength(via[0]) if len(via) > 1 else math.inf
                fastest, is_first = min(map(lane.getMaxSpeed, via)), unregulated or before in foes
                places = [*_places(own, its, APART * width, model.length)]
                for place in places:
                    merges = onto == line.onto and place is places[-1]
                    touches, blocks = _touches(front, place.its_line, TOUCHES * width), math.inf
                    if not merges and waits < math.inf:
                        its_front = _front_along(its, CARS["car"].width / 2)
                        blocks = _touches(its_front, place.own_line, TOUCHES * width)
                    crossings.append(
                        Crossing(
                            before, via, place.own, place.its, merges, is_first, waits, fastest, touches, blocks=blocks
                        )
                    )
        curvature = _curvature(own.points, round(1 / SAMPLED))
        is_sharp = curvature > SHARP / model.turning_radius
        met = {one.via[0] for one in crossings}
        found = _swung_over(line, model, width, met, network, sumo, paths) if is_sharp else []
        crossings += found
        met |= {one.via[0] for one in found}
        entering = sorted({crossing.before for crossing in crossings if crossing.first})
        fastest = max(map(lane.getMaxSpeed, entering), default=0.0)
        watched = fastest * (SLOWEST.time_for(line.across + CAR_LENGTH) + FIRST_MARGIN)
        upstream = dict(one for name in reversed(entering) for one in network.upstream(name, watched))
        walks = tuple(_walks(own, inner, width, sumo))
        waits = lane.getLength(line.via[0]) if len(line.via) > 1 else math.inf
        swung = tuple(_swung_over_by_body(line, model, curvature, met, network, sumo, paths))
        narrow = (*_narrow(line, met, inner, network, sumo, paths), *(one for one in swung if one.swings))
        return cls(tuple(upstream.items()), tuple(crossings), walks, waits, bool(found), narrow, swung)


def _last_met(crossings: Iterable[Crossing]) -> float:
    """The farthest place where the own path meets one of others, or its front touches it [m]; -inf: none."""
    places = (place for one in crossings for place in (one.own[0], one.touches) if place < math.inf)
    return max(places, default=-math.inf)


def _narrow(
    line: Line,
    met: Set[str],
    inner: set[str],
    network: Network,
    sumo: Client,
    paths: Paths,
) -> Iterator[Crossing]:
    """Paths from and to other edges that come close without a conflict in SUMO, as left turns against each other do."""
    lane, width = sumo.lane, sumo.lane.getWidth(line.lane)
    own = paths[line.via, line.onto, SAMPLED * width]
    for before, via, onto in _of_other_edges(line, network, paths):
        if via[0] in met or not inner.isdisjoint(via):
            continue
        if found := _met(own, paths[via, onto, SAMPLED * width], APART * width):
            fastest = min(map(lane.getMaxSpeed, via))
            yield Crossing(before, via, *found, False, False, math.inf, fastest)


def _of_other_edges(line: Line, network: Network, paths: Paths) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """The paths through a line's junction from and to edges that are not its own: lane before, lanes inside, beyond."""
    edges = [edge_of(line.lane), edge_of(line.onto)]
    for before in sorted({network.entered_from[name] for via in line.via[:1] for name in network.inside_with(via)}):
        for via, onto in paths.links[before]:
            if via and edge_of(before) != edges[0] and edge_of(onto) != edges[1]:
                yield before, via, onto


def _swung_over_by_body(
    line: Line,
    model: Car,
    curvature: float,
    met: Set[str],
    network: Network,
    sumo: Client,
    paths: Paths,
) -> Iterator[Crossing]:
    """The paths over which the body of a vehicle swings that is longer than SUMO's own cars, for which lanes are laid.

    In a sharp right turn its front swings over the oncoming lane, in a left turn its side: also before the line there.
    The crossing swings if the paths do not meet on the network.

    curvature: greatest one of the line's path [1/m]
    """
    width, reach, front = sumo.lane.getWidth(line.lane), max(ABOUT, REACH * model.length), model.length / 2 - model.axle
    # In a bend of radius R its front is about front^2 / 2 R farther out than its axle.
    swings = front**2 * curvature / 2 > SWUNG
    others = [*_of_other_edges(line, network, paths)] if line.kind in LONG and swings else []
    # How it turns depends on where it comes from, if the lane before is short: as at the exit of a roundabout.
    approaches = islice(network.approaches(line.lane, reach), MOST_APPROACHES) if others else ()
    body = [side for lanes in approaches for side in _sides(line, model, sumo, BODY, reach, lanes)]
    for before, via, onto in others:
        its_path = _from_before(before, via, onto, reach, SAMPLED * width, sumo)
        if spans := [*_swung(body, its_path)]:
            own, (begin, end) = _joined(spans)
            if begin < 0:  # its front faces those there, and keeps its distance from them
                begin -= model.length / 2
            fastest = min(map(sumo.lane.getMaxSpeed, via))
            yield Crossing(before, via, own, (begin, end), False, False, math.inf, fastest, own[0], via[0] not in met)


def _swung_over(
    line: Line,
    model: Car,
    width: float,
    met: Set[str],
    network: Network,
    sumo: Client,
    paths: Paths,
) -> list[Crossing]:
    """The crossings of paths to other lanes of the edge beyond, over which the vehicle's front swings out.

    met: first lanes inside of those that it meets anyway
    """
    edge, own = edge_of(line.onto), index_of(line.onto)
    others = [f"{edge}_{k}" for k in range(sumo.edge.getLaneNumber(edge)) if k != own]
    corners = _sides(line, model, sumo, FRONT) if others else ()
    found: list[Crossing] = []
    for onto in others:
        inside = {name for name, _ in network.upstream(onto, sumo.lane.getLength(onto) + 1e-3)}
        for before in sorted(
            {network.entered_from[name] for name in inside & network.entered_from.keys()} - {line.lane}
        ):
            for via, its_onto in paths.links[before]:
                if its_onto != onto or not via or via[0] in met or not set(via).isdisjoint(line.via):
                    continue
                its = paths[via, onto, SAMPLED * width]
                spans = [*_swung(corners, its)]
                if not spans:
                    continue
                swung = _joined(spans)
                fastest = min(map(sumo.lane.getMaxSpeed, via))
                found.append(Crossing(before, via, *swung, False, True, math.inf, fastest, swung[0][0], True))
    return found


def _swung(body: Sequence[Sampled], its: Sampled) -> Iterator[tuple[Span, Span]]:
    """Where points of the own body, by stations of its front, come so near to a path that a car there is in the way."""
    apart = CARS["car"].width / 2 + SWUNG
    met = (_met(point, path, apart) for path in (its, _middles(its, SUMO_LENGTH)) for point in body)
    return (spans for spans in met if spans)


def _joined(spans: Sequence[tuple[Span, Span]]) -> tuple[Span, Span]:
    """From the first begin to the last end, of the own spans and of the others."""
    own, its = ((min(of_one)[0], max(end for _, end in of_one)) for of_one in zip(*spans, strict=True))
    return own, its


def _from_before(before: str, via: Sequence[str], onto: str, reach: float, step: float, sumo: Client) -> Sampled:
    """A path through a junction and the lane so far before it [m], by stations from the line."""
    shape = np.array(sumo.lane.getShape(before))
    stations = stations_of(shape)
    begin = max(stations[-1] - reach, 0.0)
    there = np.unique([begin, *stations[stations > begin]])
    tail = np.column_stack([np.interp(there, stations, shape[:, k]) for k in (0, 1)])
    path = np.concatenate([tail[:-1], _path(via, onto, sumo)])
    path = path[np.concatenate([[True], np.hypot(*np.diff(path, axis=0).T) > SAME_POINT])]
    found = _sampled(path, step)
    return found._replace(stations=found.stations - (stations[-1] - begin))


def _middles(line: Sampled, length: float) -> Sampled:
    """Where the middle of a vehicle's body comes whose bumpers are on a line, as SUMO has them: inside its bends.

    The line itself where it is no longer than the vehicle.
    """
    if (apart := round(length / max(line.stations[1], 1e-9))) >= len(line.stations):
        return line
    return Sampled(*((values[apart:] + values[:-apart]) / 2 for values in line))


class Front(NamedTuple):
    """Points of the front of a vehicle that drives along a line: its middle, its left end and its right end."""

    stations: np.ndarray  # of the line [m], (k,)
    middle: np.ndarray  # [m], (k, 2)
    left: np.ndarray
    right: np.ndarray


def _front_along(line: Sampled, half: float) -> Front:
    """half: of the vehicle's width [m]"""
    aside = half * left_of(line.points)
    return Front(line.stations, line.points, line.points + aside, line.points - aside)


def _touches(front: Front, path: Sampled, apart: float) -> float:
    """Station from which on one of the points of a front is less than a distance from a path [m]; inf: nowhere."""
    return _first_touch(*front, path.points, apart)


def _sides(
    line: Line, model: Car, sumo: Client, places: Sequence[float], reach: float = ABOUT, comes_by: Sequence[str] = ()
) -> tuple[Sampled, ...]:
    """The paths of points on both sides of a vehicle through a junction, by stations of its front from the line.

    places  : of the points, as shares of the body from its front to its rear
    reach   : distance before and beyond the junction from which its path is rounded [m]
    comes_by: lanes on which it comes to the lane before the line

    Its driven axle is on the line that it can drive, as members' are.
    """
    before = np.array([point for name in (*comes_by, line.lane) for point in sumo.lane.getShape(name)])
    beyond = np.array(sumo.lane.getShape(line.onto))
    whole = np.concatenate([before, *(np.array(sumo.lane.getShape(name)) for name in line.via), beyond])
    whole = whole[np.concatenate([[True], np.hypot(*np.diff(whole, axis=0).T) > 1e-6])]
    stations, begin = stations_of(whole), stations_of(before)[-1]
    end = begin + stations_of(_path(line.via, line.onto, sumo))[-1]
    about = stations[(stations > begin - reach) & (stations < end + reach)]
    about = np.concatenate([[max(begin - reach, 0.0)], about, [min(end + reach, stations[-1])]])
    points = np.column_stack([np.interp(np.unique(about), stations, whole[:, k]) for k in (0, 1)])
    route = Route.along((), points, np.zeros(len(points)), [line._replace(station=begin - about[0])]).drivable_by(model)
    driven = np.arange(0.0, route.length, SAMPLED * sumo.lane.getWidth(line.lane))
    axle, front, left = route.line.at(driven), model.length / 2 - model.axle, left_of(route.line.at(driven))
    onward, aside = np.column_stack([left[:, 1], -left[:, 0]]), model.width / 2 * left
    stations, found = driven - route.lines[0].station + front, []
    for share in places:
        middle = axle + (front - share * model.length) * onward
        found += [Sampled(stations, middle + aside), Sampled(stations, middle - aside)]
    return tuple(found)


def _walks(own: Sampled, inner: set[str], width: float, sumo: Client) -> Iterator[Walk]:
    for name in sorted(inner):
        edge = edge_of(name)
        if "_c" not in edge or "pedestrian" not in sumo.lane.getAllowed(name):
            continue
        walk = _sampled(np.array(sumo.lane.getShape(name)), SAMPLED * width)
        met = _met(own, walk, APART * width)
        if met is not None:
            there = own.points[(own.stations >= met[0][0]) & (own.stations <= met[0][1])]
            yield Walk(edge, met[0], there, APART * width)


def _path(via: Sequence[str], onto: str, sumo: Client) -> np.ndarray:
    """The line of lanes inside a junction and the begin of the lane beyond, (k, 2) [m]."""
    shape = sumo.lane.getShape
    inside, beyond = [point for name in via for point in shape(name)], shape(onto)
    return _cut(np.array([*inside, *beyond]), len(inside), TAIL * sumo.lane.getWidth(onto))


def _sampled(line: np.ndarray, step: float) -> Sampled:
    return Sampled(*_at_equal_distances(line, step))


def _met(one: Sampled, other: Sampled, apart: float) -> tuple[Span, Span] | None:
    """Where each of two lines is less than a distance [m] from points of the other; None: nowhere."""
    begin, end, its_begin, its_end = _spans(*one, *other, apart)
    return ((begin, end), (its_begin, its_end)) if begin < math.inf else None


def _places(own: Sampled, other: Sampled, apart: float, between: float) -> Iterator[Place]:
    """Where two lines are less than a distance from each other [m], along the own one.

    between: length of the own line between two places, at least [m]
    """
    parts = _parts(own.stations, own.points, other.points, apart, between).tolist()
    for begin, end, its_begin, its_end in parts:
        mine, its = _span(own, begin, end), _span(other, its_begin, its_end)
        if len(parts) == 1:
            yield Place(mine, its, own, other)
        else:
            yield Place(mine, its, _about(own, mine, apart), _about(other, its, apart))


def _span(line: Sampled, first: int, last: int) -> Span:
    return float(line.stations[first]), float(line.stations[last])


def _about(line: Sampled, span: Span, more: float) -> Sampled:
    """A stretch of a line, and so much more at both ends [m]."""
    there = (line.stations >= span[0] - more) & (line.stations <= span[1] + more)
    return Sampled(line.stations[there], line.points[there])


def load() -> None:
    """Load what is compiled here."""
    line = _sampled(_cut(np.array([(0.0, 0.0), (1.0, 0.0)]), 1, 1.0), 1.0)
    _touches(_front_along(line, 1.0), line, 1.0)


@compiled
def _cut(points, begin, tail):
    """The line through points (k, 2) up to so far beyond a begin [m], without points that lie on others."""
    kept, n, along = np.empty_like(points), 0, 0.0
    for k in range(len(points)):
        away = math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]) if k else math.inf
        share = 1.0
        if k > begin:
            share = min((tail - along) / away, 1.0) if away > 0 else 1.0
            along += away
        if share * away > SAME_POINT:
            for i in range(2):
                kept[n, i] = (
                    points[k, i] if share == 1.0 else points[k - 1, i] + share * (points[k, i] - points[k - 1, i])
                )
            n += 1
        if along >= tail:
            break
    return kept[:n]


@compiled
def _at_equal_distances(line, step):
    """Stations at equal distances of about a step along a line (k, 2), and its points there (m, 2) [m]."""
    length = 0.0
    for k in range(1, len(line)):
        length += math.hypot(line[k, 0] - line[k - 1, 0], line[k, 1] - line[k - 1, 1])
    parts = max(math.ceil(length / step), 1)
    stations, points = np.empty(parts + 1), np.empty((parts + 1, 2))
    k, begins, piece = 0, 0.0, 0.0
    for i in range(parts + 1):
        stations[i] = i * (length / parts)
        while k + 1 < len(line) and (k == 0 or begins + piece < stations[i]):
            begins += piece
            k += 1
            piece = math.hypot(line[k, 0] - line[k - 1, 0], line[k, 1] - line[k - 1, 1])
        share = min((stations[i] - begins) / piece, 1.0) if piece > 0 else 0.0
        for j in range(2):
            points[i, j] = line[max(k - 1, 0), j] + share * (line[k, j] - line[max(k - 1, 0), j])
    return stations, points


@compiled
def _box_about(points, apart):
    """Sides of a box about points (k, 2) and all that is less than a distance from them: most others are not within."""
    x, y, reach = points[:, 0], points[:, 1], apart * (1 + ROUNDED)
    return x.min() - reach, x.max() + reach, y.min() - reach, y.max() + reach


@compiled
def _is_within(point, box):
    left, right, bottom, top = box
    return left <= point[0] <= right and bottom <= point[1] <= top


@compiled
def _is_near(point, other, apart):
    """Whether two points are less than a distance from each other."""
    dx, dy = point[0] - other[0], point[1] - other[1]
    # The root takes long, and decides only where the square is nearly the same.
    squares = dx * dx + dy * dy
    if squares > apart * apart * (1 + ROUNDED):
        return False
    return squares < apart * apart * (1 - ROUNDED) or math.hypot(dx, dy) < apart


@compiled
def _near(points, others, apart):
    """The first and the last of other points (l, 2) that each of points (k, 2) is less than a distance from; last is
    -1 where there are none. Returns: (k,), (k,)."""
    first, last, box = np.full(len(points), len(others)), np.full(len(points), -1), _box_about(others, apart)
    for i in range(len(points)):
        if _is_within(points[i], box):
            for k in range(len(others)):
                if _is_near(points[i], others[k], apart):
                    first[i], last[i] = min(first[i], k), max(last[i], k)
    return first, last


@compiled
def _spans(stations, points, other_stations, others, apart):
    """The first and the last station of each of two lines where it is less than a distance from the other; inf, -inf:
    nowhere. stations, other_stations: (k,), (l,) [m]; points, others: (k, 2), (l, 2) [m]"""
    own_begin, own_end, its_begin, its_end = math.inf, -math.inf, math.inf, -math.inf
    first, last = _near(points, others, apart)
    for i in range(len(points)):
        if last[i] >= 0:
            own_begin, own_end = min(own_begin, stations[i]), stations[i]
            its_begin, its_end = min(its_begin, other_stations[first[i]]), max(its_end, other_stations[last[i]])
    return own_begin, own_end, its_begin, its_end


@compiled
def _parts(stations, points, others, apart, between):
    """Where points (k, 2) at stations (k,) are less than a distance from other points (l, 2): first and last of these
    points, and of the others there, (m, 4). between: least distance of two such places by the stations [m]"""
    first, last = _near(points, others, apart)
    found, m, before = np.empty((len(points), 4), np.int64), 0, -1
    for i in range(len(points)):
        if last[i] < 0:
            continue
        if before < 0 or stations[i] - stations[before] >= between:
            found[m] = i, i, first[i], last[i]
            m += 1
        found[m - 1, 1], before = i, i
        found[m - 1, 2], found[m - 1, 3] = min(found[m - 1, 2], first[i]), max(found[m - 1, 3], last[i])
    return found[:m]


@compiled
def _curvature(points, half):
    """Greatest curvature of a line through points at equal distances, (k, 2), over so many of these each way [1/m]."""
    greatest = 0.0
    for k in range(half, len(points) - half):
        x, y = points[k, 0] - points[k - half, 0], points[k, 1] - points[k - half, 1]
        onward_x, onward_y = points[k + half, 0] - points[k, 0], points[k + half, 1] - points[k, 1]
        turn = math.atan2(onward_y, onward_x) - math.atan2(y, x)
        turn = abs((turn + math.pi) % (2 * math.pi) - math.pi)
        greatest = max(greatest, turn / (math.hypot(x, y) / 2 + math.hypot(onward_x, onward_y) / 2))
    return greatest


@compiled
def _first_near(stations, points, others, apart):
    """The first station (k,) of points (k, 2) where one of other points (l, 2) is less than a distance from it; inf:
    nowhere."""
    box = _box_about(others, apart)
    for i in range(len(points)):
        if _is_within(points[i], box):
            for k in range(len(others)):
                if _is_near(points[i], others[k], apart):
                    return stations[i]
    return math.inf


@compiled
def _first_touch(stations, middle, left, right, others, apart):
    """The least `_first_near` of three lines of points, (k, 2) each."""
    first = min(_first_near(stations, middle, others, apart), _first_near(stations, left, others, apart))
    return min(first, _first_near(stations, right, others, apart))


def _links(before: str, sumo: Client) -> Iterator[tuple[tuple[str, ...], str]]:
    """The lanes inside the junction and the lane beyond, of each link of a lane."""
    for link in sumo.lane.getLinks(before):
        yield _chain(link[LINK_VIA], sumo), link[LINK_ONTO]


def _chain(via: str, sumo: Client) -> tuple[str, ...]:
    """Consecutive lanes inside a junction, from this one on."""
    lanes = []
    while via:
        lanes.append(via)
        via = next(iter(sumo.lane.getLinks(via)), ("",) * LINK_FIELDS)[LINK_VIA]
    return tuple(lanes)
