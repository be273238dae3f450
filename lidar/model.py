"""What a scanner is: its beams, its limits and where it sits on the vehicle."""

import math
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType

import numpy as np


@dataclass(frozen=True)
class Mount:
    """Pose of the sensor in the body frame, whose origin is the centre of the vehicle [m, rad]."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self):
        _refuse_non_finite(self, "x", "y", "yaw")


@dataclass(frozen=True)
class LidarModel:
    """A planar scanner; beams lie in the sensor frame, zero ahead, counter-clockwise, both ends of the fan included.

    samples              : beams in a scan
    angle_min, angle_max : first and last beam [rad]
    range_min, range_max : nearest and farthest distance it can tell [m]
    rate                 : scans per second [Hz]
    mount                : where it sits on the vehicle
    """

    samples: int
    angle_min: float
    angle_max: float
    range_min: float
    range_max: float
    rate: float = 40.0
    mount: Mount = field(default_factory=Mount)

    def __post_init__(self):
        _refuse_non_finite(self, *(f.name for f in fields(self) if f.name != "mount"))
        if self.samples != int(self.samples) or self.samples < 2:
            raise ValueError(f"samples = {self.samples}; must be a whole number, 2 or more")
        if self.angle_max <= self.angle_min:
            raise ValueError(f"angle_max = {self.angle_max}; must be above angle_min = {self.angle_min}")
        if self.angle_max - self.angle_min > 2 * math.pi * (1 + 1e-12):
            raise ValueError(f"field of view = {self.angle_max - self.angle_min} rad; must not exceed a full turn")
        if self.range_min < 0:
            raise ValueError(f"range_min = {self.range_min}; must not be negative")
        if self.range_max <= self.range_min:
            raise ValueError(f"range_max = {self.range_max}; must be above range_min = {self.range_min}")
        if self.rate <= 0:
            raise ValueError(f"rate = {self.rate}; must be positive")

    @property
    def angle_increment(self) -> float:
        """Angle between neighbouring beams [rad]."""
        return (self.angle_max - self.angle_min) / (self.samples - 1)

    @cached_property
    def angles(self) -> np.ndarray:
        """Beam angles, (k,), read-only."""
        return _read_only(self.angle_min + self.angle_increment * np.arange(self.samples))

    @cached_property
    def directions(self) -> np.ndarray:
        """Unit vectors of the beams in the sensor frame, (2, k), read-only."""
        return _read_only(np.stack([np.cos(self.angles), np.sin(self.angles)]))


def _refuse_non_finite(record, *names):
    for name in names:
        value = getattr(record, name)
        if not math.isfinite(value):
            raise ValueError(f"{name} = {value}; must be finite")


def _read_only(array):
    array.setflags(write=False)
    return array


def _fan(half_angle_deg, range_min, range_max):
    half = math.radians(half_angle_deg)
    return LidarModel(720, -half, half, range_min, range_max)


PRESETS = MappingProxyType(
    {
        "paper-leader": _fan(90.0, 0.30, 3.0),
        "paper-follower": _fan(11.5, 0.30, 1.0),
    }
)
