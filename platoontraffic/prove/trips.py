"""Random trips for cars through a network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.road.network import CHANGING, Line, Network
from platoontraffic.road.turning import tight_turns

SHORTEST, LONGEST = 300.0, 2500.0  # wanted length of a trip [m]
ATTEMPTS = 40  # routes that are tried for each one that is wanted
SHORTEST_CHANGE = 10.0  # of a lane change on the first edge [m]
ROOM_AHEAD = 10.0  # between a start and the end of its lane, where the lane is long enough [m]


class Trip(NamedTuple):
    """A start and a route from there."""

    edges: tuple[str, ...]
    lane: int  # index on the first edge
    position: float  # of the front bumper on that lane [m]
    line: np.ndarray  # centre line of the lanes from the start of the first one on, (k, 2) [m]
    limit: np.ndarray  # speed limit from each point of the line on, (k,) [m/s]
    lines: tuple[Line, ...]  # stop lines and lane changes

    @property
    def length(self) -> float:
        """From the front bumper to the end [m]."""
        return float(np.hypot(*np.diff(self.line, axis=0).T).sum()) - self.position

    def free_time(self, fastest: float) -> float:
        """Duration at the speed limits, or at a vehicle's top speed where that is lower [s]."""
        sizes = np.hypot(*np.diff(self.line, axis=0).T)
        ends = np.cumsum(sizes)
        driven = np.clip(ends - self.position, 0, sizes)
        return float((driven / np.minimum(self.limit[:-1], fastest)).sum())

    def lane_at(self, station: float) -> str:
        """Id of the lane at a station of the line; of a chain of lanes inside a junction the first one."""
        lane = f"{self.edges[0]}_{self.lane}"
        for one in self.lines:
            if station < one.station:
                break
            inside = one.via and station < one.station + one.across
            lane = one.via[0] if inside else one.onto
        return lane


def draw(
    network: Network, count: int, rng: np.random.Generator, *, room: float, radius: float, round_blocks: bool = True
) -> list[Trip]:
    """Different trips, at most `count` of them, 300 to 2500 m long; shorter ones where there are not enough of these.

    Start and target are edges drawn at random, the route between them is the fastest one, cut to a random length.

    room         : length of lane up to the front bumper that vehicles need at the start [m]
    radius       : turning radius below which no route turns back on its road [m]
    round_blocks : False: no route turns back on a smaller radius over several short edges either
    raises       : InputError where there is no trip
    """
    lanes = network.lanes_for_cars()
    if not lanes:
        raise InputError(f"{network.path}: the network has no lane for cars; must have one to start from")
    starts = [lane for lane in lanes if lane[2] > room]
    if not starts:
        raise InputError(f"{network.path}: no lane for cars is {room:.1f} m long; must have one to start from")
    targets = sorted({edge for edge, _, _ in lanes})
    long, short = {}, {}
    for trip in _attempts(network, starts, targets, count, rng, room, radius):
        if not round_blocks and _turns_back(trip.line, radius):
            continue
        (long if trip.length >= SHORTEST else short).setdefault((trip.edges, trip.lane), trip)
        if len(long) == count:
            break
    if not long and not short:
        raise InputError(
            f"{network.path}: no route for cars was found; must have two edges that are connected, without turning back"
        )
    rest = sorted(short.values(), key=lambda trip: -trip.length)
    return [*long.values(), *rest][:count]


def _attempts(network, starts, targets, count, rng, room, radius) -> Iterator[Trip]:
    for _ in range(ATTEMPTS * count):
        edge, lane, length = starts[rng.integers(len(starts))]
        target, wanted = targets[rng.integers(len(targets))], rng.uniform(SHORTEST, LONGEST)
        position = round(rng.uniform(room, max(length - ROOM_AHEAD, room)), 1)
        try:
            route = cut(network, network.fastest_route(edge, target), position + wanted)
            line, limit, lines = network.route_lanes(route, lane, position=position)
            network.check_reversals(route, radius)
        except InputError:
            continue
        trip = Trip(tuple(route), lane, position, line, limit, tuple(lines))
        if trip.length > room and not _changes_at_once(lines):
            yield trip


def _turns_back(line: np.ndarray, radius: float) -> bool:
    """Whether a line makes half a turn or more on a smaller radius than the given one [m].

    As round a block whose sides are no longer than a car; `check_reversals` knows such turns on one road only. A car
    that drives there leaves its lane by several metres, and stands in its own platoon's way.
    """
    return bool((np.abs(tight_turns([line], radius).angle) >= math.pi).any())


def _changes_at_once(lines: Sequence[Line]) -> bool:
    """Whether the start leaves too little road for a lane change before the first junction."""
    changes = list(takewhile(lambda line: line.state == CHANGING, lines))
    return bool(changes) and sum(line.across for line in changes) < SHORTEST_CHANGE


def cut(network: Network, route: list[str], longest: float) -> list[str]:
    """The first edges of a route, as many as end within a distance of its start [m]; at least one."""
    ends = np.cumsum([network.edges[edge][0] for edge in route])
    return route[: max(int(np.searchsorted(ends, longest, side="right")), 1)]
