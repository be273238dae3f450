"""All platoon members, as arrays."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from lidar import LidarModel, ScanBatch
from lidar.pose import wrap
from platoontraffic.controllers import Decision, Sensed, Target
from platoontraffic.errors import InputError
from platoontraffic.models import FleetModel, VehicleModel
from platoontraffic.polyline import Polyline
from platoontraffic.vehicle import Motion, Twist

ROUTE_POINTS = 25  # of the path ahead that a law with `needs = {"route"}` is given
ROUTE_REACH = 6.0  # how far they reach, in vehicle lengths


@dataclass(frozen=True)
class Member:
    """A vehicle of a platoon as it was deployed."""

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
    route: tuple[str, ...] = ()  # edges it means to drive; empty: wherever its law takes it
    path: Polyline | None = None  # the lanes of that route

    @property
    def seen_ahead_of_gap(self) -> float:
        """Distance from the laser minus gap, bumper to bumper [m]: the laser stands behind the front bumper."""
        return self.model.length / 2 - self.lidar.mount.x


class Group(NamedTuple):
    """Members that share a law and a lidar, and so are scanned and decided for in one call."""

    law: Any
    lidar: LidarModel
    rows: np.ndarray
    every: int  # scans, and decides, in every so many steps


@dataclass(frozen=True)
class Fleet:
    """Members, what they do, and what their laws remember. Arrays (n,), in the order of `members`."""

    members: tuple[Member, ...]
    number: np.ndarray  # of each among all that the run ever has
    groups: tuple[Group, ...]
    model: FleetModel
    predecessor: np.ndarray  # row of the member ahead; -1 for leaders
    native: np.ndarray  # those that SUMO's own driver model drives, (n,) bool
    motion: Motion
    twist: Twist  # the last command
    target: Target  # what each law took for its predecessor
    station: np.ndarray  # on the member's own path [m]
    memories: tuple[Any, ...]  # one a group

    @classmethod
    def deployed(cls, members: Sequence[Member], dt: float) -> Fleet:
        n = len(members)
        row_of = {(m.platoon, m.place): i for i, m in enumerate(members)}
        sharing: dict[tuple, list[int]] = {}
        for i, m in enumerate(members):
            sharing.setdefault((m.law, m.lidar), []).append(i)
        groups = tuple(
            Group(law, lidar, np.array(rows), max(round(1 / (lidar.rate * dt)), 1))
            for (law, lidar), rows in sharing.items()
        )
        return cls(
            members=tuple(members),
            number=np.arange(n),
            groups=groups,
            model=FleetModel.of([m.model for m in members]),
            predecessor=np.array([row_of.get((m.platoon, m.place - 1), -1) for m in members]),
            native=np.array([getattr(m.law, "native", False) for m in members]),
            motion=Motion.at_rest(*zip(*(m.pose for m in members), strict=True)),
            twist=Twist(np.zeros(n), np.zeros(n)),
            target=Target(np.full(n, np.nan), np.full(n, np.nan)),
            # A path begins at the lane where the platoon does.
            station=np.array([m.path.project(*m.pose[:2], 0.0, window=np.inf)[0] if m.path else 0.0 for m in members]),
            memories=(None,) * len(groups),
        )

    def __len__(self) -> int:
        return len(self.members)

    def decided(self, scans: Sequence[ScanBatch | None], dt: float) -> Fleet:
        """Every group whose lidar has just scanned decides; the others (None) keep their command."""
        speed, yaw_rate = (values.copy() for values in self.twist)
        distance, bearing = (values.copy() for values in self.target)
        station = self.station.copy()
        memories = list(self.memories)
        for g, (group, scan) in enumerate(zip(self.groups, scans, strict=True)):
            if scan is None:
                continue
            rows, route = group.rows, None
            if "route" in getattr(group.law, "needs", ()):
                station[rows], route = self._route_ahead(rows)
            seen = replace(scan, hits=None)  # whose surface a beam met is for the observer, not for a law
            sensed = Sensed(seen, self.motion.speed[rows], self.motion.yaw_rate[rows], route)
            decision = self._ask(group, sensed, memories[g], group.every * dt)
            speed[rows], yaw_rate[rows] = decision.twist
            distance[rows], bearing[rows] = decision.target
            memories[g] = decision.memory
        return replace(
            self,
            twist=Twist(speed, yaw_rate),
            target=Target(distance, bearing),
            station=station,
            memories=tuple(memories),
        )

    def moved(self, dt: float) -> Fleet:
        """After dt; those that SUMO drives stay, until it has moved them."""
        motion = self.model.moved(self.motion, self.twist, dt)
        return self._with_motion(np.flatnonzero(self.native), self.motion, motion)

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

    def _route_ahead(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stations (m,) on the members' own paths, and points (m, k, 2) of the paths ahead.

        The points lie ROUTE_REACH vehicle lengths along, as seen from the driven axle: x forward, y to the left.
        """
        x, y = self.model.axle_position(self.motion)
        stations, points = [], []
        for i in rows:
            path, length = self.members[i].path, self.members[i].model.length
            station, _ = path.project(x[i], y[i], near=self.station[i], window=5 * length)
            ahead = path.at(station + np.linspace(0, ROUTE_REACH * length, ROUTE_POINTS)) - (x[i], y[i])
            cos, sin = np.cos(self.motion.heading[i]), np.sin(self.motion.heading[i])
            stations.append(station)
            points.append(ahead @ np.array([[cos, -sin], [sin, cos]]))
        return np.array(stations), np.array(points)

    def _ask(self, group: Group, sensed: Sensed, memory: Any, dt: float) -> Decision:
        """The law's decision with arrays (n,); a law from a plug-in that gives none is the user's to mend."""
        rows = sensed.speed.shape
        decision = _call(group.law, f"at {sensed.scan.stamp:.3f} s", group.law, sensed, memory, dt)
        try:
            speed, yaw_rate = (np.broadcast_to(_numbers(values), rows) for values in decision.twist)
            distance, bearing = (np.broadcast_to(_numbers(values), rows) for values in decision.target)
            memory = decision.memory
        except (AttributeError, TypeError, ValueError) as error:
            if _is_ours(group.law):
                raise
            what = f"gave {decision!r:.200}; must be a Decision of a Twist and a Target with numbers, {rows[0]} rows"
            raise InputError(f"{_place(group.law)}: law {type(group.law).__qualname__} {what}") from error
        sound = np.isfinite(speed) & np.isfinite(yaw_rate) & ~np.isinf(distance) & ~np.isinf(bearing)
        nonsense = np.flatnonzero(~sound)
        if len(nonsense):
            row = nonsense[0]
            vehicle = f"{self.members[group.rows[row]].id} at {sensed.scan.stamp:.3f} s"
            given = f"speed {speed[row]}, yaw rate {yaw_rate[row]}, target {distance[row]}, {bearing[row]}"
            what = f"gave {given} for {vehicle}; must be finite, a target may be NaN"
            raise InputError(f"{_place(group.law)}: law {type(group.law).__qualname__} {what}")
        return Decision(Twist(speed, yaw_rate), memory, Target(distance, bearing))


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
