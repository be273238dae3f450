"""Drawings of the members in sumo-gui: how far each laser sees, and the target of each law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.lidar.pose import compose
from platoontraffic.world.fleet import Fleet

# SUMO draws transparent colours opaque where there is a road; so a fan shows the road through slits between blades.
BLADE = np.radians(1.25)  # width of a blade, and of the slit beside it [rad]
CORNERS = 3  # of a blade of several beams, besides the one at the laser
TARGET_SIZE = 0.3  # half the diagonal of the diamond at a target [vehicle widths]

FAN_OF_LEADER, FAN, TARGET = (140, 190, 220), (240, 200, 110), (213, 0, 120)  # red, green, blue
FAN_LAYER, TARGET_LAYER = 120, 1200  # on the road and below vehicles; above them


class Shape(NamedTuple):
    """A filled polygon."""

    corners: np.ndarray  # (k, 2) world frame [m]
    colour: tuple[int, int, int]
    layer: int


def shapes(fleet: Fleet, ranges: Mapping[str, np.ndarray]) -> dict[str, Shape]:
    """Shapes to draw, by name: a fan of each member with ranges, a diamond at each of its targets.

    ranges: by member, of its last scan, (samples,) [m]. They are drawn at its present pose, so that the fan of a sensor
            that scans less often than the world steps stays on its vehicle
    """
    motion, drawn = fleet.motion, {}
    for group in fleet.groups:
        for row in group.rows.tolist():
            member = fleet.members[row]
            if member.id not in ranges:
                continue
            pose = compose(motion.x[row], motion.y[row], motion.heading[row], group.lidar.mount)
            reached = fan(ranges[member.id], group.lidar)
            colour = FAN_OF_LEADER if member.place == 0 else FAN
            drawn[f"fan of {member.id}"] = Shape(_in_world(reached, *pose), colour, FAN_LAYER)
            distance, bearing = float(fleet.target.distance[row]), float(fleet.target.bearing[row])
            if np.isfinite(distance):
                size = TARGET_SIZE * member.model.width
                at = distance * np.array([np.cos(bearing), np.sin(bearing)])
                diamond = at + size * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
                drawn[f"target of {member.id}"] = Shape(_in_world(diamond, *pose), TARGET, TARGET_LAYER)
    return drawn


def fan(ranges: np.ndarray, model: LidarModel) -> np.ndarray:
    """Outline of blades that end where the beams do, each from the laser and back, in the laser's frame, (k, 2) [m].

    A beam that met nothing is drawn to the longest range, one that met something too near to the shortest; lost beams
    are left out.

    ranges: (samples,) [m]
    """
    width = max(round(BLADE / model.angle_increment), 1)
    begins = np.arange(0, max(model.samples - width, 1), 2 * width)
    beams = np.linspace(begins, begins + width, min(CORNERS, width + 1), dtype=int).T  # (blades, corners)
    ends = (np.clip(ranges, model.range_min, model.range_max) * model.directions).T[beams]
    outline = np.insert(ends, 0, 0.0, axis=1).reshape(-1, 2)
    return outline[~np.isnan(outline[:, 0])]


def scanned(fleet: Fleet, scans: Sequence[ScanBatch | None]) -> dict[str, np.ndarray]:
    """Ranges (samples,) [m] by member, of the groups that have just scanned."""
    return {
        fleet.members[row].id: batch.ranges[k]
        for group, batch in zip(fleet.groups, scans, strict=True)
        if batch is not None
        for k, row in enumerate(group.rows.tolist())
    }


def _in_world(points: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return points @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
