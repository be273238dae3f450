"""What platoon members sense: lasers, odometry, and the scenario's own sensors. One call serves all that share one."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.lidar import Boxes, Carriers, LidarModel, Occasion, ScanBatch, Scene, scan
from platoontraffic.lidar.noise import GOLDEN, gauss, mixed, scan_keys, sensor_keys
from platoontraffic.plug_ins import end_copy, place_of
from platoontraffic.vehicles.motion import Twist
from platoontraffic.vehicles.odometry import measured
from platoontraffic.vehicles.records import changed, put, take
from platoontraffic.vehicles.sensor import NamedSensor
from platoontraffic.world.fleet import NOTHING, Fleet, Group, Readings
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen, Taken

OUT_OF_SIGHT = 1e8  # place of bodies that a laser does not see [m]


@dataclass(frozen=True)
class Surroundings:
    """The world at one instant, as the scenario's own sensors get it."""

    # Members, in the rows of the fleet, then background traffic in range, then obstacles; on all levels of bridges.
    traffic: TrafficSnapshot
    fleet: Fleet
    scene: Scene  # walls and buildings
    step: int
    seed: int  # of all sensor errors
    name: str  # of the sensor

    def normal(self, rows: np.ndarray, count: int = 1) -> np.ndarray:
        """Errors for these vehicles: nearly normal, of standard deviation 1, bounded at 3.46, (n, count).

        They depend on seed, vehicle, sensor and step only, not on other vehicles or on their order.
        """
        ids = tuple(self.fleet.members[i].id for i in rows)
        keys = scan_keys(sensor_keys(self.seed, ids, f"sensor {self.name}"), self.step)
        return np.column_stack([gauss(mixed(keys + np.uint64(k) * GOLDEN)) for k in range(count)])


class Measurements(NamedTuple):
    """What all members measure at one instant, or what of it arrives at one instant."""

    scans: list[ScanBatch | None]  # of the laser of each group of the fleet; None: not due
    readings: Sequence[Readings]  # of further lasers and own sensors, for each group; (): there are none
    odometry: Twist | None  # own speed and yaw rate, (n,); None: exact
    seen: Sequence[Seen | None] = ()  # the world of the scan of each group; None: not due


@dataclass(eq=False)
class Sensing:
    """All sensors of all members. A sensor measures in the steps in which it is due; all sense the same instant."""

    scene: Scene  # walls and buildings
    engine: str = "raster"
    seed: int = 0  # of all sensor errors

    def sense(self, traffic: TrafficSnapshot, fleet: Fleet, step: int, blind: np.ndarray | None = None) -> Measurements:
        """What is due in this step.

        blind  : members whose lasers lose every beam, (n,) bool; None: there are none
        raises : InputError if a sensor of a plug-in fails
        """
        scans, readings = self.scan(traffic, fleet, step, blind), self.read(traffic, fleet, step, blind)
        seen = [
            None if scan is None else Seen(traffic, group.rows) for group, scan in zip(fleet.groups, scans, strict=True)
        ]
        return Measurements(scans, readings, self.odometry(fleet, step), seen)

    def scan(
        self, traffic: TrafficSnapshot, fleet: Fleet, step: int, blind: np.ndarray | None = None
    ) -> list[ScanBatch | None]:
        """A batch of the laser of each group of the fleet; None where it is not due in this step.

        A return belongs to a row of `traffic`. blind: as in `sense`.
        """
        scans: list[ScanBatch | None] = [None] * len(fleet.groups)
        due = [laser for laser in fleet.lasers if step % laser.every == 0]
        boxes, at = _boxes(traffic, fleet) if due else None, Occasion(traffic.time, step, self.seed)
        for laser in due:
            batch = self._scan(laser.lidar, traffic, boxes, laser.rows, laser.ids, at, blind)
            for group, rows in laser.parts:
                scans[group] = batch if len(laser.parts) == 1 else batch.part(rows)
        return scans

    def read(
        self, traffic: TrafficSnapshot, fleet: Fleet, step: int, blind: np.ndarray | None = None
    ) -> Sequence[Readings]:
        """Further lasers and own sensors of each group, as far as they are due; () where no group has any.

        Arguments and errors as of `sense`.
        """
        if not fleet.has_more_sensors:
            return ()
        boxes, at = _boxes(traffic, fleet), Occasion(traffic.time, step, self.seed)
        readings = []
        for i, group in enumerate(fleet.groups):
            due = [one.sensor for one in group.further_lidars if step % one.every == 0]
            ids = fleet.ids_by_group[i]
            scans = {one.name: self._scan(one, traffic, boxes, group.rows, ids, at, blind) for one in due}
            own = [one.sensor for one in group.sensors if step % one.every == 0]
            sensed = {named.name: self._measured(named, traffic, fleet, group, step) for named in own}
            readings.append(Readings(traffic.time, scans, sensed, dict.fromkeys(scans, Seen(traffic, group.rows))))
        return readings

    def odometry(self, fleet: Fleet, step: int) -> Twist | None:
        """Measured own speed and yaw rate, (n,); None if no member's odometry has errors."""
        if fleet.odometry is None:
            return None
        motion = fleet.motion
        return measured(fleet.odometry, fleet.ids, motion.speed, motion.yaw_rate, self.seed, step)

    def _scan(
        self,
        lidar: LidarModel,
        traffic: TrafficSnapshot,
        boxes: Boxes,
        rows: np.ndarray,
        ids: tuple[str, ...],
        at: Occasion,
        blind: np.ndarray | None,
    ) -> ScanBatch:
        """rows, ids: of its carriers in the fleet, (n,)"""
        batch = scan(lidar, self.scene, boxes, Carriers.unchecked(boxes, rows, ids), at, engine=self.engine)
        for members, bodies in traffic.other_levels:
            again = np.flatnonzero(np.isin(rows, members))
            if again.size:
                level, of_them = _without(boxes, bodies), tuple(ids[k] for k in again.tolist())
                carriers = Carriers.unchecked(level, rows[again], of_them)
                part = scan(lidar, self.scene, level, carriers, at, engine=self.engine)
                batch = _with_rows(batch, again, part)
        if blind is None or not blind[rows].any():
            return batch
        ranges = np.where(blind[rows, None], np.nan, batch.ranges)
        ranges.setflags(write=False)  # as the laser's, or numba compiles the laws once more
        return replace(batch, ranges=ranges)

    def _measured(self, named: NamedSensor, traffic: TrafficSnapshot, fleet: Fleet, group: Group, step: int) -> Any:
        """raises: InputError if the sensor fails, or what it gives has not one row for each vehicle"""
        name, sensor = named
        surroundings = Surroundings(traffic, fleet, self.scene, step, self.seed, name)
        process = os.getpid()
        try:
            reading = sensor(surroundings, group.rows)
            take(reading, np.ones(len(group.rows), bool))  # one row each
        except (Exception, SystemExit) as error:  # whatever a user's code may raise
            what = f"sensor {type(sensor).__qualname__} failed at {traffic.time:.3f} s"
            raise InputError(f"{place_of(sensor, error)}: {what}: {type(error).__name__}: {error}") from error
        finally:
            end_copy(process)
        return reading


def arriving(measured: Measurements, fleet: Fleet, step: int) -> tuple[Measurements, Fleet]:
    """What the laws are given in a step in which this is measured, and the fleet with what is then under way.

    A scan arrives in the first step that begins no less than its laser's delay after it was taken, a reading of the
    odometry likewise.
    """
    if not fleet.is_late:
        return measured, fleet
    nothing = [NOTHING] * len(fleet.groups)
    groups, scans, readings, seen, rows, own = [], [], [], [], [], []
    now = measured.odometry or Twist(fleet.motion.speed, fleet.motion.yaw_rate)
    for k, (group, more) in enumerate(zip(fleet.groups, measured.readings or nothing, strict=True)):
        taken = [Taken(step + one.delay, more.scans[one.sensor.name], more.seen[one.sensor.name])
                 for one in group.further_lidars if one.sensor.name in more.scans]  # fmt: skip
        if measured.scans[k] is not None:
            taken.append(Taken(step + group.delay, measured.scans[k], measured.seen[k]))
        due, under_way = group.under_way.after(taken, step)
        reading, under_way = under_way.read(take(now, group.rows), group.odometry_delay)
        groups.append(group._replace(under_way=under_way))
        rows.append(group.rows)
        own.append(reading)
        by_name = {one.scan.name: one for one in due}
        main = by_name.pop(group.lidar.name, None)
        scans.append(main and main.scan)
        seen.append(main and main.seen)
        further = ({name: getattr(one, part) for name, one in by_name.items()} for part in ("scan", "seen"))
        readings.append(Readings(more.time, next(further), more.sensors, next(further)))
    readings = readings if measured.readings else ()
    return Measurements(scans, readings, put(now, rows, own), seen), changed(fleet, groups=tuple(groups))


def _without(boxes: Boxes, rows: np.ndarray) -> Boxes:
    """Boxes of which some are out of sight of everybody, in the same rows."""
    x = boxes.x.copy()
    x[rows] = OUT_OF_SIGHT
    return replace(boxes, x=x)


def _with_rows(batch: ScanBatch, rows: np.ndarray, part: ScanBatch) -> ScanBatch:
    """A batch with other scans in some rows."""
    arrays = {}
    for name in ("ranges", "hits", "inside"):
        arrays[name] = getattr(batch, name).copy()
        arrays[name][rows] = getattr(part, name)
        arrays[name].setflags(write=False)  # as a scan's
    return replace(batch, **arrays)


def _boxes(traffic: TrafficSnapshot, fleet: Fleet) -> Boxes:
    """The vehicles, with their motion if a lidar sweeps: on others it has no effect.

    Members turn about the middle of their driven axle. SUMO gives no yaw rate of its own vehicles; it is taken as 0.
    """
    if not fleet.has_sweeps:
        still = np.zeros(traffic.x.size)
        return traffic.moving_boxes(still, still, still)
    (cos, sin), n = traffic.facing, fleet.number.size
    yaw_rate, aside = np.zeros((2, cos.size))
    yaw_rate[:n] = fleet.motion.yaw_rate
    aside[:n] = -fleet.model.axle * fleet.motion.yaw_rate
    vx, vy = traffic.speed * cos - aside * sin, traffic.speed * sin + aside * cos
    return traffic.moving_boxes(vx, vy, yaw_rate)
