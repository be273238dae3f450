"""Room for the lane changes of members, among the vehicles that SUMO has on the lanes beside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum
from itertools import chain
from math import cos, inf, radians, sin
from types import MappingProxyType
from typing import NamedTuple

from platoontraffic.controllers.lane_room import COMFORTABLE_BRAKING, room_needed
from platoontraffic.road.gap_acceptance import STANDING, Pace
from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.lane_routes import CHANGING, SHORTEST_CHANGE, Line
from platoontraffic.road.network import Network
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.reads import PLAN_LANE, PLAN_OFFSET, Reads

CHANGING_PACE = 1.5, 6.0  # acceleration of a slow vehicle that changes lanes [m/s2], up to [m/s]
COMMITTED = 0.25  # share of a lane change after which it is not interrupted
HARDLY_BEGUN = 0.1  # share up to which it may be put off: a car's body is still within its lane
COMES_OVER = 1.0  # a vehicle one lane beside its line is half over within this time [s], or one length if that is more
BEHIND = 0.5  # distance behind another one on its lane from which a slow vehicle may go over, for a car [m]
PASSES_BY = 2.0  # a vehicle that is so much faster passes, and leaves room then [m/s]
FAST_ROAD = 20.0  # speed limit from which on vehicles change lanes as they drive, and do not wait for room [m/s] ...
FLOWS = 8.0  # ... where they and the others are so fast [m/s]
BOUND_WITHIN = 1.0  # a vehicle that has room and cannot stop makes a lane change that begins within this time [s]
QUEUE_SPEED = 3.0  # a slower vehicle, of a car's length, is part of a queue [m/s]
QUEUE_STANDS = 1.0  # below this speed a queue leaves no room for a lane change, for a car [m/s]
HELD_AFTER = 2.0  # the first one in it stands, and does not just set out, after this time [s] ...
FREE_AHEAD = 15.0  # ... or with less road before it [m]
QUEUE_PATIENCE = 20.0  # time that a lane change waits at a stand for a queue to leave [s]
GOES_BACK_AFTER = 60.0  # a vehicle that has stood partly over for so long without room goes back to its lane [s]
LOOKS_AHEAD = 10.0  # a lane change is urgent where the lane ends within this time at its speed limit, as SUMO's is [s]
COMES_WITHIN = 3.6  # vehicles that come to the adjacent lane within this time at its speed limit count [s]
ENTRY = 40.0  # first part of a lane, in which no car waits for room [m]
SWAPS_WITHIN = 50.0  # distance from the end of a lane, for a car, within which two that swap lanes make room [m] ...
FALLS_BACK_FROM, SWAP_BRAKING = 2.0, 3.0  # ... the least speed of the one behind [m/s], and its braking [m/s2]
BY_PLACES = 20.0  # two vehicles so near on their lanes [m] are compared by their places ...
SAME_WAY = 30.0  # ... if they are headed the same way within this [deg]
OWN_GAP = 4.0  # that a member of a car's length leaves in a queue [m]


class Wanted(NamedTuple):
    """Room for a lane change, as a vehicle wants it."""

    lane: str
    behind: float  # distance behind its front at which a vehicle there must stand to leave it [m]
    begun: bool  # it is going over, and is not on that lane yet
    urgent: bool = False  # its lane ends soon
    speed: float = 0.0  # its own, where it does not wait for room, but drives on until it has it [m/s]


class Gap(NamedTuple):
    """The gap to a vehicle on a lane that is crossed, when the member is over there."""

    name: str
    ahead: bool  # that vehicle's front is ahead of the member's
    room: float  # bumper to bumper [m]
    rear_speed: float  # of the one in the rear [m/s]
    closing: float  # rate at which it shrinks [m/s]


class Here(Enum):
    """The next action of a vehicle in a queue before its lane change."""

    DRIVES_ON = 0
    STAYS = 1
    GOES_OVER = 2


class Slowest(NamedTuple):
    """Least speeds of vehicles beside a member [m/s]."""

    blocking: float  # of those that leave no room for its lane change
    to_fall_back: float  # of those to fall back behind: but the one that lets it in, and those that it leaves behind


class RoomToChange:
    """Judges whether there is room for a lane change.

    now   : SUMO's values at this instant
    let_in: the vehicle that waits now, by the member for which it does
    """

    def __init__(self, network: Network, now: Reads, let_in: Mapping[str, str] = MappingProxyType({})) -> None:
        self._network, self._now, self._let_in = network, now, let_in
        self._adjacent: dict[str, tuple[tuple[str, float], ...]] = {}  # lanes leading to the end of a change's target
        self._beside: set[str] = set()  # members that wait beside another vehicle, to go over to their lane
        self.members: frozenset[str] = frozenset()  # their ids
        self._over: dict[str, list[str]] = {}  # members that were going over to a lane at the last look
        self._wanted_before: dict[str, Wanted] = {}  # `wanted` at the last look
        # The vehicles beside those members that had room for a change to a lane: at the last look, and at this one.
        self._had_room: dict[tuple[str, str], frozenset[str]] = {}
        self._has_room: dict[tuple[str, str], frozenset[str]] = {}
        self.wanted: dict[str, Wanted] = {}  # by each member without room for its lane change, going over, or let in

    def begin_look(self) -> None:
        """Before the members of a step are asked about."""
        self._had_room, self._has_room = self._has_room, {}
        self._over.clear()
        self._wanted_before = dict(self.wanted)
        for name, wanted in self.wanted.items():
            if wanted.begun and name in self.members:
                self._over.setdefault(wanted.lane, []).append(name)
        self.wanted.clear()

    def may_change(self, line: Line, distance: float, ego: Ego) -> float:
        """Distance at which a vehicle must stop because there is no room on the lane that it changes to [m].

        distance : to the begin of the lane change; negative: it has begun [m]
        returns  : to where it still is on the lane before, but at once where it has begun to go over, for the less it
                   has done so, the better others pass it, and harder where one would touch it; to where it falls back
                   behind one that swaps lanes with it; inf: there is room, or it is on that lane already

        A queue ahead leaves no room to begin: it would stand across both lanes. It is waited for, but not for ever, and
        not while it is let in. A vehicle that has driven past its lane change without changing lanes, such as one that
        followed another vehicle, changes lanes where it is, unless the change is put off: see `may_put_off`.
        """
        if self.has_missed(line, distance, ego):
            return self._goes_over_here(from_here(line, distance), ego)
        stop, half = distance + COMMITTED * line.across, distance + 0.5 * line.across
        stops_within = ego.speed**2 / (2 * COMFORTABLE_BRAKING)
        stays = stops_within <= half  # else it would be over there, and slow
        if distance < 0 and stays and ego.lane != line.onto and self._is_cut_off(line, distance, half, ego):
            self._want(line, distance, half, ego, True)
            return stops_within
        patient = self._now.waited[ego.id] < QUEUE_PATIENCE and ego.id not in self._let_in
        queue = distance >= 0 and patient and self._queue_within(line, distance, ego)
        if stop > 0 and (queue or not self._goes(line, distance, half, stops_within <= stop, ego)):
            self._want(line, distance, half, ego, distance < 0)
            return min(stop, ego.stops_within if distance < 0 else self._falls_back(line, distance, ego))
        if distance < 0 and ego.lane != line.onto:
            self._want(line, distance, max(half, 0.0), ego, True)
            return self._falls_back(line, distance, ego)
        if ego.id in self._let_in and ego.lane != line.onto:  # the vehicle that lets it in stays until then
            self._want(line, distance, half, ego, distance < 0)
        return inf

    def where_it_is(self, line: Line, distance: float, ego: Ego) -> Here:
        """The next action of a slow vehicle before its lane change: in a queue it goes over where it is, with room.

        Else it asks for room there, so that the vehicles of a queue need not go over at one place, one after another.
        It stays there while another vehicle lets it in and those beside it, which leave no room, drive on. Where its
        lane does not end soon, it drives on: it may become faster first.

        line, distance: as of `may_change`; the next one
        """
        slow = ego.speed < QUEUE_SPEED * ego.size and ego.lane == line.lane and self._ends_soon(line, distance)
        own = self._let_in.get(ego.id)
        if not slow or (own is None and not self._is_behind_queue(line, distance, ego)):
            return Here.DRIVES_ON
        across = min(line.across, SHORTEST_CHANGE * abs(line.aside))
        here, half = from_here(line, distance)._replace(across=across), 0.5 * across
        if self.has_room_here(here, ego):
            return Here.GOES_OVER
        self._want(here, 0.0, half, ego, False)
        blocking = [gap.name for gap in self._blocking(here, 0.0, half, ego) if gap.name != own]
        leave = own is not None and blocking and all(self._now.speed[name] >= STANDING for name in blocking)
        return Here.STAYS if leave else Here.DRIVES_ON

    def has_room_here(self, line: Line, ego: Ego) -> bool:
        """Whether there is room for a lane change that begins at the vehicle's front."""
        return not self._queue_within(line, 0.0, ego) and self._goes(line, 0.0, 0.5 * line.across, True, ego)

    def has_missed(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle has driven past a lane change on its lane, as one that followed another vehicle."""
        return -distance > line.across and ego.lane == line.lane

    def _goes_over_here(self, line: Line, ego: Ego) -> float:
        """As `may_change`, for a lane change that begins at the vehicle's front; without room it stops at once."""
        share = self._share(ego)
        half = (0.5 - share) * min(line.across, 2 * max(ego.length, COMES_OVER * ego.speed))
        self._want(line, 0.0, half, ego, share > HARDLY_BEGUN)
        return inf if self._is_room(line, 0.0, half, ego) else ego.stops_within

    def _share(self, ego: Ego) -> float:
        """Share of its lane change that a vehicle has made, by its distance from the middle of the lane before."""
        return min(abs(self._now.aside[ego.id]) / self._now.lane_width[ego.lane], 0.5)

    def _want(self, line: Line, distance: float, half: float, ego: Ego, begun: bool) -> None:
        """Of several changes on its edge the first one counts.

        half : distance after which half of the member is over on the lane [m]
        begun: it is going over
        """
        drives_on = self.is_fast(line) and ego.speed >= FLOWS
        speed = ego.speed if drives_on else 0.0
        # One that follows it drives on as well while it goes over, so the whole gap is needed from the begin on.
        room = room_needed(ego.length, speed, 0.0) - (0.0 if drives_on else half)
        behind = ego.length + room + self._farther_on(line, distance, ego)
        urgent = self._ends_soon(line, distance)
        self.wanted.setdefault(ego.id, Wanted(line.onto, behind, begun, urgent, speed))

    def _farther_on(self, line: Line, distance: float, ego: Ego) -> float:
        """How much farther on along its lane SUMO has a vehicle than its route: an askew one by a metre [m]."""
        if edge_of(ego.lane) != edge_of(line.lane):
            return 0.0
        to_end = self._now.lane_length[ego.lane] - self._now.position[ego.id]
        return max(distance + line.to_end - to_end, 0.0)

    def is_beside(self, line: Line, ego: Ego) -> bool:
        """Whether a slow vehicle that is not yet on its lane has another one there with its rear beside the own front.

        The other one came in between, and does not see what is behind its own front. A member does not see what is
        beside it either, unless it stands a little behind, and waits for room on the own lane, or lets this one in; of
        two that go over to each other's lanes one waits.

        line: the next one of the route: it begins on the lane on which the vehicle should be
        """
        if self._beside:
            self._beside.discard(ego.id)
        if ego.lane == line.lane or ego.speed >= QUEUE_SPEED * ego.size:
            return False
        if edge_of(ego.lane) != edge_of(line.lane):
            return False
        now, here = self._now, self._now.position[ego.id]
        for place, before in ((line.lane, 0.0), *((via, now.lane_length[line.lane]) for via in line.via[:1])):
            for name in now.on_lane[place]:
                front = before + now.position[name]
                waits = name in self._beside or self._waits_behind(name, ego) or name == self._let_in.get(ego.id)
                begin = here if waits or name not in self.members else here - ego.length
                if begin < front < here + now.length[name] + BEHIND * ego.size:
                    self._beside.add(ego.id)
                    return True
        return False

    def _waits_behind(self, name: str, ego: Ego) -> bool:
        """Whether a member stands, and waits for room on another one's lane, a little behind that one."""
        wanted, now = self._wanted_before.get(name), self._now
        waits = wanted is not None and wanted.lane == ego.lane and not wanted.begun
        return waits and now.speed[name] < STANDING and now.position[name] < now.position[ego.id]

    def may_go_over(self, line: Line, ego: Ego) -> bool:
        """Whether a slow vehicle on a lane beside its own, without a lane change, can go over; faster ones drive on.

        It has driven past its change and the junction beyond, as one that followed another vehicle. It waits for the
        next one behind on its lane, unless that one stands: it may accelerate.

        line: as of `is_beside`
        """
        if ego.lane == line.lane or edge_of(ego.lane) != edge_of(line.lane) or ego.speed >= QUEUE_SPEED * ego.size:
            return True
        share, now = self._share(ego), self._now
        if share > COMMITTED:
            return True
        here, half = now.position[ego.id], (0.5 - share) * 2 * ego.length
        behind = [name for name in now.on_lane[line.lane] if name != ego.id and now.position[name] < here]
        if not behind or now.speed[behind[-1]] < STANDING:
            return True
        foe, time = behind[-1], Pace(ego.speed, *CHANGING_PACE).time_for(half)
        comes = Pace(now.speed[foe], now.acceleration[foe], now.max_speed[line.lane])
        room = here + half - ego.length - BEHIND * ego.size - now.position[foe]
        if comes.time_for(max(room, 0.0)) >= time:
            return True
        to_end = now.lane_length[ego.lane] - here
        change = line._replace(state=CHANGING, lane=ego.lane, onto=line.lane, via=(), to_end=to_end)
        self._want(change, 0.0, half, ego, False)
        return False

    def may_put_off(self, line: Line, over: float, ego: Ego, *, has_room: bool) -> bool:
        """Whether a vehicle beyond the begin of its lane change may make another one further on.

        It may where it has hardly begun and has no room, where it has stood for long without, and where it has driven
        past the whole change on its lane.

        over: distance driven since its begin [m]
        """
        if self.has_missed(line, -over, ego):
            return self._share(ego) < HARDLY_BEGUN
        return not has_room and (over < HARDLY_BEGUN * line.across or self.goes_back(line, ego))

    def goes_back(self, line: Line, ego: Ego) -> bool:
        """Whether a vehicle that has stood partly over for long goes back to its lane, and changes lanes further on.

        Another vehicle, abreast of it, may be behind it by SUMO's positions on the lanes, and stand until it is over.
        """
        return ego.lane == line.lane and self._now.waited[ego.id] > GOES_BACK_AFTER

    def is_better_later(self, line: Line, distance: float, slowest: float, ego: Ego) -> bool:
        """Whether a vehicle without room for its lane change should look for it further on.

        Where it would stand near the begin of a long lane, those behind it stand on the junction before. Elsewhere it
        should if all vehicles that leave no room are faster, and none of them is in a queue; or if one of them is a
        little behind, and waits for room to come to its lane: side by side neither would ever have it.

        slowest: as of `slowest_beside`
        """
        blocks_junction = self._begin(line) < ENTRY * ego.size and not self._ends_soon(line, distance)
        return blocks_junction or slowest >= ego.speed + PASSES_BY or self._swaps_ahead(line, distance, ego)

    def _swaps_ahead(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle that leaves no room waits for room on the own lane, and is not ahead; of two members at one
        place, the name decides."""
        here = self._now.position[ego.id], ego.id
        for gap in self._blocking(line, distance, distance + 0.5 * line.across, ego):
            wanted = self._wanted_before.get(gap.name)
            if wanted and wanted.lane == line.lane and (self._now.position[gap.name], gap.name) < here:
                return True
        return False

    def is_fast(self, line: Line) -> bool:
        """Whether the lane of a lane change is that of a fast road."""
        return self._now.max_speed[line.lane] >= FAST_ROAD

    def slowest_beside(self, line: Line, distance: float, ego: Ego) -> Slowest:
        """Of the vehicles that leave no room for a lane change here; 0 beside a queue, inf: there are none."""
        if self._queue_within(line, distance, ego):
            return Slowest(0.0, 0.0)
        speed, own = self._now.speed, self._let_in.get(ego.id)
        gaps = [*self._blocking(line, distance, distance + 0.5 * line.across, ego)]
        leaving = {gap.name for gap in gaps if not gap.ahead and speed[gap.name] < ego.speed}
        before = (gap.name for gap in gaps if gap.name != own and gap.name not in leaving)
        return Slowest(
            min((speed[gap.name] for gap in gaps), default=inf), min(map(speed.__getitem__, before), default=inf)
        )

    def free_road(self, line: Line, distance: float, ego: Ego) -> float:
        """Distance from the begin of a lane change to the next vehicle in a queue on the lane before [m]; inf: none."""
        now, begin, slow = self._now, self._begin(line), QUEUE_SPEED * ego.size
        ahead = (name for name in now.on_lane[line.lane] if name != ego.id and now.position[name] > begin - distance)
        return min((now.position[one] - now.length[one] - begin for one in ahead if now.speed[one] < slow), default=inf)

    def _is_behind_queue(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether slow vehicles on its lane leave no room to begin a change further on, and are held up themselves.

        The first one of them stands, or has little road before it. Where it sets out, so will others.
        """
        now, slow, begin = self._now, QUEUE_SPEED * ego.size, self._begin(line)
        here, names = begin - distance, now.on_lane[line.lane]
        ahead = [name for name in names if name != ego.id and now.position[name] > here]
        rears = [now.position[name] - now.length[name] for name in ahead]  # ascending
        near = [k for k, rear in enumerate(rears) if now.speed[ahead[k]] < slow and rear - begin <= line.across]
        if not near:
            return False
        first = near[0]
        while first + 1 < len(ahead) and now.speed[ahead[first + 1]] < slow:
            first += 1
        ends = rears[first + 1] if first + 1 < len(ahead) else now.lane_length[line.lane]
        return now.waited[ahead[first]] > HELD_AFTER or ends - now.position[ahead[first]] < FREE_AHEAD * ego.size

    def _ends_soon(self, line: Line, distance: float) -> bool:
        """Whether a lane change is urgent. distance: to its begin [m]"""
        return distance + line.to_end < LOOKS_AHEAD * self._now.max_speed[line.lane]

    def _begin(self, line: Line) -> float:
        """Position of the begin of a lane change on its lane [m]."""
        return self._now.lane_length[line.lane] - line.to_end

    def _goes(self, line: Line, distance: float, half: float, can_stop: bool, ego: Ego) -> bool:
        """Whether a vehicle makes its lane change: where it has room.

        In traffic that flows, one that is near it, had room at the last look, and cannot stop any more, also makes it
        where a vehicle that was behind it then has less room now, but need not touch it. That vehicle accelerates as it
        does, and needs ever more room; by braking the member would take what there is.
        """
        key = ego.id, line.onto
        flows = self.is_fast(line) or ego.speed >= FLOWS
        is_bound = not can_stop and distance < BOUND_WITHIN * ego.speed and flows
        known = self._had_room.get(key, frozenset()) if is_bound else frozenset()
        gaps = [*self._gaps(line, distance, half, ego)]
        goes = all(
            _leaves_room(gap, ego) or (gap.name in known and not gap.ahead and not _cuts_off(gap)) for gap in gaps
        )
        if goes:
            self._has_room[key] = frozenset(gap.name for gap in gaps)
        return goes

    def _is_room(self, line: Line, distance: float, half: float, ego: Ego) -> bool:
        """Whether there will be room, and no vehicle will have to brake hard; as `_blocking`."""
        return next(self._blocking(line, distance, half, ego), None) is None

    def _is_cut_off(self, line: Line, distance: float, half: float, ego: Ego) -> bool:
        """Whether a member that goes on with its change and a vehicle on the lanes that it crosses must touch.

        That vehicle has come since the change began: SUMO has inserted it, or it has come over from the other side.
        """
        return any(map(_cuts_off, self._gaps(line, distance, half, ego)))

    def _blocking(self, line: Line, distance: float, half: float, ego: Ego) -> Iterator[Gap]:
        """The gaps to vehicles that leave no room, or would have to brake hard; as `_gaps`."""
        return (gap for gap in self._gaps(line, distance, half, ego) if not _leaves_room(gap, ego))

    def _gaps(self, line: Line, distance: float, half: float, ego: Ego) -> Iterator[Gap]:
        """The gaps to vehicles on the lanes that are crossed.

        half : distance after which half of the member is over there: until then SUMO's drivers do not see it [m]
        """
        pace = Pace(ego.speed, *CHANGING_PACE)
        time = pace.time_for(half)
        later, to_end = pace.speed_after(time), distance + line.to_end
        foes = chain.from_iterable(self._on_adjacent(one.onto, to_end, ego.id) for one in _crossed(line))
        for name, foe_to_end in foes:
            if self._waits_for(name, line, distance, ego):
                continue
            ahead, foe_speed = self._ahead(name, to_end - foe_to_end, ego), self._now.speed[name]
            if ahead >= 0:
                gap = ahead - self._now.length[name]
                closing, rear_speed = max(ego.speed - foe_speed, 0.0), ego.speed
            else:
                gap = -ahead - ego.length - foe_speed * time + half
                closing, rear_speed = max(foe_speed - later, 0.0), foe_speed
            yield Gap(name, ahead >= 0, gap, rear_speed, closing)

    def _ahead(self, name: str, along: float, ego: Ego) -> float:
        """How far the front of another vehicle is ahead of the own one [m].

        Lanes side by side have the same length for SUMO, and do not in a bend: by that, vehicles that drive abreast can
        be 7 m apart.

        along: the same by their distances from the ends of their lanes [m]
        """
        if abs(along) > BY_PLACES:
            return along
        front, angle = self._now.front, self._now.angle
        if cos(radians(angle[name] - angle[ego.id])) < cos(radians(SAME_WAY)):
            return along
        (x, y), (its_x, its_y), heading = front[ego.id], front[name], radians(90.0 - angle[ego.id])
        return (its_x - x) * cos(heading) + (its_y - y) * sin(heading)

    def _falls_back(self, line: Line, distance: float, ego: Ego) -> float:
        """Distance within which a vehicle brakes to fall back behind another one, which must come to its lane [m].

        The other one is beside it, a little ahead, near the end of both lanes. Side by side there neither could change
        lanes. inf: there is none, or the vehicle is too slow to get behind it.
        """
        if distance + line.to_end > SWAPS_WITHIN * ego.size or ego.speed < FALLS_BACK_FROM:
            return inf
        now, side = self._now, _side(line.onto, line.lane)
        for name in now.on_lane[line.onto]:  # the last one first
            front = distance + line.to_end - (now.lane_length[line.onto] - now.position[name])
            if front >= 0:
                closing = max(ego.speed - now.speed[name], 0.0)
                has_room = front - now.length[name] >= room_needed(ego.length, ego.speed, closing)
                to_left = next((plan[PLAN_OFFSET] for plan in now.best_lanes[name] if plan[PLAN_LANE] == line.onto), 0)
                return inf if has_room or to_left * side <= 0 else ego.speed**2 / (2 * SWAP_BRAKING)
        return inf

    def _waits_for(self, name: str, line: Line, distance: float, ego: Ego) -> bool:
        """Whether another member goes over to the same lane, from its other side, and lets this one go first."""
        if distance >= 0 or name not in self._over.get(line.onto, ()):
            return False
        return (self._now.position[name], name) < (self._now.position[ego.id], ego.id)

    def _queue_within(self, line: Line, distance: float, ego: Ego) -> bool:
        """Whether a vehicle stands where it is in the way of the lane change.

        On the own lane that is before the vehicle has left it, on the other one before the end of the lane change.
        """
        now = self._now
        begin = self._begin(line)
        leaves, stands = begin + line.across, QUEUE_STANDS * ego.size
        end = leaves + OWN_GAP * ego.size
        for lane, until in ((line.lane, leaves), (line.onto, end)):
            for name in now.on_lane[lane]:
                if name != ego.id and now.speed[name] < stands:
                    position = now.position[name]
                    if position > begin - distance and position - now.length[name] < until:
                        return True
        return False

    def _on_adjacent(self, onto: str, own_to_end: float, own: str) -> Iterator[tuple[str, float]]:
        """Vehicles on the adjacent lane and lanes that lead to it, and the distance of each to its end [m].

        Members that go over to a lane count as being on it.

        Of those behind only the first one on each lane, and on lanes that lead there only if there is none: the others
        follow it. They do not follow one that has only begun to go over: they pass it.

        own_to_end: distance of the own front bumper to the end of the adjacent lane [m]
        own       : the own id; SUMO may have that vehicle on the adjacent lane, and a little farther back
        """
        now = self._now
        if onto not in self._adjacent:
            reach = now.lane_length[onto] + COMES_WITHIN * now.max_speed[onto]
            self._adjacent[onto] = tuple(self._network.upstream(onto, reach))
        for name, beyond in self._adjacent[onto]:
            to_ends, on_lane = beyond + now.lane_length[name], now.on_lane[name]
            there = on_lane
            if over := self._over.get(name):
                there = sorted({*on_lane, *over}, key=lambda one: (now.position[one], one))
            for vehicle in reversed(there):
                if vehicle == own:
                    continue
                to_end = to_ends - now.position[vehicle]
                yield vehicle, to_end
                if to_end > own_to_end and (not over or vehicle in on_lane):
                    if name == onto:
                        return
                    break


def from_here(line: Line, distance: float) -> Line:
    """A lane change that begins at the vehicle's front, instead of at a distance from that [m]."""
    return line._replace(to_end=distance + line.to_end)


def _leaves_room(gap: Gap, ego: Ego) -> bool:
    return gap.room >= room_needed(ego.length, gap.rear_speed, gap.closing)


def _cuts_off(gap: Gap) -> bool:
    """Whether the one in the rear cannot help touching the other one."""
    return gap.room < gap.closing**2 / (2 * COMFORTABLE_BRAKING)


def _side(lane: str, other: str) -> int:
    """Where another lane of an edge lies: 1 to the left, -1 to the right."""
    return 1 if index_of(other) > index_of(lane) else -1


def _crossed(line: Line) -> list[Line]:
    """A lane change by each lane that it leads onto: one that is not for cars may lie between."""
    here, there = index_of(line.lane), index_of(line.onto)
    if abs(there - here) == 1:
        return [line]
    step = 1 if there > here else -1
    return [line._replace(onto=f"{edge_of(line.lane)}_{k}") for k in range(here + step, there + step, step)]
