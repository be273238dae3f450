"""Parameters of a scanner: its beams, its limits, its errors and its place on the vehicle."""

import math
import numbers
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from .noise import DEFAULT_NAME, ROUNDING, Noise


class Fan(NamedTuple):
    """Neighbouring rays, counter-clockwise, as engines cast them.

    angles     : in the sensor frame, (k,) [rad]
    directions : unit vectors of the rays, (2, k)
    increment  : between neighbours [rad]
    reach      : distance up to which engines look; a little beyond range_max, as limits are applied later [m]
    """

    angles: np.ndarray
    directions: np.ndarray
    increment: float
    reach: float

    def part(self, beams: slice) -> "Fan":
        return self._replace(angles=self.angles[beams], directions=self.directions[:, beams])


LARGEST_RANGE = 1e9  # of range_max [m]
REACH = 1 + 1e-9  # Fan.reach, as a multiple of range_max
FULL_TURN = 2 * math.pi * (1 + ROUNDING)  # [rad]
MERGING = 0.5  # distance below which two echoes of a laser pulse of 3.3 ns overlap, c τ / 2 [m]


@dataclass(frozen=True)
class Mount:
    """Pose of the sensor in the body frame, with its origin at the centre of the vehicle [m, rad]."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self):
        _convert_to_floats(self, "x", "y", "yaw")


@dataclass(frozen=True)
class LidarModel:
    """A planar scanner; beams lie in the sensor frame, zero ahead, counter-clockwise, both ends of the fan included.

    samples              : beams in a scan
    angle_min, angle_max : first and last beam [rad]
    range_min, range_max : nearest and farthest distance that the sensor measures [m]
    rate                 : scans per second [Hz]
    mount                : pose on the vehicle
    noise                : errors of a measured range
    divergence           : angle over which one beam spreads; has an effect only with several sub-beams [rad]
    subbeams             : rays that sample a beam over its divergence
    merging              : the range of a beam is the mean over its sub-beams that are at most this far behind the
                           nearest one; if they are on two surfaces, it lies between them ("mixed pixel") [m]
    sweeps               : parts of a scan that are measured one after the other as the mirror turns; 1: all beams are
                           measured at one instant. The incidence, for the noise, is estimated within a part
    name                 : of this scanner among those of its vehicle. Scanners of different names have independent
                           errors; those of one name on one vehicle have the same errors
    delay                : from the end of a scan to its use; it changes no measurement [s]

    The default of `merging` follows from the length of the laser's pulse. The echoes of two surfaces a distance d apart
    reach the receiver 2 d / c after one another; where this is less than the length τ of the pulse, they overlap and
    are measured as one. The pulse of a time-of-flight scanner lasts a few nanoseconds; the default, 0.5 m, is c τ / 2
    of 3.3 ns. With `merging = 0`, as if the pulse were infinitely short, the nearest ray alone counts: on an oblique
    surface the range is then that of the near rim of the spot, 27 cm too short at 10 m and 75° with a divergence of
    15 mrad.

    raises: ValueError
    """

    samples: int
    angle_min: float
    angle_max: float
    range_min: float
    range_max: float
    rate: float = 40.0
    mount: Mount = field(default_factory=Mount)
    noise: Noise = field(default_factory=Noise)
    divergence: float = 0.0
    subbeams: int = 1
    merging: float = MERGING
    sweeps: int = 1
    name: str = DEFAULT_NAME
    delay: float = 0.0

    def __post_init__(self):
        _convert_to_floats(self, "angle_min", "angle_max", "range_min", "range_max", "rate", "divergence", "merging")
        _convert_to_floats(self, "delay")
        for name in ("samples", "subbeams", "sweeps"):
            value = getattr(self, name)
            if not isinstance(value, numbers.Real) or value != value // 1:
                raise ValueError(f"{name} = {value!r}; must be a whole number")
            object.__setattr__(self, name, int(value))
        if not isinstance(self.mount, Mount) or not isinstance(self.noise, Noise):
            raise ValueError(f"mount = {self.mount!r}, noise = {self.noise!r}; must be a Mount and a Noise")
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"name = {self.name!r}; must be a text of one character or more")
        self._check_beams()
        self._check_limits()

    def _check_beams(self):
        if self.samples < 2:
            raise ValueError(f"samples = {self.samples}; must be a whole number, 2 or more")
        if self.angle_max <= self.angle_min:
            raise ValueError(f"angle_max = {self.angle_max}; must be above angle_min = {self.angle_min}")
        if max(abs(self.angle_min), abs(self.angle_max)) > FULL_TURN:
            angles = f"{self.angle_min} to {self.angle_max} rad"
            raise ValueError(f"angles {angles}; must be within a full turn of straight ahead")
        if self.angle_max - self.angle_min > FULL_TURN:
            raise ValueError(f"field of view = {self.angle_max - self.angle_min} rad; must not exceed a full turn")
        if not 0 <= self.divergence <= 0.1:
            raise ValueError(f"divergence = {self.divergence} rad; must be 0 to 0.1")
        if not 1 <= self.subbeams <= 64:
            raise ValueError(f"subbeams = {self.subbeams}; must be a whole number from 1 to 64")
        if not 1 <= self.sweeps <= self.samples:
            raise ValueError(f"sweeps = {self.sweeps}; must be a whole number from 1 to samples = {self.samples}")

    def _check_limits(self):
        if self.range_min < 0:
            raise ValueError(f"range_min = {self.range_min}; must not be negative")
        if self.range_max <= self.range_min:
            raise ValueError(f"range_max = {self.range_max}; must be above range_min = {self.range_min}")
        if self.range_max > LARGEST_RANGE:
            raise ValueError(f"range_max = {self.range_max}; must be {LARGEST_RANGE:g} m or less")
        if self.rate <= 0:
            raise ValueError(f"rate = {self.rate}; must be positive")
        for name in ("merging", "delay"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} = {getattr(self, name)}; must not be negative")

    def __reduce__(self):  # copies and pickles keep the tables below read-only
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    @cached_property
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
        return _read_only(_unit(self.angles))

    @cached_property
    def body_directions(self) -> np.ndarray:
        """Unit vectors of the beams in the body frame, (2, k), read-only."""
        return _read_only(_unit(self.angles + self.mount.yaw))

    @cached_property
    def fans(self) -> tuple[Fan, ...]:
        """The rays that sample the beams, one fan for each sub-beam."""
        offsets = self.divergence * ((np.arange(self.subbeams) + 0.5) / self.subbeams - 0.5)
        return tuple(
            Fan(self.angles + offset, _read_only(_unit(self.angles + offset)), self.angle_increment, self.reach)
            for offset in offsets
        )

    @cached_property
    def slices(self) -> tuple[tuple[slice, float], ...]:
        """Parts of a scan, and the time of the middle beam of each, counted from the end of the scan, 0 or less [s]."""
        ends = [self.samples * i // self.sweeps for i in range(self.sweeps + 1)]
        middles = [(first + end - 1) / 2 / (self.samples - 1) for first, end in pairwise(ends)]
        return tuple(
            (slice(first, end), self.sweep_time * (middle - 1))
            for (first, end), middle in zip(pairwise(ends), middles, strict=True)
        )

    @cached_property
    def kept(self) -> dict:
        """What engines derive from the model, by keys of their own."""
        return {}

    @cached_property
    def reach(self) -> float:
        """Distance up to which engines look [m]."""
        return self.range_max * REACH

    @cached_property
    def sweep_time(self) -> float:
        """Time from the first beam to the last; the mirror turns once in 1 / rate. 0 if all share one instant [s]."""
        turned = (self.angle_max - self.angle_min) / (2 * math.pi)
        return turned / self.rate if self.sweeps > 1 else 0.0


def _convert_to_floats(record, *names):
    for name in names:
        value = getattr(record, name)
        if not isinstance(value, numbers.Real) or not math.isfinite(value):
            raise ValueError(f"{name} = {value!r}; must be a finite number")
        object.__setattr__(record, name, float(value))


def _read_only(array):
    array.setflags(write=False)
    return array


def _unit(angles):
    return np.stack([np.cos(angles), np.sin(angles)])


def _fan(half_angle_deg, range_min, range_max, samples=720, rate=40.0, noise=Noise()):  # noqa: B008 (it is frozen)
    half = math.radians(half_angle_deg)
    return LidarModel(samples, -half, half, range_min, range_max, rate, noise=noise)


# Errors are bounded at 3.46 sigma (see Noise). The data sheet allows 30 mm up to 10 m and 50 mm up to 30 m; with half a
# step of the reported millimetres, the bound is just below these values at 10 m and at 30 m.
_UTM30LX = Noise(sigma=0.00562, sigma_per_metre=0.000288, resolution=0.001)

# 1 cm is customary in simulators. The loss of returns is an assumption: one of 500 anywhere, one more of 50 at the end
# of the range, and one more of two at a surface seen edge-on, beginning 15 degrees before.
_CAR = Noise(
    sigma=0.01,
    resolution=0.001,
    dropout=0.002,
    dropout_at_range_max=0.02,
    dropout_grazing=0.5,
    grazing_from=math.radians(75),
)

PRESETS = MappingProxyType(
    {
        "paper-leader": _fan(90.0, 0.30, 3.0),
        "paper-follower": _fan(11.5, 0.30, 1.0),
        "utm30lx": _fan(135.0, 0.1, 30.0, samples=1081, noise=_UTM30LX),
        "car-leader": _fan(90.0, 0.3, 60.0, rate=10.0, noise=_CAR),
        "car-follower": _fan(11.5, 0.3, 30.0, rate=10.0, noise=_CAR),
        "car-tracker": _fan(90.0, 0.3, 80.0, samples=721, rate=10.0, noise=_CAR),
        "car-around": _fan(180.0, 0.3, 80.0, samples=361, rate=10.0, noise=_CAR),
    }
)
