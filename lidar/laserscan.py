"""Measurements of a scanner. Fields as in sensor_msgs/LaserScan; special values as in REP 117.

Nothing within range_max: +inf. Nearer than range_min, or the sensor is inside a solid: −inf. Erroneous: NaN.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .model import LidarModel
from .noise import DEFAULT_NAME

NO_HIT = -2
"""In `hits`: the beam meets nothing within range_max."""


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """One scan of one sensor; ranges and hits are (k,), angles in the sensor frame.

    stamp    : time of the first beam [s]
    frame_id : id of the vehicle; for a scanner of another name than the default, id/name
    ranges   : distance to the first surface on each beam [m], or ±inf, NaN
    hits     : owner of that surface, also where it is too close or the return is lost; −1 the static scene, −2
               nothing. None where the receiver of the scan is not to know
    inside   : the sensor is inside a solid
    name     : of the scanner
    """

    stamp: float
    frame_id: str
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    scan_time: float
    range_min: float
    range_max: float
    ranges: np.ndarray
    hits: np.ndarray | None
    inside: bool
    name: str = DEFAULT_NAME

    def angles(self) -> np.ndarray:
        """Beam angles, (k,) [rad]."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges))

    def valid(self) -> np.ndarray:
        """Which beams measured a distance, (k,) bool."""
        return np.isfinite(self.ranges)

    def points(self, sensor=(0.0, 0.0, 0.0)) -> np.ndarray:
        """Measured points in beam order, (p, 2) [m].

        sensor : pose x, y, yaw of the sensor in the frame of the result; by default the sensor frame
        """
        x, y, yaw = sensor
        valid = self.valid()
        angles, ranges = yaw + self.angles()[valid], self.ranges[valid].astype(np.float64)
        return np.stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)], axis=1)

    def to_ros_dict(self) -> dict:
        """The fields of a sensor_msgs/LaserScan message as plain Python floats, lists and strings.

        Ranges keep ±inf and NaN, as REP 117 wants; strict JSON has no such numbers.
        """
        sec, nanosec = divmod(round(float(self.stamp) * 1e9), 10**9)
        names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
        return {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": self.frame_id},
            **{name: float(getattr(self, name)) for name in names},
            "ranges": np.asarray(self.ranges, dtype=np.float64).tolist(),
            "intensities": [],
        }

    def filled(self, no_return=None, too_close=None, error=None) -> np.ndarray:
        """Ranges, (k,) float64, with numbers for +inf (default range_max), −inf (range_min) and NaN (range_max)."""
        return _filled(self.ranges, self, no_return, too_close, error)


@dataclass(frozen=True, eq=False)
class ScanBatch:
    """Scans of n sensors of one model that begin at one time; `batch[0]` and `batch["veh.3"]` are LaserScans that share
    its memory.

    stamp        : time of the first beams [s]
    ids          : vehicle of each row
    ranges, hits : as in LaserScan, (n, k)
    inside       : (n,) bool
    """

    model: LidarModel
    stamp: float
    ids: tuple[str, ...]
    ranges: np.ndarray
    hits: np.ndarray | None
    inside: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def name(self) -> str:
        """Name of the scanner."""
        return self.model.name

    def __getitem__(self, key: int | str) -> LaserScan:
        row = self._row_of(key) if isinstance(key, str) else operator.index(key)
        model, vehicle = self.model, self.ids[row]
        return LaserScan(
            stamp=self.stamp,
            frame_id=vehicle if model.name == DEFAULT_NAME else f"{vehicle}/{model.name}",
            angle_min=model.angle_min,
            angle_max=model.angle_max,
            angle_increment=model.angle_increment,
            time_increment=model.sweep_time / (model.samples - 1),
            scan_time=1.0 / model.rate,
            range_min=model.range_min,
            range_max=model.range_max,
            ranges=self.ranges[row],
            hits=None if self.hits is None else self.hits[row],
            inside=bool(self.inside[row]),
            name=model.name,
        )

    @cached_property
    def _row_by_id(self):
        return {name: row for row, name in enumerate(self.ids)}

    def _row_of(self, vehicle):
        try:
            return self._row_by_id[vehicle]
        except KeyError:
            raise KeyError(f"{vehicle!r} is not among the {len(self)} ids of the batch") from None

    def rows(self, which) -> ScanBatch:
        """A batch of some rows, copied: row numbers or ids, in the given order, or a mask (n,) bool.

        raises: KeyError, IndexError, TypeError
        """
        which = np.asarray(which)
        if which.dtype.kind == "U":
            indices = np.array([self._row_of(name) for name in which.tolist()], dtype=np.intp)
        elif which.dtype == bool and which.shape == (len(self),):
            indices = np.flatnonzero(which)
        elif which.dtype.kind in "iu" or which.size == 0:
            indices = which.astype(np.intp)
        else:
            given = f"rows are given as {which.dtype} {which.shape}"
            raise TypeError(f"{given}; must be row numbers, ids, or a mask ({len(self)},) bool")
        ids = tuple(self.ids[row] for row in indices)
        hits = None if self.hits is None else self.hits[indices]
        return ScanBatch(self.model, self.stamp, ids, self.ranges[indices], hits, self.inside[indices])

    def part(self, rows: slice) -> ScanBatch:
        """A batch of successive rows, which shares the memory of this one."""
        hits = None if self.hits is None else self.hits[rows]
        return ScanBatch(self.model, self.stamp, self.ids[rows], self.ranges[rows], hits, self.inside[rows])

    def filled(self, no_return=None, too_close=None, error=None) -> np.ndarray:
        """As LaserScan.filled, (n, k) float64."""
        return _filled(self.ranges, self.model, no_return, too_close, error)


def _filled(ranges, limits, no_return, too_close, error):
    filled = ranges.astype(np.float64)
    filled[ranges == np.inf] = limits.range_max if no_return is None else no_return
    filled[ranges == -np.inf] = limits.range_min if too_close is None else too_close
    filled[np.isnan(ranges)] = limits.range_max if error is None else error
    return filled
