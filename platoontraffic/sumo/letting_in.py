"""Vehicles that let another one in, which waits for room on their lane: a member, or one of SUMO's among members.

SUMO's driver brakes for a vehicle that must change to its lane and cannot. It does not brake for a moved vehicle, for
SUMO does not know that this one must change; beside a queue a member would wait without end. So the first vehicle that
can stop where it leaves room for the member does so: at once where the member's lane ends soon, as SUMO's drivers do,
else once the member has stood for `AFTER`. One that SUMO drives gets speeds from which it brakes by no more than
`BRAKING`; SUMO's driver model keeps it slower where it must, as always. Where the member drives on beside it, it does
not stop, but keeps so far behind that it could stop behind the member if both braked by that. A member is given a line
to stop at, for one of SUMO's too (`first_on_lanes`). A follower of a platoon lets in nobody but those of the platoon
that belong before it. Where the lane has just begun, the vehicle that lets in may be on a lane before, if all vehicles
there come to this one, and nobody crosses their path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from platoontraffic.road.gap_acceptance import STANDING
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.conflicts import RED
from platoontraffic.sumo.reads import Once
from platoontraffic.sumo.room_to_change import Wanted

AFTER = 3.0  # time that a vehicle has stood before it is let in, where that is not urgent [s]
LONGEST = 20.0  # time that one vehicle waits for another one to begin its lane change, ... [s]
GOES_OVER = 30.0  # ... for it to be over then, on its lane, where it is seen, ... [s]
LONGEST_IN_QUEUE = 300.0  # ... and beside that while the vehicle ahead of it stands, or its light is red [s]
FORGOTTEN = 60.0  # it waits anew for one that has not wanted room for so long [s]
GIVEN_UP = 1.0  # a vehicle that has not wanted room for so long does not change lanes any more [s]
IN_QUEUE = 6.0  # distance to a vehicle or red light, beyond a length of the other one, up to which there is no room [m]
BRAKING = 3.0  # of a vehicle that lets another one in [m/s2]
PAST = 1.0  # a vehicle with its front so far ahead of the other one's front lets that one in no longer [m]
LEAST, SPARE = 1.0, 1.0  # distance behind the other one's front: at least, and beyond what the lane change needs [m]
NEAR = 50.0  # distance from there up to which a member is asked to let one of SUMO's in [m]
OWN_DRIVER = -1  # argument of setSpeed: SUMO's driver model chooses the speed again


@dataclass
class Patience:
    """How long a vehicle still waits for another one [s]; over all lane changes of that one to the same edge."""

    begins: float = LONGEST
    goes_over: float = GOES_OVER
    in_queue: float = LONGEST_IN_QUEUE

    def has_any(self, begun: bool) -> bool:
        """begun: the lane change has"""
        return (self.goes_over if begun else self.begins) > 0

    def wait(self, step: float, begun: bool, in_queue: bool) -> None:
        """Wait for a step. in_queue: it could not drive on anyway"""
        if in_queue and self.in_queue > 0:
            self.in_queue -= step
        elif begun:
            self.goes_over -= step
        else:
            self.begins -= step


@dataclass
class Wish:
    """A vehicle's wish for room, and the patience that others have had with it."""

    wanted: Wanted
    last: float  # time at which it last wanted that [s]
    patience: dict[str, Patience] = field(default_factory=dict)


class Stop(NamedTuple):
    """Where a member lets another one in."""

    lane: str  # on which it is
    place: float  # on it, for its front [m]; beyond its end where that is on the next one
    speed: float = 0.0  # of that place [m/s]


class LettingIn:
    """Which vehicle waits for which other one.

    waiting : by the vehicle that is let in, the one that waits
    stops   : where each member stops that waits, by its id
    """

    def __init__(self, sumo: Client, step: float, network: Network | None = None) -> None:
        """network: None: only vehicles on the lane itself let in"""
        self._sumo, self._step, self._network = sumo, step, network
        self._lanes_to = Once(self._lanes_leading_to)
        self.waiting: dict[str, str] = {}
        self.stops: dict[str, Stop] = {}
        self._wishes: dict[str, Wish] = {}

    def observe(
        self,
        room_wanted: Mapping[str, Wanted],
        where: Mapping[str, tuple[str, str]],
        unwilling: Set[str] = frozenset(),
        places: Mapping[str, tuple[str, int]] = MappingProxyType({}),
    ) -> None:
        """Before every step.

        room_wanted : by each that wants in: `StopLines.room_wanted`, `FirstOnLanes.room_wanted`
        where       : edge and lane of each member
        unwilling   : vehicles that let nobody in
        places      : `Fleet.places`
        """

        def refuses(foe: str, name: str) -> bool:
            """A follower lets in only members of its own platoon that are to be ahead of it."""
            (platoon, place), (its_platoon, its_place) = places.get(foe, ("", 0)), places.get(name, ("", 0))
            return foe in unwilling or (place > 0 and not (its_platoon == platoon and its_place < place))

        stopped_before = dict(self.stops)
        self.stops.clear()
        if not room_wanted and not self._wishes:
            return
        time, vehicle = self._sumo.simulation.getTime(), self._sumo.vehicle
        self._wishes = {name: wish for name, wish in self._wishes.items() if time < wish.last + FORGOTTEN}
        for name, wanted in room_wanted.items():
            if name not in where and not self._is_on_road(name):
                continue
            wanted = wanted._replace(behind=max(wanted.behind + SPARE, LEAST))
            wish = self._wished(name, wanted, time)
            if name in self.waiting and wanted.lane != wish.wanted.lane:
                self._end(name, where)
            wish.wanted, wish.last = wanted, time
            if name not in self.waiting and (wanted.urgent or vehicle.getWaitingTime(name) >= AFTER - 1e-6):
                found = self._first(name, wish, where, refuses)
                if found is not None:
                    self.waiting[name] = found
        for name, foe in list(self.waiting.items()):
            if not self._is_on_road(foe) or refuses(foe, name):
                del self.waiting[name]
                continue
            if not self._is_on_road(name):
                self._end(name, where)
                continue
            own, wish = self._lane(name, where), self._wishes[name]
            wanted, patience = wish.wanted, wish.patience.setdefault(foe, Patience())
            patience.wait(self._step, wanted.begun, self._is_in_queue(foe, name, wanted.lane))
            has_gone_on = own and (own == wanted.lane or edge_of(own) != edge_of(wanted.lane))
            is_elsewhere = self._lane(foe, where) not in self._lanes_to[wanted.lane]
            is_given_up = is_elsewhere or time >= wish.last + GIVEN_UP or self._is_past(foe, name, wanted, where)
            if has_gone_on or is_given_up or not patience.has_any(wanted.begun):
                self._end(name, where)
            elif foe in where:
                if own:
                    self.stops[foe] = self._stop(foe, name, wanted, where)
                elif foe in stopped_before:  # to SUMO the other one is off the road, as on a lane for buses
                    self.stops[foe] = stopped_before[foe]
            else:
                self._hold(foe, name, wanted, where)

    def _is_in_queue(self, foe: str, name: str, lane: str) -> bool:
        """Whether a vehicle that waits could not drive on anyway.

        The next one on its lane stands close ahead, or a light there is red: at that the other one waits half over.
        """
        vehicle, column = self._sumo.vehicle, self._column(lane)
        close = vehicle.getLength(name) + IN_QUEUE
        if any(state in RED and distance < close for _, _, distance, state in vehicle.getNextTLS(foe)[:1]):
            return True
        names = [one for one, _ in column]
        if foe not in names[:-1]:
            return False
        (_, front), (ahead, its_front) = column[names.index(foe) :][:2]
        room = its_front - vehicle.getLength(ahead) - front
        return vehicle.getSpeed(ahead) < STANDING and room < close

    def _column(self, lane: str) -> list[tuple[str, float]]:
        """Vehicles on a lane, and on those that lead to it, the last one first, with the places of their fronts [m]."""
        position, on_lane = self._sumo.vehicle.getLanePosition, self._sumo.lane.getLastStepVehicleIDs
        lanes = reversed(self._lanes_to[lane].items())
        return [(name, begin + position(name)) for before, begin in lanes for name in on_lane(before)]

    def _lanes_leading_to(self, lane: str) -> dict[str, float]:
        """A lane, and those before it that lead to it alone, across nobody's path, by the places of their begins [m].

        Places are measured along the first lane, and negative before its begin.
        """
        begins, name = {lane: 0.0}, lane
        while self._network and begins[name] > -NEAR and (before := self._network.only_before(name)):
            if before in begins or self._is_crossed(before, name):
                break
            begins[before] = begins[name] - self._sumo.lane.getLength(before)
            name = before
        return begins

    def _is_crossed(self, before: str, onto: str) -> bool:
        """Whether others cross a lane inside a junction. From lane to lane, as in networks without these, they may."""
        if not before.startswith(":"):
            return not onto.startswith(":")
        return before in self._network.unregulated or bool(self._sumo.lane.getInternalFoes(before))

    def _is_past(self, foe: str, name: str, wanted: Wanted, where: Mapping[str, tuple[str, str]]) -> bool:
        """Whether a vehicle is ahead of the one that it was to let in: it could not stop, or did not stop in time."""
        if self._lane(foe, where) != wanted.lane or edge_of(self._lane(name, where)) != edge_of(wanted.lane):
            return False
        return self._sumo.vehicle.getLanePosition(foe) > self._front(name, wanted, where) + PAST

    def _is_on_road(self, vehicle: str) -> bool:
        try:
            return bool(self._sumo.vehicle.getRoadID(vehicle))
        except self._sumo.TraCIException:  # it has left the simulation
            return False

    def _wished(self, name: str, wanted: Wanted, time: float) -> Wish:
        """The wish of a vehicle, as it was until now; a new one where that was for another edge."""
        wish = self._wishes.get(name)
        if wish is None or edge_of(wish.wanted.lane) != edge_of(wanted.lane):
            wish = self._wishes[name] = Wish(wish.wanted if wish else wanted, time)
        return wish

    def _end(self, name: str, where: Mapping[str, tuple[str, str]]) -> None:
        """A vehicle is let in no longer."""
        if (foe := self.waiting.pop(name)) not in where and self._is_on_road(foe):
            self._sumo.vehicle.setSpeed(foe, OWN_DRIVER)

    def _first(
        self, name: str, wish: Wish, where: Mapping[str, tuple[str, str]], refuses: Callable[[str, str], bool]
    ) -> str | None:
        """The first vehicle on the wanted lane that can leave the room; for one of SUMO's only a member."""
        wanted = wish.wanted
        if edge_of(self._lane(name, where)) != edge_of(wanted.lane):
            return None
        front = self._front(name, wanted, where)
        before = front + _braking_distance(wanted.speed) - wanted.behind
        for foe, place in reversed(self._column(wanted.lane)):
            if name not in where and (foe not in where or place < before - NEAR):
                continue  # SUMO's let each other in
            patience = wish.patience.get(foe)
            is_patient = patience is None or patience.has_any(wanted.begun)
            if not refuses(foe, name) and place < front and self._can_stop(foe, before - place) and is_patient:
                return foe
        return None

    def _stop(self, foe: str, name: str, wanted: Wanted, where: Mapping[str, tuple[str, str]]) -> Stop:
        """Where a member is to stop on its lane: behind the other one's rear, or nearer where it cannot.

        Behind a vehicle that drives on, it follows that place.
        """
        front = self._front(name, wanted, where)
        rear = front - max(self._sumo.vehicle.getLength(name), wanted.behind)
        lane = self._lane(foe, where)
        begin = self._lanes_to[wanted.lane][lane]
        stops_there = not wanted.speed and self._can_stop(foe, rear - begin - self._sumo.vehicle.getLanePosition(foe))
        return Stop(lane, (rear if stops_there else front - wanted.behind) - begin, wanted.speed)

    def _can_stop(self, vehicle: str, room: float) -> bool:
        """Whether it can stop within some room [m]."""
        return _braking_distance(self._sumo.vehicle.getSpeed(vehicle)) <= room

    def _front(self, name: str, wanted: Wanted, where: Mapping[str, tuple[str, str]]) -> float:
        """Place of a vehicle's front beside the wanted lane [m]."""
        length = self._sumo.lane.getLength
        return self._sumo.vehicle.getLanePosition(name) + length(wanted.lane) - length(self._lane(name, where))

    def _lane(self, name: str, where: Mapping[str, tuple[str, str]]) -> str:
        return where[name][1] if name in where else self._sumo.vehicle.getLaneID(name)

    def _hold(self, foe: str, name: str, wanted: Wanted, where: Mapping[str, tuple[str, str]]) -> None:
        """Let a vehicle stop behind a member's rear, or nearer where it cannot; it does not follow the member then."""
        vehicle, lane = self._sumo.vehicle, self._sumo.vehicle.getLaneID(foe)
        if lane == wanted.lane or not self._lane(name, where):  # to SUMO the member is off the road
            (x, y), (its_x, its_y) = vehicle.getPosition(name), vehicle.getPosition(foe)
            course = math.radians(90 - vehicle.getAngle(foe))
            ahead = (x - its_x) * math.cos(course) + (y - its_y) * math.sin(course)
        else:
            begin = self._lanes_to[wanted.lane][lane]
            ahead = self._front(name, wanted, where) - begin - vehicle.getLanePosition(foe)
        ahead += _braking_distance(wanted.speed)
        speed, length = vehicle.getSpeed(foe), vehicle.getLength(name)
        room = ahead - max(length, wanted.behind)
        if room < _braking_distance(speed):
            room = ahead - wanted.behind if speed > STANDING else 0.0
        vehicle.setSpeed(foe, speed_to_stop(speed, room, BRAKING, self._step))


def _braking_distance(speed: float) -> float:
    return speed**2 / (2 * BRAKING)


def speed_to_stop(speed: float, room: float, braking: float, step: float) -> float:
    """Argument of setSpeed for a vehicle that is to stop within some room [m/s].

    That from which it stops after the coming step, as gently as it may brake; OWN_DRIVER where it is not that fast.

    room: [m], braking: [m/s2], step: of SUMO's [s]
    """
    fastest = braking * (math.sqrt(step**2 + 2 * max(room, 0.0) / braking) - step)
    gentlest = max(speed - braking * step, 0.0)
    return max(fastest, gentlest) if fastest < speed + braking * step else OWN_DRIVER
