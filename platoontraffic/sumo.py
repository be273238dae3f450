"""The SUMO world, in process: the only module that talks to libsumo.

SUMO's frame, degrees clockwise from north and the middle of the front bumper, exists in this file only. What the calls
rely on was found by experiment with SUMO 1.28 and is kept by tests/test_sumo.py.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import libsumo
import numpy as np
import shapely

from lidar.pose import wrap
from platoontraffic.errors import InputError, RunError
from platoontraffic.fleet import Fleet, Member
from platoontraffic.network import Network
from platoontraffic.traffic import TrafficSnapshot

# keepRoute 2: the exact pose, on whatever lane lies there, never an error. 5 m, where the search for a lane ends,
# makes the call four times cheaper than the default 100 m and finds the same lanes.
KEEP_ROUTE = 2
MATCH_THRESHOLD = 5.0
ANYWHERE = ("", -1)

ALL_OFF = 32  # speed mode: SUMO believes the speed that follows from the displacement
NO_LANE_CHANGE = 0

ROOM = 1.0  # of their own length is free about members when they are deployed

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
    routes     : files of background traffic
    additional : what else SUMO is to load: vehicle types, stops, lights
    config     : a .sumocfg whose further options hold, as far as they are not set here
    outputs    : options of output files and where these go
    warm_up    : seconds of background traffic before the members come
    """

    def __init__(
        self,
        network: Network,
        step: float,
        seed: int,
        words: Path,
        routes: Sequence[Path] = (),
        additional: Sequence[Path] = (),
        config: Path | None = None,
        outputs: Mapping[str, Path] = MappingProxyType({}),
        warm_up: float = 0.0,
    ) -> None:
        self._network, self._words, self._step, self._warm_up = network, words, step, warm_up
        self.arrived: set[str] = set()  # members that SUMO drove to the end of their route
        self._options = [
            "sumo",
            *(("--configuration-file", str(config)) if config else ()),
            *("--net-file", str(network.path), "--step-length", str(step), "--seed", str(seed)),
            *("--time-to-teleport", "-1", "--collision.action", "warn", "--collision.check-junctions", "true"),
            *("--collision.mingap-factor", "0", "--emergencydecel.warning-threshold", "1000000"),
            *("--no-step-log", "true", "--duration-log.disable", "true", "--precision", "6"),
        ]
        for option, files in (("--route-files", routes), ("--additional-files", additional)):
            if files:
                self._options += [option, ",".join(str(file) for file in files)]
        for option, file in outputs.items():
            self._options += [f"--{option}", str(file)]
        self._start = 0.0  # SUMO's time when the members stood at their start poses
        self._routed: dict[str, str] = {}  # the edge from which each member's route was last set
        self._sizes: dict[str, tuple[float, float]] = {}  # length, width of SUMO's own vehicles

    def __enter__(self) -> World:
        if _running:
            raise RunError(f"SUMO already runs {_running[0]} in this process; libsumo holds one simulation a process")
        with self._listening():
            try:
                libsumo.start(self._options)
            except libsumo.TraCIException as error:
                raise InputError(f"{self._network.path}: SUMO refuses it: {self._reason(error)}") from error
        _running.append(self._network.path)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        _running.clear()
        died = isinstance(error, libsumo.TraCIException | libsumo.FatalTraCIError)
        when = f"{libsumo.simulation.getTime():g} s" if died else ""
        with self._listening():
            libsumo.close()
        if died:
            raise RunError(f"SUMO failed at {when}: {error}") from error

    def deploy(self, fleet: Fleet) -> Fleet:
        """Insert all members at their start poses and take the wheel; this is time 0.

        Background vehicles that are in their way there are taken out: a platoon does not come in by driving.
        """
        with self._listening():
            if self._warm_up:
                libsumo.simulationStep(libsumo.simulation.getTime() + self._warm_up)
        for member in fleet.members:
            self._insert(member)
        # A vehicle must have been on a lane before it may stand where there is none, as in the outer corner of a bend;
        # and moving it onto one inserts it even where another waits at the same position.
        for member in fleet.members:
            x, y, heading = self._network.lane_pose(member.edge, member.lane, member.position)
            libsumo.vehicle.moveToXY(member.id, *ANYWHERE, x, y, sumo_angle(heading), KEEP_ROUTE, MATCH_THRESHOLD)
        self._simulate()
        self._make_room(fleet)
        self.place(fleet)
        self._simulate()
        self._start = libsumo.simulation.getTime()
        missing = {m.id for m in fleet.members} - set(libsumo.vehicle.getIDList())
        if missing:
            raise RunError(f"SUMO did not insert {', '.join(sorted(missing))}; its words are in {self._words.name}")
        for member, native in zip(fleet.members, fleet.native, strict=True):
            if not native:
                libsumo.vehicle.setSpeedMode(member.id, ALL_OFF)
                libsumo.vehicle.setLaneChangeMode(member.id, NO_LANE_CHANGE)
        self._settle(fleet)
        return self._read_native(fleet)

    def snapshot(self, fleet: Fleet) -> TrafficSnapshot:
        """All vehicles at this instant; the members as the fleet knows them, the others as SUMO does."""
        members = {m.id for m in fleet.members}
        others = [name for name in libsumo.vehicle.getIDList() if name not in members]
        length, width = np.array([self._size(name) for name in others]).reshape(-1, 2).T
        front = np.array([libsumo.vehicle.getPosition(name) for name in others]).reshape(-1, 2)
        heading = heading_of(np.array([libsumo.vehicle.getAngle(name) for name in others]))
        x, y = centre_of(*front.T, heading, length)
        speed = np.array([libsumo.vehicle.getSpeed(name) for name in others])
        own = fleet.motion
        return TrafficSnapshot(
            round(libsumo.simulation.getTime() - self._start, 6),
            (*(m.id for m in fleet.members), *others),
            np.concatenate([own.x, x]),
            np.concatenate([own.y, y]),
            np.concatenate([own.heading, heading]),
            np.concatenate([own.speed, speed]),
            np.concatenate([fleet.model.length, length]),
            np.concatenate([fleet.model.width, width]),
        )

    def place(self, fleet: Fleet) -> None:
        """Tell SUMO where every member is at the end of the coming step."""
        motion = fleet.motion
        x, y = front_of(motion.x, motion.y, motion.heading, fleet.model.length)
        angle = sumo_angle(motion.heading)
        if not (np.isfinite(x).all() and np.isfinite(y).all() and np.isfinite(angle).all()):  # SUMO would take a NaN
            raise RunError("a member's pose is not finite")
        for i in np.flatnonzero(~fleet.native):
            name = fleet.members[i].id
            libsumo.vehicle.moveToXY(name, *ANYWHERE, x[i], y[i], angle[i], KEEP_ROUTE, MATCH_THRESHOLD)

    def advance(self, fleet: Fleet) -> Fleet:
        """One step of SUMO; then members' speeds and routes are set right again, and what it drives itself is read."""
        self._simulate()
        self.arrived |= {*libsumo.simulation.getArrivedIDList()} & {m.id for m in fleet.members}
        if self.arrived:
            return fleet
        self._settle(fleet)
        return self._read_native(fleet)

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
        """Edge and lane that SUMO has each member on; the lane is "" off the road."""
        vehicle = libsumo.vehicle
        return [(vehicle.getRoadID(m.id), vehicle.getLaneID(m.id)) for m in fleet.members]

    def _make_room(self, fleet: Fleet) -> None:
        """Take out background vehicles that stand where a member does, or so near that neither could stop."""
        traffic, n = self.snapshot(fleet), len(fleet)
        shapes = shapely.polygons(traffic.boxes().corners())
        near = shapely.STRtree(shapes[n:]).query(shapes[:n], predicate="dwithin", distance=ROOM * traffic.length[:n])[1]
        for row in sorted(set(near.tolist())):
            libsumo.vehicle.remove(traffic.ids[n + row])

    def _insert(self, member: Member) -> None:
        kind = f"platoontraffic.{member.id}"
        model = member.model
        libsumo.vehicletype.copy("DEFAULT_VEHTYPE", kind)
        libsumo.vehicletype.setLength(kind, model.length)
        libsumo.vehicletype.setWidth(kind, model.width)
        libsumo.vehicletype.setMinGap(kind, min(2.5, model.length / 2))
        libsumo.vehicletype.setSpeedDeviation(kind, 0)
        if getattr(member.law, "native", False):
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
            departPos=str(member.position), departSpeed="0",
        )  # fmt: skip

    def _settle(self, fleet: Fleet) -> None:
        for member, speed, native in zip(fleet.members, fleet.motion.speed, fleet.native, strict=True):
            if native and not member.path.closed:  # it keeps to the route that it was given
                continue
            if not native:
                # The speed SUMO derives is wrong where a lane's length is not that of the path driven: at corners.
                libsumo.vehicle.setPreviousSpeed(member.id, abs(speed))
            edge = libsumo.vehicle.getRoadID(member.id)
            if edge == self._routed.get(member.id) or edge not in self._network.edges:  # a junction
                continue
            if libsumo.vehicle.getRoute(member.id)[libsumo.vehicle.getRouteIndex(member.id)] != edge:
                continue  # for a few steps after a junction SUMO still counts it to the edge before
            # Other drivers judge right of way by the route, which leaving it has replaced.
            libsumo.vehicle.setRoute(member.id, self._onward(member, edge))
            self._routed[member.id] = edge

    def _onward(self, member: Member, edge: str) -> list[str]:
        """The intended edges from this one; for a law that goes where it likes, the straightest."""
        if edge not in member.route:
            return list(self._network.onward(edge))
        here = member.route.index(edge)
        again = member.route[:here] if member.path.closed else ()
        return [*member.route[here:], *again]

    def _size(self, name: str) -> tuple[float, float]:
        if name not in self._sizes:
            self._sizes[name] = libsumo.vehicle.getLength(name), libsumo.vehicle.getWidth(name)
        return self._sizes[name]

    def _simulate(self) -> None:
        with self._listening():
            libsumo.simulationStep()

    def _reason(self, error: Exception) -> str:
        """SUMO's own first error; what it raises is often only 'Process Error'."""
        errors = [line for line in self._words.read_text(errors="replace").splitlines() if line.startswith("Error")]
        return errors[0].removeprefix("Error:").strip() if errors else str(error)

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        """SUMO prints from C++ to file descriptor 2, past Python's stderr: into the file of its words."""
        sys.stderr.flush()
        kept = os.dup(2)
        with self._words.open("ab") as words:
            os.dup2(words.fileno(), 2)
            try:
                yield
            finally:
                os.dup2(kept, 2)
                os.close(kept)
