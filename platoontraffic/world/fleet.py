"""All platoon members, as arrays."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers.calls import Occasion, ask, decide, memory_of
from platoontraffic.controllers.law import Body, Known, Law, RouteAhead, Sensed, Signals, Target
from platoontraffic.errors import did_you_mean
from platoontraffic.lidar import LidarModel, Noise, ScanBatch
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.route import Route, Routes
from platoontraffic.vehicles.catalogue import FleetModel, VehicleModel
from platoontraffic.vehicles.motion import Command, Drive, Motion, Twist
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors
from platoontraffic.vehicles.records import changed, concatenate, put, some, stack, take
from platoontraffic.vehicles.sensor import NamedSensor
from platoontraffic.world.events import CLEARANCE_REACH
from platoontraffic.world.neighbours import chains, known_by, nothing_known
from platoontraffic.world.under_way import Seen, UnderWay

NO_NOISE = Noise()
CLOSING = 150.0  # greatest closing speed of two vehicles [m/s]
STANDING = 1e-3  # speed below which a member stands [vehicle lengths a second]
WINDOW = 5.0  # a member is sought on its route within this distance of its last station [vehicle lengths]


@dataclass(frozen=True)
class Member:
    """A vehicle of a platoon as it is deployed."""

    id: str
    platoon: str  # of a member from the traffic that is in none, its table `equip`
    place: int  # 0: the leader
    model: VehicleModel
    lidar: LidarModel
    law: Law
    edge: str  # on which SUMO inserts it
    lane: int
    position: float  # of its front bumper on that lane [m]
    pose: tuple[float, float, float]  # x, y of its centre [m], heading [rad]
    route: Route | None = None  # that it is to drive; None: it drives wherever its law takes it
    departs: float = 0.0  # [s]
    speed: float = 0.0  # at departure [m/s]
    odometry: OdometryErrors = ODOMETRY["none"]
    further_lidars: tuple[LidarModel, ...] = ()  # each with a name of its own
    sensors: tuple[NamedSensor, ...] = ()
    equip: str = ""  # table of members from the traffic; "": it is of a [[platoon]]
    single: bool = False  # it is in no platoon: it has no predecessor of its own, and follows any vehicle

    @property
    def lidars(self) -> tuple[LidarModel, ...]:
        return (self.lidar, *self.further_lidars)

    @property
    def recruited(self) -> bool:
        """It is from the traffic."""
        return bool(self.equip)

    @property
    def leads(self) -> bool:
        """It is to follow no vehicle."""
        return self.place == 0 and not self.single

    @property
    def is_given_its_route(self) -> bool:
        """Its law is given the route, or the stop lines on it."""
        by_route = not {"route", "signals"}.isdisjoint(self.law.needs)
        return self.route is not None and not self.law.native and by_route

    @property
    def arrives_alone(self) -> bool:
        """It arrives when it has driven its own route, not with its leader."""
        return "route" in self.law.needs or self.law.native

    @property
    def seen_ahead_of_gap(self) -> float:
        """Distance from the laser minus gap, bumper to bumper [m]: the laser stands behind the front bumper."""
        return self.model.length / 2 - self.lidar.mount.x


class Group(NamedTuple):
    """Members that share law, lasers and sensors: one call of each serves them all."""

    law: Law
    lidar: LidarModel
    rows: np.ndarray
    every: int  # steps from one scan of `lidar` to the next
    memory: Any = None  # of the law
    further_lidars: tuple[Clocked, ...] = ()
    sensors: tuple[Clocked, ...] = ()
    delay: int = 0  # steps from a scan of `lidar` to its use
    odometry_delay: int = 0  # steps from a reading of the odometry to its use
    under_way: UnderWay = UnderWay()
    since: int | None = None  # steps since the last decision; None: there was none

    @property
    def late(self) -> bool:
        """Something is used later than it is measured."""
        further = self.further_lidars
        return bool(self.delay or self.odometry_delay or (further and any(one.delay for one in further)))

    @property
    def shared(self) -> tuple:
        """What is the same for all its members, whenever they departed."""
        return self.law, self.lidar, self.further_lidars, self.sensors, self.delay, self.odometry_delay

    def joined(self, other: Group) -> Group | None:
        """Both as one; None while their memories cannot be put together. Nothing may be under way to them."""
        if self.since is None or self.since != other.since:
            return None
        try:
            for group in (self, other):
                take(group.memory, np.ones(len(group.rows), bool))  # it has a row for each member
            memory = concatenate(self.memory, other.memory)
        except (TypeError, ValueError):  # as trails with different room
            return None
        rows = np.append(self.rows, other.rows)
        return self._replace(rows=rows, memory=memory, under_way=UnderWay())

    def refitted(self, members: Sequence[Member], dt: float) -> list[Group]:
        """Its rows with the laws and sensors of these members, all of a fleet.

        A law of the same class that is given the same keeps its memory; another one begins without.
        """
        parts = []
        for new in _groups([members[i] for i in self.rows], dt):
            part = new._replace(rows=self.rows[new.rows])
            if type(new.law) is type(self.law) and new.fittings == self.fittings:
                of_part = np.isin(self.rows, part.rows)
                memory, under_way = memory_of(self.law, self.memory, of_part), self.under_way.part(of_part)
                part = part._replace(memory=memory, under_way=under_way, since=self.since)
            parts.append(part)
        return parts

    @property
    def fittings(self) -> tuple:
        """What its law is given: needs, lasers apart from their noise, sensors, delays."""
        lasers = (self.lidar, *(one.sensor for one in self.further_lidars))
        return self.law.needs, [replace(one, noise=NO_NOISE) for one in lasers], self.sensors, self.odometry_delay

    @property
    def is_prompt(self) -> bool:
        """It decides, and at once by what it measures."""
        return not (self.law.native or self.late)

    @property
    def decides_every(self) -> int:
        """Steps from one decision to the next: those of the fastest of its laser and its sensors."""
        return min(self.every, *(sensor.every for sensor in self.sensors)) if self.sensors else self.every


class Clocked(NamedTuple):
    """A further laser or a sensor of a group."""

    sensor: Any
    every: int  # steps from one measurement to the next
    delay: int = 0  # steps from a measurement to its use


class Carried(NamedTuple):
    """The members that carry one laser, whatever their laws: one scan serves them all."""

    lidar: LidarModel
    every: int  # steps from one scan to the next
    rows: np.ndarray  # of these members in the fleet, group after group
    ids: tuple[str, ...]  # of them
    parts: tuple[tuple[int, slice], ...]  # groups, and where their members are in `rows`


class Readings(NamedTuple):
    """Measurements of a group beside the scan of its laser, of what is due, by name."""

    time: float  # at which the law is given them [s]
    scans: Mapping[str, ScanBatch]  # of further lasers
    sensors: Mapping[str, Any]
    seen: Mapping[str, Seen] = {}  # the worlds of the scans


NOTHING = Readings(math.nan, {}, {})


@dataclass(frozen=True, eq=False)
class RouteProgress:
    """The members whose law is given their route, and their places on these routes. Arrays (m,)."""

    rows: np.ndarray  # of these members in the fleet, in order
    routes: Routes | None  # None if there are none
    station: np.ndarray  # of the driven axle along the route [m]
    length: np.ndarray  # of these members [m]
    front: np.ndarray  # from the driven axle to the front bumper [m]

    @classmethod
    def of(
        cls, members: Sequence[Member], station: np.ndarray | None = None, known: RouteProgress | None = None
    ) -> RouteProgress:
        """
        station : by default 0
        known   : of members many of which are the same
        """
        rows = np.flatnonzero([m.is_given_its_route for m in members])
        length = np.array([members[i].model.length for i in rows], dtype=float)
        front = length / 2 - [members[i].model.axle for i in rows]
        routes = Routes([members[i].route for i in rows], length, known and known.routes) if len(rows) else None
        return cls(rows, routes, np.zeros(len(rows)) if station is None else station, length, front)

    def with_route(self, row: int, route: Route) -> RouteProgress:
        """The same with another route for the member of a row of the fleet, which had one."""
        return changed(self, routes=self.routes.with_one(int(self.rows.searchsorted(row)), route))

    def located(self, model: FleetModel, motion: Motion, window: np.ndarray | float = WINDOW) -> RouteProgress:
        """The stations nearest to the driven axles.

        window : of the search about the last stations [vehicle lengths], (m,)
        """
        if self.routes is None:
            return self
        (x, y), rows = model.axle_position(motion), self.rows
        return changed(self, station=self.routes.project(x[rows], y[rows], self.station, window * self.length))

    def ahead(self, model: FleetModel, motion: Motion, rows: np.ndarray, reach: float = np.inf) -> RouteAhead | None:
        """The routes ahead as seen from the driven axles of some of these members; None if nobody has a route.

        rows  : of those members in the fleet, (m,)
        reach : distance up to which they are needed [m]
        """
        if self.routes is None:
            return None
        which = self.rows.searchsorted(rows)
        x, y = model.axle_position(motion)
        return self.routes.ahead(self.station[which], x[rows], y[rows], motion.heading[rows], which, reach)

    def ended(self, model: FleetModel, motion: Motion) -> np.ndarray:
        """Rows of the fleet whose front bumper has reached the end of the route.

        Where the road ends at a wall, so has a member that stands within two lengths of the end.
        """
        if self.routes is None:
            return self.rows
        left = self.routes.left(self.station) - self.front
        near = left < 2 * self.length
        if not some(near):  # as in nearly every step
            return self.rows[:0]
        stands = motion.speed[self.rows] < STANDING * self.length
        return self.rows[(left <= 0) | (self.routes.walled & stands & near)]


class Radio(NamedTuple):
    """Messages to members from their predecessors, arrays (n,); NaN where there are none."""

    age: np.ndarray  # of the newest that has arrived [s]
    lost: np.ndarray  # 1 if that sent in this step is lost, 0 if not; NaN: none is sent

    @classmethod
    def silent(cls, n: int) -> Radio:
        return cls(*np.full((2, n), np.nan))


@dataclass(frozen=True, eq=False)
class MemberState:
    """The part of a fleet that has one row for each member: arrays (n,), or records of them."""

    number: np.ndarray  # of each among all members that the run ever has
    leads: np.ndarray  # ordered to follow no vehicle, bool
    goes_round: np.ndarray  # it drives round a body, and follows no vehicle until it is past, bool
    native: np.ndarray  # driven by SUMO's own driver model, bool
    motion: Motion
    command: Command  # the last one
    target: Target  # what each law took for its predecessor
    radio: Radio


@dataclass(frozen=True, eq=False)
class Fleet(MemberState):
    """Members on the road, their motion, and the memories of their laws. Arrays (n,), in the order of `members`.

    Its cached properties depend only on which members are on the road, so `changed` keeps them from step to step.
    """

    members: tuple[Member, ...]
    predecessor: np.ndarray  # row of the predecessor; -1: none
    groups: tuple[Group, ...]
    model: FleetModel
    progress: RouteProgress

    @classmethod
    def deployed(cls, members: Sequence[Member], dt: float, number: np.ndarray | None = None) -> Fleet:
        """Members at their start poses; `number` (n,) as in the class, by default in their order."""
        n = len(members)
        still, unknown = np.zeros(n), np.full(n, np.nan)
        motion = Motion.at_rest(*np.array([m.pose for m in members]).reshape(n, 3).T)
        state = MemberState(
            number=np.arange(n) if number is None else number,
            leads=np.array([m.leads for m in members], dtype=bool),
            goes_round=np.zeros(n, dtype=bool),
            native=np.array([m.law.native for m in members], dtype=bool),
            motion=replace(motion, speed=np.array([m.speed for m in members], dtype=float)),
            command=Command.of(Twist(np.array([m.speed for m in members], dtype=float), still)),  # until a law decides
            target=Target(unknown, unknown),
            radio=Radio.silent(n),
        )
        row_of = {(m.platoon, m.place): i for i, m in enumerate(members)}
        predecessor = np.array([row_of.get((m.platoon, m.place - 1), -1) for m in members], dtype=int)
        fleet = cls._of(state, members, predecessor, _groups(members, dt), RouteProgress.of(members))
        return changed(fleet, progress=fleet.progress.located(fleet.model, motion, np.inf))

    @classmethod
    def _of(
        cls,
        state: MemberState,
        members: Sequence[Member],
        predecessor: np.ndarray,
        groups: Sequence[Group],
        progress: RouteProgress,
    ) -> Fleet:
        model = FleetModel.of([m.model for m in members])
        return cls(**vars(state), members=tuple(members), predecessor=predecessor, groups=tuple(groups), model=model,
                   progress=progress)  # fmt: skip

    def __len__(self) -> int:
        return len(self.members)

    @cached_property
    def ids(self) -> tuple[str, ...]:
        return tuple(m.id for m in self.members)

    @cached_property
    def row_of(self) -> Mapping[str, int]:
        """Rows of the members, by id."""
        return {name: row for row, name in enumerate(self.ids)}

    @cached_property
    def native_rows(self) -> np.ndarray:
        """Rows of the members that SUMO's own driver model drives, (m,)."""
        return np.flatnonzero(self.native)

    @cached_property
    def places(self) -> dict[str, tuple[str, int]]:
        """Platoon and place of each member of one, by its id."""
        return {m.id: (m.platoon, m.place) for m in self.members if not m.single}

    @cached_property
    def body(self) -> Body:
        """Sizes of all members, (n,)."""
        return Body(*(getattr(self.model, name) for name in Body._fields))

    @cached_property
    def ids_by_group(self) -> tuple[tuple[str, ...], ...]:
        return tuple(tuple(self.members[i].id for i in group.rows) for group in self.groups)

    @cached_property
    def lasers(self) -> tuple[Carried, ...]:
        """The lasers by which laws decide; SUMO-driven members need none."""
        sharing: dict[LidarModel, list[int]] = {}
        for i, group in enumerate(self.groups):
            if not group.law.native:
                sharing.setdefault(group.lidar, []).append(i)
        found = []
        for lidar, groups in sharing.items():
            rows = [self.groups[i].rows for i in groups]
            ends = np.cumsum([0, *map(len, rows)]).tolist()
            parts = tuple((i, slice(*between)) for i, between in zip(groups, pairwise(ends), strict=True))
            ids = tuple(name for i in groups for name in self.ids_by_group[i])
            found.append(Carried(lidar, self.groups[groups[0]].every, np.concatenate(rows), ids, parts))
        return tuple(found)

    @cached_property
    def sensed_by_group(self) -> tuple[Sensed, ...]:
        """What the law of each group is given that is the same in every step: the bodies of its members."""
        nothing = np.empty(0)
        return tuple(Sensed(None, nothing, nothing, take(self.body, group.rows)) for group in self.groups)

    @cached_property
    def has_more_sensors(self) -> bool:
        """Somebody has a further laser, or a sensor of the scenario's own."""
        return any(group.further_lidars or group.sensors for group in self.groups)

    @cached_property
    def has_sweeps(self) -> bool:
        """Somebody has a laser with beams that are not all measured at one instant."""
        lidars = (lidar for member in self.members for lidar in member.lidars)
        return any(lidar.sweep_time for lidar in lidars)

    @cached_property
    def odometry(self) -> OdometryErrors | None:
        """Of all members, arrays (n,); None if none has errors."""
        errors = [m.odometry for m in self.members]
        return None if all(one.exact for one in errors) else stack(errors)

    @cached_property
    def is_late(self) -> bool:
        """Something is used later than it is measured."""
        return any(group.late for group in self.groups)

    @cached_property
    def sight(self) -> float:
        """Greatest distance from a member's centre to anything that it can see or touch, or that is so near that its
        distance is measured [m]; beams may be a sweep old."""
        lidars = [
            lidar for group in self.groups for lidar in (group.lidar, *(one.sensor for one in group.further_lidars))
        ]
        seen = [lidar.reach + np.hypot(lidar.mount.x, lidar.mount.y) + lidar.sweep_time * CLOSING for lidar in lidars]
        seen += [one.sensor.sensor.reach for group in self.groups for one in group.sensors]
        return max([CLEARANCE_REACH, *seen]) + self.model.length.max(initial=0.0)

    def joined(self, others: Fleet) -> Fleet:
        """The fleet with others, which have just departed, in its last rows."""
        n = len(self)
        state = concatenate(self._state(), others._state())
        members = (*self.members, *others.members)
        predecessor = np.append(self.predecessor, np.where(others.predecessor < 0, -1, others.predecessor + n))
        groups = (*self.groups, *(group._replace(rows=group.rows + n) for group in others.groups))
        station = np.append(self.progress.station, others.progress.station)
        return self._of(state, members, predecessor, groups, RouteProgress.of(members, station, self.progress))

    @cached_property
    def is_divided(self) -> bool:
        """Several groups could be one: their members departed at different times."""
        prompt = [group.shared for group in self.groups if group.is_prompt]
        return len(set(prompt)) < len(prompt)

    def regrouped(self) -> Fleet:
        """The fleet with as few groups as there can be: each is a call of its law."""
        if not self.is_divided:
            return self
        groups: list[Group] = []
        place: dict[tuple, int] = {}  # of the first group with what it shares
        for group in self.groups:
            first = place.setdefault(group.shared, len(groups)) if group.is_prompt else len(groups)
            both = groups[first].joined(group) if first < len(groups) else None
            if both:
                groups[first] = both
            else:
                groups.append(group)
        if len(groups) == len(self.groups):
            return self
        return self._of(self._state(), self.members, self.predecessor, groups, self.progress)

    def without(self, gone: Collection[str]) -> Fleet:
        """The fleet without the members of some ids.

        raises: InputError if a plug-in remembers something that has no rows
        """
        if not gone:
            return self
        stays = np.array([m.id not in gone for m in self.members], dtype=bool)
        row = np.append(np.where(stays, np.cumsum(stays) - 1, -1), -1)  # new rows by old ones; of no predecessor: -1
        members = tuple(m for m, keep in zip(self.members, stays, strict=True) if keep)
        groups = []
        for group in self.groups:
            keep = stays[group.rows]
            if keep.any():
                memory = group.memory if keep.all() else memory_of(group.law, group.memory, keep)
                under_way = group.under_way if keep.all() else group.under_way.part(keep)
                groups.append(group._replace(rows=row[group.rows[keep]], memory=memory, under_way=under_way))
        progress = RouteProgress.of(members, self.progress.station[stays[self.progress.rows]], self.progress)
        return self._of(take(self._state(), stays), members, row[self.predecessor[stays]], groups, progress)

    def with_orders(self, predecessor: np.ndarray, leads: np.ndarray) -> Fleet:
        """The fleet with other predecessors, and other members that are ordered to lead, (n,)."""
        return changed(self, predecessor=predecessor, leads=leads)

    def with_route(self, row: int, route: Route, window: float = np.inf) -> Fleet:
        """The fleet with another route for one member, from where it is now.

        window : of the search about its last station, if the routes share stations until there [vehicle lengths]
        """
        member = replace(self.members[row], route=route)
        members = (*self.members[:row], member, *self.members[row + 1 :])
        progress = self.progress.with_route(row, route) if member.is_given_its_route else self.progress
        windows = np.where(progress.rows == row, window, WINDOW)
        return changed(self, members=members, progress=progress.located(self.model, self.motion, windows))

    def off_trail(self, rows: Sequence[int]) -> Fleet:
        """The fleet with some members that drive along their own routes, even if they drove in others' trails."""
        groups = []
        for group in self.groups:
            if group.memory is not None and len(where := np.flatnonzero(np.isin(group.rows, rows))):
                group = group._replace(memory=ask(group.law, group.law.off_trail, group.memory, where))
            groups.append(group)
        return changed(self, groups=tuple(groups))

    def refitted(self, members: Mapping[str, Member], dt: float) -> Fleet:
        """The fleet with the laws and sensors of these members, by id; routes and motion stay."""
        theirs = [members[m.id] for m in self.members]
        if all(_equipment(m) == _equipment(new) for m, new in zip(self.members, theirs, strict=True)):
            return self
        new = tuple(replace(new, route=m.route) for m, new in zip(self.members, theirs, strict=True))
        groups = [part for group in self.groups for part in group.refitted(new, dt)]
        progress = RouteProgress.of(new, known=self.progress).located(self.model, self.motion, np.inf)
        # On a route that meets itself the nearest station may be another one than the last.
        known = np.isin(progress.rows, self.progress.rows)
        progress.station[known] = self.progress.station[np.isin(self.progress.rows, progress.rows)]
        return self._of(self._state(), new, self.predecessor, groups, progress)

    def heads(self) -> np.ndarray:
        """Row of the first vehicle in each member's chain of predecessors, (n,): its own if it has none."""
        return chains(self)[0]

    def arrived(self) -> set[str]:
        """Ids of the members that have driven their own route to its end."""
        if self.progress.routes is None:
            return set()
        ended = (self.members[i] for i in self.progress.ended(self.model, self.motion))
        return {member.id for member in ended if member.arrives_alone}

    def decided(
        self,
        scans: Sequence[ScanBatch | None],
        dt: float,
        signals: Signals | None = None,
        odometry: Twist | None = None,
        readings: Sequence[Readings] = (),
        messages: Known | None = None,
    ) -> Fleet:
        """Every group with a new scan, or a new reading of a sensor, decides; the others keep their command.

        scans    : a batch for each group, as it arrives; None: not due
        readings : a record for each group; default: it has nothing but its laser
        signals  : the next stop lines, (n,), for the laws that declare to need them
        odometry : own speed and yaw rate as measured, (n,), as they arrive; by default without errors
        messages : of the members ahead, (n,), for the laws that declare to need them
        raises   : InputError if a plug-in fails
        """
        own = odometry or Twist(self.motion.speed, self.motion.yaw_rate)
        groups, rows, decisions = [], [], []
        for i, (group, scan) in enumerate(zip(self.groups, scans, strict=True)):
            since, more = None if group.since is None else group.since + 1, readings[i] if readings else NOTHING
            if scan is None and not more.sensors:
                groups.append(group._replace(since=since))
                continue
            sensed = self._sensed(i, scan, own, signals, more, messages, dt)
            at = Occasion(more.time if scan is None else scan.stamp, self.ids_by_group[i])
            decision = decide(group.law, sensed, group.memory, (since or group.decides_every) * dt, at)
            if group.since != 0 or decision.memory is not group.memory:
                group = group._replace(memory=decision.memory, since=0)
            groups.append(group)
            rows.append(group.rows)
            decisions.append(decision)
        if not decisions:
            return changed(self, groups=tuple(groups))
        command = self.command.replaced(rows, [decision.command for decision in decisions])
        target = self.target.replaced(rows, [decision.target for decision in decisions])
        return changed(self, groups=tuple(groups), command=command, target=target)

    def commanded(self, override: Mapping[str, Twist | Drive]) -> Fleet:
        """The fleet with other commands for some members, by id.

        raises: ValueError where these are no commands by id, where there is no such member, where SUMO drives it, or
                where a command is not finite
        """
        if not isinstance(override, Mapping):
            raise ValueError(f"{override!r}; must be commands by member id, such as {{'p.0': Drive(1.0, 0.0)}}")
        row_of = self.row_of
        for name, command in override.items():
            if name not in row_of:
                raise ValueError(f"{name!r}: no member on the road{did_you_mean(name, row_of)}")
            if self.native[row_of[name]]:
                raise ValueError(f"{name!r}: SUMO drives it; it takes no command")
            if not isinstance(command, Twist | Drive):
                raise ValueError(f"{name!r}: {command!r}; must be a Twist or a Drive")
            if not all(isinstance(part, Real) and math.isfinite(part) for part in command):
                raise ValueError(f"{name!r}: {command}; must be two finite numbers")
        rows = [row_of[name] for name in override]
        return changed(self, command=self.command.replaced(rows, list(override.values())))

    def moved(self, dt: float, brakes: np.ndarray | None = None) -> Fleet:
        """The fleet dt [s] later; SUMO-driven members stay until SUMO has moved them.

        brakes : deceleration that brings a member to rest whatever its law commands [m/s2], (n,); NaN: none
        """
        command = self.command if brakes is None else self.command.braked(brakes, self.motion, dt)
        motion, native = self.model.moved(self.motion, command, dt), self.native_rows
        if native.size:
            motion = put(motion, [native], [take(self.motion, native)])
        return changed(self, motion=motion, progress=self.progress.located(self.model, motion))

    def expected(self, dt: float) -> Fleet:
        """The fleet with SUMO-driven members extrapolated by dt [s] at constant speed."""
        if not self.native_rows.size:
            return self
        motion, distance = self.motion, np.where(self.native, self.motion.speed * dt, 0.0)
        x, y = motion.x + distance * np.cos(motion.heading), motion.y + distance * np.sin(motion.heading)
        return changed(self, motion=changed(motion, x=x, y=y))

    def driven(self, rows: np.ndarray, x, y, heading, speed, dt: float) -> Fleet:
        """The fleet with the members of some rows (m,) at the poses and speeds that SUMO has driven them to in dt."""
        before = take(self.motion, rows)
        turned = wrap(heading - before.heading)
        motion = Motion(
            x, y, heading, before.turned + turned, speed, turned / dt, (speed - before.speed) / dt, 0 * x, 0 * x
        )
        return changed(self, motion=put(self.motion, [rows], [motion]))

    def _state(self) -> MemberState:
        return MemberState(*(getattr(self, f.name) for f in fields(MemberState)))

    def _sensed(
        self,
        i: int,
        scan: ScanBatch | None,
        own: Twist,
        signals: Signals | None,
        more: Readings,
        messages: Known | None,
        dt: float,
    ) -> Sensed:
        """What the law of group i is given.

        own, signals, messages : of all members, (n,)
        dt                     : of a step [s]
        """
        group = self.groups[i]
        rows, needs = group.rows, group.law.needs
        given: dict[str, Any] = {
            "scan": without_surfaces(scan), "speed": own.speed[rows], "yaw_rate": own.yaw_rate[rows],
        }  # fmt: skip
        if "route" in needs:
            # What is seen is compared with it, and its predecessor may be as far away as its laser sees.
            fastest = np.maximum.reduce(given["speed"])
            reach = np.inf
            if scan is not None:
                reach = max(2 * scan.model.range_max, ask(group.law, group.law.looks_along, fastest))
            given["route"] = self.progress.ahead(self.model, self.motion, rows, reach)
        if "signals" in needs:
            given["signals"] = take(signals, rows)
        if "leads" in needs:
            given["leads"] = (self.leads | self.goes_round)[rows]
        if "truth" in needs:
            given["truth"] = known_by(self, rows, needs)
        if "messages" in needs:
            given["messages"] = _received(messages, rows, needs)
        if more is not NOTHING:
            given["scans"] = {name: without_surfaces(further) for name, further in more.scans.items()}
            given["readings"] = more.sensors
        if group.late:
            given["age"], given["odometry_age"] = group.delay * dt, group.odometry_delay * dt
            given["ages"] = {one.sensor.name: one.delay * dt for one in group.further_lidars}
        return changed(self.sensed_by_group[i], **given)


def _received(messages: Known | None, rows: np.ndarray, needs: frozenset[str]) -> Known:
    """The messages to some members; without a channel, none."""
    if messages is None:
        return nothing_known(len(rows), needs)
    received = take(messages, rows)
    if "members" not in needs:
        received = received._replace(members=None, ahead=None)
    return received if "leader" in needs else received._replace(leader=None)


def without_surfaces(scan: ScanBatch | None) -> ScanBatch | None:
    """A scan as a law gets it: which surface a beam met is for observers."""
    return scan if scan is None else changed(scan, hits=None)


def _equipment(member: Member) -> tuple:
    return member.law, member.lidars, member.sensors, member.odometry


def _groups(members: Sequence[Member], dt: float) -> list[Group]:
    sharing: dict[tuple, list[int]] = {}
    for i, m in enumerate(members):
        sharing.setdefault((m.law, m.lidar, m.further_lidars, m.sensors, m.odometry.delay), []).append(i)
    return [
        Group(
            law,
            lidar,
            np.array(rows),
            _steps(lidar.rate, dt),
            further_lidars=tuple(
                Clocked(model, _steps(model.rate, dt), _steps_with(lidar, model, dt)) for model in further
            ),
            sensors=tuple(Clocked(one, _steps(one.sensor.rate, dt)) for one in sensors),
            delay=_steps_after(lidar.delay, dt),
            odometry_delay=_steps_after(delay, dt),
        )
        for (law, lidar, further, sensors, delay), rows in sharing.items()
    ]


def _steps(rate: float, dt: float) -> int:
    """From one measurement to the next, at a rate [Hz]."""
    return max(round(1 / (rate * dt)), 1)


def _steps_with(lidar: LidarModel, further: LidarModel, dt: float) -> int:
    """From a scan of a further laser to its use, which is with a scan of `lidar`."""
    first = _steps_after(further.delay, dt)
    return first + (_steps_after(lidar.delay, dt) - first) % _steps(lidar.rate, dt)


def _steps_after(delay: float, dt: float) -> int:
    """From a measurement to the first step that begins no less than a delay [s] later."""
    return math.ceil(delay / dt - 1e-6)
