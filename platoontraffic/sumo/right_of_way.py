"""Right of way of members at junctions: gaps among foes, inside and outside, stop signs, turns at all-way stops."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain, pairwise
from typing import NamedTuple

from platoontraffic.road.gap_acceptance import (
    FIRST_MARGIN,
    IN_QUEUE_FROM,
    IN_QUEUE_SPEED,
    LEAST_MARGIN,
    STANDING,
    WATCHES_QUEUES_AFTER,
    Driven,
    Foe,
    Pace,
    lets_in,
    margin_after,
    may_cross,
)
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.lane_routes import Line
from platoontraffic.sumo.client import Client, direct
from platoontraffic.sumo.conflicts import (
    ALL_STOP,
    EQUAL,
    LINK_ONTO,
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
from platoontraffic.sumo.ego import OVERRUN, Ego
from platoontraffic.sumo.reads import PLAN_LANE, PLAN_ONWARD, Once, Reads
from platoontraffic.vehicles.motion import scale

HELD_UP_AFTER = 3.0  # a vehicle that stands at an open line for longer is held up by something else [s]
SETS_OUT_AFTER = 1.5  # a vehicle whose turn it is at an all-way stop sets out within this time [s]
NEXT_IN_TURN = 2.0  # a vehicle waits so much longer for each one that should go before it, and does not [s]
SWINGS_OUT_AFTER = 5.0  # time at a stand after which its front swings over the paths of others without a margin [s] ...
SWINGS_OUT_LONGEST = 30.0  # ... and after which it does so even if a vehicle comes [s]
NEARLY_STANDS = 1.0  # speed up to which a car that has stopped too near to the path of another vehicle stays [m/s]
PASSED_WITHIN = 0.5  # distance by which a car may stand in the way of another path, and a car passes by 0.2 m [m]
BEFORE_PATH = 0.5  # distance that a car which stops inside a junction keeps from the path of another vehicle [m]
STOPS_BY = 4.5  # hardest braking with which a vehicle stops at a sign, or a yellow light [m/s2]: that of SUMO's cars
STOPS_MIDWAY_BY = 2.0  # least braking of a vehicle that will wait midway [m/s2]: more than by which drivers dawdle
STOPS_HARD_BY = 7.0  # hardest braking for a vehicle inside a junction that should have given way [m/s2]
WAITS_FROM = 2.0  # distance beyond a line from which a vehicle may wait, clear of a crossing for people [lengths]
ENTERS_WITHIN = 15.0  # distance from its line from which a vehicle is expected to wait midway [m]
COMES_UNTIL = 5.0  # a member that has stood for longer does not come: vehicles that waited for it go when they can [s]
LETS_IN_FOR = 3.0  # time for which a member stays at its line after it was last asked to let another one in [s] ...
LETS_IN_LONGEST = 12.0  # ... and after it was first asked [s]
JUNCTIONS = 3  # number of the next junctions at which a vehicle's path is compared with the own one
QUEUE_GAP = 2.5  # between cars of SUMO's that stand in a queue [m]
AT_LINE = 4.0  # distance from a line, for a car, at which a vehicle that stands stands at it [m]


class Approach(NamedTuple):
    """A vehicle whose path crosses the own one; distances from its front bumper [m]."""

    id: str
    crossing: Crossing
    to_line: float  # negative inside the junction
    pace: Pace


class Standing(NamedTuple):
    """A vehicle that stands outside the junction, and the distance of its front bumper to the line [m]."""

    id: str
    to_line: float


class RightOfWay:
    """Judges right of way by the vehicles that SUMO has about a junction.

    SUMO reports whether links are open (getNextLinks) only for a vehicle that arrives at full speed, always as open for
    a turn that may wait inside the junction, and not at all inside one. So gaps are judged here.

    now      : SUMO's values at this instant
    conflicts: at each line, at station 0
    stops    : vehicles of SUMO's that would wait inside in the way of a member, and the distance after which each is to
               stop [m]: `note_waiting`
    """

    def __init__(self, sumo: Client, now: Reads, conflicts: Mapping[Line, Conflicts]) -> None:
        self._sumo, self._now, self._conflicts = sumo, now, conflicts
        # By line, at this instant: those outside the junction, the same as they come, paths on which there is somebody
        # inside, those inside with priority, all inside, and those that may wait midway in the own path.
        self._outside = Once(self._foes_outside)
        self._patiently = Once(lambda line: [*self._approaching(line)])
        self._occupied = Once(self._occupied_paths)
        self._first_inside = Once(lambda line: self._inside(line, first=True))
        self._all_inside = Once(lambda line: self._inside(line, first=False))
        self._may_wait = Once(self._those_that_may_wait)
        self._profiles = Once(Ego.profile)
        self.stops: dict[str, float] = {}
        self._inside_between = Once(self._between)
        # States of links without a light: by the lane before, and the first lane inside.
        self._steady = Once(lambda link: _state_of(sumo.lane.getLinks(link[0]), link[1]))
        # Vehicles that stand at an open line ("") or on a lane inside a junction: since when, and when last seen [s].
        self._standing: dict[tuple[str, str], tuple[float, float]] = {}
        self._stood: dict[str, tuple[str, float]] = {}  # the line's lane at which each has stood, and since when [s]
        self._still: dict[tuple[str, str], float] = {}  # since when nothing moves at the line at which one waits [s]
        # Members that were asked to let another one in: at the end of which lane, since when, and when last [s].
        self._asked: dict[str, tuple[str, float, float]] = {}
        # Members that had a gap at the last look, and those that have one at this: at the end of which lane, whether
        # beyond the place midway, and before which other place.
        self._had_gap: set[tuple[str, str, bool, float]] = set()
        self._has_gap: set[tuple[str, str, bool, float]] = set()
        self.members: frozenset[str] = frozenset()  # their ids ...
        self.obedient: frozenset[str] = frozenset()  # ... and of those with a law that heeds lines

    def renew(self) -> None:
        """SUMO has made a step: all vehicles are elsewhere."""
        self._profiles.clear()
        for found in (
            self._outside, self._patiently, self._occupied, self._first_inside, self._all_inside, self._may_wait
        ):  # fmt: skip
            found.clear()

    def _time(self) -> float:
        """SUMO's clock [s]."""
        return direct(self._sumo.simulation.getTime)()

    def begin_look(self) -> None:
        """All members' lines are about to be judged."""
        self.stops.clear()
        self._had_gap, self._has_gap = self._has_gap, set()

    def follow_stops(self, step: float) -> None:
        """The vehicles that are to stop have driven for a step [s] since, or have left."""
        for name in [*self.stops]:
            try:
                self.stops[name] -= step * self._now.speed[name]
            except self._sumo.TraCIException:
                del self.stops[name]

    def has_way(self, line: Line, state: str, distance: float, ego: Ego) -> bool:
        """Whether a vehicle may pass a line at which it has to give way."""
        if state in ALL_STOP:
            return self._is_its_turn(line, distance, ego)
        return self.may_cross(line, distance, ego, state=state)

    def may_cross(
        self,
        line: Line,
        distance: float,
        ego: Ego,
        *,
        midway: bool = False,
        until: float = math.inf,
        state: str = "m",
    ) -> bool:
        """Whether there is a gap among all priority vehicles.

        One that had a gap at the last look, and drives, goes on with half the margin, or without any where it cannot
        stop: it would brake in vain, and be there for longer.

        distance: to the junction [m]
        midway  : judged for what is met after the place where it may wait midway; else for what is met before it
        until   : with midway: judged for what is met before a place so far beyond the line [m]
        """
        foes = [*self._coming(line, ego, state), *self._first_inside[line]]
        if state in ZIPPER:  # the nearer one goes first, and one that stands inside may set out at any time
            foes = [foe for foe in foes if (foe.to_line, foe.crossing.before) < (distance, line.lane)]
            foes = [foe if foe.to_line > 0 else self._setting_out(foe) for foe in foes]
        key, swings = (ego.id, line.lane, midway, until), self._conflicts[line].swings
        stood = self._waited(line, distance, ego) if swings or state not in EQUAL else 0.0
        if not foes:
            self._has_gap.add(key)
            return True
        enters = distance + self._conflicts[line].waits if midway and until == math.inf else distance
        if swings and stood >= SWINGS_OUT_AFTER:
            beside = [foe._replace(pace=Pace(foe.pace.speed)) for foe in foes if foe.crossing.swings]
            foes = [foe for foe in foes if not foe.crossing.swings]
            waits = stood < SWINGS_OUT_LONGEST and ego.speed < STANDING
            met = self._met(line, beside, distance, midway, ego.length, until=until) if waits else []
            if not self._has_gap_among(met, line, distance, ego, 0.0, enters):
                return False
        # Where no lane has priority, it is not known which vehicle came first.
        waited = 0.0 if state in EQUAL else stood
        if waited > WATCHES_QUEUES_AFTER:
            foes = [self._in_queue(foe) for foe in foes]
        met = self._met(line, foes, distance, midway, ego.length, _still_clear(ego), until)
        margin = margin_after(waited)
        if key in self._had_gap and ego.speed >= STANDING:
            stops_at = enters + OVERRUN * ego.size
            if until < math.inf:  # before the first of these paths
                stops_at = distance + min(map(_begin, (one.crossing for one in met)), default=math.inf)
            can_stop = ego.speed**2 / (2 * STOPS_BY) < stops_at
            margin = min(margin, LEAST_MARGIN) if can_stop else 0.0
        has_gap = self._has_gap_among(met, line, distance, ego, margin, enters, waited)
        if has_gap:
            self._has_gap.add(key)
        return has_gap

    def may_enter(self, line: Line, state: str, ego: Ego) -> bool:
        """Whether there was a gap for a vehicle that has just entered: among vehicles outside, without margin.

        At an all-way stop: whether nobody who had stood for longer was driving already; a slower one set out later.
        """
        if state in ZIPPER:
            return True
        if state in ALL_STOP:
            return not any(self._departs(foe, ego) and foe.pace.speed > ego.speed for foe in self._at_lines(line))
        coming = (foe for foe in self._coming(line, ego, state) if not foe.crossing.swings)
        foes = [foe._replace(pace=Pace(foe.pace.speed)) for foe in coming]
        met = self._met(line, foes, 0.0, False, ego.length)
        return self._has_gap_among(met, line, 0.0, ego, 0.0, 0.0, self._waited(line, 0.0, ego))

    def pace(self, line: Line, ego: Ego) -> Driven:
        """How a vehicle drives through a junction."""
        if ego.route is not None:
            return self._profiles[ego]
        return ego.pace(max(map(self._now.max_speed.__getitem__, line.via), default=ego.speed))

    def stop_before_foes(self, line: Line, over: float, ego: Ego, passed: str = "") -> float:
        """Distance at which a vehicle must stop for others that drive inside the junction [m].

        A vehicle without priority may have set out before it saw this one: SUMO's drivers see a member only on the lane
        from which its route goes on. Once inside they do not stop. A vehicle that stands does not count.

        One that has passed a line where it gives way stops for those with priority as well, outside too: it had a gap,
        but may have been slower than it was to be, as behind another one.

        over   : distance driven beyond the line [m]; negative: before it
        passed : state of the line's link, if it has passed the line and may be in the way of those with priority
        returns: to the line where it can stop there by `STOPS_BY`, else to before the path of the first of them; at
                 once where it has nearly stopped nearer to that path, and they can pass it; inf where it can pass them,
                 or cannot stop any more
        """
        conflicts = self._conflicts[line]
        if _is_past_all(conflicts, over, ego) or not (passed or self._all_inside[line] or conflicts.narrow):
            return math.inf
        stop, waits_until = math.inf, -over
        for foe in self._not_to_cut_off(line, over, ego, passed):
            # One that stands where the own body will swing over it is waited for, but not for ever.
            if foe.pace.speed < STANDING and (not foe.crossing.swings or self._squeezes_past(line, over, ego)):
                continue
            left = _stop_before(foe.crossing, over, ego)
            margin = LEAST_MARGIN if foe.to_line > 0 and foe.crossing.first else 0.0
            if left < stop and not self._has_gap_among([foe], line, -over, ego, margin, -over):
                stop = left
                if foe.crossing.swings:  # from farther on it would be in the way of others
                    waits_until = OVERRUN * ego.size - over
        for place in (-over, waits_until):
            if ego.speed**2 / (2 * STOPS_BY) < place < stop < math.inf:
                return place
        return stop

    def _not_to_cut_off(self, line: Line, over: float, ego: Ego, passed: str) -> Iterator[Approach]:
        """The vehicles that `stop_before_foes` is about."""
        # At equal ones either of two may have to.
        priority_too = passed != "" and passed not in PRIORITY + EQUAL and line.state not in EQUAL
        for one in self._all_inside[line]:
            # At an all-way stop a car of SUMO's may set out late, after a member that went in its place.
            sets_out_late = passed == ALL_STOP and one.id not in self.members
            if not self._needs_no_stop(one, line, over, priority_too or sets_out_late):
                yield one
        yield from self._first_where_it_is_narrow(line, over)
        if passed and passed not in PRIORITY + ALL_STOP + ZIPPER + RED + YELLOW:
            yield from (one for one in self._coming(line, ego, passed) if not one.crossing.swings)

    def _needs_no_stop(self, foe: Approach, line: Line, over: float, priority_too: bool) -> bool:
        """Whether `stop_before_foes` may leave out a vehicle that is inside the junction.

        One with priority: unless those count too; in a zipper one that merges, or comes later.
        One without: where it waits midway, stops (as a member with a law that heeds lines does), or comes from the same
        edge, and so is beside or ahead on the same lane.
        """
        crossing = foe.crossing
        if crossing.swings or crossing.first:
            equal = line.state in ZIPPER and (crossing.merges or not self._is_nearer(foe, line, over))
            return crossing.swings or not priority_too or equal
        if edge_of(crossing.before) == edge_of(line.lane):
            return True
        left = foe.to_line + crossing.its[0]
        may_stop = foe.id in self.obedient and left > foe.pace.speed**2 / (2 * STOPS_BY)
        return may_stop or 0 < foe.to_line + crossing.waits < math.inf

    def _squeezes_past(self, line: Line, over: float, ego: Ego) -> bool:
        """Whether it goes although one stands where its body will swing: it is inside, or has waited for long."""
        return over > OVERRUN * ego.size or self._waited(line, -over, ego) > SWINGS_OUT_LONGEST

    def _first_where_it_is_narrow(self, line: Line, over: float) -> Iterator[Approach]:
        """Vehicles that go first where two cars inside the junction have no room beside each other.

        Of two members that is the one that comes there sooner. Cars of SUMO's drive through each other there, so they
        go first once they are inside, or enter next, unless they have to stop at their line.
        """
        for crossing in self._conflicts[line].narrow:
            for one in self.on(crossing):
                first = one.id not in self.members or self._is_nearer(one, line, over)
                if first and not self.is_past(one):
                    yield one
            if crossing.swings:
                yield from self._too_near_to_stop(crossing)
                continue
            for one in self._next_on(crossing):
                state = self._links_ahead(one.id, crossing.before)[1]
                may_stop = state in YELLOW and one.pace.speed**2 / (2 * STOPS_BY) < one.to_line
                if state not in RED + STOP and not may_stop:
                    yield one

    def _is_nearer(self, foe: Approach, line: Line, over: float) -> bool:
        """Whether another one has less far to where the paths meet; of two that have as far, the lane decides."""
        crossing = foe.crossing
        return (foe.to_line + crossing.its[0], crossing.before) < (crossing.own[0] - over, line.lane)

    def note_waiting(self, line: Line, distance: float, ego: Ego) -> None:
        """Note the vehicles that would wait midway in the way of a member, and must stop before its path.

        Those without priority stop for one that comes, or has just come to a stand; all, for one that stands in their
        way, and where they have no gap: their place midway may lie in that path.

        distance: of its front from the line [m]; negative: beyond it
        """
        for foe in self._may_wait[line]:
            crossing = foe.crossing
            if distance + crossing.own[1] + ego.length < 0:
                continue
            left = foe.to_line + crossing.its[0] - BEFORE_PATH
            # It is to stop by less, and sooner: one that does so must not drive on for a few centimetres too many.
            can_stop = left + BEFORE_PATH >= foe.pace.speed**2 / (2 * STOPS_HARD_BY)
            # Where it stands a little farther, since no member came then, the member can pass, and it is to stay.
            if not (can_stop or self._stands_before(foe)):
                continue
            gives_way = distance < 0 or not crossing.first
            comes = distance + crossing.touches < 0 or self._now.waited[ego.id] <= COMES_UNTIL
            if (gives_way and comes) or not self._drives_on(foe):
                self.stops[foe.id] = min(left, self.stops.get(foe.id, math.inf))

    def note_swung_over(self, line: Line, distance: float, ego: Ego) -> bool:
        """Note the vehicles of SUMO's that must stop before the place over which a long vehicle's body swings.

        SUMO knows no conflict there. Where the two paths also cross, they stop only once the body is there: before,
        either vehicle may have to give way. One that stands in its way goes on once it has stood for long: each would
        wait for the other.

        distance: of its front from the line [m]; negative: beyond it
        returns : whether its body is, or will be, over such a place
        """
        swings = False
        for crossing in self._conflicts[line].swung_over:
            if distance + crossing.own[1] < 0:
                continue
            swings = True
            is_there = crossing.swings or distance + crossing.own[0] < 0
            if (not is_there and distance > 0) or self._now.waited[ego.id] > SWINGS_OUT_LONGEST:
                continue
            for foe in chain(self.on(crossing), self._towards(crossing)):
                if not is_there and foe.pace.speed > NEARLY_STANDS:
                    continue
                # It is to stop by less, and sooner, as in `note_waiting`.
                if foe.id not in self.members and self._can_stop_before(foe, STOPS_HARD_BY):
                    left = foe.to_line + crossing.its[0] - BEFORE_PATH
                    self.stops[foe.id] = min(left, self.stops.get(foe.id, math.inf))
        return swings

    def _can_stop_before(self, foe: Approach, braking: float) -> bool:
        """Whether a vehicle can stop before the place at which its path meets the own one."""
        return foe.to_line + foe.crossing.its[0] >= foe.pace.speed**2 / (2 * braking)

    def _towards(self, crossing: Crossing) -> Iterator[Approach]:
        """Vehicles near a place over which the own body swings, the first ones first.

        Where it begins before the line, all on that lane come there.
        """
        now, begins = self._now, min(crossing.its[0], 0.0)
        for name in reversed(now.on_lane[crossing.before]):
            to_line, speed = now.lane_length[crossing.before] - now.position[name], now.speed[name]
            if to_line + begins >= max(ENTERS_WITHIN, speed**2 / (2 * STOPS_BY)):
                return
            if begins < 0 or self._links_ahead(name, crossing.before)[0][:1] == crossing.via[:1]:
                yield Approach(name, crossing, to_line, Pace(speed))

    def _too_near_to_stop(self, crossing: Crossing) -> Iterator[Approach]:
        """Vehicles near such a place that cannot stop before it, as they will be there.

        One that has to give way will stand at its line, and those behind it in a queue. A queue at a red light does not
        count: it stands until the own light is red.
        """
        queue = 0.0
        for one in self._towards(crossing):
            inside, state = self._links_ahead(one.id, crossing.before)
            if inside and state in RED + YELLOW:
                return
            stands = queue > 0 or (bool(inside) and state not in PRIORITY)
            if one.id in self.members or not self._can_stop_before(one, STOPS_BY):
                yield one._replace(to_line=min(queue, one.to_line), pace=Pace(0.0)) if stands else one
            if stands:
                queue += self._now.length[one.id] + QUEUE_GAP

    def _those_that_may_wait(self, line: Line) -> list[Approach]:
        """Vehicles of SUMO's on paths on which they wait midway in the own way, and those that enter there next."""
        found: list[Approach] = []
        for crossing in self._conflicts[line].waited_on:
            if any(map(self._now.on_lane.__getitem__, crossing.via)):
                found += [one for one in self.on(crossing) if one.id not in self.members]
            found += self._next_on(crossing, STOPS_BY)
        return found

    def _drives_on(self, waiting: Approach) -> bool:
        """Whether a vehicle of SUMO's drives on where it may wait midway: it has a gap, and does not brake."""
        now, crossing = self._now, waiting.crossing
        if STANDING <= waiting.pace.speed < crossing.fastest and now.accelerates_by[waiting.id] < -STOPS_MIDWAY_BY:
            return False
        line, to_line = self._line_of(crossing), waiting.to_line
        ego = Ego(waiting.id, crossing.before, waiting.pace.speed, now.length[waiting.id], now.acceleration[waiting.id])
        met = self._met(line, [*self._patiently[line], *self._first_inside[line]], to_line, midway=True)
        return self._has_gap_among(met, line, to_line, ego, FIRST_MARGIN, to_line + self._conflicts[line].waits)

    def _line_of(self, crossing: Crossing) -> Line:
        """The line at which a vehicle that may wait midway has entered, or will; a light does not matter there."""
        onto = next(one[LINK_ONTO] for one in self._now.links[crossing.before] if one[LINK_VIA] == crossing.via[0])
        across = sum(map(self._now.lane_length.__getitem__, crossing.via))
        return Line(0.0, MINOR[0], "", 0, crossing.before, onto, crossing.via, across)

    def _next_on(self, crossing: Crossing, braking: float = math.inf) -> Sequence[Approach]:
        """The vehicle that enters the junction next on a path, if it is one of SUMO's, and near; else none.

        braking: near is also from where it would stop at its line by that [m/s2]
        """
        now, before = self._now, crossing.before
        if not (names := now.on_lane[before]) or (name := names[-1]) in self.members:
            return ()
        to_line, speed = now.lane_length[before] - now.position[name], now.speed[name]
        if to_line >= max(ENTERS_WITHIN, speed**2 / (2 * braking)):
            return ()
        is_on_it = self._links_ahead(name, before)[0][:1] == crossing.via[:1]
        return (Approach(name, crossing, to_line, Pace(speed)),) if is_on_it else ()

    # ---- gaps

    def _has_gap_among(
        self,
        foes: Sequence[Approach],
        line: Line,
        distance: float,
        ego: Ego,
        margin: float,
        enters: float,
        waited: float = 0.0,
    ) -> bool:
        """Whether it may cross before or behind each foe, or is let in.

        distance, enters: from the front bumper to the line, and to the line or where it waits midway [m]
        waited          : time since it first stood at the line [s]
        """
        if not foes:
            return True
        pace, asked = self.pace(line, ego), []
        for one in foes:
            if one.id == ego.id:  # SUMO may have it on a lane beside its own inside
                continue
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
                math.inf if 0 < one.to_line + crossing.waits < math.inf else one.to_line,
            )
            if may_cross(foe, pace, ego.length, margin):
                continue
            if not lets_in(foe, waited):
                return False
            if one.id in self.members:
                asked.append(one)
        return all([self._stands_for_another(one) for one in asked])

    def _stands_for_another(self, one: Approach) -> bool:
        """Ask a member that comes in a queue to let the vehicle in; whether it stands at its line by now."""
        if not 0 < one.to_line < AT_LINE * scale(self._now.length[one.id]):
            return False
        time = self._time()
        _, since, last = self._asked.get(one.id, ("", time, time))
        since = since if time - last < LETS_IN_FOR else time
        self._asked[one.id] = one.crossing.before, since, time
        return self._now.speed[one.id] < STANDING and time - since < LETS_IN_LONGEST

    def is_asked(self, name: str, lane: str) -> bool:
        """Whether a member has been asked to stop at the line of its lane, and to let another one in."""
        if name not in self._asked:
            return False
        (before, since, last), time = self._asked[name], self._time()
        return before == lane and time - last < LETS_IN_FOR and time - since < LETS_IN_LONGEST

    def _met(
        self,
        line: Line,
        foes: Sequence[Approach],
        distance: float,
        midway: bool,
        length: float = math.inf,
        still_clear: float = 0.0,
        until: float = math.inf,
    ) -> list[Approach]:
        """The foes that are met after, or before, the place where the vehicle may wait midway.

        Before it are those whose paths its front touches, or if it touches them nowhere, whose paths meet its own,
        nearer than that place: others pass close before its front where it waits. It cannot wait for a vehicle that it
        already blocks. In a large junction SUMO's place may lie beyond paths that it touches. Then it waits before
        these, if they are far enough beyond the line.

        length     : of the vehicle [m]
        still_clear: `_still_clear`
        until      : as of `may_cross`
        """
        if midway:
            clear = distance + still_clear
            pairs = ((foe, foe.crossing) for foe in foes)
            ahead = (foe for foe, one in pairs if one.own[0] + distance > 0 or 0 < one.touches + clear < math.inf)
            return [foe for foe in ahead if _begin(foe.crossing) < until]
        waits = self._conflicts[line].waits
        if waits < math.inf:
            waits = min(waits, WAITS_FROM * length)
        return [foe for foe in foes if _begin(foe.crossing) < waits]

    def _setting_out(self, foe: Approach) -> Approach:
        """A vehicle inside the junction, as it drives if it sets out now."""
        pace = Pace(foe.pace.speed, self._now.acceleration[foe.id], foe.crossing.fastest)
        return foe._replace(pace=pace)

    def _in_queue(self, foe: Approach) -> Approach:
        """A slow vehicle that SUMO drives, far from the line, keeps its speed: it is in a queue.

        A member may have no vehicle before it.
        """
        is_slow = STANDING <= foe.pace.speed < IN_QUEUE_SPEED
        follows = is_slow and foe.to_line > IN_QUEUE_FROM and foe.id not in self.members
        return foe._replace(pace=Pace(foe.pace.speed)) if follows else foe

    # ---- foes

    def _coming(self, line: Line, ego: Ego, state: str) -> Iterable[Approach]:
        """Vehicles outside the junction that will cross the path with priority and are not stopped by a light."""
        return self._approaching(line, ego) if state in EQUAL else self._patiently[line]

    def _approaching(self, line: Line, ego: Ego | None = None) -> Iterator[Approach]:
        """The same as they come, but for those behind one that does not set out; ego: where nobody has priority."""
        for foe, steady, ahead in self._outside[line]:
            before, patience = foe.crossing.before, HELD_UP_AFTER
            if ego and self._order(ahead.id if ahead else foe.id, before) > self._order(ego.id, line.lane):
                patience = 0.0  # both stand, and it came later
            if ahead is None or self._hurries(*ahead, patience):
                yield foe if self._hurries(foe.id, foe.to_line, patience) else foe._replace(pace=steady)

    def _foes_outside(self, line: Line) -> list[tuple[Approach, Pace, Standing | None]]:
        """Those vehicles as they hurry, and how they drive if they do not; the next one before each that stands.

        One that comes to a stop sign stops there first. One that can stop at a yellow light does, but for a member of a
        convoy. A vehicle behind one that stands midway, before the own path, does not count: that one stays while a
        member is inside.
        """
        conflicts, now, found = self._conflicts[line], self._now, []
        crossings, occupied = conflicts.by_path, self._occupied[line] if conflicts.waited_on else ()
        waits = [one for one in conflicts.waited_on if one in occupied] if occupied else ()
        closed = [one for one in waits if any(map(self._stands_before, self.on(one)))]
        for name, beyond in conflicts.entering:
            to_end, stands = beyond + now.lane_length[name], None
            for foe in reversed(now.on_lane[name]):
                ahead, to_line, speed = stands, to_end - now.position[foe], now.speed[foe]
                if speed < STANDING:
                    stands = Standing(foe, to_line)
                inside, state = self._links_ahead(foe, name)
                via = next((one for one in inside if one in crossings), "")
                if not via or not crossings[via][0].first or state in RED:
                    continue
                stops_here = inside[0] == via and (foe in self.obedient or foe not in self.members)
                if state in YELLOW and stops_here and speed**2 / (2 * STOPS_BY) < to_line:
                    continue
                hurrying = Pace(speed, now.acceleration[foe], now.max_speed[name])
                steady = Pace(speed)
                if state in STOP and inside[0] == via and speed >= STANDING:
                    stops_after = max(to_line, 0.0) / speed + speed / (2 * STOPS_BY)
                    to_line, steady = 0.0, hurrying._replace(speed=0.0, delay=stops_after)
                    hurrying = steady
                for one in crossings[via]:
                    if one not in closed:
                        found.append((Approach(foe, one, to_line, hurrying), steady, ahead))
        return found

    def _stands_before(self, foe: Approach) -> bool:
        """Whether a vehicle stands, and its front is not in the own way yet."""
        return foe.pace.speed < STANDING and 0 < foe.to_line + foe.crossing.blocks < math.inf

    def _links_ahead(self, name: str, lane: str) -> tuple[tuple[str, ...], str]:
        """First lanes inside the next junctions on a vehicle's path, at most `JUNCTIONS`; state of the next link.

        As `getNextLinks` has them; but that judges whether each link is open, and takes five times as long. SUMO's plan
        ends where the vehicle is to stop and at the end of its route, and there is none inside a junction.
        """
        now = self._now
        lanes: Sequence[str] = ()
        for plan in now.best_lanes[name]:
            if plan[PLAN_LANE] == lane:
                lanes = plan[PLAN_ONWARD]
                break
        if len(lanes) <= JUNCTIONS:
            links = now.next_links[name][:JUNCTIONS]
            return tuple(link[LINK_VIA] for link in links), links[0][LINK_STATE] if links else ""
        inside = self._inside_between[tuple(lanes[: JUNCTIONS + 1])]
        if lane in self._controlled:
            return inside, _state_of(now.links[lane], inside[0])
        return inside, self._steady[lane, inside[0]]

    @cached_property
    def _controlled(self) -> frozenset[str]:
        """Lanes that end at a traffic light."""
        lights = self._sumo.trafficlight
        return frozenset(chain.from_iterable(map(lights.getControlledLanes, lights.getIDList())))

    def _between(self, lanes: Sequence[str]) -> tuple[str, ...]:
        """First lanes inside the junctions between lanes that follow one another."""
        found = []
        for here, onto in pairwise(lanes):
            found += [link[LINK_VIA] for link in self._sumo.lane.getLinks(here) if link[LINK_ONTO] == onto]
        return tuple(found)

    def occupied(self, line: Line) -> Sequence[Crossing]:
        """Paths across that of a line on which somebody is inside the junction."""
        return self._occupied[line]

    def _occupied_paths(self, line: Line) -> list[Crossing]:
        on_lane, conflicts = self._now.on_lane, self._conflicts[line]
        on_lane.look_up(conflicts.lanes)
        if not any(map(on_lane.__getitem__, conflicts.lanes)):  # as at most lines
            return []
        return [one for one in conflicts.crossings if any(map(on_lane.__getitem__, one.via))]

    def _inside(self, line: Line, *, first: bool) -> list[Approach]:
        """Vehicles inside the junction whose paths cross the own one.

        first: only those with priority
        """
        return [
            one
            for crossing in self._occupied[line]
            if crossing.first or not first
            for one in self.on(crossing)
            if not self.is_past(one) and not self.held_up(one.id, "in")
        ]

    def on(self, crossing: Crossing) -> Iterator[Approach]:
        """Vehicles inside the junction on a path; one that has left it with its nose only is on the next lane.

        Those that drive may accelerate.
        """
        now, driven = self._now, 0.0
        for via in crossing.via:
            for name in now.on_lane[via]:
                one = Approach(name, crossing, -driven - now.position[name], Pace(now.speed[name]))
                yield self._setting_out(one) if one.pace.speed >= STANDING else one
            driven += now.lane_length[via]

    def is_past(self, one: Approach) -> bool:
        """Whether its rear has left the conflict area."""
        return one.to_line + one.crossing.its[1] + self._now.length[one.id] < 0

    def _hurries(self, foe: str, to_line: float, patience: float = HELD_UP_AFTER) -> bool:
        """Whether a foe may come sooner than by its speed: one that drives, or that stands at a line just opened.

        Whether a line is open to a member SUMO does not know.
        """
        if self._now.speed[foe] >= STANDING:
            self._standing.pop((foe, ""), None)
            return True  # even if it brakes now: two that brake for each other would both count on that
        if to_line > self._now.length[foe]:
            return False
        links = self._now.next_links[foe] if foe not in self.members else ()
        if foe not in self.members and not (links and links[0][LINK_OPEN]):
            return False
        return not self.held_up(foe, "", patience)

    def held_up(self, foe: str, where: str, patience: float = HELD_UP_AFTER) -> bool:
        """Whether a foe stands too long where it might drive: at an open line ("") or inside a junction ("in")."""
        if self._now.speed[foe] >= STANDING:
            self._standing.pop((foe, where), None)
            return False
        time = self._time()
        since, last = self._standing.get((foe, where), (time, time))
        since = since if time - last < HELD_UP_AFTER else time
        self._standing[foe, where] = since, time
        return time - since > patience

    # ---- stop signs

    def has_stood(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle has stood at this line; that is remembered until it has passed the line."""
        return distance < 0 or self._stood_since(ego.id, line.lane, distance, ego.length) is not None

    def _stood_since(self, name: str, lane: str, to_line: float, length: float) -> float | None:
        """Time since which a vehicle has been standing at its line, or has stood there [s]; None: it has not."""
        before, since = self._stood.get(name, ("", 0.0))
        is_far = to_line > AT_LINE * scale(length)
        if before == lane and is_far:  # it has come to this line again
            del self._stood[name]
            self._still.pop((name, lane), None)
        elif before == lane:
            return since
        if is_far or self._now.speed[name] >= STANDING:
            return None
        since = self._time() - self._now.waited[name]
        self._stood[name] = lane, since
        return since

    def _waited(self, line: Line, distance: float, ego: Ego) -> float:
        """Time since a vehicle first stood at this line [s]; 0 if it has not."""
        since = self._stood_since(ego.id, line.lane, distance, ego.length)
        return 0.0 if since is None else self._time() - since

    def watches_queues(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether it has stood at this line for so long that it expects of a queue which moves that it goes on."""
        return self._waited(line, distance, ego) > WATCHES_QUEUES_AFTER

    def _order(self, name: str, lane: str) -> tuple[float, str]:
        """Order in which vehicles that have stood at their lines go; of equal ones, by lane."""
        before, since = self._stood.get(name, ("", math.inf))
        return (since if before == lane else math.inf), lane

    def _at_lines(self, line: Line) -> Iterator[Approach]:
        """The first vehicle on each crossing lane, if it stands at its line or has stood there."""
        now, conflicts = self._now, self._conflicts[line]
        for before in sorted({crossing.before for crossing in conflicts.crossings} - {line.lane}):
            names = now.on_lane[before]
            if not names:
                continue
            foe = names[-1]
            to_line = now.lane_length[before] - now.position[foe]
            inside, _ = self._links_ahead(foe, before)
            met = conflicts.by_path.get(inside[0]) if inside else None
            if met and self._stood_since(foe, before, to_line, now.length[foe]) is not None:
                crossing = met[0]
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
        own, time, key = self._order(ego.id, line.lane), self._time(), (ego.id, line.lane)
        inside = self._all_inside[line]
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


def _begin(crossing: Crossing) -> float:
    """Where the own front touches another path, or where that does not, where the paths meet [m]."""
    return crossing.touches if crossing.touches < math.inf else crossing.own[0]


def _state_of(links: Iterable[Sequence], inside: str) -> str:
    """State of that one of the links of a lane which leads onto a lane inside a junction."""
    return next(link[LINK_STATE] for link in links if link[LINK_VIA] == inside)


def _is_past_all(conflicts: Conflicts, over: float, ego: Ego) -> bool:
    """Whether `_stop_before` is inf for all paths, as for most vehicles inside a junction. over: as there"""
    if ego.speed < NEARLY_STANDS * ego.size:
        return False
    given_way, others = (ego.speed**2 / (2 * braking) for braking in (STOPS_BY, STOPS_HARD_BY))
    driven = over + BEFORE_PATH * ego.size
    return conflicts.last_with_priority - driven < given_way and conflicts.last_of_others - driven < others


def _stop_before(crossing: Crossing, over: float, ego: Ego) -> float:
    """Distance at which a vehicle stops before another path in the junction [m]; inf: it cannot.

    over: distance driven beyond the line [m]
    """
    stops_within = ego.speed**2 / (2 * (STOPS_BY if crossing.first else STOPS_HARD_BY))
    keeps = BEFORE_PATH * ego.size
    meets, touches = crossing.own[0] - over, crossing.touches - over
    for place in (meets - keeps, touches - keeps):
        if stops_within <= place:
            return place
    stays = ego.speed < NEARLY_STANDS * ego.size and -_still_clear(ego) < touches < math.inf
    return stops_within if stays else math.inf


def _still_clear(ego: Ego) -> float:
    """How far beyond where its front begins to be in the way of another path a vehicle can stop, and be passed [m].

    0 if it does not nearly stand: then it is to leave that path.
    """
    if ego.speed >= NEARLY_STANDS * ego.size:
        return 0.0
    return max(PASSED_WITHIN * ego.size - ego.speed**2 / (2 * STOPS_BY), 0.0)
