"""Input of a scan beside the world: the vehicles that carry the scanner, and which scan of the run it is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .scene import FARTHEST, Boxes, owners


@dataclass(frozen=True, eq=False)
class Carriers:
    """Vehicles that carry one scanner each, one vehicle a row; world frame, SI.

    x, y             : centre of the vehicle, (n,); the model's mount is added when it scans [m]
    heading          : counter-clockwise from east, (n,) [rad]
    owner            : owner id of the vehicle, (n,); boxes of this owner are transparent to its scanner
    ids              : names of the rows, (n,); row numbers if not given. Errors depend on the name, not on the row.
                       Names are stored as text, so 1, 1.0 and True are three names
    vx, vy, yaw_rate : motion, (n,) or one value for all [m/s, rad/s]; has an effect only on models with sweeps

    raises: ValueError
    """

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    owner: np.ndarray
    ids: Iterable | None = None
    vx: np.ndarray = 0.0
    vy: np.ndarray = 0.0
    yaw_rate: np.ndarray = 0.0

    def __post_init__(self):
        poses = x, y, heading = [np.array(value, np.float64, ndmin=1) for value in (self.x, self.y, self.heading)]
        owner = owners(self.owner)
        if not (x.shape == y.shape == heading.shape == owner.shape and x.ndim == 1):
            shapes = ", ".join(str(values.shape) for values in (*poses, owner))
            raise ValueError(f"x, y, heading, owner have shapes {shapes}; must be equal, one value a sensor")
        ids = _names(self.ids, len(x))
        good = (np.abs(x) <= FARTHEST) & (np.abs(y) <= FARTHEST) & np.isfinite(heading)
        if not good.all():
            row = int(np.flatnonzero(~good)[0])
            pose = f"{x[row]}, {y[row]}, {heading[row]}"
            limit = f"must be finite, within {FARTHEST:g} m of the origin"
            raise ValueError(f"row {row} ({ids[row]}): pose {pose}; {limit}")
        motion = [np.array(value, np.float64) for value in (self.vx, self.vy, self.yaw_rate)]
        for name, values in zip(("vx", "vy", "yaw_rate"), motion, strict=True):
            if values.shape not in ((), x.shape) or not np.isfinite(values).all():
                raise ValueError(f"{name} = {values}; must be finite, one value or one a sensor")
        for name, value in zip(self.__dataclass_fields__, (*poses, owner, ids, *motion), strict=True):
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, boxes: Boxes, rows: slice | np.ndarray = slice(None), ids: Iterable | None = None) -> Carriers:
        """The vehicles in some rows of `boxes`, in this order; ids name these rows only."""
        pose = boxes.x[rows], boxes.y[rows], boxes.heading[rows]
        return cls(*pose, boxes.owner[rows], ids, boxes.vx[rows], boxes.vy[rows], boxes.yaw_rate[rows])

    @classmethod
    def unchecked(cls, boxes: Boxes, rows: np.ndarray, ids: tuple[str, ...]) -> Carriers:
        """As `of`, where the caller knows that the boxes are sound and the ids distinct."""
        carriers = object.__new__(cls)
        carriers.__dict__.update(
            x=boxes.x[rows], y=boxes.y[rows], heading=boxes.heading[rows], owner=boxes.owner[rows], ids=ids,
            vx=boxes.vx[rows], vy=boxes.vy[rows], yaw_rate=boxes.yaw_rate[rows],
        )  # fmt: skip
        return carriers

    def __len__(self) -> int:
        return len(self.x)


class Occasion(NamedTuple):
    """Which scan of which run it is: the same seed, number and id give the same errors.

    stamp  : time of the world that is scanned; the last beam is measured at this time [s]
    number : number of the scan in the run, 0 or more
    seed   : seed of the run
    """

    stamp: float = 0.0
    number: int = 0
    seed: int = 0


def _names(ids, n):
    if ids is None:
        return _row_numbers(n)
    ids = (ids,) if isinstance(ids, str) else tuple(map(str, ids))
    if len(ids) != n or _distinct(ids) != n:
        raise ValueError(f"{len(ids)} ids, {_distinct(ids)} of them distinct, for {n} sensors; must be one name each")
    return ids


@lru_cache(maxsize=64)  # the same vehicles scan again and again
def _distinct(ids):
    return len(set(ids))


@lru_cache(maxsize=64)
def _row_numbers(n):
    return tuple(map(str, range(n)))
