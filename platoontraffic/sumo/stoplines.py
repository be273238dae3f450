"""State of the next stop line of members: signal, right of way, space to clear; and violations of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import BRAKES_FOR, CLOSED_BY, Law, Signals
from platoontraffic.controllers.lane_room import room_needed
from platoontraffic.road.gap_acceptance import STANDING, Foe, Pace, margin_after, may_cross
from platoontraffic.road.lane_routes import CHANGE_AFTER, CHANGING, Line
from platoontraffic.road.later_change import with_later_change
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.conflicts import (
    ALL_STOP,
    EQUAL,
    GAP_HORIZON,
    LINK_OPEN,
    LINK_STATE,
    LINK_VIA,
    MINOR,
    PRIORITY,
    RED,
    STOP,
    YELLOW,
    ZIPPER,
    Conflicts,
    Crossing,
)
from platoontraffic.sumo.reads import Once, Reads
from platoontraffic.vehicles.motion import scale
from platoontraffic.world import ground
from platoontraffic.world.fleet import WINDOW, Fleet, Member
from platoontraffic.world.ground import Entry

BRAKES_FOR_LINE = BRAKES_FOR.index("line")
LIGHT, RIGHT_OF_WAY, LANE_CHANGE, NO_ROOM, STOP_SIGN, PEOPLE = range(1, len(CLOSED_BY))

CHANGING_PACE = 1.5, 6.0  # acceleration of a slow vehicle that changes lanes [m/s2], up to [m/s]
COMMITTED = 0.25  # share of a lane change after which it is not interrupted
EARLY_BRAKING = 2.0  # deceleration that sets how early the adjacent lane and the space beyond are checked [m/s2]
OVERRUN = 1.0  # distance beyond a stop line, for a car, up to which a vehicle may still stop there [m]
HELD_UP_AFTER = 3.0  # a vehicle that stands at an open line for longer is held up by something else [s]
SETS_OUT_AFTER = 1.5  # a vehicle whose turn it is at an all-way stop sets out within this time [s]
NEXT_IN_TURN = 2.0  # a vehicle waits so much longer for each one that should go before it, and does not [s]
SWINGS_OUT_AFTER = 5.0  # time at a stand after which its front swings over the paths of others all the same [s]
AT_LINE = 4.0  # distance from a line, for a car, at which a vehicle that stands stands at it [m]
AT_ONCE = 0.9  # distance of a closed line, for a car, that a slow vehicle stops before at once [m]
BEHIND = 0.5  # distance behind another one on its lane from which a slow vehicle may go over, for a car [m]
PASSES_BY = 2.0  # a vehicle that is so much faster passes, and leaves room then [m/s]
CHANGE_TIME = 3.0  # that a lane change takes, at the speed at which there was no room for it [s]
LOOKS_EVERY = 1.0  # without room for its lane change, a vehicle looks for it so much later [s]
QUEUE_SPEED = 3.0  # a slower vehicle, of a car's length, is part of a queue [m/s]
QUEUE_STANDS = 1.0  # below this speed a queue leaves no room for a lane change, for a car [m/s]
QUEUE_PATIENCE = 20.0  # time that a lane change waits at a stand for a queue to leave [s]
QUEUE_GAP, OWN_GAP = 2.5, 4.0  # between cars that stand in a queue; that a member of a car's length leaves [m]
STARTING = 0.4  # from the decision to set out until the vehicle accelerates: a scan and the lag of the drive [s]
SOONER, LATER = 0.7, 1.3  # a vehicle may come to people, and be past them, by these shares of the expected times
WALKING = 0.3  # speed below which a person on a crossing stands [m/s]


class Ego(NamedTuple):
    """The vehicle that a stop line is judged for."""

    id: str
    lane: str  # "" off the road
    speed: float  # [m/s]
    length: float  # [m]
    acceleration: float = 1.5  # of its law in comfort [m/s2]
    lateral: float = 2.0  # greatest lateral acceleration of its law [m/s2]

    @classmethod
    def of(cls, member: Member) -> Ego:
        """A member at rest, off the road.

        raises: nothing; a law that does not name its gains counts as a timid one
        """
        law = member.law
        gains = [_gain(one, "acceleration", cls._field_defaults["acceleration"]) for one in _drivers(law)]
        lateral = [_gain(one, "lateral_acceleration", cls._field_defaults["lateral"]) for one in _drivers(law)]
        return cls(member.id, "", 0.0, float(member.model.length), min(gains), min(lateral))

    @property
    def size(self) -> float:
        """Factor for distances."""
        return scale(self.length)

    @property
    def checks_from(self) -> float:
        """Distance before a line at which it must know whether the line is open [m]."""
        return self.speed**2 / (2 * EARLY_BRAKING) + self.length

    def pace(self, conflicts: Conflicts, limit: float) -> Pace:
        """How it drives through a junction with a speed limit [m/s]."""
        bend = math.sqrt(self.lateral / max(conflicts.curvature, 1e-6))
        return Pace(self.speed, self.acceleration, min(bend, limit), STARTING)


def _drivers(law: Law) -> list[object]:
    """A law, and the one that drives in its place where it has no predecessor."""
    return [law, *([law.alone] if hasattr(law, "alone") else [])]


def _gain(law: object, name: str, default: float) -> float:
    value = getattr(law, name, default)
    return float(value) if isinstance(value, (int, float)) and value > 0 else default


class LineState(NamedTuple):
    """A row of `Signals`."""

    distance: float
    open: bool
    minor: bool
    changing: bool
    reason: int


class Approach(NamedTuple):
    """A vehicle whose path crosses the own one; distances from its front bumper [m]."""

    id: str
    crossing: Crossing
    to_line: float  # negative inside the junction
    pace: Pace


NO_LINE = LineState(np.inf, True, False, False, 0)


class StopLines:
    """Judges stop lines by the vehicles that SUMO has about them.

    SUMO reports whether links are open (getNextLinks) only for a vehicle that arrives at full speed, always as open for
    a turn that may wait inside the junction, and not at all inside one. So gaps are judged here.
    """

    def __init__(self, network: Network, sumo: Client) -> None:
        self._network, self._sumo = network, sumo
        self._now = Reads(sumo)
        self._conflicts = Once(lambda line: Conflicts.at(line, network, sumo))
        self._at_junction = Once(lambda line: line._replace(station=0.0))  # one for all routes over it
        # By line, at this instant: those outside the junction, the same as they come, and those inside with priority.
        self._outside = Once(self._foes_outside)
        self._patiently = Once(lambda line: [*self._approaching(line)])
        self._first_inside = Once(lambda line: [*self._inside(line, first=True)])
        # Vehicles that stand at an open line ("") or on a lane inside a junction: since when, and when last seen [s].
        self._standing: dict[tuple[str, str], tuple[float, float]] = {}
        self._adjacent: dict[Line, tuple[tuple[str, float], ...]] = {}  # lanes leading to the end of a change's target
        self._fleet: tuple[Member, ...] = ()  # at the last look
        self._members: frozenset[str] = frozenset()  # their ids
        self._asking: list[tuple[int, int, Ego]] = []  # those whose law needs signals: row in `progress`, in the fleet
        self._stood: dict[str, tuple[str, float]] = {}  # the line's lane at which each has stood, and since when [s]
        self._still: dict[tuple[str, str], float] = {}  # since when nothing moves at the line at which one waits [s]
        self._beside: set[str] = set()  # members that wait beside another vehicle, to go over to their lane
        # The lane change that each member cannot begin now, and whether the vehicles in its way pass it soon.
        self._blocked_changes: dict[str, tuple[Line, bool]] = {}
        # Of each member without room for its lane change, begun or not: the lane on which it wants room, and how far
        # behind its front a vehicle there must stand to leave it [m].
        self.room_wanted: dict[str, tuple[str, float]] = {}
        self._later: dict[tuple[Route, Line, float, float], Route | None] = {}  # with a later or shorter lane change

    def renew(self) -> None:
        """Ask SUMO anew: it has made a step since, and all vehicles are elsewhere."""
        self._now.renew()
        for foes in (self._outside, self._patiently, self._first_inside):
            foes.clear()

    def signals(self, fleet: Fleet, roads: Mapping[str, tuple[str, str]]) -> Signals | None:
        """The next stop line of each member with a law that needs it; None if no law does.

        roads: edge and lane of each member
        """
        progress, members = fleet.progress, fleet.members
        if members is not self._fleet:
            self._fleet, self._members = members, frozenset(fleet.ids)
            rows = enumerate(progress.rows.tolist())
            self._asking = [(k, i, Ego.of(members[i])) for k, i in rows if "signals" in members[i].law.needs]
            self._no_lines = Signals(*(np.full(len(fleet), value) for value in NO_LINE))
        if not self._asking:
            return None
        self.renew()
        front = (progress.station + (fleet.model.length / 2 - fleet.model.axle)[progress.rows]).tolist()
        speed, signals = fleet.motion.speed.tolist(), Signals(*(values.copy() for values in self._no_lines))
        self._blocked_changes.clear()
        self.room_wanted.clear()
        for k, i, (name, _, _, *own) in self._asking:
            state = self._state(members[i], front[k], Ego(name, roads[name][1], speed[i], *own))
            if state is not NO_LINE:
                for values, value in zip(signals, state, strict=True):
                    values[i] = value
        return signals

    def with_later_changes(self, fleet: Fleet) -> Fleet:
        """The fleet with other routes for members that brake because there is no room for their lane change here.

        They look for it further on, as long as their lane leads on, but not beside a queue. The slower they are, the
        less road their lane change takes.
        """
        for group in fleet.groups if self._blocked_changes else ():
            limit = group.law.braking_for(group.memory) if group.memory is not None else None
            rows = group.rows[limit.reason == BRAKES_FOR_LINE] if limit else ()
            for member, row in ((fleet.members[i], int(i)) for i in rows if fleet.ids[i] in self._blocked_changes):
                (change, passed), speed = self._blocked_changes[member.id], float(fleet.motion.speed[row])
                width = self._sumo.lane.getWidth(change.lane)
                step = CHANGE_AFTER * width
                by = step * max(math.ceil(LOOKS_EVERY * speed / step), 1) if passed else 0.0
                longest = width * math.ceil(CHANGE_TIME * speed / width)
                key = member.route, change, by, longest
                if key not in self._later:
                    self._later[key] = with_later_change(*key[:3], self._network, member.model, longest)
                if route := self._later[key]:
                    fleet = fleet.with_route(row, route, WINDOW)
        return fleet

    def entries(self, fleet: Fleet, entered: Sequence[tuple[str, str, str]]) -> list[Entry]:
        """How members entered junctions; SUMO-driven ones are left out.

        SUMO takes a member beside the middle of its lane for one on another lane inside, of those that begin there.
        What counts is the one of its route.

        entered: ids of members that entered one, the lane that each left, its lane inside
        """
        if not entered:
            return []
        self.renew()
        found, row = [], {m.id: i for i, m in enumerate(fleet.members)}
        for name, lane, via in entered:
            i = row.get(name)
            if i is None or fleet.native[i]:
                continue
            lines = fleet.members[i].route.lines if fleet.members[i].route else ()
            from_here = [line for line in lines if line.lane == lane and line.via]
            line = next((line for line in from_here if line.via[0] == via), from_here[0] if from_here else None)
            via = line.via[0] if line else via
            state = next((link[LINK_STATE] for link in self._now.links[lane] if link[LINK_VIA] == via), "")
            if not state:
                continue
            ego = Ego.of(fleet.members[i])._replace(lane=via, speed=float(fleet.motion.speed[i]))
            signal = _signal(state)
            has_gap = signal != ground.GIVES_WAY or line is None or self._may_enter(self._at_junction[line], state, ego)
            found.append(Entry(i, lane, signal, has_gap))
        return found

    # ---- one vehicle's row

    def _state(self, member: Member, station: float, ego: Ego) -> LineState:
        """The line that the member must heed; its front bumper is at a station of its route [m].

        Of several lines ahead that is the first, unless it is open and has priority: then the first closed one.
        """
        checks_from = ego.checks_from
        passed, over, lines = member.route.lines_about(station, checks_from)
        if passed and passed.via and passed.state != CHANGING and ego.lane[:1] == ":" and ego.lane not in passed.via:
            ego = self._on_its_route(passed, over, ego)
        may_stop = passed and (ego.lane in passed.via or passed.state == CHANGING)
        if may_stop and (state := self._passed(self._at_junction[passed], over, ego)):
            return state
        if not lines:
            return NO_LINE
        if self._is_beside(lines[0][0], ego):
            return LineState(AT_ONCE * ego.size, False, False, False, LANE_CHANGE)
        ahead = [self._ahead(line, distance, distance < checks_from, ego) for line, distance in lines]
        first = ahead[0]
        if first.open and not first.minor:
            for line in ahead:
                if not line.open:
                    return line
        return first

    def _on_its_route(self, line: Line, over: float, ego: Ego) -> Ego:
        """The vehicle on the first lane of its route inside a junction, where SUMO takes it to be on one beside that.

        Lanes that begin at the same line lie side by side at first.
        """
        beside = any(link[LINK_VIA] == ego.lane for link in self._now.links[line.lane])
        is_there = beside and over < self._now.lane_length[line.via[0]]
        return ego._replace(lane=line.via[0]) if is_there else ego

    def _passed(self, line: Line, over: float, ego: Ego) -> LineState | None:
        """State of the line just passed, if the vehicle can still stop: None if it cannot, or need not.

        It can midway in the junction, with its nose over the line, and before it is on the adjacent lane.

        line: the vehicle is on one of its lanes, or it is a lane change
        over: distance driven beyond the line [m]
        """
        if len(line.via) > 1 and ego.lane == line.via[0]:
            inside = self._now.lane_length[ego.lane]
            driven = self._now.position[ego.id]
            is_open = self._may_cross(line, -driven, ego, midway=True)
            return LineState(inside - driven, is_open, False, False, RIGHT_OF_WAY)
        if line.state == CHANGING:
            before = self._may_change(line, -over, ego)
            if before < np.inf and ego.lane != line.onto:  # the less it has gone over, the better others pass it
                soon = ego.speed**2 / (2 * EARLY_BRAKING) + AT_ONCE * ego.size
                return LineState(min(before, soon), False, False, False, LANE_CHANGE)
        elif ego.lane in line.via and (state := self._link_state(line)) not in PRIORITY:
            left = OVERRUN * ego.size - over
            if ego.speed**2 / (2 * EARLY_BRAKING) < left and not self._has_way(line, state, -over, ego):
                return LineState(left, False, False, False, RIGHT_OF_WAY)
        return None

    def _ahead(self, line: Line, distance: float, near: bool, ego: Ego) -> LineState:
        """State of a line ahead; the adjacent lane and the space beyond are checked only when it is near."""
        if line.state == CHANGING:
            is_open = not near or ego.lane == line.onto or self._may_change(line, distance, ego) == np.inf
            if not is_open:
                self._blocked_changes[ego.id] = line, self._is_passed_soon(line, distance, ego)
            return LineState(distance, is_open, False, False, LANE_CHANGE)
        line = self._at_junction[line]
        state, conflicts = self._link_state(line), self._conflicts[line]
        minor = state in STOP or (state in MINOR and bool(conflicts.entering))
        yellow = state in YELLOW
        if state in RED + YELLOW:
            return LineState(distance, False, minor, yellow, LIGHT)
        if distance >= conflicts.reach and not (state in STOP and near):
            return LineState(distance, True, minor, yellow, RIGHT_OF_WAY)
        if state in STOP and not self._has_stood(line, distance, ego):
            return LineState(distance, False, minor, yellow, STOP_SIGN)
        if state not in PRIORITY and not self._has_way(line, state, distance, ego):
            return LineState(distance, False, minor, yellow, RIGHT_OF_WAY)
        if state in PRIORITY and near and conflicts.swings and not self._may_cross(line, distance, ego):
            return LineState(distance, False, minor, yellow, RIGHT_OF_WAY)
        if not self._is_free_of_people(line, distance, ego):
            return LineState(distance, False, minor, yellow, PEOPLE)
        if near and line.light and not self._is_cleared(line):
            return LineState(distance, False, False, False, RIGHT_OF_WAY)
        if near and not self._has_room(line, ego):
            return LineState(distance, False, False, False, NO_ROOM)
        if near and len(line.via) > 1 and not self._may_cross(line, distance, ego, midway=True):
            return LineState(distance + conflicts.waits, False, False, yellow, RIGHT_OF_WAY)  # so slow that it can wait
        return LineState(distance, True, minor, yellow, RIGHT_OF_WAY)

    def _link_state(self, line: Line) -> str:
        """State of the link beyond a line now, as SUMO writes it; but equal where the network gives nobody priority."""
        if not line.light:
            return EQUAL[0] if self._conflicts[line].unregulated else line.state
        return self._now.lights[line.light][line.index]

    # ---- lane changes

    def _may_change(self, line: Line, distance: float, ego: Ego) -> float:
        """Distance at which a vehicle must stop because there is no room on a lane that it crosses or changes to [m].

        distance : to the begin of the lane change; negative: it has begun [m]
        returns  : to where it still is on the lane before; inf: there is room, or it is on all those lanes already

        A queue ahead leaves no room to begin: it would stand across both lanes. It is waited for, but not for ever.
        """
        crossed = _crossed(line)
        share = line.across / len(crossed)
        patient = self._now.waited[ego.id] < QUEUE_PATIENCE
        queue = distance >= 0 and patient and self._queue_within(line, distance, ego)
        for k, one in enumerate(crossed):
            stop = distance + (k + COMMITTED) * share
            half = distance + (k + 0.5) * share
            if stop > 0 and (queue or not self._is_room(one, distance, half, ego)):
                self.room_wanted[ego.id] = one.onto, ego.length + room_needed(ego.length, 0.0, 0.0) - half
                return stop
        return np.inf

    def _is_beside(self, line: Line, ego: Ego) -> bool:
        """Whether a slow vehicle that is not yet on its lane has another one there with its rear beside the own front.

        The other one came in between, and does not see what is behind its own front. A member does not see what is
        beside it either; of two that go over to each other's lanes one waits.

        line: the next one of the route: it begins on the lane on which the vehicle should be
        """
        if self._beside:
            self._beside.discard(ego.id)
        if ego.lane == line.lane or ego.speed >= QUEUE_SPEED * ego.size:
            return False
        if ego.lane.rpartition("_")[0] != line.lane.rpartition("_")[0]:
            return False
        now, here = self._now, self._now.position[ego.id]
        for place, before in ((line.lane, 0.0), *((via, now.lane_length[line.lane]) for via in line.via[:1])):
            for name in now.on_lane[place]:
                front = before + now.position[name]
                yields = name not in self._members or name in self._beside
                begin = here if yields else here - ego.length
                if begin < front < here + now.length[name] + BEHIND * ego.size:
                    self._beside.add(ego.id)
                    return True
        return False

    def _is_passed_soon(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether all vehicles that leave no room for a lane change here are faster, and none of them is in a queue."""
        if self._queue_within(line, distance, ego):
            return False
        crossed = _crossed(line)
        for k, one in enumerate(crossed):
            for name in self._blocking(one, distance, distance + (k + 0.5) * line.across / len(crossed), ego):
                if self._now.speed[name] < ego.speed + PASSES_BY:
                    return False
        return True

    def _is_room(self, line: Line, distance: float, half: float, ego: Ego) -> bool:
        """Whether there will be room on one lane, and no vehicle there will have to brake hard; as `_blocking`."""
        return next(self._blocking(line, distance, half, ego), None) is None

    def _blocking(self, line: Line, distance: float, half: float, ego: Ego) -> Iterator[str]:
        """Vehicles on one lane that leave no room, or would have to brake hard.

        half : distance after which half of the member is over there: until then SUMO's drivers do not see it [m]
        """
        pace = Pace(ego.speed, *CHANGING_PACE)
        time = pace.time_for(half)
        later = pace.speed_after(time)
        for name, foe_to_end in self._on_adjacent(line, distance + line.to_end):
            if name == ego.id:
                continue
            ahead, foe_speed = distance + line.to_end - foe_to_end, self._now.speed[name]
            if ahead >= 0:
                gap = ahead - self._now.length[name]
                closing, rear_speed = max(ego.speed - foe_speed, 0.0), ego.speed
            else:
                gap = -ahead - ego.length - foe_speed * time + half
                closing, rear_speed = max(foe_speed - later, 0.0), foe_speed
            if gap < room_needed(ego.length, rear_speed, closing):
                yield name

    def _queue_within(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle stands on one of the two lanes before the end of the lane change."""
        now = self._now
        here = now.lane_length[line.lane] - line.to_end - distance  # position of the own front bumper
        end, stands = here + distance + line.across + OWN_GAP * ego.size, QUEUE_STANDS * ego.size
        for name in (*now.on_lane[line.lane], *now.on_lane[line.onto]):
            if name != ego.id and now.speed[name] < stands:
                position = now.position[name]
                if position > here and position - now.length[name] < end:
                    return True
        return False

    def _on_adjacent(self, line: Line, own_to_end: float) -> Iterator[tuple[str, float]]:
        """Vehicles on the adjacent lane and lanes that lead to it, and the distance of each to its end [m].

        Of those behind only the first one on each lane, and on lanes that lead there only if there is none: the others
        follow it.

        own_to_end: distance of the own front bumper to the end of the adjacent lane [m]
        """
        now = self._now
        if line not in self._adjacent:
            reach = now.lane_length[line.onto] + GAP_HORIZON * now.max_speed[line.onto]
            self._adjacent[line] = tuple(self._network.upstream(line.onto, reach))
        for name, beyond in self._adjacent[line]:
            to_ends = beyond + now.lane_length[name]
            for vehicle in reversed(now.on_lane[name]):
                to_end = to_ends - now.position[vehicle]
                yield vehicle, to_end
                if to_end > own_to_end:
                    if name == line.onto:
                        return
                    break

    # ---- junctions

    def _is_cleared(self, line: Line) -> bool:
        """Whether crossing vehicles that entered the junction before their light became red have left it."""
        for crossing in self._conflicts[line].crossings.values():
            there = [one for one in self._on(crossing) if not self._is_past(one) and not self._held_up(one.id, "in")]
            via = crossing.via[0]
            if there and any(
                link[LINK_VIA] == via and link[LINK_STATE] in RED for link in self._now.links[crossing.before]
            ):
                return False
        return True

    def _has_room(self, line: Line, ego: Ego) -> bool:
        """Whether a vehicle can leave a junction with cross traffic before it stands behind the queue beyond it.

        Where it may wait midway, there must be room for it: no other vehicle stands there. To SUMO it may be there
        itself, a little over the line.
        """
        now, length, size = self._now, ego.length, ego.size
        inside = [[name for name in now.on_lane[via] if name != ego.id] for via in line.via]
        for name in inside[0] if len(inside) > 1 else ():
            behind = now.position[name] - now.length[name]
            if now.speed[name] < STANDING and behind < length:
                return False
        onto = now.on_lane[line.onto]  # the last one first
        last = next((k for k, name in enumerate(onto) if now.speed[name] < QUEUE_SPEED * size), None)
        if last is None or not any(map(self._sumo.lane.getInternalFoes, line.via)):
            return True
        left = now.position[onto[last]] - now.length[onto[last]]
        before = [*onto[:last], *chain.from_iterable(inside)]
        taken = sum(now.length[name] + QUEUE_GAP * size for name in before)
        return left > taken + length + OWN_GAP * size

    def _is_free_of_people(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether nobody on a pedestrian crossing stands where the vehicle drives, or will be there when it comes."""
        conflicts = self._conflicts[line]
        for walk in conflicts.walks:
            if distance + walk.own[1] + ego.length < 0:
                continue
            pace = self._pace(line, ego)
            comes = SOONER * pace.time_for(distance + walk.own[0])
            gone = LATER * pace.time_for(distance + walk.own[1] + ego.length)
            for name in self._now.people[walk.edge]:
                person = self._sumo.person
                here, speed = np.array(person.getPosition(name)[:2]), person.getSpeed(name)
                course = math.radians(90 - person.getAngle(name))
                walks = speed * np.array([math.cos(course), math.sin(course)])
                start, end = (here + comes * walks, here + gone * walks) if speed > WALKING else (here, here)
                if _distance(walk.points, start, end) < walk.apart:
                    return False
        return True

    def _pace(self, line: Line, ego: Ego) -> Pace:
        limit = max(map(self._now.max_speed.__getitem__, line.via), default=ego.speed)
        return ego.pace(self._conflicts[line], limit)

    # ---- right of way

    def _has_way(self, line: Line, state: str, distance: float, ego: Ego) -> bool:
        """Whether a vehicle may pass a line at which it has to give way."""
        if state in ALL_STOP:
            return self._is_its_turn(line, distance, ego)
        return self._may_cross(line, distance, ego, state=state)

    def _may_cross(self, line: Line, distance: float, ego: Ego, *, midway: bool = False, state: str = "m") -> bool:
        """Whether there is a gap among all priority vehicles.

        distance: to the junction [m]
        midway  : judged for what is met after the place where it may wait midway; else for what is met before it
        """
        foes = [*self._coming(line, ego, state), *self._first_inside[line]]
        if state in ZIPPER:  # the nearer one goes first, and one that stands inside may set out at any time
            foes = [foe for foe in foes if (foe.to_line, foe.crossing.before) < (distance, line.lane)]
            foes = [foe if foe.to_line > 0 else self._setting_out(foe) for foe in foes]
        if self._conflicts[line].swings and self._now.waited[ego.id] >= SWINGS_OUT_AFTER:
            foes = [foe for foe in foes if not foe.crossing.swings]
        margin = margin_after(self._waited(ego))
        enters = distance + self._conflicts[line].waits if midway else distance
        return self._has_gap_among(self._met(line, foes, distance, midway), line, distance, ego, margin, enters)

    def _setting_out(self, foe: Approach) -> Approach:
        """A vehicle inside the junction, as it drives if it sets out now."""
        pace = Pace(foe.pace.speed, self._now.acceleration[foe.id], foe.crossing.fastest)
        return foe._replace(pace=pace)

    def _met(self, line: Line, foes: Sequence[Approach], distance: float, midway: bool) -> list[Approach]:
        """The foes that are met after, or before, the place where the vehicle may wait midway."""
        waits = self._conflicts[line].waits
        if midway:  # where it is already in another one's way, it cannot wait; one that passes before its front it can
            begins = ((foe, foe.crossing.own[0], foe.crossing.touches) for foe in foes)
            return [foe for foe, own, touches in begins if own + distance > 0 or 0 < touches + distance < math.inf]
        return [foe for foe in foes if foe.crossing.own[0] < waits]

    def _may_enter(self, line: Line, state: str, ego: Ego) -> bool:
        """Whether there was a gap for a vehicle that has just entered: among vehicles outside, without margin.

        At an all-way stop: whether nobody who had stood for longer was driving already; a slower one set out later.
        """
        if state in ZIPPER:
            return True
        if state in ALL_STOP:
            return not any(self._departs(foe, ego) and foe.pace.speed > ego.speed for foe in self._at_lines(line))
        coming = (foe for foe in self._coming(line, ego, state) if not foe.crossing.swings)
        foes = [foe._replace(pace=Pace(foe.pace.speed)) for foe in coming]
        return self._has_gap_among(self._met(line, foes, 0.0, midway=False), line, 0.0, ego, 0.0, 0.0)

    def _has_gap_among(
        self, foes: Sequence[Approach], line: Line, distance: float, ego: Ego, margin: float, enters: float
    ) -> bool:
        """distance, enters: from the front bumper to the line, and to the line or where it waits midway [m]"""
        pace = self._pace(line, ego)
        for one in foes:
            crossing = one.crossing
            foe = Foe(
                enters if enters > 0 else distance + crossing.own[0],
                distance + crossing.own[0],
                distance + crossing.own[1],
                one.to_line + crossing.its[0],
                one.to_line + crossing.its[1],
                one.pace,
                self._now.length[one.id],
                crossing.fastest,
                crossing.merges,
            )
            if not may_cross(foe, pace, ego.length, margin):
                return False
        return True

    def _coming(self, line: Line, ego: Ego, state: str) -> Iterable[Approach]:
        """Vehicles outside the junction that will cross the path with priority and are not stopped by a light."""
        return self._approaching(line, ego) if state in EQUAL else self._patiently[line]

    def _approaching(self, line: Line, ego: Ego | None = None) -> Iterator[Approach]:
        """The same as they come; ego: where nobody has priority."""
        for foe, hurrying, is_open in self._outside[line]:
            patience = HELD_UP_AFTER
            if ego and self._order(foe.id, foe.crossing.before) > self._order(ego.id, line.lane):
                patience = 0.0  # both stand, and it came later
            yield hurrying if self._hurries(foe.id, foe.to_line, is_open, patience) else foe

    def _foes_outside(self, line: Line) -> list[tuple[Approach, Approach, bool]]:
        """Those vehicles at their speed, and as they hurry, and whether the line ahead of each is open."""
        conflicts, now, found = self._conflicts[line], self._now, []
        for name, beyond in conflicts.entering:
            to_end = beyond + now.lane_length[name]
            for foe in now.on_lane[name]:
                links = now.next_links[foe][:3]
                via = next((link[LINK_VIA] for link in links if link[LINK_VIA] in conflicts.crossings), None)
                crossing = conflicts.crossings.get(via)
                if crossing is None or not crossing.first or links[0][LINK_STATE] in RED:
                    continue
                to_line, speed = to_end - now.position[foe], now.speed[foe]
                hurrying = Pace(speed, now.acceleration[foe], now.max_speed[name])
                approaches = (Approach(foe, crossing, to_line, pace) for pace in (Pace(speed), hurrying))
                found.append((*approaches, links[0][LINK_OPEN]))
        return found

    def _inside(self, line: Line, *, first: bool) -> Iterator[Approach]:
        """Vehicles inside the junction whose paths cross the own one.

        first: only those with priority
        """
        for crossing in self._conflicts[line].crossings.values():
            if crossing.first or not first:
                for one in self._on(crossing):
                    if not self._is_past(one) and not self._held_up(one.id, "in"):
                        yield one

    def _on(self, crossing: Crossing) -> Iterator[Approach]:
        """Vehicles inside the junction on a path; one that has left it with its nose only is on the next lane.

        Those that drive may accelerate.
        """
        now, driven = self._now, 0.0
        for via in crossing.via:
            for name in now.on_lane[via]:
                one = Approach(name, crossing, -driven - now.position[name], Pace(now.speed[name]))
                yield self._setting_out(one) if one.pace.speed >= STANDING else one
            driven += now.lane_length[via]

    def _is_past(self, one: Approach) -> bool:
        """Whether its rear has left the conflict area."""
        return one.to_line + one.crossing.its[1] + self._now.length[one.id] < 0

    def _hurries(self, foe: str, to_line: float, is_open: bool, patience: float = HELD_UP_AFTER) -> bool:
        """Whether a foe may come sooner than by its speed: one that drives, or that stands at a line just opened.

        Whether a line is open to a member SUMO does not know.
        """
        if self._now.speed[foe] >= STANDING:
            self._standing.pop((foe, ""), None)
            return True  # even if it brakes now: two that brake for each other would both count on that
        if not (is_open or foe in self._members) or to_line > self._now.length[foe]:
            return False
        return not self._held_up(foe, "", patience)

    def _held_up(self, foe: str, where: str, patience: float = HELD_UP_AFTER) -> bool:
        """Whether a foe stands too long where it might drive: at an open line ("") or inside a junction ("in")."""
        if self._now.speed[foe] >= STANDING:
            self._standing.pop((foe, where), None)
            return False
        time = self._sumo.simulation.getTime()
        since, last = self._standing.get((foe, where), (time, time))
        since = since if time - last < HELD_UP_AFTER else time
        self._standing[foe, where] = since, time
        return time - since > patience

    # ---- stop signs

    def _has_stood(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle has stood at this line; that is remembered until it has passed the line."""
        return distance < 0 or self._stood_since(ego.id, line.lane, distance, ego.length) is not None

    def _stood_since(self, name: str, lane: str, to_line: float, length: float) -> float | None:
        """Time since which a vehicle has been standing at its line, or has stood there [s]; None: it has not."""
        before, since = self._stood.get(name, ("", 0.0))
        if before == lane:
            return since
        if self._now.speed[name] >= STANDING or to_line > AT_LINE * scale(length):
            return None
        since = self._sumo.simulation.getTime() - self._now.waited[name]
        self._stood[name] = lane, since
        return since

    def _waited(self, ego: Ego) -> float:
        """Time since a vehicle first stood at its line [s]; 0 if it has not."""
        lane, since = self._stood.get(ego.id, ("", 0.0))
        return self._sumo.simulation.getTime() - since if lane == ego.lane else 0.0

    def _order(self, name: str, lane: str) -> tuple[float, str]:
        """Order in which vehicles that have stood at their lines go; of equal ones, by lane."""
        before, since = self._stood.get(name, ("", math.inf))
        return (since if before == lane else math.inf), lane

    def _at_lines(self, line: Line) -> Iterator[Approach]:
        """The first vehicle on each crossing lane, if it stands at its line or has stood there."""
        now, conflicts = self._now, self._conflicts[line]
        for before in sorted({crossing.before for crossing in conflicts.crossings.values()} - {line.lane}):
            names = now.on_lane[before]
            if not names:
                continue
            foe = names[-1]
            to_line = now.lane_length[before] - now.position[foe]
            links = now.next_links[foe][:1]
            crossing = conflicts.crossings.get(links[0][LINK_VIA]) if links else None
            if crossing and self._stood_since(foe, before, to_line, now.length[foe]) is not None:
                yield Approach(foe, crossing, to_line, Pace(now.speed[foe], now.acceleration[foe], crossing.fastest))

    def _departs(self, foe: Approach, ego: Ego) -> bool:
        """Whether a vehicle that has stood at its line sets out, before this one."""
        earlier = self._order(foe.id, foe.crossing.before) < self._stood.get(ego.id, ("", math.inf))[::-1]
        return earlier and foe.pace.speed >= STANDING

    def _is_its_turn(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle that has stood at an all-way stop may go: those that have stood longer are gone.

        The order of arrival is the same for all, so two vehicles never wait for each other. If one that should go does
        not, the next one goes after SETS_OUT_AFTER, the one after that NEXT_IN_TURN later.
        """
        own, time, key = self._order(ego.id, line.lane), self._sumo.simulation.getTime(), (ego.id, line.lane)
        inside = [*self._inside(line, first=False)]
        earlier, departs = [], False
        for foe in self._at_lines(line):
            if foe.pace.speed >= STANDING:  # it has begun to drive
                departs |= self._order(foe.id, foe.crossing.before) < own or distance >= 0
            elif self._order(foe.id, foe.crossing.before) < own:
                earlier.append(foe)
        still = self._still.setdefault(key, time)
        if departs or any(foe.pace.speed >= STANDING for foe in inside):
            still = self._still[key] = time
        if departs or not self._has_gap_among(inside, line, distance, ego, 0.0, distance):
            return False
        return time - still > SETS_OUT_AFTER + NEXT_IN_TURN * (len(earlier) - 1) if earlier else True


def _crossed(line: Line) -> list[Line]:
    """A lane change by each lane that it leads onto, in their order."""
    edge, _, first = line.lane.rpartition("_")
    here, there = int(first), int(line.onto.rpartition("_")[2])
    step = 1 if there > here else -1
    return [line._replace(onto=f"{edge}_{k}") for k in range(here + step, there + step, step)]


def _distance(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Least distance of points (k, 2) from the line from one place to another [m]."""
    along = end - start
    share = np.clip((points - start) @ along / max(float(along @ along), 1e-9), 0.0, 1.0)
    return float(np.hypot(*(points - start - share[:, None] * along).T).min())


def _signal(state: str) -> str:
    """The signal of a link, from SUMO's letter."""
    if state in RED:
        return ground.RED
    if state in YELLOW:
        return ground.YELLOW
    return ground.PRIORITY if state in PRIORITY else ground.GIVES_WAY
