"""Members between two lanes, which SUMO's drivers on both lanes must see.

A vehicle of SUMO's that changes lanes has a shadow on the other lane, for which drivers there brake: on its target lane
from the moment at which it begins, on the lane that it leaves until its body has left it. SUMO looks for a moved
vehicle's shadow only when it inserts the vehicle on a lane: it is then on the lane that the body overlaps, to the left
of a vehicle in the middle of its lane. So a member whose shadow is missing is inserted anew, wider than its lane:

- for a shadow to the left, on another lane and back on its own, in the middle;
- for a shadow to the right, on the right lane, where it has a shadow on its own lane for the coming step, at whose end
  `moveToXY` inserts it on its own lane, to the right of the middle (in left-hand traffic it then has the wrong shadow,
  and this is done again before each step);
- to remove a shadow, as for one to the left, with its true width.

Of the bodies that overlap a lane from elsewhere SUMO's drivers see the one that is next in the order in which they were
inserted. So a shadow further ahead is inserted again after one behind it. And the rear of a vehicle that stands on the
junction behind the lane would hide a shadow that is inserted in every step; there a member in left-hand traffic keeps
to its own lane.

A member gets no shadow on a lane where the front of another vehicle is beside it. That vehicle would take the shadow
for a leader into which it has driven; it would brake hard or change lanes, even into the member. In a bend bodies come
near the border of their lanes for a moment. And a member that stands has none while a vehicle abreast of it can drive
past: by the lengths that SUMO gives to lanes in a bend that vehicle may be behind the shadow, and would not go on.

SUMO's drivers do not see shadows when they change lanes. So those beside a member change no lanes while that could lead
them into it: on the lane beyond that of its shadow; and for one step of a shadow to the right, in which only a shadow
is on the member's own lane, on both lanes next to that.

All of this happens between two steps, so that no driver sees it elsewhere. Left is towards the lanes with the higher
index, also in left-hand traffic.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from platoontraffic.road.gap_acceptance import STANDING
from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client, direct

LEFT, NONE, RIGHT = 1, 0, -1
AHEAD = 1.5  # a shadow is on the lane that the body will reach within this time at its present lateral speed [s]
TOUCH = 1e-6  # a vehicle as near to the middle of its lane as this was not on the other side of it [m]
WIDER = 1.01  # width of a vehicle that is to have a shadow wherever it is on its lane [lane widths]
SLOW = 5.0  # speed up to which a vehicle may stand so much across that its rear matters [m/s]
ABREAST = 20.0  # distance by SUMO's positions up to which vehicles on two lanes can be abreast in a bend [m]
PASSING = 0.05  # least distance at which a vehicle passes one that stands [m]
NEARLY = 5.0  # distance up to which another vehicle is beside that might change lanes [m]
NO_CHANGES = 0  # argument of setLaneChangeMode
DURATION = "lanechange.duration"
SHORTEST = "0.001"  # [s]; SUMO has shadows if a lane change takes any time, and its own cars still change at once


class Mover(NamedTuple):
    """A vehicle that is moved."""

    id: str
    kind: str  # its vehicle type, which no other vehicle has
    width: float  # [m]


class _Seen(NamedTuple):
    lane: str
    lateral: float  # of the front bumper's middle, left of the lane's centre line [m]
    speed: float  # lateral [m/s]
    over: tuple[int, float] | None  # side on which the front was last over the border, and where on the lane [m]


class _Shadow(NamedTuple):
    """As a vehicle is to have it in the coming step."""

    place: float  # of the vehicle's front on its lane [m]
    mover: Mover
    seen: _Seen
    side: int


def shadow_options(network: Network, options: Mapping[str, str]) -> dict[str, str]:
    """Options that SUMO must have besides `options` so that vehicles have shadows."""
    if all(len(lanes) < 2 for lanes in network.edges.values()) or "lateral-resolution" in options:
        return {}
    with contextlib.suppress(ValueError):  # other notations of a time
        return {DURATION: SHORTEST} if float(options.get(DURATION, 0)) == 0 else {}
    return {}


class Shadows:
    """The shadows of moved vehicles.

    In left-hand traffic SUMO mirrors lanes and lateral positions, but not those of `moveToXY`.

    step: of SUMO's [s]
    """

    def __init__(self, sumo: Client, network: Network, step: float) -> None:
        self._sumo, self._step, self._mirror = sumo, step, -1 if network.left_hand else 1
        self._possible = any(len(lanes) > 1 for lanes in network.edges.values())
        self._seen: dict[str, _Seen] = {}
        self._side: dict[str, int] = {}  # of the shadow that each vehicle has in SUMO
        self._widened: list[Mover] = []  # in the step that SUMO makes
        self._kept: dict[str, int] = {}  # mode of lane changes of vehicles that change none in it
        self._lanes: dict[str, int] = {}  # number, by edge
        self._widths: dict[str, float] = {}  # [m], by lane

    def observe(self, movers: Iterable[Mover], where: Mapping[str, tuple[str, str]]) -> None:
        """After a step: where vehicles are on their lanes.

        where: edge and lane by vehicle; the lane is "" off the road
        """
        if not self._possible:
            return
        for mover in self._widened:
            self._sumo.vehicletype.setWidth(mover.kind, mover.width)
        widened, self._widened = {mover.id for mover in self._widened}, []
        for name, mode in self._kept.items():
            with contextlib.suppress(self._sumo.TraCIException):  # it has left the simulation
                self._sumo.vehicle.setLaneChangeMode(name, mode)
        self._kept.clear()
        lateral_of = direct(self._sumo.vehicle.getLateralLanePosition)
        for mover in movers:
            edge, lane = where[mover.id]
            if not lane or self._lane_number(edge) < 2:
                self._seen.pop(mover.id, None)
                continue
            placed, before = lateral_of(mover.id), self._seen.get(mover.id)
            lateral = self._mirror * placed
            same = before is not None and before.lane == lane
            speed = (lateral - before.lateral) / self._step if same else before.speed if before else 0.0
            over = before.over if same else None
            if abs(lateral) > self._room(mover, lane):
                over = _towards(lateral), self._sumo.vehicle.getLanePosition(mover.id)
            self._seen[mover.id] = _Seen(lane, lateral, speed, over)
            if same and mover.id in widened:
                self._side[mover.id] = _towards(placed)
            elif not same:  # SUMO has inserted it there
                self._side[mover.id] = _towards(placed) if abs(placed) > self._room(mover, lane) else NONE

    def forget(self, names: Iterable[str]) -> None:
        """Vehicles that are moved no longer."""
        for name in names:
            self._seen.pop(name, None)
            self._side.pop(name, None)

    def lost(self, names: Iterable[str]) -> None:
        """Vehicles that have been inserted anew in the middle of their lanes, by others."""
        self._side.update(dict.fromkeys(names, NONE))

    def cast(self, movers: Iterable[Mover]) -> None:
        """Before a step, and before vehicles are moved: give them the shadows that they must have in it."""
        if not self._seen:
            return
        casts, has = [], []
        for mover in movers:
            if (seen := self._seen.get(mover.id)) is None:
                continue
            if side := self._wanted(mover, seen):
                self._keep_lanes(mover, seen, (2 * side,))
                if self._lets_pass(mover, seen, side):
                    side = NONE
            elif self._side[mover.id] == NONE:  # as most
                continue
            one = _Shadow(self._sumo.vehicle.getLanePosition(mover.id), mover, seen, side)
            if side == self._side[mover.id]:
                if side:
                    has.append(one)
            elif not (side and self._is_before_a_front(mover, seen, side)) and self._may_insert(one):
                casts.append(one)
        # SUMO's driver sees the shadow that was inserted last, and earlier ones only if they are further ahead.
        for _, mover, seen, side in sorted([*casts, *self._to_be_sorted(casts, has)], key=lambda one: one.place):
            self._insert(mover, seen, side)
            if side == RIGHT:
                self._keep_lanes(mover, seen, (LEFT, RIGHT))
            self._side[mover.id] = side

    def _may_insert(self, one: _Shadow) -> bool:
        return not (one.side == RIGHT and self._mirror < 0 and self._has_a_rear_on_it(one.seen.lane))

    def _to_be_sorted(self, casts: Sequence[_Shadow], has: Sequence[_Shadow]) -> list[_Shadow]:
        """Shadows that are there already, further ahead on a lane than one that is inserted now: they must be inserted
        again after it, or they hide it."""
        first: dict[str, float] = {}  # place of the hindmost one that is inserted on each lane, now or after the step
        found: list[_Shadow] = []

        def note(one: _Shadow, lanes: Iterable[int]) -> None:
            for lane in (self._lane_beside(one.seen, by) for by in lanes):
                first[lane] = min(first.get(lane, math.inf), one.place)

        for one in casts:
            note(one, (NONE, RIGHT) if one.side == RIGHT else (one.side,))
        left = sorted(has, key=lambda one: one.place)
        for one in left if first else ():
            if one.place > first.get(self._lane_beside(one.seen, one.side), math.inf) and self._may_insert(one):
                found.append(one)
                note(one, (NONE, RIGHT) if one.side == RIGHT else (one.side,))
        return found

    def _lane_beside(self, seen: _Seen, left: int) -> str:
        return f"{edge_of(seen.lane)}_{index_of(seen.lane) + left}"

    def _wanted(self, mover: Mover, seen: _Seen) -> int:
        """The side of the lane that its body overlaps, or will soon overlap as it moves away from the middle.

        The rear of a slow vehicle, which may stand across, overlaps it until it comes to where the front was over the
        border last.
        """
        side, room = _towards(seen.lateral), self._room(mover, seen.lane)
        outwards = side * seen.speed if side * (seen.lateral - seen.speed * self._step) > -TOUCH else 0.0
        if abs(seen.lateral) + max(outwards, 0.0) * AHEAD <= room:
            if seen.over is None:
                return NONE
            side, place = seen.over
            vehicle = self._sumo.vehicle
            rear = vehicle.getLanePosition(mover.id) - vehicle.getLength(mover.id)
            if rear > place or vehicle.getSpeed(mover.id) > SLOW:
                return NONE
        return side if 0 <= index_of(seen.lane) + side < self._lane_number(edge_of(seen.lane)) else NONE

    def _is_before_a_front(self, mover: Mover, seen: _Seen, side: int) -> bool:
        """Whether the front of a vehicle on the lane on that side is beside it."""
        position = self._sumo.vehicle.getLanePosition
        front, length = position(mover.id), self._sumo.vehicle.getLength(mover.id)
        return any(front - length < position(name) <= front for name in self._on_lane(seen, side))

    def _lets_pass(self, mover: Mover, seen: _Seen, side: int) -> bool:
        """Whether a vehicle stands while another one, truly abreast on the lane on that side, can drive past it."""
        vehicle = self._sumo.vehicle
        others = self._on_lane(seen, side)
        if not others or vehicle.getSpeed(mover.id) >= STANDING:
            return False
        (x, y), course = vehicle.getPosition(mover.id), math.radians(90 - vehicle.getAngle(mover.id))
        place, length, half = vehicle.getLanePosition(mover.id), vehicle.getLength(mover.id), mover.width / 2
        cos, sin = math.cos(course), math.sin(course)
        ends = ((0.0, half), (0.0, -half), (length, half), (length, -half))
        corners = [(x - back * cos - left * sin, y - back * sin + left * cos) for back, left in ends]
        for name in others:
            if not place - ABREAST < vehicle.getLanePosition(name) <= place:
                continue
            (its_x, its_y), its_course = vehicle.getPosition(name), math.radians(90 - vehicle.getAngle(name))
            cos, sin = math.cos(its_course), math.sin(its_course)
            ahead = [(px - its_x) * cos + (py - its_y) * sin for px, py in corners]
            aside = [(py - its_y) * cos - (px - its_x) * sin for px, py in corners]
            is_abreast = min(ahead) < 0 < max(ahead) + vehicle.getLength(name)
            clear = vehicle.getWidth(name) / 2 + PASSING
            if is_abreast and (min(aside) > clear or max(aside) < -clear):
                return True
        return False

    def _keep_lanes(self, mover: Mover, seen: _Seen, lanes: Iterable[int]) -> None:
        """Vehicles beside it change no lanes in the coming step. lanes: on which they are, from its own to the left"""
        vehicle = self._sumo.vehicle
        front, length = vehicle.getLanePosition(mover.id), vehicle.getLength(mover.id)
        for lane in lanes:
            for name in self._on_lane(seen, lane):
                its = vehicle.getLanePosition(name)
                is_beside = its > front - length - NEARLY and its - vehicle.getLength(name) < front + NEARLY
                if is_beside and name != mover.id and name not in self._kept:
                    self._kept[name] = vehicle.getLaneChangeMode(name)
                    vehicle.setLaneChangeMode(name, NO_CHANGES)

    def _on_lane(self, seen: _Seen, left: int) -> Sequence[str]:
        """Vehicles on the lane that is so many lanes to the left of its own."""
        is_there = 0 <= index_of(seen.lane) + left < self._lane_number(edge_of(seen.lane))
        return self._sumo.lane.getLastStepVehicleIDs(self._lane_beside(seen, left)) if is_there else ()

    def _has_a_rear_on_it(self, lane: str) -> bool:
        """Whether the rear of a vehicle that has left the lane is still on it."""
        vehicle, lanes = self._sumo.vehicle, self._sumo.lane
        for onto, *_, via, _, _, length in lanes.getLinks(lane):
            for there, beyond in ((via, 0.0), (onto, length)):
                for name in lanes.getLastStepVehicleIDs(there) if there else ():
                    if beyond + vehicle.getLanePosition(name) < vehicle.getLength(name):
                        return True
        return False

    def _insert(self, mover: Mover, seen: _Seen, side: int) -> None:
        """Insert a vehicle anew, so that its shadow is on this side."""
        vehicle, types = self._sumo.vehicle, self._sumo.vehicletype
        edge, own = edge_of(seen.lane), index_of(seen.lane)
        position = vehicle.getLanePosition(mover.id)
        if side:
            types.setWidth(mover.kind, WIDER * self._width(seen.lane))
        if side == RIGHT:
            right = f"{edge}_{own - 1}"
            vehicle.moveTo(mover.id, right, position)
            vehicle.setLateralLanePosition(mover.id, seen.lateral + (self._width(seen.lane) + self._width(right)) / 2)
            self._widened.append(mover)
            return
        vehicle.moveTo(mover.id, f"{edge}_{own - 1 if own else 1}", position)
        vehicle.moveTo(mover.id, seen.lane, position)
        vehicle.setLateralLanePosition(mover.id, seen.lateral)
        types.setWidth(mover.kind, mover.width)

    def _room(self, mover: Mover, lane: str) -> float:
        """Lateral distance from the middle of its lane at which the body touches the border [m]."""
        return (self._width(lane) - mover.width) / 2

    def _width(self, lane: str) -> float:
        if lane not in self._widths:
            self._widths[lane] = self._sumo.lane.getWidth(lane)
        return self._widths[lane]

    def _lane_number(self, edge: str) -> int:
        if edge not in self._lanes:
            self._lanes[edge] = self._sumo.edge.getLaneNumber(edge)
        return self._lanes[edge]


def _towards(lateral: float) -> int:
    return RIGHT if lateral < 0 else LEFT  # as SUMO decides
