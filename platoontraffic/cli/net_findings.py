"""A judgement of a network for this tool: faults, and places at which cars cannot drive, or not well."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.cli.net_content import Content, Edge, Lane, Link, Points, read
from platoontraffic.errors import InputError
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.permissions import NO_ROAD
from platoontraffic.vehicles.bicycle import CARS

CAR = CARS["car"]  # the vehicle that is judged for
ROBOT_LANES = 2.0  # width up to which the widest lane makes a network one for robots [m]
WORST = 3  # places of one kind that are listed
AT_MOST = 8  # lines of one kind of difference between networks
ON_RAILS = {"tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"}
TURNAROUND = frozenset("tT")  # directions of a connection
NEXT = 15.0  # stretch of the lanes before and after a junction that is judged with it [m]
SIDE_BY_SIDE = 10.0  # length from which two lanes overlap [m]; where roads cross at 20 degrees it is shorter
GO = frozenset("gGsoOyY")  # letters of a light that does not forbid to drive for good


class Place(NamedTuple):
    """A place of a network that its user should know."""

    text: str
    x: float  # [m]; NaN: nowhere in particular
    y: float
    badness: float = 0.0  # of two places of a kind the one with more is worse


class Kind(NamedTuple):
    """What is wrong at the places of a kind, the worst place first."""

    name: str  # a few words, for pictures
    what: str  # `{n} …`, with the number of places as n; for one place and for several, divided by |
    places: tuple[Place, ...]


class Findings(NamedTuple):
    """Findings about a network."""

    faults: tuple[str, ...] = ()  # they make a run fail; one line each
    kinds: tuple[Kind, ...] = ()  # they do not; the worst kind first
    content: Content | None = None


def findings(net: Path) -> Findings:
    """Faults of a network, or else the judgement of it."""
    try:
        content = read(net)
    except InputError as error:
        return Findings(error.faults)
    if fault := _incomplete(content):
        return Findings((f"{net}: {fault}; must be as netconvert writes it",))
    lanes = [lane for edge in content.roads().values() for lane in edge.lanes]
    if not any(lane.for_cars for lane in lanes):
        return Findings((f"{net}: no lane for cars: all are for {_users(content)} only",))
    if not any(lane.width * lane.length > 0 for lane in lanes):
        return Findings((f"{net}: nothing to drive on: the lanes have no area",))
    judgements: tuple[Callable[[Content], Kind], ...] = (_closed, _kinks, _narrow, _overlaps, _unconnected, _dead_ends)
    judgements += _unreached, _without_inside, _left_hand, _of_others
    widest = max(lane.width for lane in lanes)
    if widest <= ROBOT_LANES:
        what = f"narrow: no lane is wider than {widest:g} m; suitable for small robots, without SUMO traffic"
        robots = Kind("narrow", what, (Place("", math.nan, math.nan),))
        return Findings(kinds=tuple(kind for kind in (robots, _unconnected(content)) if kind.places), content=content)
    kinds = (judge(content) for judge in judgements)
    return Findings(kinds=tuple(kind for kind in kinds if kind.places), content=content)


def lines_of(kind: Kind, every: bool = False) -> Iterator[str]:
    """A kind as one line with its worst places; every: one line for each place."""
    n, (one, *several) = len(kind.places), kind.what.split("|")
    what = (one if n == 1 or not several else several[0]).format(n=n)
    shown = [place.text for place in kind.places if place.text]
    if not every:
        more = f"; and {len(shown) - WORST} more" if len(shown) > WORST else ""
        yield f"{what}{': ' if shown else ''}{'; '.join(shown[:WORST])}{more}"
        return
    yield f"{what}{':' if shown else ''}"
    yield from (f"    {text}" for text in shown)


def some(lines: Iterator[str]) -> Iterator[str]:
    """The first lines, and the number of further ones."""
    for i, line in enumerate(every := list(lines)):
        if i == AT_MOST < len(every) - 1:
            yield f"and {len(every) - i} more of this kind"
            return
        yield line


def _kind(name: str, what: str, places: Iterator[Place]) -> Kind:
    return Kind(name, what, tuple(sorted(places, key=lambda place: (-place.badness, place.text))))


def _at(x: float, y: float) -> str:
    return f"({x:.0f}, {y:.0f}) m"


def _place(text: str, where: Sequence[float], badness: float = 0.0) -> Place:
    """A place at a point, which the text names at its end."""
    x, y = float(where[0]), float(where[1])
    return Place(f"{text} at {_at(x, y)}", x, y, badness)


# ---- faults


def _incomplete(content: Content) -> str:
    """The part that a network lacks and SUMO, or this tool, would crash without; "" if it is complete."""
    lanes = {name: len(edge.lanes) for name, edge in content.edges.items()}
    shapes = {lane.id: lane.shape for edge in content.edges.values() for lane in edge.lanes}
    for name, edge in content.edges.items():
        if edge.function == "normal":
            for end, junction in (("from", edge.start), ("to", edge.end)):
                if not junction:
                    return f"edge '{name}' does not name the junction {end} which it goes"
                if junction not in content.junctions:
                    return f"edge '{name}' goes {end} junction '{junction}', which is missing"
    for name, shape in shapes.items():
        points = set(shape) if name[0] != ":" else shape  # inside a junction a lane may have no extent
        if len(points) < 2 or not all(map(math.isfinite, (value for point in shape for value in point))):
            return f"lane '{name}' has no shape of two or more points"
    for link in content.links:
        for name, index in (link.source, link.target):
            if index >= lanes.get(name, 0):
                return f"a connection names lane '{name}_{index}', which is missing"
    reached = {link.via for link in content.links}
    for junction, inside in content.inside.items():
        for name in inside:
            if name not in shapes:
                return f"junction '{junction}' names lane '{name}', which is missing"
            if content.edges[edge_of(name)].function == "internal" and name not in reached:
                return f"no connection leads over lane '{name}' in junction '{junction}'"
    return ""


def _users(content: Content) -> str:
    users = {user for edge in content.roads().values() for lane in edge.lanes for user in lane.allowed or ()}
    return "rails" if users and users <= ON_RAILS else ", ".join(sorted(users)) or "none"


# ---- judgements, the worst first


def _closed(content: Content) -> Kind:
    """Stop lines at lights that are red to them in every phase."""
    programs: dict[str, list[str]] = {}
    for name, phases in content.lights.items():
        programs.setdefault(name.partition(" ")[0], []).extend(state for _, state in phases)

    def places() -> Iterator[Place]:
        for link, lane in _from_cars(content):
            states, index = programs.get(link.rules[2]), link.rules[3]
            if states and index.isdigit() and not any(GO.issuperset(state[int(index) : int(index) + 1]) and
                                                      len(state) > int(index) for state in states):  # fmt: skip
                to = f"'{lane.id}' to '{link.target[0]}', light '{link.rules[2]}'"
                yield _place(to, lane.shape[-1])

    return _kind("never opens", "stop line that never opens|{n} stop lines that never open", places())


def _kinks(content: Content) -> Kind:
    """Where a car must leave its lane, because the lane, or its line across a junction, turns too sharply."""
    lines: list[np.ndarray] = []
    names: list[str] = []
    rooms: list[float] = []
    judged: list[tuple[float, float]] = []  # stations between which a line is judged [m]
    lane_of = {lane.id: lane for edge in content.edges.values() for lane in edge.lanes}
    onward = {f"{link.source[0]}_{link.source[1]}": link for link in content.links}
    for edge in content.roads().values():
        for lane in edge.lanes:
            if lane.for_cars and len(lane.shape) > 2:
                lines.append(np.array(lane.shape))
                names.append(f"lane '{lane.id}'")
                rooms.append(_room(lane))
                judged.append((0.0, math.inf))
    for link, lane in _from_cars(content):
        target = lane_of[f"{link.target[0]}_{link.target[1]}"]
        if not link.via or link.rules[0] in TURNAROUND or not target.for_cars:
            continue
        inside, via = [], link.via
        while via in lane_of and via not in inside:
            inside.append(via)
            via = onward[via].via if via in onward else ""
        before, after = _stretch(lane.shape[::-1])[::-1], _stretch(target.shape)
        line = np.array([*before, *(point for name in inside for point in lane_of[name].shape), *after])
        steps = np.hypot(*np.diff(line, axis=0).T)
        lines.append(line)
        names.append(f"from '{lane.id}' to '{target.id}'")
        rooms.append(min(_room(lane), _room(target)))
        judged.append(
            (float(steps[: len(before) - 1].sum()) - 1e-6, float(steps[: len(line) - len(after)].sum()) + 1e-6)
        )
    from platoontraffic.road.turning import tight_turns  # here, since importing numba takes half a second

    turns = tight_turns(lines, CAR.turning_radius)
    room, (first, last) = np.array(rooms)[turns.line], np.array(judged).reshape(-1, 2)[turns.line].T
    found = np.flatnonzero((turns.offset > room) & (turns.end >= first) & (turns.start <= last))
    worst: dict[tuple[int, int], int] = {}  # of stretches near each other on a line, the one with the greatest offset
    groups = 0
    for before, i in zip([-1, *found], found, strict=False):
        apart = (
            before < 0 or turns.line[before] != turns.line[i] or turns.start[i] - turns.end[before] > CAR.turning_radius
        )
        groups += apart
        key = (int(turns.line[i]), groups)
        if key not in worst or turns.offset[i] > turns.offset[worst[key]]:
            worst[key] = int(i)

    def places() -> Iterator[Place]:
        for i in worst.values():
            line = lines[turns.line[i]]
            ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            middle = (turns.start[i] + turns.end[i]) / 2
            where = [np.interp(middle, ends, line[:, axis]) for axis in (0, 1)]
            side = "left" if turns.angle[i] > 0 else "right"
            angle, length = math.degrees(abs(turns.angle[i])), turns.end[i] - turns.start[i]
            within = f" within {length:.1f} m" if length > 0.05 else ""
            text = f"{names[turns.line[i]]}: {angle:.0f}° to the {side}{within}, {turns.offset[i]:.1f} m off the line,"
            yield _place(text, where, float(turns.offset[i]))

    what = f"sharper than a car can drive within its lane (turning radius {CAR.turning_radius:.1f} m)"
    return _kind("too sharp", f"kink {what}|{{n}} kinks {what}", places())


def _narrow(content: Content) -> Kind:
    places = (
        _place(f"'{lane.id}', {lane.width:g} m", _middle(lane.shape), -lane.width)
        for lane in _car_lanes(content)
        if lane.width < CAR.width
    )
    what = f"narrower than a car ({CAR.width:g} m)"
    return _kind("too narrow", f"lane {what}|{{n}} lanes {what}", places)


def _overlaps(content: Content) -> Kind:
    """Lanes of different edges on which cars side by side would touch."""
    names, lanes = [], []
    for name, edge in content.roads().items():
        for lane in edge.lanes:
            if lane.for_cars:
                names.append(name)
                lanes.append(lane)
    shapes = shapely.linestrings(
        np.concatenate([lane.shape for lane in lanes]),
        indices=np.repeat(np.arange(len(lanes)), [len(lane.shape) for lane in lanes]),
    )
    pairs = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=CAR.width)
    number = np.unique(names, return_inverse=True)[1]
    a, b = pairs[:, (pairs[0] < pairs[1]) & (number[pairs[0]] != number[pairs[1]])]
    near = np.isin(a, a)
    if len(
        a
    ):  # the ends of lanes at a junction are near each other: only those that run along each other are looked at
        shared = shapely.intersection(shapes[a], shapely.buffer(shapes[b], CAR.width, cap_style="flat", quad_segs=4))
        near = shapely.length(shared) >= SIDE_BY_SIDE
        shared = shared[near]

    def places() -> Iterator[Place]:
        for i, j, common in zip(a[near], b[near], shared, strict=True) if len(a) else ():
            length, middle = shapely.length(common), shapely.centroid(common)
            text = f"'{lanes[i].id}' and '{lanes[j].id}' for {length:.0f} m"
            yield _place(text, (middle.x, middle.y), length)

    what = "of different roads on which cars side by side would touch"
    return _kind("overlap", f"pair of lanes {what}|{{n}} pairs of lanes {what}", places())


def _unconnected(content: Content) -> Kind:
    """Lanes without a connection beside others that have one."""
    leading = {link.source for link in content.links}
    going_on = {link.source[0] for link in _onward(content)}

    def places() -> Iterator[Place]:
        for name, edge in _for_cars(content).items():
            for i, lane in enumerate(edge.lanes):
                if name in going_on and lane.for_cars and not lane.merges and (name, i) not in leading:
                    yield _place(f"'{lane.id}'", lane.shape[-1])

    what = "that ends, though other lanes of its road go on|{n} lanes that end, though others of their roads go on"
    return _kind("lane ends", f"lane {what}", places())


def _dead_ends(content: Content) -> Kind:
    """Edges that lead nowhere, at junctions from which other roads lead on."""
    left = {link.source[0] for link in _onward(content)}
    roads = _for_cars(content)
    onward: dict[str, set[str]] = {}  # junctions to which roads lead from each junction
    for edge in roads.values():
        onward.setdefault(edge.start, set()).add(edge.end)
    places = (
        _place(f"'{name}' before junction '{edge.end}'", edge.lanes[0].shape[-1])
        for name, edge in roads.items()
        if name not in left and onward.get(edge.end, set()) - {edge.start}
    )
    what = "road that leads nowhere, though others lead on from its junction"
    return _kind("leads nowhere", f"{what}|{{n}} roads that lead nowhere, though others lead on from there", places)


def _unreached(content: Content) -> Kind:
    reached = {link.target[0] for link in _onward(content)}
    roads = _for_cars(content)
    origins: dict[str, set[str]] = {}  # junctions from which roads lead to each
    for edge in roads.values():
        origins.setdefault(edge.end, set()).add(edge.start)
    places = (
        _place(f"'{name}' behind junction '{edge.start}'", edge.lanes[0].shape[0])
        for name, edge in roads.items()
        if name not in reached and origins.get(edge.start, set()) - {edge.end}
    )
    what = "road that cannot be reached, though others lead to its junction"
    return _kind("not reached", f"{what}|{{n}} roads that cannot be reached, though others lead there", places)


def _without_inside(content: Content) -> Kind:
    across = [link for link, _ in _from_cars(content)]
    without = [(link, lane) for link, lane in _from_cars(content) if not link.via]
    if across and len(without) == len(across):
        what = "no lanes inside junctions: routes cross them in straight lines; build without no-internal-links"
        return Kind("no inside", what, (Place("", math.nan, math.nan),))
    places = (_place(f"from '{lane.id}' to '{link.target[0]}'", lane.shape[-1]) for link, lane in without)
    what = "without a lane inside the junction"
    return _kind("no inside", f"connection {what}|{{n}} connections {what}", places)


def _left_hand(content: Content) -> Kind:
    here = content.options.get("lefthand") in ("1", "true")
    what = "left-hand traffic: distances to the right of the road's middle have the other sign"
    return Kind("left-hand", what, (Place("", math.nan, math.nan),) if here else ())


def _of_others(content: Content) -> Kind:
    """Lanes that are not for cars: footpaths, rails, bus lanes."""
    apart: Counter[str] = Counter()
    beside: Counter[str] = Counter()
    for edge in content.roads().values():
        for lane in edge.lanes:
            if not lane.for_cars:
                allowed = lane.allowed
                is_road = allowed is None or not allowed <= NO_ROAD
                users = "none" if not allowed else "rails" if allowed <= ON_RAILS else " and ".join(sorted(allowed)[:3])
                (beside if is_road else apart)["closed to cars" if allowed is None else users] += 1
    texts = [f"{_counted(beside)}, part of the road, but not of routes"] if beside else []
    texts += [f"{_counted(apart)}, no part of the road"] if apart else []
    total = sum(beside.values()) + sum(apart.values())
    what = f"{total} lane{'s are' if total > 1 else ' is'} for others: {'; '.join(texts)}"
    return Kind("for others", what, (Place("", math.nan, math.nan),) if total else ())


def _counted(users: Counter[str]) -> str:
    return ", ".join(f"{name} {times}" for name, times in sorted(users.items(), key=lambda item: (-item[1], item[0])))


# ---- lanes


def _for_cars(content: Content) -> Mapping[str, Edge]:
    return {name: edge for name, edge in content.roads().items() if any(lane.for_cars for lane in edge.lanes)}


def _car_lanes(content: Content) -> list[Lane]:
    return [lane for edge in content.roads().values() for lane in edge.lanes if lane.for_cars]


def _from_cars(content: Content) -> Iterator[tuple[Link, Lane]]:
    """The connections of lanes for cars to other roads, each with the lane before it."""
    roads = content.roads()
    for link in content.links:
        if link.source[0] in roads and link.target[0] in roads:
            lane = roads[link.source[0]].lanes[link.source[1]]
            if lane.for_cars and roads[link.target[0]].lanes[link.target[1]].for_cars:
                yield link, lane


def _onward(content: Content) -> Iterator[Link]:
    """The connections of `_from_cars` without turnarounds on the same road: few roads are wide enough for a car's."""
    return (link for link, _ in _from_cars(content) if link.rules[0] not in TURNAROUND)


def _room(lane: Lane) -> float:
    """How far a car's axle may be off the line of a lane without the car leaving the lane [m]."""
    return max(lane.width - CAR.width, 0.0) / 2


def _stretch(shape: Points) -> Points:
    """The first part of a line, up to the first point that is NEXT away."""
    driven = 0.0
    for i in range(1, len(shape)):
        driven += math.dist(shape[i - 1], shape[i])
        if driven >= NEXT:
            return shape[: i + 1]
    return shape


def _middle(shape: Points) -> tuple[float, ...]:
    """The middle of the middle one of a line's pieces."""
    k = len(shape) // 2
    return tuple((a + b) / 2 for a, b in zip(shape[k - 1], shape[k], strict=True))
