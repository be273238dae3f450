"""A test bench without SUMO: simulations on bare ground, and laws and scans made by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers import CLOSED_BY, Decision, Law, Sensed, Signals
from platoontraffic.lidar import PRESETS, LaserScan, LidarModel, Mount, ScanBatch, Scene
from platoontraffic.observation.instant import Instant
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.catalogue import VehicleModel
from platoontraffic.vehicles.differential import DifferentialDrive
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import BareGround, members_at

DT = 0.025
ROBOT = DifferentialDrive()
AT_BUMPER = Mount(ROBOT.length / 2 - 0.03)
FOLLOWER_EYE = replace(PRESETS["paper-follower"], mount=AT_BUMPER)
LEADER_EYE = replace(PRESETS["paper-leader"], mount=AT_BUMPER)
BLIND = LidarModel(2, -0.1, 0.1, 0.0, 1.0)  # for leaders that drive by the clock
FAR = LidarModel(2, -0.1, 0.1, 0.0, 300.0)  # for leaders that drive by speed limits where nothing is ahead
NO_WALLS = Scene.from_shapely()
LOOP = Scene.from_shapely(walls=[shapely.box(0, 0, 6, 5)], solids=[shapely.box(2, 2, 4, 3)])  # a road 2 m wide

POINT = DifferentialDrive(length=0.002, width=0.02, axle=0.0)  # laser, rear and driven axle in one place
WIDE_EYE = LidarModel(1441, -np.pi / 4, np.pi / 4, 0.01, 4.0)

snapshot = members_at


@dataclass(frozen=True)
class Prescribed(Law):
    """A law for leaders: the command is a function of time."""

    twist_at: Callable[[float], Twist | Drive]

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        command = self.twist_at(sensed.scan.stamp)
        return Decision(type(command)(*(np.full(len(sensed.speed), float(value)) for value in command)))


def constant(speed: float, yaw_rate: float = 0.0) -> Prescribed:
    return Prescribed(lambda time: Twist(speed, yaw_rate))


@dataclass(frozen=True)
class Unseeing(Law):
    """Another law, that is given scans without any return from one time to another [s]."""

    law: Law
    since: float
    until: float

    @property
    def needs(self) -> frozenset[str]:
        return self.law.needs

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        scan = sensed.scan
        if self.since <= scan.stamp < self.until:
            nothing = np.full_like(scan.ranges, np.inf)
            nothing.setflags(write=False)  # as the laser's, or numba compiles once more
            sensed = replace(sensed, scan=replace(scan, ranges=nothing))
        return self.law(sensed, memory, dt)


class StopLine(BareGround):
    """Bare ground with a stop line across the x axis."""

    def __init__(
        self,
        step: float,
        x: float = np.inf,  # of the line [m]
        is_open: Callable[[float], bool] = lambda time: True,
        *,
        minor: bool = False,
        changing: bool = False,  # while it is closed
    ) -> None:
        super().__init__(step)
        self._x, self._is_open, self._minor, self._changing = x, is_open, minor, changing

    def signals(self, fleet: Fleet) -> Signals:
        ahead = self._x - fleet.motion.x - fleet.model.length / 2
        passed, n = ahead < 0, len(fleet)
        may_pass = passed | self._is_open(self.time)
        light = np.full(n, CLOSED_BY.index("light"))
        return Signals(
            np.where(passed, np.inf, ahead), may_pass, np.full(n, self._minor), self._changing & ~may_pass, light
        )


class Log(NamedTuple):
    """A simulation, instant by instant: time (k,), the rest (k, n), one column a member."""

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    turned: np.ndarray
    speed: np.ndarray
    wanted_speed: np.ndarray
    wanted_yaw_rate: np.ndarray
    distance: np.ndarray  # of the law's target; NaN: none
    bearing: np.ndarray
    on: np.ndarray  # what that target lies on: a column, -1 a wall, -2 nothing
    acceleration: np.ndarray
    yaw_rate: np.ndarray
    axle: np.ndarray  # middle of the driven axle, (k, n, 2)

    def locked(self) -> np.ndarray:
        """Which followers have their predecessor for their target, (k, n - 1)."""
        return self.on[:, 1:] == np.arange(self.on.shape[1] - 1)


def platoon(
    leader: Any,
    follower: Any = None,
    followers: int = 0,
    *,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    distance: float = 0.5,
    model: VehicleModel = ROBOT,
    leader_eye: LidarModel = BLIND,
    eye: LidarModel = FOLLOWER_EYE,
    speed: float = 0.0,
    odometry: OdometryErrors = ODOMETRY["none"],
) -> list[Member]:
    """A leader, its centre at a pose, and followers straight behind it, each laser `distance` behind a rear."""
    x, y, heading = at
    spacing = distance + model.length / 2 + eye.mount.x
    return [
        Member(
            id=f"robot.{i}",
            platoon="robot",
            place=i,
            model=model,
            lidar=eye if i else leader_eye,
            law=follower if i else leader,
            edge="",
            lane=0,
            position=0.0,
            pose=(x - i * spacing * np.cos(heading), y - i * spacing * np.sin(heading), heading),
            speed=speed,
            odometry=odometry,
        )
        for i in range(followers + 1)
    ]


def drive(
    members: Sequence[Member],
    scene: Scene,
    seconds: float,
    dt: float = DT,
    observe: Callable[[Instant], None] = lambda now: None,
    **setting: Any,
) -> Log:
    """A simulation on bare ground, until its end or until all members have arrived.

    observe: called at every instant
    setting: further fields of `Setting`
    """
    rows = []
    with Simulation(Setting(members, scene, dt, steps=round(seconds / dt), **setting)) as simulation:
        for now in simulation:
            observe(now)
            if not len(now.fleet):
                break
            fleet, motion = now.fleet, now.fleet.motion
            where = motion.x, motion.y, motion.heading, motion.turned, motion.speed
            more = motion.acceleration, motion.yaw_rate, np.column_stack(fleet.model.axle_position(motion))
            rows.append((*where, *fleet.command.twist, *fleet.target, targets(now), *more))
    return Log(np.arange(len(rows)) * dt, *(np.array(column) for column in zip(*rows, strict=True)))


def targets(now: Instant) -> np.ndarray:
    """What the beam nearest to each law's target met, (n,): a row of `now.traffic`, -1 a wall, -2 none or no scan."""
    fleet = now.fleet
    on = np.full(len(fleet), -2)
    for group, scan, world in zip(fleet.groups, now.scans, now.seen, strict=True):
        if scan is None:
            continue
        bearing = fleet.target.bearing[group.rows]
        seen = ~np.isnan(bearing)
        beam = np.rint((np.where(seen, bearing, 0.0) - scan.model.angle_min) / scan.model.angle_increment).astype(int)
        hit = scan.hits[np.arange(len(beam)), np.clip(beam, 0, scan.model.samples - 1)]
        rows = np.array([*(now.traffic.ids.index(one) for one in world.traffic.ids), -2, -1])  # of the hits now
        on[group.rows] = np.where(seen, rows[hit], -2)
    return on


def scan_of(ranges: np.ndarray, model: LidarModel = PRESETS["paper-follower"]) -> LaserScan:
    return batch_of([ranges], model)[0]


def batch_of(ranges: Sequence[np.ndarray], model: LidarModel = PRESETS["paper-follower"]) -> ScanBatch:
    """Scans with these ranges, (n, k), made by hand."""
    ranges = np.array(ranges)
    n, hits = len(ranges), np.full(ranges.shape, -2, np.int32)
    for array in (ranges, hits):
        array.setflags(write=False)  # as the laser's, or numba compiles once more
    return ScanBatch(model, 0.0, tuple(map(str, range(n))), ranges, hits, np.zeros(n, dtype=bool))


def asked(
    law: Any, ranges: Sequence[np.ndarray], model: LidarModel = PRESETS["paper-follower"], memory=None
) -> Decision:
    """What a law decides on scans made by hand, (n, k)."""
    n = len(ranges)
    return law(Sensed(batch_of(ranges, model), np.zeros(n), np.zeros(n)), memory, DT)


def rear_at(distance: float, width: float, bearing: float = 0.0, model: LidarModel = PRESETS["paper-follower"]):
    """Ranges to a rear that stands square to the direction `bearing`, and to nothing else, (k,)."""
    off = model.angles - bearing
    return np.where(np.abs(distance * np.tan(off)) <= width / 2, distance / np.cos(off), np.inf)


def amplitude(time: np.ndarray, values: np.ndarray, omega: float) -> np.ndarray:
    """Amplitude of the oscillation at omega in values (k, n), (n,)."""
    basis = np.column_stack([np.cos(omega * time), np.sin(omega * time), np.ones_like(time)])
    cos, sin, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return np.hypot(cos, sin)
