"""State of the next stop line of members: signal, right of way, space to clear; and violations of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, takewhile

import numpy as np

from platoontraffic.controllers import CLOSED_BY, Signals
from platoontraffic.controllers.path_kernel import LOOK
from platoontraffic.road.gap_acceptance import STANDING
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.conflicts import (
    EQUAL,
    LINK_STATE,
    LINK_VIA,
    LONG,
    MINOR,
    PRIORITY,
    RED,
    STOP,
    YELLOW,
    Conflicts,
    Crossing,
    JudgedLine,
    Paths,
)
from platoontraffic.sumo.ego import AT_ONCE, EARLY_BRAKING, OVERRUN, Ego
from platoontraffic.sumo.far_lines import FarLines, LastLook, LineState
from platoontraffic.sumo.lane_choice import LaneChoice
from platoontraffic.sumo.later_changes import LaterChanges
from platoontraffic.sumo.letting_in import BRAKING, LettingIn
from platoontraffic.sumo.placement import BEFORE_END
from platoontraffic.sumo.reads import Once, Reads
from platoontraffic.sumo.right_of_way import QUEUE_GAP, RightOfWay
from platoontraffic.sumo.room_to_change import FREE_AHEAD, QUEUE_SPEED, Here, RoomToChange, Wanted
from platoontraffic.world import ground
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import Entry

LIGHT, RIGHT_OF_WAY, LANE_CHANGE, NO_ROOM, STOP_SIGN, PEOPLE, LETTING_IN = range(1, len(CLOSED_BY))

LOOKS_EVERY = 0.2  # period in which lines are judged [s], in whole steps
SETS_OUT = 1.0  # a vehicle faster than that [m/s], with `FREE_AHEAD` before it, is in no queue
SOONER, LATER = 0.7, 1.3  # a vehicle may come to people, and be past them, by these shares of the expected times
CHANGES_SOON = 4.0  # a red light that changes within this time lets vehicles come to whoever waits in their path [s]
WALKING = 0.3  # speed below which a person on a crossing stands [m/s]


NO_LINE = LineState(np.inf, True, False, False, 0)


class StopLines:
    """Judges stop lines by the vehicles that SUMO has about them."""

    def __init__(
        self, network: Network, sumo: Client, letting_in: LettingIn | None = None, step: float = LOOKS_EVERY
    ) -> None:
        """letting_in: None: nobody lets in; step: of SUMO's [s]"""
        self._network, self._sumo = network, sumo
        self._stops = letting_in.stops if letting_in else {}
        self._now = Reads(sumo)
        paths = Paths(sumo)
        self._conflicts = Once(lambda line: Conflicts.at(line, network, sumo, paths))
        # By line and kind of vehicle: one for all routes over it.
        self._judged = Once(lambda passed: JudgedLine.of(*passed, network))
        self._at_junction = Once(lambda passed: self._judged[passed[0]._replace(station=0.0), passed[1]])
        # Whether vehicles from elsewhere cross the path, by line.
        self._is_crossed = Once(lambda line: any(one.before != line.lane for one in self._conflicts[line].crossings))
        self._has_looked = False  # `signals` has asked SUMO since its last step
        self._way = RightOfWay(sumo, self._now, self._conflicts)
        self._change = RoomToChange(network, self._now, letting_in.waiting if letting_in else {})
        self._fleet: tuple[Member, ...] = ()  # at the last look
        self.heedless: frozenset[str] = frozenset()  # members whose law is given no lines
        self._asking: list[Ego] = []  # those whose law needs signals, at rest
        self._rows = self._rows_in_progress = np.empty(0, dtype=np.intp)  # of those, in the fleet and in `progress`
        self._slow = np.empty(0)  # speed of those below which they may be in a queue [m/s]
        self._far, self._last = FarLines(()), LastLook(0)  # of those
        self._step, self._every = step, max(round(LOOKS_EVERY / step), 1)  # from look to look [steps]
        # Members that stand with their front a little over a closed line, or on it, and how far over it [m].
        self.over_line: dict[str, float] = {}
        self._were_over_line: frozenset[str] = frozenset()  # at the last look
        self._later = LaterChanges(network, sumo, self._change)
        self._choice = LaneChoice(network, self._now, self._change)

    @property
    def room_wanted(self) -> Mapping[str, Wanted]:
        """`RoomToChange.wanted`."""
        return self._change.wanted

    @property
    def waiting_places(self) -> Mapping[str, float]:
        """`RightOfWay.stops`."""
        return self._way.stops

    def renew(self) -> None:
        """Ask SUMO anew: it has made a step since, and all vehicles are elsewhere."""
        self._now.renew()
        self._way.renew()

    def look_ahead(self, members: Sequence[Member]) -> None:
        """Find what the lines on members' routes are judged by, which lasts, before a member comes to one."""
        for member in members:
            if member.route and "signals" in member.law.needs:
                kind = Ego.of(member).kind
                for line in member.route.lines:
                    if line.state != CHANGING:
                        self._conflicts[self._at_junction[line, kind]]

    def signals(self, fleet: Fleet, lanes: Sequence[str]) -> Signals | None:
        """The next stop line of each member with a law that needs it; None if no law does.

        lanes: on which the members are, (n,); "" off the road
        """
        self._has_looked = False
        if fleet.members is not self._fleet:
            self._welcome(fleet)
            if not self._asking:
                self._begin_look()  # so that nothing is left of the last one
        if not self._asking:
            return None
        if looks := self._looks_now():
            self._begin_look()
        self.renew()
        self._has_looked = True
        if not looks:
            self._between_looks()
        rows, asking = self._rows, self._asking
        axle = fleet.progress.station[self._rows_in_progress]
        front = axle + (fleet.model.length / 2 - fleet.model.axle)[rows]
        speed = fleet.motion.speed[rows]
        if looks:
            own_lanes = [lanes[row] for row in rows.tolist()]
            is_far, state = self._far.still(front, speed, own_lanes)
            judged = ~is_far | self._far.by_light | (self._far.changes & (speed < self._slow))
            if self._stops:
                judged |= [ego.id in self._stops for ego in asking]
        else:
            judged, state = self._last.now(front)
            is_far = np.zeros(len(asking), bool)
        self._last.note(front, state)
        if (which := judged.nonzero()[0]).size:
            driven = front, axle, speed, fleet.motion.acceleration[rows], state.distance, is_far
            found = self._judge(fleet, lanes, which, (values[which].tolist() for values in driven))
            for values, column in zip(state, zip(*found, strict=True), strict=True):
                values[which] = column
        signals = Signals(*(values.copy() for values in self._no_lines))
        for values, column in zip(signals, state, strict=True):
            values[rows] = column
        if looks and self._choice.is_due(time := self._sumo.simulation.getTime()):
            drive = zip(asking, own_lanes, rows.tolist(), speed.tolist(), axle.tolist(), strict=True)
            egos = (
                ego.driving(lane, speed, 0.0, fleet.members[row].route, axle) for ego, lane, row, speed, axle in drive
            )
            self._choice.look(fleet, own_lanes, egos, time)
        return signals

    def _judge(
        self, fleet: Fleet, lanes: Sequence[str], which: np.ndarray, driven: Iterable[Sequence]
    ) -> Iterator[LineState]:
        """The lines of some of the members that ask, by their numbers among these, (m,).

        lanes : as of `signals`
        driven: stations of front bumper and driven axle [m], speed [m/s], acceleration [m/s2], distance of the next
                line [m], and whether that is far, as before, (m,) each
        """
        rows = self._rows[which]
        goes_round = fleet.goes_round[rows].tolist()
        for k, row, front, axle, speed, drive, distance, is_far, is_aside in zip(
            which.tolist(), rows.tolist(), *driven, goes_round, strict=True
        ):
            member, ego = fleet.members[row], self._asking[k]
            ego = ego.driving(lanes[row], speed, drive, member.route, axle)
            if is_aside:
                ego = ego._replace(top=member.route.limit_at(axle))
            if is_far:
                found = self._ahead(self._far.lines[k], distance, False, ego, member.route)
            else:
                found = self._state(member, front, ego, k)
            yield self._letting_in(found, ego) if ego.id in self._stops else found

    def _looks_now(self) -> bool:
        """Whether members look at their lines in this step."""
        return self._every == 1 or round(self._sumo.simulation.getTime() / self._step) % self._every == 0

    def _between_looks(self) -> None:
        """What was found at the last look has been done since; vehicles that are to stop have come nearer."""
        self._later.forget()
        self._choice.forget()
        self._way.follow_stops(self._step)

    def _begin_look(self) -> None:
        self._way.begin_look()
        self._were_over_line = frozenset(self.over_line)
        self.over_line.clear()
        self._later.forget()
        self._choice.forget()
        self._change.begin_look()

    def _welcome(self, fleet: Fleet) -> None:
        """The members have changed."""
        members, old = fleet.members, [self._fleet[row] for row in self._rows.tolist()]
        self._fleet = members
        self._way.members = self._change.members = frozenset(fleet.ids)
        # Most members are those of the last look, and share a few laws: what follows from these is found once.
        laws = {id(member.law): member.law for member in members}
        need = {key for key, law in laws.items() if "signals" in law.needs}
        asking = [(k, i) for k, i in enumerate(fleet.progress.rows.tolist()) if id(members[i].law) in need]
        self._rows_in_progress, self._rows = np.array(asking, dtype=np.intp).reshape(-1, 2).T
        known = {(id(m.law), id(m.model), m.id): ego for m, ego in zip(old, self._asking, strict=True)}
        asked = [members[i] for _, i in asking]
        self._asking = [known.get((id(m.law), id(m.model), m.id)) or Ego.of(m) for m in asked]
        self._slow = QUEUE_SPEED * np.array([ego.size for ego in self._asking])
        self.heedless = frozenset(fleet.ids).difference(ego.id for ego in self._asking)
        self._way.obedient = frozenset(member.id for member in asked if member.law.heeds_lines)
        self._no_lines = Signals(*(np.full(len(fleet), value) for value in NO_LINE))
        before = {member.id: (k, member.route) for k, member in enumerate(old)}
        had = ((k, *before.get(member.id, (0, None)), member.route) for k, member in enumerate(asked))
        far, self._far = self._far, FarLines(self._asking)
        stay = [(k, j) for k, j, route, now in had if route and route is now]
        self._far.take_over(far, stay)
        last, self._last = self._last, LastLook(len(asked))
        self._last.take_over(last, stay)

    def with_other_lanes(self, fleet: Fleet) -> Fleet:
        """The fleet with other routes for members whose lane changes are later or sooner, or that have found a better
        lane: see `LaterChanges`, `LaneChoice`."""
        if not self._asking:
            return fleet
        fleet = self._choice.given_up(fleet, self._later.blocked)
        return self._choice.chosen(self._later.put_off(fleet))

    def entries(self, fleet: Fleet, entered: Sequence[tuple[str, str, str]]) -> list[Entry]:
        """How members entered junctions; SUMO-driven ones are left out.

        SUMO takes a member beside the middle of its lane for one on another lane inside, of those that begin there.
        What counts is the one of its route.

        entered: ids of members that entered one, the lane that each left, its lane inside
        """
        if not entered:
            return []
        if not self._has_looked:
            self.renew()
        self._has_looked = False  # used up: another step may follow
        found, row = [], fleet.row_of
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
            signal, has_gap = _signal(state), True
            if signal == ground.GIVES_WAY and line:
                ego = self._entered(fleet, i)._replace(lane=via)
                has_gap = self._way.may_enter(self._at_junction[line, ego.kind], state, ego)
            found.append(Entry(i, lane, signal, has_gap))
        return found

    def _entered(self, fleet: Fleet, row: int) -> Ego:
        """The vehicle in a row as it drives on now."""
        member, motion, progress = fleet.members[row], fleet.motion, fleet.progress
        speed, drive = float(motion.speed[row]), float(motion.acceleration[row])
        ego = Ego.of(member)._replace(speed=speed, drive=drive)
        if member.is_given_its_route:
            ego = ego._replace(route=member.route, axle=float(progress.station[progress.rows == row][0]))
        return ego

    # ---- one vehicle's row

    def _letting_in(self, state: LineState, ego: Ego) -> LineState:
        """The line of a member that lets another one in: it stops where it leaves room, or at its own line before."""
        lane, place, speed = self._stops[ego.id]
        if lane != ego.lane:
            return state
        distance = place - self._now.position[ego.id]
        distance = ego.line_to_follow(speed, distance, BRAKING) if speed else max(distance, 0.0)
        return (
            LineState(distance, False, False, False, LETTING_IN) if state.open or distance < state.distance else state
        )

    def _state(self, member: Member, station: float, ego: Ego, k: int) -> LineState:
        """The line that the k-th member must heed; its front bumper is at a station of its route [m].

        Of several lines ahead that is the first, unless it is open and has priority: then the first closed one.
        """
        checks_from = ego.checks_from
        passed, over, lines = member.route.lines_about(station, checks_from)
        if passed and passed.state == CHANGING:
            passed, over = _not_made(passed, over, ego.lane, member.route)
        elif passed and passed.via and ego.lane[:1] == ":" and ego.lane not in passed.via:
            ego = self._on_its_route(passed, over, ego)
        # SUMO may have one that it was told to have before a closed line on a lane beside.
        before = ego.lane == passed.lane or ego.id in self._were_over_line if passed else False
        is_over = passed and (ego.lane in passed.via or (before and over < OVERRUN * ego.size))
        may_stop = is_over or (passed and passed.state == CHANGING)
        swings = bool(passed and passed.via and ego.kind in LONG) and self._way.note_swung_over(
            self._at_junction[passed, ego.kind], -over, ego
        )
        if may_stop:
            state = self._passed(self._at_junction[passed, ego.kind], over, ego)
            if passed.state == CHANGING and self._change.may_put_off(passed, over, ego, has_room=state is None):
                self._later.note(passed, -over, ego, member.route)
            if state and (not lines or state.distance <= lines[0][1]):
                return state
        if not lines:
            return NO_LINE
        changes = passed and passed.state == CHANGING
        if self._change.is_beside(lines[0][0], ego) or not (changes or self._change.may_go_over(lines[0][0], ego)):
            return LineState(AT_ONCE * ego.size, False, False, False, LANE_CHANGE)
        ahead = []
        for line, distance in lines:
            ahead.append(self._ahead(line, distance, distance < checks_from, ego, member.route))
            if line.state != CHANGING and not ahead[-1].open:  # what lies beyond does not count yet
                break
        first, (line, distance) = ahead[0], lines[0]
        has_changed = may_stop and ego.lane == passed.onto and over >= passed.across
        may_be_far = distance >= min(checks_from, LOOK * ego.length) and ego.lane == line.lane
        stays = line.state == CHANGING and not first.open  # only while it is slow
        if may_be_far and not swings and not stays and (has_changed or not may_stop) and not member.route.closed:
            judged = None if line.state == CHANGING else self._at_junction[line, ego.kind]
            gives_way = judged is not None and self._gives_way(judged, self._link_state(judged))
            begins = passed.station if passed else -math.inf
            self._far.note(k, ego, begins, line, first._replace(distance=distance), gives_way)
        if first.open and not first.minor:
            for line in ahead:
                if not line.open:
                    return line
        return first

    def _on_its_route(self, line: Line, over: float, ego: Ego) -> Ego:
        """The vehicle on the first lane of its route inside a junction, where SUMO takes it to be on one beside that.

        Lanes that begin at the end of the same edge lie side by side at first.
        """
        beside = edge_of(self._network.entered_from.get(ego.lane, "")) == edge_of(line.lane)
        is_there = beside and over < self._now.lane_length[line.via[0]]
        return ego._replace(lane=line.via[0]) if is_there else ego

    def _passed(self, line: Line, over: float, ego: Ego) -> LineState | None:
        """State of the line just passed, if the vehicle can still stop: None if it cannot, or need not.

        It can midway in the junction, with its nose over the line, and before it is on the adjacent lane.

        line: the vehicle is on one of its lanes inside, or SUMO has it before the line, or it is a lane change
        over: distance driven beyond the line [m]
        """
        left = OVERRUN * ego.size - over
        may_stop = ego.speed**2 / (2 * EARLY_BRAKING) < left
        if line.via and may_stop and self._link_state(line) in RED:
            if ego.speed < STANDING:
                self.over_line[ego.id] = over
            return LineState(left, False, False, False, LIGHT)
        is_inside = line.via and ego.lane in (line.lane, *line.via)  # SUMO may have it before the line still
        if is_inside:
            self._way.note_waiting(line, -over, ego)
        if len(line.via) > 1 and ego.lane == line.via[0]:
            inside = self._now.lane_length[ego.lane]
            driven = self._now.position[ego.id]
            is_open, reason = self._way.may_cross(line, -driven, ego, midway=True), RIGHT_OF_WAY
            if is_open and not self._is_free_of_people(line, -driven, ego):
                is_open, reason = False, PEOPLE
            stop = min(inside, self._midway(line, driven - OVERRUN * ego.size, -driven, ego, is_open)) - driven
            if (before := self._way.stop_before_foes(line, driven, ego)) < math.inf:
                is_open, reason, stop = False, RIGHT_OF_WAY, min(stop, before)
            may_stop = ego.speed < STANDING or ego.speed**2 / (2 * EARLY_BRAKING) < stop
            if is_open and may_stop and not self._has_room(line, ego, -driven, midway=True):
                return LineState(max(stop, 0.0), False, False, False, NO_ROOM)
            return LineState(stop, is_open, False, False, reason)
        if line.state == CHANGING:
            before = self._change.may_change(line, -over, ego)
            if before < np.inf and ego.lane != line.onto:
                return LineState(before, False, False, False, LANE_CHANGE)
        elif is_inside:
            state = self._link_state(line)
            if may_stop and state not in PRIORITY and not self._way.has_way(line, state, -over, ego):
                if ego.speed < STANDING:
                    self.over_line[ego.id] = over
                return LineState(left, False, False, False, RIGHT_OF_WAY)
            if (stop := self._way.stop_before_foes(line, over, ego, state)) < math.inf:
                return LineState(stop, False, False, False, RIGHT_OF_WAY)
        return None

    def _midway(self, line: Line, driven: float, distance: float, ego: Ego, is_open: bool = False) -> float:
        """Where the front of a vehicle that waits inside a junction stops, beyond the line [m]; inf: nobody comes.

        That is where it comes into the way of the first path with priority. If it has a gap on that path, and its body
        is clear of it beyond, it is before a later path: the farthest such place. It is never beyond SUMO's own place
        midway, which may lie in the way: SUMO's vehicles pass through each other there.

        driven  : paths into whose way its front came before this place do not count [m]
        distance: of its front from the line [m]; negative: beyond it
        is_open : it has a gap on all paths
        """
        crossings, waits = self._conflicts[line].crossings, self._conflicts[line].waits
        ahead = [one for one in crossings if one.first and driven < one.touches < math.inf]
        if not ahead:
            return math.inf
        changes = line.light and self._now.next_switch[line.light] - self._sumo.simulation.getTime() < CHANGES_SOON
        coming = sorted((one.touches, one.own[1]) for one in ahead if changes or self._may_come(one))
        if not coming:
            return math.inf
        places, clear = [], -math.inf
        for touches, leaves in [*coming, (math.inf, math.inf)]:
            if not places or clear <= min(touches, waits) < math.inf:
                places.append(min(touches, waits))
            if touches >= waits:
                break
            clear = max(clear, leaves + ego.length)
        first, *farther = places
        for place in farther:
            if not (is_open or self._way.may_cross(line, distance, ego, midway=True, until=place)):
                break
            first = place
        return first

    def _may_come(self, crossing: Crossing) -> bool:
        """Whether no red light stops the vehicles on another path."""
        states = (link[LINK_STATE] for link in self._now.links[crossing.before] if link[LINK_VIA] == crossing.via[0])
        return not any(state in RED for state in states)

    def _ahead(self, line: Line, distance: float, near: bool, ego: Ego, route: Route) -> LineState:
        """State of a line ahead; near: so near that the vehicles about it count, where it does not give way anyway."""
        if line.state == CHANGING:
            if distance > 0 and not route.closed:
                here = self._change.where_it_is(line, distance, ego)
                if here == Here.GOES_OVER:
                    self._later.note_in_queue(line, distance, ego)
                elif here == Here.STAYS:
                    return LineState(min(distance, ego.stops_within), False, False, False, LANE_CHANGE)
            looks = near and ego.lane != line.onto
            before = self._change.may_change(line, distance, ego) if looks else math.inf
            stop = min(distance, before)
            if distance <= before < math.inf:
                stop = self._later.note(line, distance, ego, route)
            return LineState(stop, before == math.inf, False, False, LANE_CHANGE)
        line = self._at_junction[line, ego.kind]
        found = self._at_line(line, distance, near, ego)
        enters = found.open or found.distance > distance
        gives_way = found.minor and found.reason in (RIGHT_OF_WAY, LETTING_IN) and distance <= LOOK * ego.length
        if near and (enters or gives_way):
            self._way.note_waiting(line, distance, ego)
        if near and enters:
            if ego.kind in LONG:
                self._way.note_swung_over(line, distance, ego)
            stop = self._way.stop_before_foes(line, -distance, ego)
            if stop < (math.inf if found.open else found.distance):
                return found._replace(distance=stop, open=False, reason=RIGHT_OF_WAY)
        return found

    def _at_line(self, line: Line, distance: float, near: bool, ego: Ego) -> LineState:
        """State of a junction's line ahead, whatever drives without priority in the junction; as `_ahead`."""
        state, conflicts = self._link_state(line), self._conflicts[line]
        minor, yellow = self._gives_way(line, state), state in YELLOW
        if state in RED + YELLOW:
            if distance < BEFORE_END and ego.speed < STANDING:  # SUMO may have inserted it with its front on the line
                self.over_line[ego.id] = -distance
            return LineState(distance, False, minor, yellow, LIGHT)
        if minor and distance > LOOK * ego.length:
            return LineState(distance, False, minor, yellow, RIGHT_OF_WAY)
        if not near and not minor:
            return LineState(distance, True, minor, yellow, RIGHT_OF_WAY)
        if state in STOP and not self._way.has_stood(line, distance, ego):
            return LineState(distance, False, minor, yellow, STOP_SIGN)
        if state not in PRIORITY and not self._way.has_way(line, state, distance, ego):
            return LineState(distance, False, minor, yellow, RIGHT_OF_WAY)
        if not self._is_free_of_people(line, distance, ego, until=conflicts.waits):
            return LineState(distance, False, minor, yellow, PEOPLE)
        if not near:
            return LineState(distance, True, minor, yellow, RIGHT_OF_WAY)
        if self._way.is_asked(ego.id, line.lane):
            return LineState(distance, False, minor, yellow, LETTING_IN)
        if state in PRIORITY and conflicts.swings and not self._way.may_cross(line, distance, ego):
            return LineState(distance, False, minor, yellow, RIGHT_OF_WAY)
        if line.light and not self._is_cleared(line):
            return LineState(distance, False, False, False, RIGHT_OF_WAY)
        if not self._has_room(line, ego, distance):
            return LineState(distance, False, False, False, NO_ROOM)
        if len(line.via) > 1:
            is_open, reason = self._way.may_cross(line, distance, ego, midway=True), RIGHT_OF_WAY
            if is_open and not self._is_free_of_people(line, distance, ego):
                is_open, reason = False, PEOPLE
            stop = math.inf if is_open else min(conflicts.waits, self._midway(line, 0.0, distance, ego))
            if self._queues_on_walk(line, stop, ego):
                return LineState(distance, False, False, False, NO_ROOM)
            if not is_open:
                return LineState(distance + stop, False, False, yellow, reason)  # so slow that it can wait
        return LineState(distance, True, minor, yellow, RIGHT_OF_WAY)

    def _gives_way(self, line: Line, state: str) -> bool:
        """Whether a vehicle looks for others before a junction's line. state: of its link now"""
        return state in STOP or (state in MINOR and bool(self._conflicts[line].entering))

    def _link_state(self, line: Line) -> str:
        """State of the link beyond a junction's line now, as SUMO writes it.

        Where nobody has to give way, and paths cross, a green light lets all of them in at once.
        """
        if not line.light:
            return line.state
        state = self._now.lights[line.light][line.index]
        return line.state if line.state == EQUAL[0] and state in PRIORITY else state

    # ---- junctions

    def _is_cleared(self, line: Line) -> bool:
        """Whether crossing vehicles that entered the junction before their light became red have left it."""
        for crossing in self._way.occupied(line):
            there = [
                one
                for one in self._way.on(crossing)
                if not self._way.is_past(one) and not self._way.held_up(one.id, "in")
            ]
            via = crossing.via[0]
            if there and any(
                link[LINK_VIA] == via and link[LINK_STATE] in RED for link in self._now.links[crossing.before]
            ):
                return False
        return True

    def _has_room(self, line: Line, ego: Ego, distance: float = math.inf, *, midway: bool = False) -> bool:
        """Whether a vehicle can leave a junction with cross traffic before it stands behind the queue beyond it.

        Vehicles that stand inside, from everywhere, join that queue first. Where it may wait midway, there must be room
        for it: no other vehicle stands there. To SUMO it may be there itself, a little over the line.

        After `WATCHES_QUEUES_AFTER` at a line where it gives way, a long one at any line, it expects of a queue that
        moves that it keeps its speed meanwhile: SUMO's cars, which count vehicles that stand only, or need less room,
        would come in first each time.

        distance: of its front from the line [m]; negative: beyond it
        midway  : it is before the place where it may wait midway: the queue may have grown since it passed the line
        """
        now, length, size = self._now, ego.length, ego.size
        # Paths that part from its own are no cross traffic. But before a lane change it needs the room beside a queue.
        if not self._is_crossed[line] and not _changes_on(line.onto, ego.route):
            return True
        for name in now.on_lane[line.via[0]] if len(line.via) > 1 and not midway else ():
            if name != ego.id and now.speed[name] < STANDING and now.position[name] - now.length[name] < length:
                return False
        onto = now.on_lane[line.onto]  # the last one first
        last = next((k for k in range(len(onto)) if self._queues(onto, k, line, size)), None)
        if last is None:
            return True
        inside = [[name for name in now.on_lane[via] if name != ego.id] for via in line.via]
        if midway:
            inside[0] = [name for name in inside[0] if now.position[name] > now.position[ego.id]]
        crossings = self._conflicts[line].crossings
        left, speed = now.position[onto[last]] - now.length[onto[last]], now.speed[onto[last]]
        others_first = speed >= STANDING and (ego.kind in LONG or self._gives_way(line, self._link_state(line)))
        if others_first and self._way.watches_queues(line, distance, ego):
            left += speed * self._way.pace(line, ego).time_for(distance + line.across)
        merging = chain.from_iterable(one.via for one in crossings if one.merges)
        standing = [name for via in merging for name in now.on_lane[via] if now.speed[name] < STANDING]
        before = [*onto[:last], *chain.from_iterable(inside), *standing]
        taken = sum(
            now.length[name] + (ego.keeps if name in self._way.members else QUEUE_GAP * size) for name in before
        )
        return left > taken + length + ego.keeps

    def _queues_on_walk(self, line: Line, midway: float, ego: Ego) -> bool:
        """Whether a vehicle would stand on a pedestrian crossing, behind those that wait midway before it.

        midway: place at which the first of them waits, beyond the line [m]; inf: it need not
        """
        now, walks, front, stands = self._now, self._conflicts[line].walks, midway, False
        before = [name for name in now.on_lane[line.via[0]] if name != ego.id] if walks else ()
        for name in reversed(before):
            stands = stands or now.speed[name] < STANDING
            if stands or now.position[name] < front:
                front = (min(front, now.position[name]) if stands else front) - now.length[name] - ego.keeps
        is_on = any(walk.own[0] < front and front - ego.length < walk.own[1] for walk in walks)
        return bool(before) and (is_on or front <= 0)

    def _queues(self, onto: Sequence[str], k: int, line: Line, size: float) -> bool:
        """Whether the k-th vehicle on the lane behind a junction, from the last one on, stands, or soon will.

        One that is slow in the bend, and has the road before it, does not.
        """
        now, name = self._now, onto[k]
        if now.speed[name] >= QUEUE_SPEED * size:
            return False
        if now.speed[name] < SETS_OUT * size:
            return True
        ends, ahead = now.lane_length[line.onto], onto[k + 1] if k + 1 < len(onto) else None
        if ahead and now.speed[ahead] < QUEUE_SPEED * size:
            ends = now.position[ahead] - now.length[ahead]
        return ends - now.position[name] < FREE_AHEAD * size

    def _is_free_of_people(self, line: Line, distance: float, ego: Ego, until: float = math.inf) -> bool:
        """Whether nobody on a pedestrian crossing stands where the vehicle drives, or will be there when it comes.

        A crossing whose middle is behind its front does not count: the vehicle is in the way there, and leaves it.

        until: crossings that begin so far beyond the line do not count either [m]: it may wait before them
        """
        for walk in self._conflicts[line].walks:
            if distance + sum(walk.own) / 2 < 0 or walk.own[0] >= until:
                continue
            pace = self._way.pace(line, ego)
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


def _changes_on(lane: str, route: Route | None) -> bool:
    """Whether a route changes from a lane to another one."""
    return route is not None and any(line.lane == lane and line.state == CHANGING for line in route.lines)


def _not_made(change: Line, over: float, lane: str, route: Route) -> tuple[Line, float]:
    """The lane change that a vehicle has passed without making it, and the distance driven since its begin [m].

    Of several on its edge that is the one from the lane on which the vehicle is; else the given one, the last passed,
    as where the vehicle is on the lane to which that leads: it may lead back.
    """
    if change.onto == lane:
        return change, over
    passed = route.lines[: route.lines.index(change) + 1]
    for line in takewhile(lambda line: line.state == CHANGING, reversed(passed)):
        if line.lane == lane:
            return line, over + change.station - line.station
    return change, over


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
