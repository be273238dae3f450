"""All platoon members, as arrays."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers import Body, Decision, RouteAhead, Sensed, Signals, Target
from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.route import Route, Routes
from platoontraffic.vehicles.catalogue import FleetModel, VehicleModel
from platoontraffic.vehicles.motion import Command, Drive, Motion, Twist
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors

CLOSING = 150.0  # no two vehicles come nearer faster [m/s]
STANDING = 1e-3  # slower is standing [vehicle lengths a second]


@dataclass(frozen=True)
class Member:
    """A vehicle of a platoon as it is deployed."""

    id: str
    platoon: str
    place: int  # 0 leads
    model: VehicleModel
    lidar: LidarModel
    law: Any
    edge: str  # where SUMO inserts it
    lane: int
    position: float  # of its front bumper on that lane [m]
    pose: tuple[float, float, float]  # x, y of its centre, heading
    route: Route | None = None  # that it means to drive; None: wherever its law takes it
    departs: float = 0.0  # [s]
    speed: float = 0.0  # then [m/s]
    odometry: OdometryErrors = ODOMETRY["none"]

    @property
    def knows_its_way(self) -> bool:
        """It arrives by itself, and not with its leader."""
        return "route" in getattr(self.law, "needs", ()) or getattr(self.law, "native", False)

    @property
    def seen_ahead_of_gap(self) -> float:
        """Distance from the laser minus gap, bumper to bumper [m]: the laser stands behind the front bumper."""
        return self.model.length / 2 - self.lidar.mount.x


class Group(NamedTuple):
    """Members that came together and share a law and a lidar: they are scanned and decided for in one call."""

    law: Any
    lidar: LidarModel
    rows: np.ndarray
    every: int  # scans, and decides, in every so many steps
    memory: Any = None  # of the law


@dataclass(frozen=True)
class Fleet:
    """Members on the road, what they do, and what their laws remember. Arrays (n,), in the order of `members`."""

    members: tuple[Member, ...]
    number: np.ndarray  # of each among all that the run ever has
    groups: tuple[Group, ...]
    model: FleetModel
    predecessor: np.ndarray  # row of the member ahead; -1 for leaders
    leads: np.ndarray  # those who are told to follow nobody, (n,) bool
    native: np.ndarray  # those that SUMO's own driver model drives, (n,) bool
    routed: np.ndarray  # rows (m,) of those whose law is given their route
    routes: Routes | None  # of these; None if there are none
    station: np.ndarray  # of these on their routes [m], (m,)
    motion: Motion
    command: Command  # the last one
    target: Target  # what each law took for its predecessor

    @classmethod
    def deployed(cls, members: Sequence[Member], dt: float, number: np.ndarray | None = None) -> Fleet:
        """Members at their start poses; `number` (n,) as in the class, by default in their order."""
        n = len(members)
        row_of = {(m.platoon, m.place): i for i, m in enumerate(members)}
        sharing: dict[tuple, list[int]] = {}
        for i, m in enumerate(members):
            sharing.setdefault((m.law, m.lidar), []).append(i)
        groups = tuple(
            Group(law, lidar, np.array(rows), max(round(1 / (lidar.rate * dt)), 1))
            for (law, lidar), rows in sharing.items()
        )
        still = np.zeros(n)
        motion = Motion.at_rest(*np.array([m.pose for m in members]).reshape(n, 3).T)
        model = FleetModel.of([m.model for m in members])
        routed, routes = _routes(members)
        station = np.zeros(len(routed))
        if routes:
            x, y = (axle[routed] for axle in model.axle_position(motion))
            station = routes.project(x, y, station, np.full(len(routed), np.inf))
        return cls(
            members=tuple(members),
            number=np.arange(n) if number is None else number,
            groups=groups,
            model=model,
            predecessor=np.array([row_of.get((m.platoon, m.place - 1), -1) for m in members], dtype=int),
            leads=np.array([m.place == 0 for m in members], dtype=bool),
            native=np.array([getattr(m.law, "native", False) for m in members], dtype=bool),
            routed=routed,
            routes=routes,
            station=station,
            motion=replace(motion, speed=np.array([m.speed for m in members], dtype=float)),
            command=Command.of(Twist(still, still)),
            target=Target(np.full(n, np.nan), np.full(n, np.nan)),
        )

    def __len__(self) -> int:
        return len(self.members)

    @property
    def sight(self) -> float:
        """How far from a member's centre that may be which it sees or touches [m]; beams may be a sweep old."""
        seen = [
            lidar.reach + np.hypot(lidar.mount.x, lidar.mount.y) + lidar.sweep_time * CLOSING
            for lidar in (group.lidar for group in self.groups)
        ]
        return max(seen, default=0.0) + self.model.length.max(initial=0.0)

    def joined(self, others: Fleet) -> Fleet:
        """With others behind, who have just come."""
        n = len(self)
        members = (*self.members, *others.members)
        routed, routes = _routes(members)
        return Fleet(
            members=members,
            number=np.append(self.number, others.number),
            groups=(*self.groups, *(group._replace(rows=group.rows + n) for group in others.groups)),
            model=FleetModel.of([m.model for m in members]),
            predecessor=np.append(self.predecessor, np.where(others.predecessor < 0, -1, others.predecessor + n)),
            leads=np.append(self.leads, others.leads),
            native=np.append(self.native, others.native),
            routed=routed,
            routes=routes,
            station=np.append(self.station, others.station),
            motion=_both(self.motion, others.motion),
            command=_both(self.command, others.command),
            target=_both(self.target, others.target),
        )

    def without(self, gone: Collection[str]) -> Fleet:
        """Without the members of those ids."""
        if not gone:
            return self
        stays = np.array([m.id not in gone for m in self.members], dtype=bool)
        row = np.append(np.where(stays, np.cumsum(stays) - 1, -1), -1)  # the last one is that of no predecessor
        members = tuple(m for m, keep in zip(self.members, stays, strict=True) if keep)
        groups = []
        for group in self.groups:
            keep = stays[group.rows]
            if keep.any():
                memory = group.memory if keep.all() else _taken(group.memory, keep, group.law)
                groups.append(group._replace(rows=row[group.rows[keep]], memory=memory))
        routed, routes = _routes(members)
        return Fleet(
            members=members,
            number=self.number[stays],
            groups=tuple(groups),
            model=FleetModel.of([m.model for m in members]),
            predecessor=row[self.predecessor[stays]],
            leads=self.leads[stays],
            native=self.native[stays],
            routed=routed,
            routes=routes,
            station=self.station[stays[self.routed]],
            motion=self.motion.of(stays),
            command=self.command.rows(stays),
            target=_rows(self.target, stays),
        )

    def with_orders(self, predecessor: np.ndarray, leads: np.ndarray) -> Fleet:
        return replace(self, predecessor=predecessor, leads=leads)

    def with_route(self, row: int, route: Route) -> Fleet:
        """With another route for a member, from where it is now."""
        members = tuple(replace(m, route=route) if i == row else m for i, m in enumerate(self.members))
        routed, routes = _routes(members)
        x, y = (axle[routed] for axle in self.model.axle_position(self.motion))
        window = np.where(routed == row, np.inf, 5 * self.model.length[routed])
        return replace(self, members=members, routes=routes, station=routes.project(x, y, self.station, window))

    def heads(self) -> np.ndarray:
        """Rows of those whom each member follows in the end, (n,): its own, if it follows nobody."""
        head = np.arange(len(self))
        for _ in range(len(self)):
            ahead = self.predecessor[head]
            if (ahead < 0).all():
                break
            head = np.where(ahead < 0, head, ahead)
        return head

    def arrived(self) -> set[str]:
        """Members whose law is given their route, and whose front bumper has come to its end.

        Or who stand within two lengths of that, where the road ends at a wall.
        """
        if self.routes is None:
            return set()
        length = self.model.length[self.routed]
        left = self.routes.left(self.station) - length / 2 + self.model.axle[self.routed]
        stands = self.motion.speed[self.routed] < STANDING * length
        before_wall = self.routes.walled & stands & (left < 2 * length)
        there = self.routed[(left <= 0) | before_wall]
        return {member.id for member in (self.members[i] for i in there) if member.knows_its_way}

    def decided(
        self,
        scans: Sequence[ScanBatch | None],
        dt: float,
        signals: Signals | None = None,
        odometry: Twist | None = None,
    ) -> Fleet:
        """Every group whose lidar has just scanned decides; the others (None) keep their command.

        signals  : (n,), for those laws that declare to need them
        odometry : own speed and yaw rate as they are measured, (n,); by default as they are
        """
        own = odometry or Twist(self.motion.speed, self.motion.yaw_rate)
        twist, drive = (type(kind)(*(values.copy() for values in kind)) for kind in self.command)
        distance, bearing = (values.copy() for values in self.target)
        ahead = self._ahead()
        row_on_route = dict(zip(self.routed.tolist(), range(len(self.routed)), strict=True))
        groups = []
        for group, scan in zip(self.groups, scans, strict=True):
            if scan is None:
                groups.append(group)
                continue
            rows, needs = group.rows, getattr(group.law, "needs", ())
            sensed = Sensed(
                replace(scan, hits=None),  # whose surface a beam met is for the observer, not for a law
                own.speed[rows],
                own.yaw_rate[rows],
                Body(self.model.length[rows], self.model.width[rows], self.model.axle[rows]),
                _rows(ahead, [row_on_route[i] for i in rows.tolist()]) if "route" in needs else None,
                _rows(signals, rows) if "signals" in needs and signals else None,
                self.leads[rows],
            )
            decision = self._ask(group, sensed, group.every * dt)
            command = Command.of(decision.command)
            for old, new in zip((*twist, *drive), (*command.twist, *command.drive), strict=True):
                old[rows] = new
            distance[rows], bearing[rows] = decision.target
            groups.append(group._replace(memory=decision.memory))
        return replace(
            self,
            command=Command(twist, drive),
            target=Target(distance, bearing),
            groups=tuple(groups),
        )

    def commanded(self, override: Mapping[str, Twist | Drive]) -> Fleet:
        """The fleet with other commands for some members, by id.

        raises: ValueError where there is no such member, where SUMO drives it, or where a command is not finite
        """
        if not override:
            return self
        row_of = {m.id: i for i, m in enumerate(self.members)}
        twist, drive = (type(kind)(*(values.copy() for values in kind)) for kind in self.command)
        for name, command in override.items():
            row = row_of.get(name)
            if row is None:
                raise ValueError(f"{name!r}: no member on the road{did_you_mean(name, row_of)}")
            if self.native[row]:
                raise ValueError(f"{name!r}: SUMO drives it; it takes no command")
            if not np.isfinite(command).all():
                raise ValueError(f"{name!r}: {command}; must be finite")
            given = Command.of(command)
            for old, new in zip((*twist, *drive), (*given.twist, *given.drive), strict=True):
                old[row] = new
        return replace(self, command=Command(twist, drive))

    def moved(self, dt: float, brakes: np.ndarray | None = None) -> Fleet:
        """After dt; those that SUMO drives stay, until it has moved them.

        brakes: what some are brought to a stand with, whatever their laws want [m/s2], (n,); NaN: they are not
        """
        command = self.command if brakes is None else self.command.braked(brakes, self.motion, dt)
        motion = self.model.moved(self.motion, command, dt)
        return self._with_motion(np.flatnonzero(self.native), self.motion, motion)._located()

    def expected(self, dt: float) -> Fleet:
        """With those whom SUMO drives where they will be dt later if they keep their speed; for who meets them then."""
        motion, way = self.motion, np.where(self.native, self.motion.speed * dt, 0.0)
        x, y = motion.x + way * np.cos(motion.heading), motion.y + way * np.sin(motion.heading)
        return replace(self, motion=replace(motion, x=x, y=y))

    def driven(self, rows: np.ndarray, x, y, heading, speed, dt: float) -> Fleet:
        """With the poses (m,) that SUMO has driven the members of some rows to."""
        before = self.motion.of(rows)
        turned = wrap(heading - before.heading)
        motion = Motion(
            x, y, heading, before.turned + turned, speed, turned / dt, (speed - before.speed) / dt, 0 * x, 0 * x
        )
        everywhere = Motion(*(np.empty(len(self)) for _ in fields(Motion)))
        for f in fields(Motion):
            getattr(everywhere, f.name)[rows] = getattr(motion, f.name)
        return self._with_motion(rows, everywhere, self.motion)

    def _with_motion(self, rows: np.ndarray, some: Motion, others: Motion) -> Fleet:
        """Some rows move in one way, the others in another."""
        if not len(rows):
            return replace(self, motion=others)
        values = {f.name: getattr(others, f.name).copy() for f in fields(Motion)}
        for name, of_all in values.items():
            of_all[rows] = getattr(some, name)[rows]
        return replace(self, motion=Motion(**values))

    def _located(self) -> Fleet:
        """With the stations of where it is now."""
        if self.routes is None:
            return self
        x, y = (axle[self.routed] for axle in self.model.axle_position(self.motion))
        window = 5 * self.model.length[self.routed]
        return replace(self, station=self.routes.project(x, y, self.station, window))

    def _ahead(self) -> RouteAhead | None:
        """Of the routed (m,), as seen from the driven axle."""
        if self.routes is None:
            return None
        x, y = (axle[self.routed] for axle in self.model.axle_position(self.motion))
        return self.routes.ahead(self.station, x, y, self.motion.heading[self.routed])

    def _ask(self, group: Group, sensed: Sensed, dt: float) -> Decision:
        """The law's decision with arrays (n,); a law from a plug-in that gives none is the user's to mend."""
        rows = sensed.speed.shape
        decision = _call(group.law, f"at {sensed.scan.stamp:.3f} s", group.law, sensed, group.memory, dt)
        try:
            kind = Drive if isinstance(decision.command, Drive) else Twist
            command = kind(*(np.broadcast_to(_numbers(values), rows) for values in decision.command))
            distance, bearing = (np.broadcast_to(_numbers(values), rows) for values in decision.target)
            memory = decision.memory
        except (AttributeError, TypeError, ValueError) as error:
            if _is_ours(group.law):
                raise
            what = f"gave {decision!r:.200}; must be a Decision of a Twist, or a Drive, and a Target "
            what += f"with numbers, {rows[0]} rows"
            raise InputError(f"{_place(group.law)}: law {type(group.law).__qualname__} {what}") from error
        sound = np.isfinite(command).all(axis=0) & ~np.isinf(distance) & ~np.isinf(bearing)
        nonsense = np.flatnonzero(~sound)
        if len(nonsense):
            row = nonsense[0]
            vehicle = f"{self.members[group.rows[row]].id} at {sensed.scan.stamp:.3f} s"
            given = ", ".join(f"{name.replace('_', ' ')} {v[row]}" for name, v in command._asdict().items())
            given += f", target {distance[row]}, {bearing[row]}"
            what = f"gave {given} for {vehicle}; must be finite, a target may be NaN"
            raise InputError(f"{_place(group.law)}: law {type(group.law).__qualname__} {what}")
        return Decision(command, memory, Target(distance, bearing))


def _routes(members: Sequence[Member]) -> tuple[np.ndarray, Routes | None]:
    """Rows of those whose law is given its route, and these routes."""
    laws = [getattr(m.law, "needs", ()) if m.route and not getattr(m.law, "native", False) else () for m in members]
    rows = np.flatnonzero(["route" in needs or "signals" in needs for needs in laws])
    if not len(rows):
        return rows, None
    return rows, Routes([members[i].route for i in rows], np.array([members[i].model.length for i in rows]))


def _rows(record: Any, rows: Any) -> Any:
    """Some rows of a NamedTuple of arrays."""
    return type(record)(*(values[rows] for values in record))


def _both(one: Any, other: Any) -> Any:
    """Two records of arrays as one, row after row."""
    if isinstance(one, np.ndarray):
        return np.concatenate([one, other])
    parts = [f.name for f in fields(one)] if is_dataclass(one) else one._fields
    return type(one)(*(_both(getattr(one, part), getattr(other, part)) for part in parts))


def _taken(memory: Any, keep: np.ndarray, law: Any) -> Any:
    """What a law remembers of those that stay."""
    if memory is None:
        return None
    if isinstance(memory, np.ndarray) and memory.shape[:1] == keep.shape:
        return memory[keep]
    if isinstance(memory, list) and len(memory) == len(keep):
        return [one for one, stays in zip(memory, keep, strict=True) if stays]
    if isinstance(memory, tuple) and hasattr(memory, "_fields"):
        return type(memory)(*(_taken(part, keep, law) for part in memory))
    if is_dataclass(memory):
        return replace(memory, **{f.name: _taken(getattr(memory, f.name), keep, law) for f in fields(memory)})
    what = f"remembers a {type(memory).__name__}; must be arrays, lists, NamedTuples or dataclasses, one row a vehicle"
    raise InputError(f"{_place(law)}: law {type(law).__qualname__} {what}")


def desired_distance(member: Member, speed: float) -> float:
    """What the member's law wants from laser to rear at a steady speed [m]; NaN if it names nothing."""
    wanted = getattr(member.law, "desired_distance", None)
    if not callable(wanted):
        return np.nan
    return float(_call(member.law, f"in desired_distance({speed:g})", lambda: float(wanted(speed))))


def _call(law: Any, when: str, function: Callable, *arguments: Any) -> Any:
    """function(*arguments), where what fails in a plug-in is said with its file and line."""
    try:
        return function(*arguments)
    except (Exception, SystemExit) as error:
        if _is_ours(law):
            raise
        what = f"failed {when}: {type(error).__name__}: {error}"
        raise InputError(f"{_place(law, error)}: law {type(law).__qualname__} {what}") from error


def _is_ours(law: Any) -> bool:
    return type(law).__module__.startswith("platoontraffic.")


def _numbers(values: Any) -> np.ndarray:
    values = np.asarray(values)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"{values.dtype} is no number")
    return values.astype(float)


def _place(law: Any, error: BaseException | None = None) -> str:
    """`file:line` in the law's own file: where it failed, or else where it is written."""
    try:
        file, line = inspect.getsourcefile(type(law)), inspect.getsourcelines(type(law))[1]
    except (OSError, TypeError):  # no source at hand
        return type(law).__module__
    frames = traceback.extract_tb(error.__traceback__) if error else []
    return f"{file}:{next((f.lineno for f in reversed(frames) if f.filename == file), line)}"
