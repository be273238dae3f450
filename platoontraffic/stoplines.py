"""What drivers are told of the lines ahead of them, as SUMO has it: lights, right of way, room beside and beyond."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers import CLOSED_BY, Signals
from platoontraffic.events import Noted
from platoontraffic.fleet import Fleet, Member
from platoontraffic.network import CHANGING, Line, Network
from platoontraffic.rightofway import ACCELERATION, MARGIN, STANDING, TURNING_SPEED, Foe, may_cross, time_for

LIGHT, RIGHT_OF_WAY, LANE_CHANGE, NO_ROOM = range(1, len(CLOSED_BY))

WATCHED = 3.6  # for those to give way to one looks as far as the fastest of them may drive in this time [s]
CHANGE_HEADWAY = 0.5  # that is left on the lane beside when one changes to it [s]
COMMITTED = 0.25  # so far over there, one does not stop again to let others pass
EARLY_BRAKING = 2.0  # so that one can stop by it, it is looked for room beside in time [m/s2]
OVER = 1.0  # so far over a line one may stop after all [m]
SETS_OUT = 3.0  # who stands so long at an open line is held up by something else [s]
FLOWS = 3.0  # slower is a queue, which those before it will come to stand behind [m/s]
QUEUE_GAP, OWN_GAP = 2.5, 4.0  # between those who stand in one, and that a member leaves [m]
REACTION, COMFORTABLE_BRAKING = 1.0, 4.5  # of SUMO's drivers: tau [s], decel [m/s2]


class GoFirst(NamedTuple):
    """Where those come from who go first at a line, and others whose way crosses that beyond it."""

    entering: tuple[tuple[str, float], ...]  # lanes, and the way from each one's end to the junction [m]
    inside: Mapping[str, bool]  # lanes in the junction that cross the way -> whether one waits at its end
    reach: float  # so far before the junction one looks for them, and from so far before it [m]
    crossing: Mapping[str, tuple[str, str]]  # lanes in it that cross the way -> from which lane, on which one enters

    @classmethod
    def at(cls, line: Line, network: Network, sumo: Any) -> GoFirst:
        entering = {name for name in sumo.lane.getFoes(line.lane, line.onto) if not name.startswith(":")}
        inside = {}
        for via in line.via:
            for name in sumo.lane.getInternalFoes(via):
                if name not in line.via and network.entered_from.get(name) in entering:
                    inside[name] = bool(sumo.lane.getLinks(name)[0][4])
        reach = WATCHED * max(map(sumo.lane.getMaxSpeed, entering), default=0.0)
        crossing = {}
        for name in {name for via in line.via for name in sumo.lane.getInternalFoes(via)} - set(line.via):
            before = network.entered_from.get(name)
            for link in sumo.lane.getLinks(before) if before else ():
                if name in _chain(link[4], sumo):
                    crossing[name] = before, link[4]
        entering = tuple(one for name in sorted(entering) for one in network.upstream(name, reach))
        return cls(entering, inside, reach, dict(sorted(crossing.items())))


def _chain(via: str, sumo: Any) -> list[str]:
    """The lanes inside a junction from one on."""
    lanes = []
    while via:
        lanes.append(via)
        via = next(iter(sumo.lane.getLinks(via)), ("",) * 5)[4]
    return lanes


class StopLines:
    """client: what has the functions of the module libsumo, of a simulation that runs"""

    def __init__(self, network: Network, client: Any) -> None:
        self._network, self._sumo = network, client
        self._first: dict[Line, GoFirst] = {}
        # Who stands at an open line ("") or on a lane inside a junction: since, and last seen so [s].
        self._ready: dict[tuple[str, str], tuple[float, float]] = {}
        self._beside: dict[Line, tuple[tuple[str, float], ...]] = {}  # lanes that lead to that which one changes to

    def signals(self, fleet: Fleet, roads: Mapping[str, tuple[str, str]]) -> Signals | None:
        """The next line to stop at on the routes of those whose law asks for it.

        roads: edge and lane of each member
        """
        n = len(fleet)
        signals = Signals(np.full(n, np.inf), np.ones(n, bool), *np.zeros((2, n), bool), np.zeros(n, int))
        asking = [i for i in fleet.routed if "signals" in getattr(fleet.members[i].law, "needs", ())]
        front = fleet.station + (fleet.model.length / 2 - fleet.model.axle)[fleet.routed]
        for i, station in zip(fleet.routed, front, strict=True):
            if i in asking:
                member, speed, length = fleet.members[i], fleet.motion.speed[i], fleet.model.length[i]
                row = self._signal(member, roads[member.id][1], station, speed, length)
                for values, value in zip(signals, row, strict=True):
                    values[i] = value
        return signals if asking else None

    def _signal(self, member: Member, here: str, station: float, speed: float, length: float) -> tuple:
        """One vehicle's row of `signals`; it is on the lane `here`.

        SUMO tells of links (getNextLinks) whether they are open, but for one who arrives at full speed, and always for
        a turn that may wait inside the junction; and nothing once one is inside. So the gaps are judged here.
        """
        passed, line, way = member.route.lines_about(station)
        if passed and len(passed.via) > 1 and here == passed.via[0]:  # where one may wait midway
            way = self._sumo.lane.getLength(here) - self._sumo.vehicle.getLanePosition(member.id)
            return way, self._may_cross(passed, way, speed, length), False, False, RIGHT_OF_WAY
        over = (station % member.route.length if member.route.closed else station) - passed.station if passed else 0.0
        if passed and passed.state == CHANGING:
            left = COMMITTED * passed.across - over
            if left > 0 and not self._may_change(member, passed, -over, speed, length):
                return left, False, False, False, LANE_CHANGE
        if passed and passed.via and here in passed.via:
            may_stop = speed**2 / (2 * EARLY_BRAKING) < OVER - over
            if passed.state not in "GMoO" and may_stop and not self._may_cross(passed, -over, speed, length):
                return OVER - over, False, False, False, RIGHT_OF_WAY
        if line is None:
            return np.inf, True, False, False, 0
        if line.state == CHANGING:
            near = way < speed**2 / (2 * EARLY_BRAKING) + length
            return way, not near or self._may_change(member, line, way, speed, length), False, False, LANE_CHANGE
        state = self._sumo.trafficlight.getRedYellowGreenState(line.light)[line.index] if line.light else line.state
        is_open = state not in "ruyY"
        if is_open and state not in "GMoO" and way < self._go_first(line).reach:
            is_open = self._may_cross(line, way, speed, length)
            if state in "sw":  # only who has stood there may go
                links = self._sumo.vehicle.getNextLinks(member.id)
                is_open &= bool(links) and links[0][2]
        near = way < speed**2 / (2 * EARLY_BRAKING) + length
        if is_open and near and line.light and not self._is_cleared(line):
            return way, False, False, False, RIGHT_OF_WAY
        if is_open and near and not self._has_room(line, length):
            return way, False, False, False, NO_ROOM
        return way, is_open, state in "msw", state in "yY", LIGHT if state in "ruyY" else RIGHT_OF_WAY

    def violations(self, fleet: Fleet, entered: Sequence[tuple[str, str, str]]) -> list[Noted]:
        """Who of those entered a junction that was closed to it: members, from which lane, on which inside."""
        found, row = [], {m.id: i for i, m in enumerate(fleet.members)} if entered else {}
        for name, lane, via in entered:
            state = next((link[5] for link in self._sumo.lane.getLinks(lane) if link[4] == via), "")
            i = row.get(name)
            if i is None or fleet.native[i] or not state:
                continue
            lines = fleet.members[i].route.lines if fleet.members[i].route else ()
            line = next((line for line in lines if line.lane == lane and line.via[:1] == (via,)), None)
            speed, length = fleet.motion.speed[i], fleet.model.length[i]
            if state in "ru":
                found.append(Noted(i, "red_light", lane))
            elif line and state not in "GMoOyY" and not self._may_cross(line, 0.0, speed, length, entered=True):
                found.append(Noted(i, "failed_to_yield", lane))
        return found

    def _may_change(self, member: Member, line: Line, way: float, speed: float, length: float) -> bool:
        """Whether there will be room on the lane beside, and nobody there have to brake hard.

        That is reckoned for when half of the member is over there, for until then SUMO's drivers do not see it.
        """
        half = way + line.across / 2
        time, top = time_for(half, speed), max(speed, TURNING_SPEED)
        later = min(math.sqrt(speed**2 + 2 * ACCELERATION * half), top)
        to_end = self._sumo.lane.getLength(line.lane) - self._sumo.vehicle.getLanePosition(member.id)
        for name, foe_to_end in self._coming(line):
            ahead, fast = to_end - foe_to_end, self._sumo.vehicle.getSpeed(name)
            if ahead >= 0 and fast >= speed:
                gap, closing = ahead - self._sumo.vehicle.getLength(name), 0.0
            elif ahead >= 0:
                gap, closing = ahead - self._sumo.vehicle.getLength(name), speed - fast
            else:
                gap, closing = -ahead - length - fast * time + half, max(fast - later, 0.0)
            room = max(length / 2, CHANGE_HEADWAY * (speed if ahead >= 0 else fast))
            if gap < room + closing * REACTION + closing**2 / (2 * COMFORTABLE_BRAKING):
                return False
        return True

    def _coming(self, line: Line) -> Iterator[tuple[str, float]]:
        """Vehicles on the lane beside and those that lead to it, and each one's way to its end [m]."""
        if line not in self._beside:
            reach = self._sumo.lane.getLength(line.onto) + WATCHED * self._sumo.lane.getMaxSpeed(line.onto)
            self._beside[line] = tuple(self._network.upstream(line.onto, reach))
        for lane, beyond in self._beside[line]:
            for name in self._sumo.lane.getLastStepVehicleIDs(lane):
                yield name, beyond + self._sumo.lane.getLength(lane) - self._sumo.vehicle.getLanePosition(name)

    def _is_cleared(self, line: Line) -> bool:
        """Whether those have left the junction who entered it before their own light became red."""
        lane = self._sumo.lane
        for name, (before, onto) in self._go_first(line).crossing.items():
            there = [foe for foe in lane.getLastStepVehicleIDs(name) if not self._held_up(foe, name)]
            if there and any(link[4] == onto and link[5] in "ru" for link in lane.getLinks(before)):
                return False
        return True

    def _has_room(self, line: Line, length: float) -> bool:
        """Whether one will not come to stand in a junction that others cross, for the queue behind it."""
        vehicle, lane = self._sumo.vehicle, self._sumo.lane
        onto = lane.getLastStepVehicleIDs(line.onto)  # the last one first
        last = next((k for k, name in enumerate(onto) if vehicle.getSpeed(name) < FLOWS), None)
        if last is None or not any(map(lane.getInternalFoes, line.via)):
            return True
        left = vehicle.getLanePosition(onto[last]) - vehicle.getLength(onto[last])
        before = [*onto[:last], *(name for via in line.via for name in lane.getLastStepVehicleIDs(via))]
        return left > sum(vehicle.getLength(name) + QUEUE_GAP for name in before) + length + OWN_GAP

    def _go_first(self, line: Line) -> GoFirst:
        if line not in self._first:
            self._first[line] = GoFirst.at(line, self._network, self._sumo)
        return self._first[line]

    def _may_cross(self, line: Line, way: float, speed: float, length: float, entered: bool = False) -> bool:
        """Whether there is a gap among all those who go first, for a vehicle `way` metres before the junction.

        entered: judges one who has just entered, by those who come, without margin
        """
        first = self._go_first(line)
        vehicle, lane = self._sumo.vehicle, self._sumo.lane
        foes = []
        for name, beyond in first.entering:
            for foe in lane.getLastStepVehicleIDs(name):
                to_line = beyond + lane.getLength(name) - vehicle.getLanePosition(foe)
                links = [link for link in vehicle.getNextLinks(foe)[:3] if link[4] in first.inside]
                if links and links[0][5] not in "ru":  # it goes that way, and is not stopped
                    hurries = not entered and self._hurries(foe, to_line, links[0][2])
                    foes.append((foe, to_line, to_line + max(links[0][7], line.across), hurries))
        for name, waits in () if entered else first.inside.items():
            for foe in lane.getLastStepVehicleIDs(name):
                left = lane.getLength(name) - vehicle.getLanePosition(foe)
                foes.append((foe, left if waits or self._held_up(foe, name) else 0.0, left, False))
        return all(
            may_cross(
                Foe(way, way + line.across, to, end, vehicle.getSpeed(foe), vehicle.getLength(foe), hurries),
                speed,
                length,
                0.0 if entered else MARGIN,
            )
            for foe, to, end, hurries in foes
        )

    def _hurries(self, foe: str, to_line: float, is_open: bool) -> bool:
        """Whether a foe may come sooner than by its speed: one that drives, or that stands at a line just opened."""
        if self._sumo.vehicle.getSpeed(foe) >= STANDING:
            return is_open
        if not is_open or to_line > self._sumo.vehicle.getLength(foe):
            return False
        return not self._held_up(foe, "")

    def _held_up(self, foe: str, inside: str) -> bool:
        """Whether a foe stands where it might drive, at an open line or on a lane inside, for longer than it need."""
        if self._sumo.vehicle.getSpeed(foe) >= STANDING:
            return False
        time = self._sumo.simulation.getTime()
        since, last = self._ready.get((foe, inside), (time, time))
        since = since if time - last < SETS_OUT else time
        self._ready[foe, inside] = since, time
        return time - since > SETS_OUT
