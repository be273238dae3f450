"""All platoon members, as arrays."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from lidar import LidarModel, ScanBatch
from platoontraffic.controllers import Decision, Sensed, Target
from platoontraffic.errors import InputError
from platoontraffic.polyline import Polyline
from platoontraffic.vehicle import DifferentialDrive, Motion, Twist, stack

ROUTE_POINTS = 25  # of the path ahead that a law with `needs = {"route"}` is given
ROUTE_REACH = 6.0  # how far they reach, in vehicle lengths


@dataclass(frozen=True)
class Member:
    """A vehicle of a platoon as it was deployed."""

    id: str
    platoon: str
    place: int  # 0 leads
    model: DifferentialDrive
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
    groups: tuple[Group, ...]
    model: DifferentialDrive  # of all members, fields (n,)
    predecessor: np.ndarray  # row of the member ahead; -1 for leaders
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
            Group(law, lidar, np.array(rows), round(1 / (lidar.rate * dt))) for (law, lidar), rows in sharing.items()
        )
        return cls(
            members=tuple(members),
            groups=groups,
            model=stack([m.model for m in members]),
            predecessor=np.array([row_of.get((m.platoon, m.place - 1), -1) for m in members]),
            motion=Motion.at_rest(*zip(*(m.pose for m in members), strict=True)),
            twist=Twist(np.zeros(n), np.zeros(n)),
            target=Target(np.full(n, np.nan), np.full(n, np.nan)),
            station=np.array(
                [m.path.project(*m.pose[:2], near=0.0, window=np.inf)[0] if m.path else 0.0 for m in members]
            ),
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
            sensed = Sensed(scan, self.motion.speed[rows], self.motion.yaw_rate[rows], route)
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
        return replace(self, motion=self.model.moved(self.motion, self.twist, dt))

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
        """The law's decision; a law from a plug-in that fails, or gives no number, is the user's to mend."""
        law = type(group.law)
        at = f"at {sensed.scan.stamp:.3f} s"
        try:
            decision = group.law(sensed, memory, dt)
            twist = np.broadcast_arrays(*decision.twist, sensed.speed)[:2]
        except Exception as error:
            if law.__module__.startswith("platoontraffic."):
                raise
            what = f"failed {at}: {type(error).__name__}: {error}"
            raise InputError(f"{_place(law, error)}: law {law.__qualname__} {what}") from error
        nonsense = np.flatnonzero(~np.isfinite(twist).all(axis=0))
        if len(nonsense):
            row = nonsense[0]
            vehicle = self.members[group.rows[row]].id
            what = f"gave speed {twist[0][row]}, yaw rate {twist[1][row]} for {vehicle} {at}; both must be finite"
            raise InputError(f"{_place(law)}: law {law.__qualname__} {what}")
        return decision


def _place(law: type, error: Exception | None = None) -> str:
    """`file:line` in the law's own file: where it failed, or else where it is written."""
    file, line = inspect.getsourcefile(law), inspect.getsourcelines(law)[1]
    frames = traceback.extract_tb(error.__traceback__) if error else []
    return f"{file}:{next((f.lineno for f in reversed(frames) if f.filename == file), line)}"


def _first_station(member: Member) -> float:
    """Where on its path a member starts; it may be anywhere on it."""
    return member.path.project(*member.pose[:2], near=0.0, window=np.inf)[0] if member.path else 0.0
