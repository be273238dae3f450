"""The SUMO world, in process: the only module that talks to libsumo, with `stoplines`, which is given it.

SUMO's frame, degrees clockwise from north and the middle of the front bumper, exists in this file only. What the calls
rely on was found by experiment with SUMO 1.28 and is kept by tests/test_sumo.py.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, compress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely

from platoontraffic.controllers import Signals
from platoontraffic.errors import InputError, RunError
from platoontraffic.lidar import Boxes
from platoontraffic.lidar.compiled import compiler
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.sumo.stoplines import COMFORTABLE_BRAKING, REACTION, StopLines
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import CLOSING, Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot

# Of a pyarrow that it finds libsumo prints at import, into what users read; `doctor` tells of it.
_was = os.environ.get("LIBSUMO_AS_TRACI")
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo  # noqa: E402

os.environ.pop("LIBSUMO_AS_TRACI")
if _was is not None:  # traci goes by it
    os.environ["LIBSUMO_AS_TRACI"] = _was

# keepRoute 2: the exact pose, on whatever lane lies there, never an error. 5 m, where the search for a lane ends,
# makes the call four times cheaper than the default 100 m and finds the same lanes.
KEEP_ROUTE = 2
MATCH_THRESHOLD = 5.0
ANYWHERE = ("", -1)

ALL_OFF = 32  # speed mode: SUMO believes the speed that follows from the displacement
NO_LANE_CHANGE = 0

ROOM = 1.0  # of their own length is free before and behind members when they are deployed
BESIDE = 0.5  # and this, of both sides together [m]

PERSON = "person."  # before the names of SUMO's pedestrians

FAR_FOR = 0.5  # so long who is far from all members is not looked at [s]

compiled = compiler(__file__)

_in_process = libsumo
_running: list[Path] = []  # libsumo holds one simulation a process; a second start would replace the first in silence


def sumo_angle(heading):
    """Heading (counter-clockwise from east [rad]) as SUMO's angle (clockwise from north [deg], in [0, 360))."""
    return (90.0 - np.degrees(heading)) % 360.0


def heading_of(angle):
    """SUMO's angle as heading in (-pi, pi]; the inverse of `sumo_angle`."""
    return wrap(np.radians(90.0 - angle))


def front_of(x, y, heading, length):
    """Middle of the front bumper, SUMO's position, of a vehicle with its centre at x, y."""
    return x + length / 2 * np.cos(heading), y + length / 2 * np.sin(heading)


def centre_of(x, y, heading, length):
    """Centre of a vehicle with its front bumper at x, y; the inverse of `front_of`."""
    return x - length / 2 * np.cos(heading), y - length / 2 * np.sin(heading)


class World:
    """SUMO from start to close: a context manager. Steps are `step` seconds long (whole milliseconds).

    words   : the file that everything SUMO says goes to
    options : what else SUMO is told: files to read and to write
    warm_up : seconds of background traffic before the members come
    client  : what has the functions of the module libsumo, to be used in its place
    """

    def __init__(
        self,
        network: Network,
        step: float,
        seed: int,
        words: Path,
        options: Mapping[str, str] = MappingProxyType({}),
        warm_up: float = 0.0,
        client: Any = None,
    ) -> None:
        self._network, self._words, self._step, self._warm_up = network, words, step, warm_up
        self._client = client
        self._options = [
            "sumo",
            *("--step-length", str(step), "--seed", str(seed)),
            *("--time-to-teleport", "-1", "--collision.action", "warn", "--collision.check-junctions", "true"),
            *("--collision.mingap-factor", "0", "--emergencydecel.warning-threshold", "1000000"),
            *("--no-step-log", "true", "--duration-log.disable", "true", "--precision", "6"),
        ]
        for option, value in {"net-file": str(network.path), **options}.items():
            self._options += [f"--{option}", value]
        self._start = 0.0  # SUMO's time when the members stood at their start poses
        self._later: list[Fleet] = []  # platoons that depart later, the next one first
        self._roads: dict[str, tuple[str, str]] = {}  # edge and lane of each member
        self._entered: list[
            tuple[str, str, str]
        ] = []  # members that have entered a junction: from which lane, on which
        self._leg: dict[str, int] = {}  # how far on its route each member is, as an index of edges
        self._routed: dict[str, tuple[str, Route | None]] = {}  # from which edge on each one's route was last set
        self._slowed: set[str] = set()  # members that SUMO drives, and whose drive is broken
        self._sizes: dict[str, tuple[float, float]] = {}  # length, width of SUMO's own vehicles
        self._far: set[str] = set()  # see _others
        self._far_from: tuple[Member, ...] = ()
        self._far_until = -np.inf  # SUMO's time
        self._near: list[str] | None = None  # the others; None once somebody has come or gone
        self._expected = 0  # how many vehicles are on the road or due
        self._obstacles: TrafficSnapshot | None = None  # see hold
        self._ways: dict[str, tuple[str, ...]] = {}  # of those of them that SUMO has, the edges that they mean to drive

    def __enter__(self) -> World:
        if _running:
            raise RunError(f"SUMO already runs {_running[0]} in this process; libsumo holds one simulation a process")
        global libsumo  # there is one simulation a process, whoever runs it
        libsumo = self._client or _in_process
        self._log = self._words.open("ab")
        try:
            with self._listening():
                libsumo.start(self._options)
        except libsumo.TraCIException as error:
            self._log.close()
            raise InputError(f"{self._network.path}: SUMO refuses it: {self._reason(error)}") from error
        _running.append(self._network.path)
        self._lines = StopLines(self._network, libsumo)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        _running.clear()
        died = isinstance(error, libsumo.TraCIException | libsumo.FatalTraCIError)
        when = "its end"
        if died:
            with contextlib.suppress(libsumo.FatalTraCIError):  # a window is another process
                when = f"{libsumo.simulation.getTime():g} s"
        with self._listening():
            libsumo.close()
        self._log.close()
        if died:
            raise RunError(f"SUMO failed at {when}: {self._reason(error)}") from error

    def deploy(self, fleet: Fleet, later: Sequence[Fleet] = ()) -> Fleet:
        """Insert all members at their start poses and take the wheel; this is time 0.

        Background vehicles that are in their way there are taken out: a platoon does not come in by driving. Those that
        depart `later` wait for room: see `advance`.
        """
        self._later = sorted(later, key=lambda platoon: platoon.members[0].departs)
        with self._listening():
            if self._warm_up:
                libsumo.simulationStep(libsumo.simulation.getTime() + self._warm_up)
        self._insert(fleet)
        self._simulate()
        for name in self._in_the_way(fleet, fleet):
            if not name.startswith(PERSON):
                libsumo.vehicle.remove(name)
        self.place(fleet)
        self._simulate()
        self._start = libsumo.simulation.getTime()
        return self._taken_over(fleet)

    @property
    def waiting(self) -> Sequence[Fleet]:
        """Platoons that have not yet departed."""
        return self._later

    def snapshot(self, fleet: Fleet, reach: float = np.inf) -> TrafficSnapshot:
        """The vehicles at this instant; the members as the fleet knows them, the others as SUMO does.

        reach: from a member's centre [m]; others may be left out of which nothing is within it
        """
        others = self._others(fleet, reach)
        n, vehicle = len(others), libsumo.vehicle
        # Thousands in every step: numbers go from the calls into the arrays without lists between them.
        length, width = np.fromiter(chain.from_iterable(map(self._size, others)), float, 2 * n).reshape(-1, 2).T
        front = _fronts(others)
        heading = heading_of(np.fromiter(map(vehicle.getAngle, others), float, n))
        x, y = centre_of(*front.T, heading, length)
        speed = np.fromiter(map(vehicle.getSpeed, others), float, n)
        own = fleet.motion
        traffic = TrafficSnapshot(
            round(libsumo.simulation.getTime() - self._start, 6),
            (*(m.id for m in fleet.members), *others),
            np.concatenate([own.x, x]),
            np.concatenate([own.y, y]),
            np.concatenate([own.heading, heading]),
            np.concatenate([own.speed, speed]),
            np.concatenate([fleet.model.length, length]),
            np.concatenate([fleet.model.width, width]),
        )
        if libsumo.person.getIDCount():
            traffic = traffic.with_others(self._people(fleet, reach))
        return traffic.with_others(self._obstacles) if self._obstacles and self._obstacles.ids else traffic

    def _people(self, fleet: Fleet, reach: float) -> TrafficSnapshot:
        """SUMO's own pedestrians, who sit in no vehicle, as others; they may have the names of vehicles."""
        person = libsumo.person
        names = [name for name in person.getIDList() if not person.getVehicle(name)]
        front = np.array([person.getPosition(name) for name in names]).reshape(-1, 2)
        if reach < np.inf:
            near = ~_far(front, fleet.motion.x, fleet.motion.y, np.full(len(names), reach + 1.0))
            names, front = list(compress(names, near)), front[near]
        heading = heading_of(np.array([person.getAngle(name) for name in names]))
        length, width = (np.array(list(map(get, names)), float) for get in (person.getLength, person.getWidth))
        x, y = centre_of(*front.T, heading, length)
        speed = np.array(list(map(person.getSpeed, names)), float)
        return TrafficSnapshot(0.0, tuple(PERSON + name for name in names), x, y, heading, speed, length, width)

    def hold(self, obstacles: TrafficSnapshot, ways: Mapping[str, tuple[str, ...]]) -> None:
        """What else is on the road, at the end of the coming step, or now if none has been made.

        SUMO has each that `ways` names as a vehicle of its size, for its own drivers to see, put where it is in every
        step, while its middle is on the road; with the edges that it means to drive, if there are any. Who of them
        stands where one comes up is taken out.
        """
        vehicle = libsumo.vehicle
        if not obstacles.ids and not self._ways:
            self._obstacles = None
            return
        on_road = shapely.contains_xy(self._network.drivable, obstacles.x, obstacles.y)
        ways = {name: ways[name] for name in compress(obstacles.ids, on_road) if name in ways}
        for name in sorted(self._ways.keys() - ways.keys()):
            vehicle.remove(name)
            del self._ways[name]
            self._routed.pop(name, None)
        self._obstacles = obstacles
        x, y = front_of(obstacles.x, obstacles.y, obstacles.heading, obstacles.length)
        angle = sumo_angle(obstacles.heading)
        for i, name in enumerate(obstacles.ids):
            if name not in ways:
                continue
            if name not in self._ways:
                self._make_room(i)
                kind = f"platoontraffic.{name}"
                if kind not in libsumo.vehicletype.getIDList():
                    self._make_type(kind, float(obstacles.length[i]), float(obstacles.width[i]))
                    libsumo.vehicletype.setSpeedFactor(kind, 10)
                    libsumo.vehicletype.setMaxSpeed(kind, 150.0)
                vehicle.add(name, "", typeID=kind)  # on whatever edge it is then put
                vehicle.setSpeedMode(name, ALL_OFF)
                vehicle.setLaneChangeMode(name, NO_LANE_CHANGE)
                self._ways[name], self._far_until = ways[name], -np.inf
            vehicle.moveToXY(name, *ANYWHERE, float(x[i]), float(y[i]), float(angle[i]), KEEP_ROUTE, MATCH_THRESHOLD)

    def _make_room(self, i: int) -> None:
        """SUMO's own vehicles where an obstacle comes up are taken out."""
        names = [name for name in libsumo.vehicle.getIDList() if name not in self._roads and name not in self._ways]
        sizes = np.array([self._size(name) for name in names]).reshape(-1, 2)
        heading = heading_of(np.array([libsumo.vehicle.getAngle(name) for name in names]))
        x, y = centre_of(*_fronts(names).T, heading, sizes[:, 0])
        others = shapely.polygons(Boxes(x, y, heading, *sizes.T, np.arange(len(names))).corners())
        own = shapely.polygons(self._obstacles.boxes().corners()[i])
        for k in np.flatnonzero(shapely.intersects(others, own)):
            libsumo.vehicle.remove(names[k])

    def _settle_obstacles(self) -> None:
        """Their speeds and routes in SUMO set right, as of members."""
        if not self._ways:
            return
        vehicle, speeds = libsumo.vehicle, dict(zip(self._obstacles.ids, self._obstacles.speed.tolist(), strict=True))
        for name, way in self._ways.items():
            if not vehicle.getLaneID(name):  # of one that never was on a lane, the next edge kills the process
                continue
            vehicle.setPreviousSpeed(name, speeds[name])
            edge = vehicle.getRoadID(name) if way else ""
            if edge not in way or self._routed.get(name) == (edge, None):
                continue
            if vehicle.getRoute(name)[vehicle.getRouteIndex(name)] == edge:
                vehicle.setRoute(name, list(way[way.index(edge) :]))
                self._routed[name] = edge, None

    def _others(self, fleet: Fleet, reach: float) -> list[str]:
        """SUMO's own vehicles, without most of those of which nothing is within reach of a member.

        Who is far away stays out of reach for a while, and is not asked where it is until then (a Verlet list). For the
        names of all, SUMO is asked then, and when somebody has come or gone.
        """
        if reach == np.inf:
            members = {m.id for m in fleet.members} | self._ways.keys()
            return [name for name in libsumo.vehicle.getIDList() if name not in members]
        time = libsumo.simulation.getTime()
        if time >= self._far_until or fleet.members is not self._far_from:
            others, own = self._others(fleet, np.inf), fleet.motion
            length = np.array([self._size(name)[0] for name in others])
            far = _far(_fronts(others), own.x, own.y, reach + 2 * length + FAR_FOR * CLOSING)
            self._far = {m.id for m in fleet.members} | self._ways.keys() | set(compress(others, far))
            self._far_from, self._far_until, self._near = fleet.members, time + FAR_FOR, None
        if self._near is None:
            self._near = [name for name in libsumo.vehicle.getIDList() if name not in self._far]
        return self._near

    def place(self, fleet: Fleet, brakes: np.ndarray | None = None) -> None:
        """Tell SUMO where every member is at the end of the coming step.

        brakes: what some are brought to a stand with [m/s2], (n,), NaN of others; those that SUMO drives, too
        """
        motion = fleet.motion
        x, y = front_of(motion.x, motion.y, motion.heading, fleet.model.length)
        angle = sumo_angle(motion.heading)
        if not (np.isfinite(x).all() and np.isfinite(y).all() and np.isfinite(angle).all()):  # SUMO would take a NaN
            raise RunError("a member's pose is not finite")
        poses = zip(fleet.members, fleet.native.tolist(), x.tolist(), y.tolist(), angle.tolist(), strict=True)
        for member, native, *pose in poses:
            if not native:
                libsumo.vehicle.moveToXY(member.id, *ANYWHERE, *pose, KEEP_ROUTE, MATCH_THRESHOLD)
        slowed = set()
        for i in () if brakes is None else np.flatnonzero(fleet.native & ~np.isnan(brakes)):
            libsumo.vehicle.setSpeed(fleet.members[i].id, max(float(motion.speed[i] - brakes[i] * self._step), 0.0))
            slowed.add(fleet.members[i].id)
        for member in fleet.members if self._slowed else ():
            if member.id in self._slowed - slowed:
                libsumo.vehicle.setSpeed(member.id, -1)  # its own driver's again
        self._slowed = slowed

    def advance(self, fleet: Fleet) -> Fleet:
        """One step of SUMO: the fleet after it, its speeds and routes set right again.

        Who has come to the end of its route is taken out, and with a leader those who follow it and know no route. A
        platoon that is due comes in as soon as there is room.
        """
        due: list[Fleet] = []
        for platoon in filter(self._is_due, self._later):
            begun = {(m.edge, m.lane) for other in due for m in other.members}  # a lane takes one platoon a step
            if (platoon.members[0].edge, platoon.members[0].lane) in begun or self._in_the_way(platoon, fleet):
                continue
            self._insert(platoon)
            due.append(platoon)
        gone = fleet.arrived()
        native = {fleet.members[i].id for i in np.flatnonzero(fleet.native)}
        self._simulate()
        out = {*libsumo.simulation.getArrivedIDList()} & native
        gone |= out
        heads = fleet.heads()
        gone |= {
            member.id
            for member, head in zip(fleet.members, heads.tolist(), strict=True)
            if fleet.members[head].id in gone and not member.arrives_alone
        }
        for name in sorted(gone - out):
            libsumo.vehicle.remove(name, libsumo.constants.REMOVE_ARRIVED)
        fleet = fleet.without(gone)
        self._locate(fleet)
        self._put_in_order(fleet)
        self._settle_obstacles()
        fleet = self._read_native(self._settled(fleet))
        for platoon in due:
            self._later.remove(platoon)
            fleet = fleet.joined(self._taken_over(platoon))
        return fleet

    def _taken_over(self, platoon: Fleet) -> Fleet:
        """Members whom SUMO has just inserted; from now on they are driven from here, or read."""
        missing = {m.id for m in platoon.members} - set(libsumo.vehicle.getIDList())
        if missing:
            raise RunError(f"SUMO did not insert {', '.join(sorted(missing))}; its words are in {self._words.name}")
        behind = np.isin(np.arange(len(platoon)), platoon.predecessor)
        for i, (member, native) in enumerate(zip(platoon.members, platoon.native, strict=True)):
            if not native:
                libsumo.vehicle.setSpeedMode(member.id, ALL_OFF)
                libsumo.vehicle.setLaneChangeMode(member.id, NO_LANE_CHANGE)
            elif behind[i]:
                libsumo.vehicle.setParameter(member.id, "laneChangeModel.lcKeepRight", "0")
        self._locate(platoon)
        return self._read_native(self._settled(platoon))

    def _is_due(self, platoon: Fleet) -> bool:
        """Whether it is to stand there at the end of the coming step."""
        time = libsumo.simulation.getTime() - self._start + self._step
        return platoon.members[0].departs < time + self._step / 2

    def _in_the_way(self, platoon: Fleet, fleet: Fleet) -> list[str]:
        """Vehicles near where it is to stand, and those on its lane that could not brake for it, or it for them."""
        traffic, here = self.snapshot(fleet), self.snapshot(platoon)
        own, n = {m.id for m in platoon.members}, len(platoon)
        room = replace(here, length=here.length * (1 + 2 * ROOM), width=here.width + BESIDE)
        places = shapely.polygons(room.boxes().corners()[:n])
        rows = np.flatnonzero(platoon.predecessor >= 0)
        between = shapely.convex_hull(shapely.union(places[rows], places[platoon.predecessor[rows]]))
        places = np.concatenate([places, between])
        others = shapely.STRtree(shapely.polygons(traffic.boxes().corners()))
        found = {traffic.ids[row] for row in others.query(places, predicate="intersects")[1]}
        behind = set(platoon.predecessor[platoon.predecessor >= 0].tolist())
        for i, member in enumerate(platoon.members):
            for name in libsumo.lane.getLastStepVehicleIDs(f"{member.edge}_{member.lane}"):
                front, speed = libsumo.vehicle.getLanePosition(name), libsumo.vehicle.getSpeed(name)
                if i not in behind and front < member.position:  # the last one, and who comes up behind it
                    gap, closing = member.position - member.model.length - front, speed - member.speed
                elif member.place == 0 and front > member.position:
                    gap, closing = front - libsumo.vehicle.getLength(name) - member.position, member.speed - speed
                else:
                    continue
                closing = max(closing, 0.0)
                if gap < closing * REACTION + closing**2 / (2 * COMFORTABLE_BRAKING):
                    found.add(name)
        return sorted(found - own)

    def _read_native(self, fleet: Fleet) -> Fleet:
        """The fleet with the poses of those members that SUMO drives."""
        rows = np.flatnonzero(fleet.native)
        if not len(rows):
            return fleet
        names = [fleet.members[i].id for i in rows]
        front = np.array([libsumo.vehicle.getPosition(name) for name in names])
        heading = heading_of(np.array([libsumo.vehicle.getAngle(name) for name in names]))
        speed = np.array([libsumo.vehicle.getSpeed(name) for name in names])
        return fleet.driven(rows, *centre_of(*front.T, heading, fleet.model.length[rows]), heading, speed, self._step)

    def roads(self, fleet: Fleet) -> list[tuple[str, str]]:
        """Edge and lane that SUMO has each member on since the last step; the lane is "" off the road."""
        return [self._roads[m.id] for m in fleet.members]

    def _locate(self, fleet: Fleet) -> None:
        names = [m.id for m in fleet.members]
        roads, lanes = map(libsumo.vehicle.getRoadID, names), list(map(libsumo.vehicle.getLaneID, names))
        for name, lane in zip(names, lanes, strict=True):
            if lane[:1] == ":" and (before := self._roads.get(name, ("", ""))[1]) and before[0] != ":":
                self._entered.append((name, before, lane))
        self._roads.update(zip(names, zip(roads, lanes, strict=True), strict=True))

    def signals(self, fleet: Fleet) -> Signals | None:
        """The next line to stop at on the routes of those whose law asks for it."""
        return self._lines.signals(fleet, self._roads)

    def violations(self, fleet: Fleet) -> list[Noted]:
        """Who entered a junction in the last step that was closed to it, and from which lane."""
        entered, self._entered = self._entered, []
        return self._lines.violations(fleet, entered)

    def _insert(self, fleet: Fleet) -> None:
        """Onto their lanes; in the step after, `place` puts them to their start poses."""
        for member in fleet.members:
            self._add(member)
        # A vehicle must have been on a lane before it may stand where there is none, as in the outer corner of a bend;
        # and moving it onto one inserts it even where another waits at the same position.
        for member in fleet.members:
            x, y, heading = self._network.lane_pose(member.edge, member.lane, member.position)
            libsumo.vehicle.moveToXY(member.id, *ANYWHERE, x, y, sumo_angle(heading), KEEP_ROUTE, MATCH_THRESHOLD)

    def _add(self, member: Member) -> None:
        kind = f"platoontraffic.{member.id}"
        model = member.model
        self._make_type(kind, model.length, model.width)
        if member.law.native:
            libsumo.vehicletype.setSpeedFactor(kind, member.law.speed_factor)
            libsumo.vehicletype.setMaxSpeed(kind, min(member.law.max_speed, model.top_speed))
            libsumo.route.add(kind, self._onward(member, member.edge))
        else:
            # SUMO clips the speed it believes to lane limit x factor, and to the maximum of the type.
            libsumo.vehicletype.setSpeedFactor(kind, 10)
            libsumo.vehicletype.setMaxSpeed(kind, 1.5 * model.top_speed)
            libsumo.route.add(kind, [member.edge])
        libsumo.vehicle.add(
            member.id, kind, typeID=kind, depart="now", departLane=str(member.lane),
            departPos=str(member.position), departSpeed=str(member.speed),
        )  # fmt: skip

    def _make_type(self, kind: str, length: float, width: float) -> None:
        libsumo.vehicletype.copy("DEFAULT_VEHTYPE", kind)
        libsumo.vehicletype.setVehicleClass(kind, "passenger")  # a scenario may have made its own default
        libsumo.vehicletype.setLength(kind, length)
        libsumo.vehicletype.setWidth(kind, width)
        libsumo.vehicletype.setMinGap(kind, min(2.5, length / 2))
        libsumo.vehicletype.setSpeedDeviation(kind, 0)

    def _put_in_order(self, fleet: Fleet) -> None:
        """Where a member has passed another vehicle on one lane, set right in which order SUMO has them there.

        SUMO looks for a vehicle's place in a lane's order only when it enters the lane, and takes whoever is next in
        the order for the leader. So members leave the lane and enter it again, at once: nobody sees them elsewhere.
        """
        vehicle = libsumo.vehicle
        members: dict[str, list[str]] = {}  # by lane
        for member, native in zip(fleet.members, fleet.native, strict=True):
            if not native and (lane := self._roads[member.id][1]):
                members.setdefault(lane, []).append(member.id)
        for lane, names in members.items():
            order = libsumo.lane.getLastStepVehicleIDs(lane)
            positions = list(map(vehicle.getLanePosition, order))
            if positions == sorted(positions):
                continue
            position = dict(zip(order, positions, strict=True))
            away = {name: aside for name in names if (aside := _another_lane(name, lane))}
            for name, aside in away.items():
                vehicle.moveTo(name, aside, 0.0)
            for name in away:
                vehicle.moveTo(name, lane, position[name])

    def _settled(self, fleet: Fleet) -> Fleet:
        """The same fleet, its speeds and routes in SUMO set right."""
        vehicle = libsumo.vehicle
        speeds, natives = fleet.motion.speed.tolist(), fleet.native.tolist()
        for member, speed, native in zip(fleet.members, speeds, natives, strict=True):
            if native and not member.route.closed:  # it keeps to the route that it was given
                continue
            if not native:
                # The speed SUMO derives is wrong where a lane's length is not that of the path driven: at corners.
                vehicle.setPreviousSpeed(member.id, abs(speed))
            edge = self._roads[member.id][0]
            if self._routed.get(member.id) == (edge, member.route) or edge not in self._network.edges:  # a junction
                continue
            if vehicle.getRoute(member.id)[vehicle.getRouteIndex(member.id)] != edge:
                continue  # for a few steps after a junction SUMO still counts it to the edge before
            # Other drivers judge right of way by the route, which leaving it has replaced.
            if self._routed.get(member.id, ("", member.route))[1] is not member.route:
                self._leg.pop(member.id, None)
            vehicle.setRoute(member.id, self._onward(member, edge))
            self._routed[member.id] = edge, member.route
        return fleet

    def _onward(self, member: Member, edge: str) -> list[str]:
        """The intended edges from this one; for a law that goes where it likes, the straightest."""
        edges = member.route.edges if member.route else ()
        if edge not in edges:
            return list(self._network.onward(edge))
        leg = self._leg.get(member.id, 0)
        # The next visit of an edge that the route uses more than once.
        here = edges.index(edge, leg) if edge in edges[leg:] else edges.index(edge)
        self._leg[member.id] = here
        return [*edges[here:], *(edges[:here] if member.route.closed else ())]

    def _size(self, name: str) -> tuple[float, float]:
        if name not in self._sizes:
            self._sizes[name] = libsumo.vehicle.getLength(name), libsumo.vehicle.getWidth(name)
        return self._sizes[name]

    def _simulate(self) -> None:
        with self._listening():
            libsumo.simulationStep()
        simulation, expected = libsumo.simulation, libsumo.simulation.getMinExpectedNumber()
        came = simulation.getDepartedNumber() + simulation.getEndingTeleportNumber()
        went = simulation.getArrivedNumber() + simulation.getStartingTeleportNumber()
        if came or went or expected != self._expected:
            self._near = None
        self._expected = expected

    def _reason(self, error: Exception) -> str:
        """SUMO's own first error; what it raises is often only 'Process Error'."""
        said = self._words.read_text(errors="replace")
        errors = re.findall(r"^Error: *(.+(?:\n .+)*)", said, re.MULTILINE)  # what belongs to it is indented
        return " ".join(errors[0].split()) if errors else str(error)

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        """SUMO prints from C++ to file descriptor 2, past Python's stderr: into the file of its words."""
        sys.stderr.flush()
        kept = os.dup(2)
        os.dup2(self._log.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _fronts(names: Sequence[str]) -> np.ndarray:
    """Positions (n, 2) of vehicles, as SUMO has them."""
    numbers = chain.from_iterable(map(libsumo.vehicle.getPosition, names))
    return np.fromiter(numbers, float, 2 * len(names)).reshape(-1, 2)


@compiled
def _far(points, x, y, reach):
    """Which of points (n, 2) are farther than their reach (n,) from all x, y."""
    far = np.ones(len(points), np.bool_)
    for i in range(len(points)):
        for k in range(len(x)):
            dx, dy = points[i, 0] - x[k], points[i, 1] - y[k]
            if dx * dx + dy * dy <= reach[i] * reach[i]:
                far[i] = False
                break
    return far


def _another_lane(name: str, lane: str) -> str:
    """A lane beside a vehicle's own, or of the next or previous edge of its route; "" if there is neither."""
    edge, _, index = lane.rpartition("_")
    if libsumo.edge.getLaneNumber(edge) > 1:
        return f"{edge}_{int(index == '0')}"
    route, here = libsumo.vehicle.getRoute(name), libsumo.vehicle.getRouteIndex(name)
    return next((f"{other}_0" for other in (*route[here + 1 : here + 2], *route[max(here - 1, 0) : here])), "")
