"""What drivers are told of the lines ahead of them, as SUMO has it: lights, right of way, room beside and beyond."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers import CLOSED_BY, Signals
from platoontraffic.road.gap_acceptance import ACCELERATION, MARGIN, STANDING, TURNING_SPEED, Foe, may_cross, time_for
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.road.network import Network
from platoontraffic.vehicles.motion import CAR_LENGTH, scale
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet, Member

LIGHT, RIGHT_OF_WAY, LANE_CHANGE, NO_ROOM = range(1, len(CLOSED_BY))
GO_FIRST = "GMO"  # states of links on which one gives way to nobody; o is a light that is off, or blinks

LOOKS = 3.6  # so long before it is there one judges a gap, at the speed of the fastest; and looks back beside [s]
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
    reach: float  # from so far before the junction one judges whether there is a gap [m]
    crossing: Mapping[str, tuple[str, str]]  # lanes in it that cross the way -> from which lane, on which one enters

    @classmethod
    def at(cls, line: Line, network: Network, sumo: Any) -> GoFirst:
        entering = {name for name in sumo.lane.getFoes(line.lane, line.onto) if not name.startswith(":")}
        inside = {}
        for via in line.via:
            for name in sumo.lane.getInternalFoes(via):
                if name not in line.via and network.entered_from.get(name) in entering:
                    inside[name] = bool(sumo.lane.getLinks(name)[0][4])
        fastest = max(map(sumo.lane.getMaxSpeed, entering), default=0.0)
        crossing = {}
        for name in {name for via in line.via for name in sumo.lane.getInternalFoes(via)} - set(line.via):
            before = network.entered_from.get(name)
            for link in sumo.lane.getLinks(before) if before else ():
                if name in _chain(link[4], sumo):
                    crossing[name] = before, link[4]
        watched = fastest * (time_for(line.across + CAR_LENGTH, 0.0) + MARGIN)
        entering = tuple(one for name in sorted(entering) for one in network.upstream(name, watched))
        return cls(entering, inside, LOOKS * fastest, dict(sorted(crossing.items())))


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
            row = self._signal(member, roads[member.id][1], station, speed, length)
            for values, value in zip(signals, row, strict=True):
                values[i] = value
        return signals

    def _signal(self, member: Member, here: str, station: float, speed: float, length: float) -> tuple:
        """One vehicle's row of `signals`; it is on the lane `here`, its front bumper at a station of its route.

        SUMO tells of links (getNextLinks) whether they are open, but for one who arrives at full speed, and always for
        a turn that may wait inside the junction; and nothing once one is inside. So the gaps are judged here.
        """
        passed, over = member.route.line_passed(station)
        if passed and (row := self._just_passed(member, passed, over, here, speed, length)):
            return row
        near = speed**2 / (2 * EARLY_BRAKING) + length
        ahead = member.route.lines_ahead(station, near)
        rows = [self._next(member, line, way, way < near, here, speed, length) for line, way in ahead]
        if not rows:
            return np.inf, True, False, False, 0
        _, is_open, minor, *_ = rows[0]
        return rows[0] if minor or not is_open else next((row for row in rows if not row[1]), rows[0])

    def _just_passed(self, member: Member, line: Line, over: float, here: str, speed: float, length: float):
        """Of who may stop yet beyond a line: midway in the junction, with the nose over it, or before it is beside."""
        if len(line.via) > 1 and here == line.via[0]:
            inside = self._sumo.lane.getLength(here)
            way = inside - self._sumo.vehicle.getLanePosition(member.id)
            is_open = self._may_cross(line, way, speed, length, across=line.across - inside)
            return way, is_open, False, False, RIGHT_OF_WAY
        if line.state == CHANGING:
            left = COMMITTED * line.across - over
            if left > 0 and here != line.onto and not self._may_change(member, line, -over, speed, length):
                return left, False, False, False, LANE_CHANGE
        elif here in line.via and self._state(line) not in GO_FIRST:
            left = OVER * scale(length) - over
            if speed**2 / (2 * EARLY_BRAKING) < left and not self._may_cross(line, -over, speed, length):
                return left, False, False, False, RIGHT_OF_WAY
        return None

    def _next(self, member: Member, line: Line, way: float, near: bool, here: str, speed: float, length: float):
        """Of a line ahead; near: so that one should know now whether one has to stop there."""
        if line.state == CHANGING:
            is_open = not near or here == line.onto or self._may_change(member, line, way, speed, length)
            return way, is_open, False, False, LANE_CHANGE
        state = self._state(line)
        minor, yellow = state in "mswo", state in "yY"
        if state in "ruyY":
            return way, False, minor, yellow, LIGHT
        is_open = True
        if state not in GO_FIRST and way < self._go_first(line).reach:
            is_open = self._may_cross(line, way, speed, length)
            if state in "sw":  # only who has stood there may go
                links = self._sumo.vehicle.getNextLinks(member.id)
                is_open &= bool(links) and links[0][2]
        if is_open and near and line.light and not self._is_cleared(line):
            return way, False, False, False, RIGHT_OF_WAY
        if is_open and near and not self._has_room(line, length):
            return way, False, False, False, NO_ROOM
        return way, is_open, minor, yellow, RIGHT_OF_WAY

    def _state(self, line: Line) -> str:
        if not line.light:
            return line.state
        return self._sumo.trafficlight.getRedYellowGreenState(line.light)[line.index]

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
            elif line and state not in GO_FIRST + "yY" and not self._may_cross(line, 0.0, speed, length, entered=True):
                found.append(Noted(i, "failed_to_yield", lane))
        return found

    def _may_change(self, member: Member, line: Line, way: float, speed: float, length: float) -> bool:
        """Whether there will be room on the lane beside, and nobody there have to brake hard.

        That is reckoned for when half of the member is over there, for until then SUMO's drivers do not see it.
        """
        half = way + line.across / 2
        time, top = time_for(half, speed), max(speed, TURNING_SPEED)
        later = min(math.sqrt(speed**2 + 2 * ACCELERATION * half), top)
        for name, foe_to_end in self._coming(line):
            if name == member.id:
                continue
            ahead, fast = way + line.to_end - foe_to_end, self._sumo.vehicle.getSpeed(name)
            if ahead >= 0:
                gap, closing, kept = ahead - self._sumo.vehicle.getLength(name), max(speed - fast, 0.0), speed
            else:
                gap, closing, kept = -ahead - length - fast * time + half, max(fast - later, 0.0), fast
            room = max(length / 2, CHANGE_HEADWAY * kept)
            if gap < room + closing * REACTION + closing**2 / (2 * COMFORTABLE_BRAKING):
                return False
        return True

    def _coming(self, line: Line) -> Iterator[tuple[str, float]]:
        """Vehicles on the lane beside and those that lead to it, and each one's way to its end [m]."""
        if line not in self._beside:
            reach = self._sumo.lane.getLength(line.onto) + LOOKS * self._sumo.lane.getMaxSpeed(line.onto)
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
        size = scale(length)
        last = next((k for k, name in enumerate(onto) if vehicle.getSpeed(name) < FLOWS * size), None)
        if last is None or not any(map(lane.getInternalFoes, line.via)):
            return True
        left = vehicle.getLanePosition(onto[last]) - vehicle.getLength(onto[last])
        before = [*onto[:last], *(name for via in line.via for name in lane.getLastStepVehicleIDs(via))]
        taken = sum(vehicle.getLength(name) + QUEUE_GAP * size for name in before)
        return left > taken + length + OWN_GAP * size

    def _go_first(self, line: Line) -> GoFirst:
        if line not in self._first:
            self._first[line] = GoFirst.at(line, self._network, self._sumo)
        return self._first[line]

    def _may_cross(
        self,
        line: Line,
        way: float,
        speed: float,
        length: float,
        *,
        across: float | None = None,
        entered: bool = False,
    ) -> bool:
        """Whether there is a gap among all those who go first, for a vehicle `way` metres before the junction.

        across : what is to be driven of it from there [m]; default: all
        entered: judges one who has just entered, by those who come, without margin
        """
        across = line.across if across is None else across
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
                Foe(way, way + across, to, end, vehicle.getSpeed(foe), vehicle.getLength(foe), hurries),
                speed,
                length,
                0.0 if entered else MARGIN,
            )
            for foe, to, end, hurries in foes
        )

    def _hurries(self, foe: str, to_line: float, is_open: bool) -> bool:
        """Whether a foe may come sooner than by its speed: one that drives, or that stands at a line just opened."""
        if self._sumo.vehicle.getSpeed(foe) >= STANDING:
            self._ready.pop((foe, ""), None)
            return is_open
        if not is_open or to_line > self._sumo.vehicle.getLength(foe):
            return False
        return not self._held_up(foe, "")

    def _held_up(self, foe: str, inside: str) -> bool:
        """Whether a foe stands where it might drive, at an open line or on a lane inside, for longer than it need."""
        if self._sumo.vehicle.getSpeed(foe) >= STANDING:
            self._ready.pop((foe, inside), None)
            return False
        time = self._sumo.simulation.getTime()
        since, last = self._ready.get((foe, inside), (time, time))
        since = since if time - last < SETS_OUT else time
        self._ready[foe, inside] = since, time
        return time - since > SETS_OUT
