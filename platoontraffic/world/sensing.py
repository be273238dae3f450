"""Lidar scans and odometry of platoon members: one batch call for all lidars that share a model and a law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from platoontraffic.lidar import Boxes, Carriers, Occasion, ScanBatch, Scene, scan
from platoontraffic.vehicles.motion import Twist
from platoontraffic.vehicles.odometry import ODOMETRY, measured
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.traffic import TrafficSnapshot


@dataclass(frozen=True)
class Sensing:
    scene: Scene  # walls and buildings
    engine: str = "raster"
    seed: int = 0  # of all sensor errors

    def scan(self, traffic: TrafficSnapshot, fleet: Fleet, step: int) -> list[ScanBatch | None]:
        """A batch for each group of the fleet; None where the lidar is not due in this step.

        All members sense the same instant. A return belongs to a row of `traffic`.
        """
        boxes = _boxes(traffic, fleet)
        scans: list[ScanBatch | None] = []
        for group in fleet.groups:
            rows = group.rows
            due = step % group.every == 0 and not fleet.native[rows[0]]  # a group shares its law
            scans.append(
                scan(
                    group.lidar,
                    self.scene,
                    boxes,
                    Carriers.of(boxes, rows, tuple(fleet.members[i].id for i in rows)),
                    Occasion(traffic.time, step, self.seed),
                    engine=self.engine,
                )
                if due
                else None
            )
        return scans

    def odometry(self, fleet: Fleet, step: int) -> Twist | None:
        """Measured own speed and yaw rate, (n,); None if no member's odometry has errors."""
        errors = [m.odometry for m in fleet.members]
        if all(one == ODOMETRY["none"] for one in errors):
            return None
        ids, motion = tuple(m.id for m in fleet.members), fleet.motion
        return measured(errors, ids, motion.speed, motion.yaw_rate, self.seed, step)


def _boxes(traffic: TrafficSnapshot, fleet: Fleet) -> Boxes:
    """The vehicles with their motion, which matters to lidars that sweep.

    Members turn about the middle of their driven axle. SUMO gives no yaw rate of its own vehicles; it is taken as 0.
    """
    cos, sin = np.cos(traffic.heading), np.sin(traffic.heading)
    yaw_rate, aside = np.zeros(len(cos)), np.zeros(len(cos))
    yaw_rate[: len(fleet)] = fleet.motion.yaw_rate
    aside[: len(fleet)] = -fleet.model.axle * fleet.motion.yaw_rate
    vx, vy = traffic.speed * cos - aside * sin, traffic.speed * sin + aside * cos
    return traffic.boxes(vx, vy, yaw_rate)
