"""The vehicles by name, and the motion of a fleet in which their classes are mixed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.differential import ROBOTS
from platoontraffic.vehicles.motion import Command, Drive, Motion, Twist, VehicleModel
from platoontraffic.vehicles.records import put, stack, take

VEHICLES: dict[str, VehicleModel] = ROBOTS | CARS


class Kind(NamedTuple):
    """The members of one class."""

    rows: np.ndarray
    model: VehicleModel  # of these members, fields (m,)


@dataclass(frozen=True)
class FleetModel:
    """The vehicle models of all members: arrays (n,), each member in its row whatever its class."""

    length: np.ndarray  # of the footprint [m]
    width: np.ndarray
    axle: np.ndarray  # the driven one, ahead of the centre [m]; negative: behind it
    turning_radius: np.ndarray  # at full lock [m]; 0: it turns on the spot
    curvature_rate: np.ndarray  # of steering [1/(m s)]; inf: at once
    steering_lag: np.ndarray  # first order [s]; 0: none
    drive_lag: np.ndarray
    brake_lag: np.ndarray
    hardest_braking: np.ndarray  # [m/s2]; inf: it stops at once
    kinds: tuple[Kind, ...]

    @classmethod
    def of(cls, models: Sequence[VehicleModel]) -> FleetModel:
        # A fleet is made anew whenever a member comes or goes, and most members share a few models.
        distinct = list({id(model): model for model in models}.values())
        place = {id(model): k for k, model in enumerate(distinct)}
        which = np.array([place[id(model)] for model in models], dtype=np.intp)
        kinds = []
        for kind in dict.fromkeys(map(type, distinct)):
            is_of_kind = np.array([type(model) is kind for model in distinct])
            rows, among = np.flatnonzero(is_of_kind[which]), np.cumsum(is_of_kind) - 1
            same = stack([model for model in distinct if type(model) is kind])
            kinds.append(Kind(rows, take(same, among[which[rows]])))
        names = [field.name for field in fields(cls) if field.name != "kinds"]
        columns = (np.array([getattr(model, name) for model in distinct], dtype=float) for name in names)
        return cls(*(column[which] for column in columns), tuple(kinds))

    def axle_position(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The middle of the driven axle, x and y [m]. Arrays (n,)."""
        return motion.x + self.axle * np.cos(motion.heading), motion.y + self.axle * np.sin(motion.heading)

    def strongest_acceleration(self, speed: np.ndarray) -> np.ndarray:
        """Greatest acceleration of each member at its speed [m/s2], (n,); inf: any."""
        strongest = [model.strongest_acceleration(speed[rows]) for rows, model in self.kinds]
        return put(np.zeros(len(speed)), [kind.rows for kind in self.kinds], strongest)

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt [s] under one command, each member by its own model."""
        command = command if isinstance(command, Command) else Command.of(command)
        if len(self.kinds) == 1:
            return self.kinds[0].model.moved(motion, command, dt)
        after = [model.moved(take(motion, rows), take(command, rows), dt) for rows, model in self.kinds]
        return put(motion, [kind.rows for kind in self.kinds], after)
