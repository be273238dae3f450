"""The time that a vehicle loses on each lane by which it may leave an edge: in queues, and by changing lanes.

SUMO's cars choose their lanes by the same: how many lanes each is away from the best one, and how many vehicles are on
it. Edges, lanes and links are sumolib's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from platoontraffic.road.lane_routes import ENOUGH_ROOM, links_between
from platoontraffic.road.permissions import CAR

CHANGE_COSTS = 4.0  # time lost for each lane that is crossed [s] ...
LITTLE_ROOM_COSTS = 8.0  # ... and so much more where there is hardly room [s]
QUEUE = 4.0  # time in it from which a queue is one that stands [s]
NO_CHANGE = 20.0  # shorter edges count as too short for a change over one lane [m]


class Queue(NamedTuple):
    """A queue at the end of a lane."""

    time: float  # that a vehicle waits in it [s]
    length: float  # of the lane that it takes [m]

    @property
    def stands(self) -> bool:
        return self.time >= QUEUE


NO_QUEUE = Queue(0.0, 0.0)


def change_time(lanes: int, room: float) -> float:
    """Time lost by a change over a number of lanes on a length of road [m]; inf where that is too short [s]."""
    if lanes == 0:
        return 0.0
    if room < lanes * NO_CHANGE:
        return math.inf
    return lanes * (CHANGE_COSTS + LITTLE_ROOM_COSTS * max(1 - room / (lanes * ENOUGH_ROOM), 0.0))


class LaneTimes:
    """The lanes of a route's edges.

    road: the edges; each leads to the next one
    """

    def __init__(self, road: Sequence[Any]) -> None:
        self._road = road
        # Time lost without queues from the begin of each edge on, by the lane on which a vehicle comes to it [s].
        self._entering: list[dict[int, float]] = [{}] * len(road)
        self._entering[-1] = dict.fromkeys(_lanes(road[-1]), 0.0)
        for i in range(len(road) - 2, -1, -1):
            self._entering[i] = _entering(road[i], self._leaving(i, self._entering[i + 1], _no_queue), _no_queue)

    def leaving(self, i: int, queue: Callable[[str], Queue], reach: float) -> dict[int, float]:
        """Time lost in queues at the end of an edge, and from there on, by index of the lane that leads on [s].

        i     : number of the edge, not the last one
        queue : on a lane, by its id
        reach : queues count on this edge, and on those that begin within this distance beyond its end [m]
        """
        last = i + 1
        while last < len(self._road) - 1 and reach > 0:
            reach -= self._road[last].getLength()
            last += 1
        entering = self._entering[last]
        for k in range(last - 1, i, -1):
            entering = _entering(self._road[k], self._leaving(k, entering, queue), queue)
        return self._leaving(i, entering, queue)

    def _leaving(self, i: int, entering: Mapping[int, float], queue: Callable[[str], Queue]) -> dict[int, float]:
        found: dict[int, float] = {}
        for link in links_between(self._road[i], self._road[i + 1]):
            lane = link.getFromLane()
            time = entering.get(link.getToLane().getIndex(), math.inf)
            found[lane.getIndex()] = min(found.get(lane.getIndex(), math.inf), time)
        edge = self._road[i].getID()
        return {k: time + queue(f"{edge}_{k}").time for k, time in found.items()}


def _lanes(edge: Any) -> list[int]:
    return [lane.getIndex() for lane in edge.getLanes() if lane.allows(CAR)]


def _no_queue(lane: str) -> Queue:
    return NO_QUEUE


def _entering(edge: Any, leaving: Mapping[int, float], queue: Callable[[str], Queue]) -> dict[int, float]:
    """Time lost from the begin of an edge on, by the lane there [s]; leaving: from its end on, by the lane there [s].

    A vehicle changes lanes before the queue on its own lane. Nobody counts on a change to a lane on which a queue
    stands: it may be longer by then, and have no gap. A vehicle that waits beside it blocks its own lane.
    """
    queues = {lane: queue(f"{edge.getID()}_{lane}") for lane in _lanes(edge)}
    standing = {lane: one.length for lane, one in queues.items() if one.stands}
    found = {}
    for here in queues:
        room = edge.getLength() - standing.get(here, 0.0)
        onto = (k for k in leaving if k == here or k not in standing)
        found[here] = min((leaving[k] + change_time(abs(k - here), room) for k in onto), default=math.inf)
    return found
