"""The motion models of a whole fleet, robots and cars mixed, and the vehicles there are by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from platoontraffic.vehicles.bicycle import CARS, Car
from platoontraffic.vehicles.motion import ROBOTS, Command, DifferentialDrive, Drive, Motion, Twist, stack

VehicleModel = DifferentialDrive | Car

VEHICLES: dict[str, VehicleModel] = ROBOTS | CARS


class Kind(NamedTuple):
    """Members of one class."""

    rows: np.ndarray
    model: VehicleModel  # of these members, fields (m,)


@dataclass(frozen=True)
class FleetModel:
    """What all members are: arrays (n,), each member in its row whatever its class."""

    length: np.ndarray  # of the footprint [m]
    width: np.ndarray
    axle: np.ndarray  # the driven one, ahead of the centre [m]; negative: behind it
    kinds: tuple[Kind, ...]

    @classmethod
    def of(cls, models: Sequence[VehicleModel]) -> FleetModel:
        rows: dict[type, list[int]] = {}
        for i, model in enumerate(models):
            rows.setdefault(type(model), []).append(i)
        kinds = tuple(Kind(np.array(which), stack([models[i] for i in which])) for which in rows.values())
        size = (np.array([getattr(m, name) for m in models], dtype=float) for name in ("length", "width", "axle"))
        return cls(*size, kinds)

    def axle_position(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The middle of the driven axle. Arrays (n,)."""
        return motion.x + self.axle * np.cos(motion.heading), motion.y + self.axle * np.sin(motion.heading)

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt under one command, each member by its own class."""
        command = command if isinstance(command, Command) else Command.of(command)
        after = {f.name: np.empty(len(self.length)) for f in fields(Motion)}
        for rows, model in self.kinds:
            moved = model.moved(motion.of(rows), command.rows(rows), dt)
            for name, values in after.items():
                values[rows] = getattr(moved, name)
        return Motion(**after)
