"""Errors of a real scanner, drawn from counters instead of a stream.

Every number is a hash of what it is for: run seed, vehicle, number of the scan, beam, purpose. So a vehicle's errors
are the same whoever else scans, in whatever order, in whatever process, and none of them has to be kept.
"""

import hashlib
import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
GAUSS, DROPOUT, PURPOSES = 0, 1, 2
GAUSS_MEAN = 2.0 * 0xFFFF
GAUSS_SCALE = 1.0 / math.sqrt((0x10000**2 - 1) / 3.0)  # of the sum of four whole numbers below 2^16
BOUND = 2.0 * 0xFFFF * GAUSS_SCALE  # no draw is farther from zero: 3.46 sigma


@dataclass(frozen=True)
class Noise:
    """What is wrong with a measured distance. Only returns are touched: a beam that met nothing stays +inf.

    sigma, sigma_per_metre : standard deviation of the range, sigma + sigma_per_metre · range [m]; nearly normal, and
                             bounded at 3.46 times itself as the accuracy on a data sheet is
    bias                   : standard deviation of an error that a sensor keeps for the whole run [m]
    resolution             : step of the range that is reported [m]; 0 is none
    dropout                : probability that a return is lost, anywhere
    dropout_at_range_max   : added to it at range_max, less nearer by the square of the range
    dropout_grazing        : added to it where a surface is seen edge-on, less by the squared cosine of the incidence
    grazing_from           : ... and not where the beam and the surface's normal are nearer than this angle [rad]
    dropped                : what a lost return becomes: "error" (NaN) or "no_return" (+inf)

    What the noise pushes beyond range_max or below range_min becomes ±inf; it is not pushed back to the limit.
    """

    sigma: float = 0.0
    sigma_per_metre: float = 0.0
    bias: float = 0.0
    resolution: float = 0.0
    dropout: float = 0.0
    dropout_at_range_max: float = 0.0
    dropout_grazing: float = 0.0
    grazing_from: float = math.radians(75)
    dropped: str = "error"

    def __post_init__(self):
        for name in ("sigma", "sigma_per_metre", "bias", "resolution"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"noise: {name} = {value}; must be finite and not negative")
        for name in ("dropout", "dropout_at_range_max", "dropout_grazing"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"noise: {name} = {getattr(self, name)}; must be a probability, 0 to 1")
        if self.dropout + self.dropout_at_range_max + self.dropout_grazing > 1:
            raise ValueError("noise: dropout, dropout_at_range_max and dropout_grazing; must add up to 1 or less")
        if not 0 <= self.grazing_from < math.pi / 2:
            raise ValueError(f"noise: grazing_from = {self.grazing_from} rad; must be 0 to below pi/2")
        if self.dropped not in ("error", "no_return"):
            raise ValueError(f"noise: dropped = {self.dropped!r}; must be 'error' or 'no_return'")

    @property
    def none(self) -> bool:
        """Nothing is wrong."""
        return not any(getattr(self, f.name) for f in fields(self) if f.name not in ("grazing_from", "dropped"))

    @property
    def lost(self) -> float:
        """What a lost return becomes."""
        return math.nan if self.dropped == "error" else math.inf


def draws(noise: Noise, seed: int, ids: tuple[str, ...], number: int):
    """What the errors of one scan are made of: a key and a bias [m] for each sensor, (n,); (0,) if there are none."""
    if noise.none:
        return np.empty(0, np.uint64), np.empty(0)
    sensors = sensor_keys(seed, ids)
    return scan_keys(sensors, number), biases(noise, sensors)


def sensor_keys(seed: int, ids: tuple[str, ...]) -> np.ndarray:
    """A random-looking number for each vehicle of a run, (n,) uint64. Equal ids have equal numbers in every process."""
    return _sensor_keys(int(seed), ids)


@lru_cache(maxsize=64)  # the same vehicles scan again and again
def _sensor_keys(seed, ids):
    digests = b"".join(hashlib.blake2b(f"{seed} {name}".encode(), digest_size=8).digest() for name in ids)
    keys = np.frombuffer(digests, dtype="<u8").astype(np.uint64)
    keys.setflags(write=False)
    return keys


def scan_keys(sensors: np.ndarray, number: int) -> np.ndarray:
    """As many numbers for one scan of these sensors, (n,) uint64."""
    return mixed(sensors + np.uint64((number + 1) * int(GOLDEN) % 2**64))


def biases(noise: Noise, sensors: np.ndarray) -> np.ndarray:
    """The error that each sensor keeps, (n,) [m]."""
    return noise.bias * gauss(mixed(sensors))


def perturbed(noise, range_min, range_max, increment, ranges, hits, keys, bias, first_beam):
    """Ranges with errors, (n, k) float64; new memory.

    ranges     : true distances, or ±inf, (n, k)
    hits       : owners of the surfaces met, (n, k)
    keys, bias : of scan_keys and biases, (n,)
    first_beam : number of the first column in the whole scan
    """
    met = np.isfinite(ranges)
    r = np.where(met, ranges, 0.0)
    counter = np.arange(first_beam, first_beam + ranges.shape[1], dtype=np.uint64) * np.uint64(PURPOSES)

    measured = r + bias[:, None]
    if noise.sigma or noise.sigma_per_metre:
        draw = gauss(mixed(keys[:, None] + (counter + np.uint64(GAUSS)) * GOLDEN))
        measured = measured + (noise.sigma + noise.sigma_per_metre * r) * draw
    if noise.resolution:
        measured = np.rint(measured / noise.resolution) * noise.resolution
    measured = np.where(measured > range_max, np.inf, np.where(measured < range_min, -np.inf, measured))

    chance = noise.dropout + noise.dropout_at_range_max * ((r / range_max) * (r / range_max))
    if noise.dropout_grazing:
        limit = math.cos(noise.grazing_from) ** 2
        squared = incidence_cosine_squared(r, hits, met, increment)
        chance = chance + noise.dropout_grazing * np.maximum(1.0 - squared / limit, 0.0)
    draw = uniform(mixed(keys[:, None] + (counter + np.uint64(DROPOUT)) * GOLDEN))
    measured = np.where(draw < chance, noise.lost, measured)
    return np.where(met, measured, ranges)


def incidence_cosine_squared(ranges, hits, met, increment):
    """Square of the cosine of the angle between each beam and the normal of the surface it meets, (n, k).

    It follows from where the neighbouring beam meets the same owner: of the triangle sensor, point, neighbour two sides
    and the angle between them are known. Of both neighbours the one that shows the flatter incidence is on the same
    face. A surface that only one beam meets is taken as met squarely; so is everything if each beam is a sweep of its
    own.
    """
    sine_squared, versine = math.sin(increment) ** 2, 2.0 * math.sin(increment / 2) ** 2
    a, b = ranges[:, :-1], ranges[:, 1:]
    apart_squared = (a - b) * (a - b) + 2.0 * versine * (a * b)
    same = met[:, :-1] & met[:, 1:] & (hits[:, :-1] == hits[:, 1:]) & (apart_squared > 0.0)
    q = sine_squared / np.where(same, apart_squared, 1.0)
    squared = np.full(ranges.shape, -1.0)
    squared[:, :-1] = np.where(same, b * b * q, -1.0)
    squared[:, 1:] = np.maximum(squared[:, 1:], np.where(same, a * a * q, -1.0))
    return np.where(squared < 0.0, 1.0, squared)


# The raster engine compiles the following three as they stand: for arrays and for single numbers alike.


def mixed(z):
    """The last step of SplitMix64 (Steele, Lea and Flood 2014): any change of z turns half of the bits over."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def gauss(h):
    """Mean 0, standard deviation 1, nearly normal: the sum of the four 16-bit parts of h."""
    part = np.uint64(0xFFFF)
    total = (h & part) + ((h >> np.uint64(16)) & part) + ((h >> np.uint64(32)) & part) + (h >> np.uint64(48))
    return (np.float64(total) - GAUSS_MEAN) * GAUSS_SCALE


def uniform(h):
    """In [0, 1), from the upper bits of h."""
    return np.float64(h >> np.uint64(11)) * 2.0**-53
