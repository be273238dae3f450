"""The lanes of a route: which ones it takes, where it changes them, and where it meets stop lines.

Edges, lanes and links (connections of two lanes) are sumolib's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString, Point

from platoontraffic.errors import InputError
from platoontraffic.geometry.polyline import left_of
from platoontraffic.road.permissions import CAR

CHANGING = "change"  # state of a line where a change of lanes begins
CHANGE_AFTER = 5.0  # distance of a lane change from the begin of its edge [lane widths]: 16 m in streets
CHANGE_LENGTH = 12.0  # length of a change over one lane [lane widths]: 38 m, or 3 s at 13 m/s
SHORTEST_CHANGE = 5.0  # the same where there is little room [lane widths]: 16 m
BETWEEN = 3.0  # length of lane between two changes, on which a car stands straight [lane widths]: 10 m
ROOM_SHARE = 0.6  # of the rest of the lane that a change takes then, so that it ends before a queue at the line
ENOUGH_ROOM = 80.0  # length of lane with which a lane change has all the room that it needs, in traffic too [m]
ABREAST = 2.2  # distance of lanes on which cars drive side by side with some room [m]
TO_BORDER = 0.95  # from the middle of a car to the border of its lane, at least [m] ...
TO_KERB = 1.1  # ... and where no other lane is beyond that: the laws keep 0.22 m free beside a car
AS_ONE = 1.2  # distance up to which lanes meet, and do not lead side by side [m]
EASED = 4.0  # distance from its ends up to which a lane is moved less [m]
SAMPLED = 2.0  # spacing of the places at which lanes are compared [m]
NO_STEP = 1.0  # length up to which the direction of a piece of line does not count [m]
ALIKE = 0.2  # links that bend by about as much are equal [rad]
EARLIEST_SHARE = 0.1  # share of a short edge that precedes a lane change, and that is left for it at least


class Line(NamedTuple):
    """A stop line: where a lane ends at a junction, and the right of way there; or where a lane change begins.

    A lane change leads to the next lane for cars. Others may lie between.
    """

    station: float  # on the route [m]
    state: str  # SUMO's link state: M and G have priority, m, s and w yield; or CHANGING
    light: str  # id of the traffic light; "" if there is none
    index: int  # of this link among those of the light
    lane: str
    onto: str  # lane beyond the junction, or the adjacent lane
    via: tuple[str, ...]  # lanes inside the junction: two or more where vehicles may wait midway
    across: float  # length of those lanes, or of the lane change [m]
    to_end: float = 0.0  # from where a lane change begins to the lane's end [m]
    aside: float = 0.0  # distance of the lane that is changed to, to the left [m]
    kind: str = "car"  # vehicle of `CARS` for which conflicts beyond it are found: its front may swing out


class Change(NamedTuple):
    """A lane change on one edge of a route, by indices."""

    edge: int  # of the route
    lane: int
    onto: int


class _Crossed(NamedTuple):
    """What lane changes cost, compared in this order."""

    lanes: int  # that are crossed
    lacks: float  # room that is missing, of all changes [m]
    late: int  # lanes, each times the number of the edge on which it is left
    bends: int  # by how much the links bend [ALIKE]


def links_between(here: Any, there: Any) -> list[Any]:
    """The links for cars from one edge to another.

    raises : InputError where there is none
    """
    links = here.getAllowedOutgoing(CAR).get(there, [])
    if not links:
        onward = ", ".join(sorted(edge.getID() for edge in here.getAllowedOutgoing(CAR)))
        raise InputError(
            f"no connection from edge '{here.getID()}' to '{there.getID()}'; "
            f"it leads to: {onward or 'nothing, the road ends'}"
        )
    return links


def inside(link: Any, net: Any) -> list[Any]:
    """The lanes of a link inside the junction: one, or several in a chain where vehicles wait midway."""
    lanes = []
    while via := link.getViaLaneID():
        lanes.append(net.getLane(via))
        link = lanes[-1].getOutgoing()[0]
    return lanes


def _bends(link: Any) -> int:
    """By how much a link bends, to either side, from the end of its lane straight to the begin of the next [ALIKE]."""
    (ahead, end), (begin, beyond) = link.getFromLane().getShape()[-2:], link.getToLane().getShape()[:2]
    steps = [(ahead, end), (end, begin), (begin, beyond)]
    long = [step for step in steps if math.dist(*step) > NO_STEP]
    headings = [math.atan2(y - its_y, x - its_x) for (its_x, its_y), (x, y) in long]
    turns = (abs(math.remainder(after - before, 2 * math.pi)) for before, after in pairwise(headings))
    return round(sum(turns) / ALIKE)


def least_changes(
    road: Sequence[Any], lane: int, last: int | None, position: float = 0.0, change: Change | None = None
) -> list[Any]:
    """The links from each edge to the next that cross the fewest lanes.

    Of equal ones, those that change where there is most room, up to `ENOUGH_ROOM`; of these, those that change first;
    of these, those that bend least: where lanes begin, a link to each leads from one lane, and some of them swerve.

    lane, last : index of the first lane, and of the last one if it can be reached; None: any
    position   : before which lanes are not changed [m], on the first edge, or on that of the change
    change     : the first one, or none on its edge, onto the same lane; None: any
    raises     : InputError where there is none
    """
    on = change.edge if change else 0
    best: dict[int, tuple[_Crossed, list[Any]]] = {lane: (_Crossed(0, 0.0, 0, 0), [])}  # by index of the lane reached
    for i, (here, there) in enumerate(pairwise(road)):
        lacks = max(ENOUGH_ROOM - here.getLength() + (position if i == on else 0.0), 0.0)
        onward: dict[int, tuple[_Crossed, list[Any]]] = {}
        for now, (crossed, links) in best.items():
            for link in links_between(here, there):
                leaves, to = link.getFromLane().getIndex(), link.getToLane().getIndex()
                if change and i == change.edge and (now, leaves) != (change.lane, change.onto):
                    continue
                lanes = abs(leaves - now)
                cost = _Crossed(
                    crossed.lanes + lanes, crossed.lacks + lacks * lanes, crossed.late + i * lanes,
                    crossed.bends + _bends(link),
                )  # fmt: skip
                if to not in onward or cost < onward[to][0]:
                    onward[to] = cost, [*links, link]
        if not onward:
            raise InputError(f"no lanes from edge '{here.getID()}' to '{there.getID()}' with that lane change")
        best = onward
    return best[last][1] if last in best else min(best.values(), key=lambda option: option[0])[1]


@dataclass
class LaneRoute:
    """The centre line of a route, put together lane by lane."""

    net: Any
    left_hand: bool = False  # traffic
    parts: list[np.ndarray] = field(default_factory=list)  # points (k, 2) of each lane [m]
    limits: list[float] = field(default_factory=list)  # speed limit of each lane [m/s]
    lines: list[Line] = field(default_factory=list)
    length: float = 0.0  # of the parts [m]

    def add(self, lane: Any) -> None:
        """Append a whole lane."""
        self._append(_line_of(lane, self.left_hand), lane)

    def _append(self, part: np.ndarray, lane: Any) -> None:
        self.parts.append(part)
        self.limits.append(lane.getSpeed())
        self.length += _length(part)

    def cross(
        self, lane: Any, link: Any, position: float, longest: float = math.inf, first: Sequence[Line] = ()
    ) -> None:
        """Append a lane, the changes to the lane on which a link begins, the stop line and the junction.

        position : on the lane, before which it is not changed [m]
        longest  : greatest length of a change over one lane [m]
        first    : changes before these, with their stations on the lane
        """
        length = LineString(lane.getShape()).length
        places = [(line.station / length, line.across / length) for line in first]
        lanes = [lane, *(self.net.getLane(line.onto) for line in first)]
        onward = _from_lane_to_lane(lanes[-1], link.getFromLane())
        places += _places_of_changes(onward, position, longest, sum(places[-1]) if places else 0.0)
        lanes += onward[1:]
        points = _crossing_over(lanes, places) if places else _line_of(lane, self.left_hand)
        for (here, there), (begin, share) in zip(pairwise(lanes), places, strict=True):
            before, across = begin * length, share * length
            sides, to_end = (here.getID(), there.getID()), _length(points) - before
            at, aside = self.length + before, _aside(here, there)
            self.lines.append(Line(at, CHANGING, "", 0, *sides, (), across, to_end, aside))
        self._append(points, lane)
        across = inside(link, self.net)
        ends = link.getFromLane().getID(), link.getToLane().getID()
        via, length = tuple(one.getID() for one in across), sum(one.getLength() for one in across)
        signal = link.getState(), link.getTLSID(), link.getTLLinkIndex()
        self.lines.append(Line(self.length, *signal, *ends, via, length))
        for one in across:
            self.add(one)

    def close(self, lane: Any) -> None:
        """Append the first point, on the lane from which the route starts."""
        self._append(self.parts[0][:1], lane)

    def joined(self) -> tuple[np.ndarray, np.ndarray, list[Line]]:
        """Points (k, 2) [m], speed limit from each point on (k,) [m/s], stop lines."""
        line, limit = np.concatenate(self.parts), np.repeat(self.limits, [len(part) for part in self.parts])
        # Where one lane's last point is the first point of the next, the limit is that of the next.
        new = np.concatenate([np.hypot(*np.diff(line, axis=0).T) > 1e-6, [True]])
        return line[new], limit[new], self.lines


def _line_of(lane: Any, left_hand: bool) -> np.ndarray:
    """A lane's centre line, moved aside within the lane where another lane is too close for cars side by side, (k, 2).

    Networks have such places in long bends of junctions. Lanes of one direction that meet or cross are left as they
    are. Roads with kinks are narrower than their lanes, and those of two directions overlap: there drivers keep to
    their side of the road.
    """
    shape, edge, index = np.array(lane.getShape()), lane.getEdge().getLanes(), lane.getIndex()
    line, moved = LineString(shape), shape
    for other in (*edge[max(index - 1, 0) : index], *edge[index + 1 : index + 2]):
        beside = LineString(other.getShape())
        if not other.allows(CAR) or not AS_ONE < line.distance(beside) < ABREAST:
            continue
        there, away, ends = _places_beside(line, beside)
        apart = np.hypot(*away.T)
        by = np.clip(ABREAST - apart, 0.0, max(lane.getWidth() / 2 - TO_BORDER, 0.0)) * ends
        moved = (there if moved is shape else moved) + (by / apart)[:, None] * away
    most, side = lane.getWidth() / 2 - TO_KERB, -1.0 if left_hand else 1.0  # oncoming vehicles are to the left: 1
    for other in _oncoming(lane) if most > 0 else ():
        beside = LineString(other.getShape())
        if not other.allows(CAR) or line.distance(beside) >= ABREAST:
            continue
        there, away, ends = _places_beside(line, beside)
        outward = -side * left_of(there)
        apart = (away * outward).sum(axis=1)  # negative where the two have crossed, at a kink
        by = np.clip(ABREAST - apart, 0.0, most) * (np.abs(apart) < ABREAST) * ends
        moved = (there if moved is shape else moved) + by[:, None] * outward
    return moved


def _places_beside(line: LineString, beside: LineString) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places on a line, the vectors to them from the nearest places of another line, both (k, 2) [m], and shares that
    fade from 1 to 0 towards the ends of the line, (k,)."""
    own = shapely.line_locate_point(line, shapely.points(line.coords))
    along = np.union1d(own, np.arange(0.0, line.length, SAMPLED))
    there = shapely.line_interpolate_point(line, along)
    nearest = shapely.line_interpolate_point(beside, shapely.line_locate_point(beside, there))
    there, nearest = shapely.get_coordinates(there), shapely.get_coordinates(nearest)
    return there, there - nearest, np.clip(np.minimum(along, line.length - along) / EASED, 0.0, 1.0)


def _oncoming(lane: Any) -> list[Any]:
    """Lanes of the other direction beside a lane, if it is the innermost one of its road; none inside junctions."""
    edge = lane.getEdge()
    if edge.getFunction() == "internal" or lane is not edge.getLanes()[-1]:
        return []
    back = [one for one in edge.getToNode().getOutgoing() if one.getToNode() is edge.getFromNode()]
    return [one.getLanes()[-1] for one in back if one is not edge]


def change_length(width: float, longest: float) -> float:
    """Length of a change over one lane of a width, where there is room [m]: at most `longest`, but fit to be driven."""
    return min(CHANGE_LENGTH * width, max(longest, SHORTEST_CHANGE * width))


def changes_length(width: float, longest: float, lanes: int, changes: int) -> float:
    """Length of so many changes over so many lanes of a width, as `change_length` [m]."""
    return lanes * change_length(width, longest) + (changes - 1) * BETWEEN * width


def _from_lane_to_lane(lane: Any, other: Any) -> list[Any]:
    """The lanes for cars of an edge from one to another, both included."""
    first, last = lane.getIndex(), other.getIndex()
    step = 1 if first < last else -1
    lanes = [lane.getEdge().getLane(k) for k in range(first, last + step, step)]
    return [one for one in lanes if one in (lane, other) or one.allows(CAR)]


def _places_of_changes(
    lanes: Sequence[Any], position: float, longest: float, earliest: float
) -> list[tuple[float, float]]:
    """Where each change from one of an edge's lanes to the next begins, and its length, as shares of the lane.

    position : after which they are made [m]
    longest  : greatest length of a change over one lane [m]
    earliest : share of the lane before which none begins
    """
    if len(lanes) == 1:
        return []
    steps, count = np.abs(np.diff([one.getIndex() for one in lanes])), len(lanes) - 1
    width, length = lanes[0].getWidth(), LineString(lanes[0].getShape()).length
    shortest, wanted = (changes_length(width, most, int(steps.sum()), count) / length for most in (0.0, longest))
    # As early as that, or as early as its length needs; but not before the position, if that leaves room.
    latest = 1 - min(shortest, EARLIEST_SHARE)
    begin = min((position + CHANGE_AFTER * width) / length, max(1 - wanted, EARLIEST_SHARE))
    begin = max(begin, min(max(position / length, earliest), latest))
    whole = min(wanted, max(shortest, ROOM_SHARE * (1 - begin)), 1 - begin)
    across = steps * change_length(width, longest) / length * whole / wanted
    between = BETWEEN * width / length * whole / wanted
    begins = begin + np.cumsum(np.concatenate([[0.0], across[:-1] + between]))
    return list(zip(begins.tolist(), across.tolist(), strict=True))


def _crossing_over(lanes: Sequence[Any], places: Sequence[tuple[float, float]]) -> np.ndarray:
    """The line along the first of an edge's lanes that crosses over from each to the next; its points (k, 2) [m].

    places: as of `_places_of_changes`
    """
    lines, count = [LineString(one.getShape()) for one in lanes], len(places)
    begins, across = np.array(places).T
    ends = [one.project(Point(p), normalized=True) for one in lines for p in one.coords]
    share = np.unique([*ends, *begins, *(begins + across)])
    crossed = np.clip((share[:, None] - begins) / across, 0.0, 1.0).sum(axis=1)
    left = np.minimum(crossed.astype(int), count - 1)
    here, there = (
        shapely.get_coordinates(shapely.line_interpolate_point(np.array(lines)[k], share, normalized=True))
        for k in (left, left + 1)
    )
    return here + (crossed - left)[:, None] * (there - here)


def _aside(lane: Any, other: Any) -> float:
    """Distance of another lane of the same edge, to the left [m]."""
    line = LineString(lane.getShape())
    place = line.interpolate(0.5, normalized=True)
    before, after = (line.interpolate(share, normalized=True) for share in (0.45, 0.55))
    beside = LineString(other.getShape()).interpolate(LineString(other.getShape()).project(place))
    ahead, across = (after.x - before.x, after.y - before.y), (beside.x - place.x, beside.y - place.y)
    return math.copysign(math.hypot(*across), ahead[0] * across[1] - ahead[1] * across[0])


def _length(line: np.ndarray) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())
