"""What every platoon member's lidar sees: one batch call for all that share a model and a law."""

from __future__ import annotations

from dataclasses import dataclass

from lidar import ScanBatch, Scene, scan
from platoontraffic.fleet import Fleet
from platoontraffic.traffic import TrafficSnapshot


@dataclass(frozen=True)
class Sensing:
    scene: Scene  # what stands still
    engine: str = "numpy"

    def scan(self, traffic: TrafficSnapshot, fleet: Fleet, step: int) -> list[ScanBatch | None]:
        """A batch for each of the fleet's groups; None where the lidar is not due in this step.

        All members sense the same instant. The owner of a return is a row of `traffic`.
        """
        boxes = traffic.boxes()
        scans: list[ScanBatch | None] = []
        for group in fleet.groups:
            rows = group.rows
            due = step % group.every == 0
            scans.append(
                scan(
                    group.lidar,
                    self.scene,
                    boxes,
                    traffic.x[rows],
                    traffic.y[rows],
                    traffic.heading[rows],
                    owner=rows,
                    ids=tuple(fleet.members[i].id for i in rows),
                    stamp=traffic.time,
                    engine=self.engine,
                )
                if due
                else None
            )
        return scans
