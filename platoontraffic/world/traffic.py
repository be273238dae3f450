"""All vehicles, pedestrians and obstacles on the road at one instant."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from platoontraffic.lidar import Boxes
from platoontraffic.vehicles.records import every
from platoontraffic.world.events import WALL

PERSON = "person."  # prefix of pedestrians' ids in snapshots: SUMO allows a person and a vehicle of one name


@dataclass(frozen=True)
class TrafficSnapshot:
    """Arrays (n,): platoon members first, in the fleet's order, then background traffic, then obstacles."""

    time: float  # since the platoons were placed [s]
    ids: tuple[str, ...]  # of members and vehicles, as SUMO has them, and of obstacles
    x: np.ndarray  # of the footprint's centre, east [m]
    y: np.ndarray  # of it, north [m]
    heading: np.ndarray  # counter-clockwise from east [rad]
    speed: np.ndarray  # forward [m/s]
    length: np.ndarray  # of the footprint [m]
    width: np.ndarray  # of it [m]
    # Rows of members, and of the bodies on a bridge over their road, or below it: neither sees or touches the others.
    other_levels: tuple[tuple[np.ndarray, np.ndarray], ...] = ()

    @cached_property
    def facing(self) -> tuple[np.ndarray, np.ndarray]:
        """Cosine and sine of the heading, (n,)."""
        return np.cos(self.heading), np.sin(self.heading)

    @cached_property
    def surfaces(self) -> tuple[str, ...]:
        """Names of what hits number: ids; of -1, a wall, and of -2, nothing, as indices from the end."""
        return (*self.ids, "", WALL)

    def with_others(self, others: TrafficSnapshot) -> TrafficSnapshot:
        """This snapshot with the rows of `others` appended."""
        if not others.ids:
            return self
        both = [np.concatenate(pair) for pair in zip(_arrays(self), _arrays(others), strict=True)]
        return TrafficSnapshot(self.time, self.ids + others.ids, *both, self.other_levels)

    def only(self, rows: np.ndarray) -> TrafficSnapshot:
        """This snapshot with some of its rows, in order, on one level."""
        some = [values[rows] for values in _arrays(self)]
        return TrafficSnapshot(self.time, tuple([self.ids[k] for k in rows.tolist()]), *some)

    def on_levels(self, apart: Mapping[int, Set[str]]) -> TrafficSnapshot:
        """This snapshot with other levels. apart: by row of a member, ids of the bodies on another level"""
        row, members = {name: k for k, name in enumerate(self.ids)}, defaultdict(list)
        for i, names in sorted(apart.items()):
            if names:
                members[tuple(sorted(row[name] for name in names))].append(i)
        return replace(self, other_levels=tuple((np.array(m), np.array(bodies)) for bodies, m in members.items()))

    def are_apart(self, one: int, other: int) -> bool:
        """Whether two bodies are on different levels, by their rows."""
        return any(
            (one in members and other in bodies) or (other in members and one in bodies)
            for members, bodies in self.other_levels
        )

    def boxes(self) -> Boxes:
        """Footprints as lidars see them, each owned by its row here."""
        return Boxes(self.x, self.y, self.heading, self.length, self.width, np.arange(len(self.ids)))

    def moving_boxes(self, vx: np.ndarray, vy: np.ndarray, yaw_rate: np.ndarray) -> Boxes:
        """The same with their motion, (n,), as in lidar.Boxes.

        It is called in every step, so only the places are checked; the sizes were checked before the run.

        raises: ValueError (a vehicle is not at a finite place)
        """
        if not every(np.isfinite(self.x + self.y + self.heading)):
            return Boxes(self.x, self.y, self.heading, self.length, self.width, np.arange(len(self.ids)))  # says which
        return Boxes.unchecked(
            x=self.x, y=self.y, heading=self.heading, length=self.length, width=self.width,
            owner=np.arange(self.x.size, dtype=np.int32), vx=vx, vy=vy, yaw_rate=yaw_rate,
        )  # fmt: skip


_arrays = attrgetter("x", "y", "heading", "speed", "length", "width")
