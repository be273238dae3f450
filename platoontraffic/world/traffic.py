"""All vehicles, pedestrians and obstacles on the road at one instant."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from platoontraffic.lidar import Boxes


@dataclass(frozen=True)
class TrafficSnapshot:
    """Arrays (n,): platoon members first, in the fleet's order, then background traffic, then obstacles."""

    time: float  # [s]
    ids: tuple[str, ...]
    x: np.ndarray  # centre of the footprint [m]
    y: np.ndarray
    heading: np.ndarray  # counter-clockwise from east [rad]
    speed: np.ndarray  # forward [m/s]
    length: np.ndarray  # of the footprint [m]
    width: np.ndarray

    def with_others(self, others: TrafficSnapshot) -> TrafficSnapshot:
        """This snapshot with the rows of `others` appended."""
        both = (np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)[2:])
        return TrafficSnapshot(self.time, (*self.ids, *others.ids), *both)

    def boxes(self, vx=0.0, vy=0.0, yaw_rate=0.0) -> Boxes:
        """Footprints as lidars see them, each owned by its row here; motion (vx, vy, yaw_rate) as in lidar.Boxes."""
        owner = np.arange(len(self.ids))
        return Boxes(self.x, self.y, self.heading, self.length, self.width, owner, vx, vy, yaw_rate)
