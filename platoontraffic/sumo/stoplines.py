"""State of the next stop line of members: signal, right of way, space to clear; and violations of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import CLOSED_BY, Signals
from platoontraffic.road.gap_acceptance import ACCELERATION, MARGIN, STANDING, TURNING_SPEED, Foe, may_cross, time_for
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.conflicts import (
    GAP_HORIZON,
    LINK_LENGTH,
    LINK_OPEN,
    LINK_STATE,
    LINK_VIA,
    MINOR,
    PRIORITY,
    RED,
    STOP,
    YELLOW,
    Conflicts,
)
from platoontraffic.vehicles.motion import scale
from platoontraffic.world import ground
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import Entry

LIGHT, RIGHT_OF_WAY, LANE_CHANGE, NO_ROOM = range(1, len(CLOSED_BY))

CHANGE_HEADWAY = 0.5  # time gap that a lane change leaves on the adjacent lane [s]
COMMITTED = 0.25  # share of a lane change after which it is not interrupted
EARLY_BRAKING = 2.0  # deceleration that sets how early the adjacent lane and the space beyond are checked [m/s2]
OVERRUN = 1.0  # distance beyond a stop line, for a car, up to which a vehicle may still stop there [m]
HELD_UP_AFTER = 3.0  # a vehicle that stands at an open line for longer is held up by something else [s]
QUEUE_SPEED = 3.0  # a slower vehicle, of a car's length, is part of a queue [m/s]
QUEUE_GAP, OWN_GAP = 2.5, 4.0  # between cars that stand in a queue; that a member of a car's length leaves [m]
REACTION, COMFORTABLE_BRAKING = 1.0, 4.5  # of SUMO's drivers: tau [s], decel [m/s2]


class Ego(NamedTuple):
    """The vehicle that a stop line is judged for."""

    id: str
    lane: str  # "" off the road
    speed: float  # [m/s]
    length: float  # [m]

    @property
    def checks_from(self) -> float:
        """Distance before a line at which it must know whether the line is open [m]."""
        return self.speed**2 / (2 * EARLY_BRAKING) + self.length


class LineState(NamedTuple):
    """A row of `Signals`."""

    distance: float
    open: bool
    minor: bool
    changing: bool
    reason: int


class Approach(NamedTuple):
    """A vehicle that crosses the path with priority; distances from its front bumper [m]."""

    id: str
    to_conflict: float
    to_exit: float  # of the conflict
    hurries: bool  # it may come sooner than by its speed


NO_LINE = LineState(np.inf, True, False, False, 0)


class StopLines:
    """Judges stop lines by the vehicles that SUMO has about them.

    SUMO reports whether links are open (getNextLinks) only for a vehicle that arrives at full speed, always as open for
    a turn that may wait inside the junction, and not at all inside one. So gaps are judged here.
    """

    def __init__(self, network: Network, sumo: Client) -> None:
        self._network, self._sumo = network, sumo
        self._conflicts: dict[Line, Conflicts] = {}
        # Vehicles that stand at an open line ("") or on a lane inside a junction: since when, and when last seen [s].
        self._standing: dict[tuple[str, str], tuple[float, float]] = {}
        self._adjacent: dict[Line, tuple[tuple[str, float], ...]] = {}  # lanes leading to the end of a change's target

    def signals(self, fleet: Fleet, roads: Mapping[str, tuple[str, str]]) -> Signals | None:
        """The next stop line of each member with a law that needs it; None if no law does.

        roads: edge and lane of each member
        """
        progress = fleet.progress
        front = progress.station + (fleet.model.length / 2 - fleet.model.axle)[progress.rows]
        asking = [
            (i, station)
            for i, station in zip(progress.rows.tolist(), front.tolist(), strict=True)
            if "signals" in fleet.members[i].law.needs
        ]
        if not asking:
            return None
        n = len(fleet)
        signals = Signals(np.full(n, np.inf), np.ones(n, bool), *np.zeros((2, n), bool), np.zeros(n, int))
        for i, station in asking:
            member, speed, length = fleet.members[i], float(fleet.motion.speed[i]), float(fleet.model.length[i])
            state = self._state(member, station, Ego(member.id, roads[member.id][1], speed, length))
            for values, value in zip(signals, state, strict=True):
                values[i] = value
        return signals

    def entries(self, fleet: Fleet, entered: Sequence[tuple[str, str, str]]) -> list[Entry]:
        """How members entered junctions; SUMO-driven ones are left out.

        entered: ids of members that entered one, the lane that each left, its lane inside
        """
        found, row = [], {m.id: i for i, m in enumerate(fleet.members)} if entered else {}
        for name, lane, via in entered:
            state = next((link[LINK_STATE] for link in self._sumo.lane.getLinks(lane) if link[LINK_VIA] == via), "")
            i = row.get(name)
            if i is None or fleet.native[i] or not state:
                continue
            lines = fleet.members[i].route.lines if fleet.members[i].route else ()
            line = next((line for line in lines if line.lane == lane and line.via[:1] == (via,)), None)
            ego = Ego(name, via, fleet.motion.speed[i], fleet.model.length[i])
            signal = _signal(state)
            has_gap = signal != ground.GIVES_WAY or line is None or self._may_enter(line, ego)
            found.append(Entry(i, lane, signal, has_gap))
        return found

    # ---- one vehicle's row

    def _state(self, member: Member, station: float, ego: Ego) -> LineState:
        """The line that the member must heed; its front bumper is at a station of its route [m].

        Of several lines ahead that is the first, unless it is open and has priority: then the first closed one.
        """
        passed, over = member.route.line_passed(station)
        if passed and (state := self._passed(passed, over, ego)):
            return state
        near = ego.checks_from
        ahead = [self._ahead(line, distance, ego) for line, distance in member.route.lines_ahead(station, near)]
        if not ahead:
            return NO_LINE
        first = ahead[0]
        return first if first.minor or not first.open else next((line for line in ahead if not line.open), first)

    def _passed(self, line: Line, over: float, ego: Ego) -> LineState | None:
        """State of the line just passed, if the vehicle can still stop: None if it cannot, or need not.

        It can midway in the junction, with its nose over the line, and before it is on the adjacent lane.

        over: distance driven beyond the line [m]
        """
        if len(line.via) > 1 and ego.lane == line.via[0]:
            inside = self._sumo.lane.getLength(ego.lane)
            left = inside - self._sumo.vehicle.getLanePosition(ego.id)
            is_open = self._may_cross(line, left, ego, across=line.across - inside)
            return LineState(left, is_open, False, False, RIGHT_OF_WAY)
        if line.state == CHANGING:
            left = COMMITTED * line.across - over
            if left > 0 and ego.lane != line.onto and not self._may_change(line, -over, ego):
                return LineState(left, False, False, False, LANE_CHANGE)
        elif ego.lane in line.via and self._link_state(line) not in PRIORITY:
            left = OVERRUN * scale(ego.length) - over
            if ego.speed**2 / (2 * EARLY_BRAKING) < left and not self._may_cross(line, -over, ego):
                return LineState(left, False, False, False, RIGHT_OF_WAY)
        return None

    def _ahead(self, line: Line, distance: float, ego: Ego) -> LineState:
        """State of a line ahead; the adjacent lane and the space beyond are checked only when it is near."""
        near = distance < ego.checks_from
        if line.state == CHANGING:
            is_open = not near or ego.lane == line.onto or self._may_change(line, distance, ego)
            return LineState(distance, is_open, False, False, LANE_CHANGE)
        state = self._link_state(line)
        minor, yellow = state in MINOR, state in YELLOW
        if state in RED + YELLOW:
            return LineState(distance, False, minor, yellow, LIGHT)
        is_open = state in PRIORITY or self._has_gap(line, state, distance, ego)
        if is_open and near and line.light and not self._is_cleared(line):
            return LineState(distance, False, False, False, RIGHT_OF_WAY)
        if is_open and near and not self._has_room(line, ego.length):
            return LineState(distance, False, False, False, NO_ROOM)
        return LineState(distance, is_open, minor, yellow, RIGHT_OF_WAY)

    def _link_state(self, line: Line) -> str:
        """State of the link beyond a line now, as SUMO writes it."""
        if not line.light:
            return line.state
        return self._sumo.trafficlight.getRedYellowGreenState(line.light)[line.index]

    # ---- lane changes

    def _may_change(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether there will be room on the adjacent lane, and no vehicle there will have to brake hard.

        Judged for the time when half of the member is over there: until then SUMO's drivers do not see it.
        """
        half = distance + line.across / 2
        time, top = time_for(half, ego.speed), max(ego.speed, TURNING_SPEED)
        later = min(math.sqrt(ego.speed**2 + 2 * ACCELERATION * half), top)
        for name, foe_to_end in self._on_adjacent(line):
            if name == ego.id:
                continue
            ahead, foe_speed = distance + line.to_end - foe_to_end, self._sumo.vehicle.getSpeed(name)
            if ahead >= 0:
                gap = ahead - self._sumo.vehicle.getLength(name)
                closing, rear_speed = max(ego.speed - foe_speed, 0.0), ego.speed
            else:
                gap = -ahead - ego.length - foe_speed * time + half
                closing, rear_speed = max(foe_speed - later, 0.0), foe_speed
            room = max(ego.length / 2, CHANGE_HEADWAY * rear_speed)
            if gap < room + closing * REACTION + closing**2 / (2 * COMFORTABLE_BRAKING):
                return False
        return True

    def _on_adjacent(self, line: Line) -> Iterator[tuple[str, float]]:
        """Vehicles on the adjacent lane and lanes that lead to it, and the distance of each to its end [m]."""
        lane = self._sumo.lane
        if line not in self._adjacent:
            reach = lane.getLength(line.onto) + GAP_HORIZON * lane.getMaxSpeed(line.onto)
            self._adjacent[line] = tuple(self._network.upstream(line.onto, reach))
        for name, beyond in self._adjacent[line]:
            for vehicle in lane.getLastStepVehicleIDs(name):
                yield vehicle, beyond + lane.getLength(name) - self._sumo.vehicle.getLanePosition(vehicle)

    # ---- junctions

    def _is_cleared(self, line: Line) -> bool:
        """Whether crossing vehicles that entered the junction before their light became red have left it."""
        lane = self._sumo.lane
        for name, (before, via) in self._conflicts_at(line).crossing.items():
            there = [foe for foe in lane.getLastStepVehicleIDs(name) if not self._held_up(foe, name)]
            if there and any(link[LINK_VIA] == via and link[LINK_STATE] in RED for link in lane.getLinks(before)):
                return False
        return True

    def _has_room(self, line: Line, length: float) -> bool:
        """Whether a vehicle can leave a junction with cross traffic before it stands behind the queue beyond it."""
        vehicle, lane = self._sumo.vehicle, self._sumo.lane
        onto = lane.getLastStepVehicleIDs(line.onto)  # the last one first
        size = scale(length)
        last = next((k for k, name in enumerate(onto) if vehicle.getSpeed(name) < QUEUE_SPEED * size), None)
        if last is None or not any(map(lane.getInternalFoes, line.via)):
            return True
        left = vehicle.getLanePosition(onto[last]) - vehicle.getLength(onto[last])
        before = [*onto[:last], *(name for via in line.via for name in lane.getLastStepVehicleIDs(via))]
        taken = sum(vehicle.getLength(name) + QUEUE_GAP * size for name in before)
        return left > taken + length + OWN_GAP * size

    def _conflicts_at(self, line: Line) -> Conflicts:
        if line not in self._conflicts:
            self._conflicts[line] = Conflicts.at(line, self._network, self._sumo)
        return self._conflicts[line]

    def _has_gap(self, line: Line, state: str, distance: float, ego: Ego) -> bool:
        """Whether a vehicle may pass a line at which it has to give way; far from the line it counts as allowed."""
        if distance >= self._conflicts_at(line).reach:
            return True
        is_open = self._may_cross(line, distance, ego)
        if state in STOP:
            links = self._sumo.vehicle.getNextLinks(ego.id)
            is_open &= bool(links) and links[0][LINK_OPEN]
        return is_open

    def _may_cross(self, line: Line, distance: float, ego: Ego, across: float | None = None) -> bool:
        """Whether there is a gap among all priority vehicles.

        distance: to the junction [m]
        across  : path from there that is in conflict [m]; default: all of the line's
        """
        across = line.across if across is None else across
        foes = [*self._coming(line, may_hurry=True), *self._inside(line)]
        return self._has_gap_among(foes, distance, distance + across, ego, MARGIN)

    def _may_enter(self, line: Line, ego: Ego) -> bool:
        """Whether there was a gap for a vehicle that has just entered: among vehicles outside, without margin."""
        return self._has_gap_among([*self._coming(line, may_hurry=False)], 0.0, line.across, ego, 0.0)

    def _has_gap_among(
        self, foes: Sequence[Approach], to_conflict: float, to_exit: float, ego: Ego, margin: float
    ) -> bool:
        length, speed = self._sumo.vehicle.getLength, self._sumo.vehicle.getSpeed
        return all(
            may_cross(
                Foe(to_conflict, to_exit, foe.to_conflict, foe.to_exit, speed(foe.id), length(foe.id), foe.hurries),
                ego.speed,
                ego.length,
                margin,
            )
            for foe in foes
        )

    def _coming(self, line: Line, *, may_hurry: bool) -> Iterator[Approach]:
        """Vehicles outside the junction that will cross the path with priority and are not stopped by a light."""
        conflicts = self._conflicts_at(line)
        vehicle, lane = self._sumo.vehicle, self._sumo.lane
        for name, beyond in conflicts.entering:
            for foe in lane.getLastStepVehicleIDs(name):
                to_line = beyond + lane.getLength(name) - vehicle.getLanePosition(foe)
                links = [link for link in vehicle.getNextLinks(foe)[:3] if link[LINK_VIA] in conflicts.inside]
                if links and links[0][LINK_STATE] not in RED:
                    hurries = may_hurry and self._hurries(foe, to_line, links[0][LINK_OPEN])
                    yield Approach(foe, to_line, to_line + max(links[0][LINK_LENGTH], line.across), hurries)

    def _inside(self, line: Line) -> Iterator[Approach]:
        """Vehicles inside the junction that will cross the path with priority."""
        lane = self._sumo.lane
        for name, waits in self._conflicts_at(line).inside.items():
            for foe in lane.getLastStepVehicleIDs(name):
                left = lane.getLength(name) - self._sumo.vehicle.getLanePosition(foe)
                yield Approach(foe, left if waits or self._held_up(foe, name) else 0.0, left, False)

    def _hurries(self, foe: str, to_line: float, is_open: bool) -> bool:
        """Whether a foe may come sooner than by its speed: one that drives, or that stands at a line just opened."""
        if self._sumo.vehicle.getSpeed(foe) >= STANDING:
            self._standing.pop((foe, ""), None)
            return is_open
        if not is_open or to_line > self._sumo.vehicle.getLength(foe):
            return False
        return not self._held_up(foe, "")

    def _held_up(self, foe: str, inside: str) -> bool:
        """Whether a foe stands too long where it might drive: at an open line ("") or on a lane inside a junction."""
        if self._sumo.vehicle.getSpeed(foe) >= STANDING:
            self._standing.pop((foe, inside), None)
            return False
        time = self._sumo.simulation.getTime()
        since, last = self._standing.get((foe, inside), (time, time))
        since = since if time - last < HELD_UP_AFTER else time
        self._standing[foe, inside] = since, time
        return time - since > HELD_UP_AFTER


def _signal(state: str) -> str:
    """The signal of a link, from SUMO's letter."""
    if state in RED:
        return ground.RED
    if state in YELLOW:
        return ground.YELLOW
    return ground.PRIORITY if state in PRIORITY else ground.GIVES_WAY
