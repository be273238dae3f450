"""Vehicles on the road at one instant."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from platoontraffic.lidar import Boxes


@dataclass(frozen=True)
class TrafficSnapshot:
    """Platoon members first, in the fleet's order, then SUMO's own vehicles and pedestrians, then obstacles.

    Arrays (n,).
    """

    time: float
    ids: tuple[str, ...]
    x: np.ndarray  # centre of the footprint
    y: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    length: np.ndarray
    width: np.ndarray

    def with_others(self, others: TrafficSnapshot) -> TrafficSnapshot:
        """With others behind, at the same instant."""
        both = (np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)[2:])
        return TrafficSnapshot(self.time, (*self.ids, *others.ids), *both)

    def boxes(self, vx=0.0, vy=0.0, yaw_rate=0.0) -> Boxes:
        """What a lidar sees of the vehicles; the owner of a box is its row here. Their motion is as in lidar.Boxes."""
        owner = np.arange(len(self.ids))
        return Boxes(self.x, self.y, self.heading, self.length, self.width, owner, vx, vy, yaw_rate)
