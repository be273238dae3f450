"""Errors of a real scanner, drawn from counters instead of a stream.

Every number is a hash of its use: seed of the run, vehicle, scanner, number of the scan, beam, purpose. The errors of a
scanner thus do not depend on other scanners, on their order or on the process, and no state is kept.
"""

import hashlib
import math
import numbers
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
GAUSS, DROPOUT, PURPOSES = 0, 1, 2
GAUSS_MEAN = 2.0 * 0xFFFF  # mean of the sum of four whole numbers below 2^16
GAUSS_SCALE = 1.0 / math.sqrt((0x10000**2 - 1) / 3.0)  # inverse of its standard deviation
BOUND = 2.0 * 0xFFFF * GAUSS_SCALE  # largest magnitude of a draw: 3.46 standard deviations
ROUNDING = 1e-12  # relative; a range this little beyond a limit is at the limit, however it was computed
DEFAULT_NAME = "lidar"  # of a scanner; its errors are keyed by the vehicle alone


@dataclass(frozen=True)
class Noise:
    """Errors of a measured distance. They apply to returns only: a beam that met nothing stays +inf.

    sigma, sigma_per_metre : standard deviation of the range, sigma + sigma_per_metre · range [m]; nearly normal, and
                             bounded at 3.46 times itself, as the accuracy on a data sheet is
    bias                   : standard deviation of an error that is constant for one sensor in one run [m]
    resolution             : step of the reported range [m]; 0 for none
    dropout                : probability that a return is lost, at any range and incidence
    dropout_at_range_max   : added to it at range_max; decreases with the square of the range
    dropout_grazing        : added to it at a surface seen edge-on; decreases with the squared cosine of the incidence
    grazing_from           : incidence, between beam and normal of the surface, from which dropout_grazing applies [rad]
    dropped                : value of a lost return: "error" (NaN) or "no_return" (+inf)

    A range that noise, bias or resolution moves beyond range_max or below range_min becomes ±inf; it is not moved back
    to the limit.

    raises: ValueError
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

    @property
    def random(self) -> bool:
        """Whether anything of it is drawn; steps of the reported range are not."""
        spreads = (self.sigma, self.sigma_per_metre, self.bias)
        return any((*spreads, self.dropout, self.dropout_at_range_max, self.dropout_grazing))

    def __post_init__(self):
        for field in fields(self)[:-1]:
            value = getattr(self, field.name)
            if not (isinstance(value, numbers.Real) and math.isfinite(value) and value >= 0):
                raise ValueError(f"noise: {field.name} = {value!r}; must be finite and not negative")
            object.__setattr__(self, field.name, float(value))
        chances = {name: getattr(self, name) for name in ("dropout", "dropout_at_range_max", "dropout_grazing")}
        for name, value in chances.items():
            if value > 1:
                raise ValueError(f"noise: {name} = {value}; must be a probability, 0 to 1")
        if sum(chances.values()) > 1:
            raise ValueError(f"noise: {', '.join(chances)} = {sum(chances.values())} in all; must be 1 or less")
        if self.grazing_from >= math.pi / 2:
            raise ValueError(f"noise: grazing_from = {self.grazing_from} rad; must be 0 to below pi/2")
        if self.dropped not in ("error", "no_return"):
            raise ValueError(f"noise: dropped = {self.dropped!r}; must be 'error' or 'no_return'")

    @cached_property
    def none(self) -> bool:
        """There are no errors."""
        return not any(getattr(self, f.name) for f in fields(self) if f.name not in ("grazing_from", "dropped"))

    @property
    def lost(self) -> float:
        """Value of a lost return."""
        return math.nan if self.dropped == "error" else math.inf


def draws(noise: Noise, seed: int, ids: tuple[str, ...], number: int, scanner: str = DEFAULT_NAME):
    """Hash of each sensor, (n,), what is added to it for this scan, and bias of each sensor [m], (n,).

    The arrays are (0,) without errors. `perturbed` draws from the hash of the first two's sum.
    """
    if noise.none:
        return _NO_ERRORS
    return sensor_keys(seed, ids, scanner), of_scan(number), _biases(noise, int(seed), ids, scanner)


_NO_ERRORS = np.empty(0, np.uint64), np.uint64(0), np.empty(0)
_NO_ERRORS[0].setflags(write=False)  # as hashes are, or numba compiles once more


def sensor_keys(seed: int, ids: tuple[str, ...], scanner: str = DEFAULT_NAME) -> np.ndarray:
    """A hash for each vehicle of a run and the name of its scanner, (n,) uint64; the same in every process."""
    return _sensor_keys(int(seed), ids, scanner)


@lru_cache(maxsize=64)  # the same vehicles scan again and again
def _sensor_keys(seed, ids, scanner):
    # The name goes into the personalisation of the hash: no id of another vehicle can make up for it.
    person = b"" if scanner == DEFAULT_NAME else hashlib.blake2b(scanner.encode(), digest_size=16).digest()
    hashes = (hashlib.blake2b(f"{seed} {name}".encode(), digest_size=8, person=person) for name in ids)
    keys = np.frombuffer(b"".join(one.digest() for one in hashes), dtype="<u8").astype(np.uint64)
    keys.setflags(write=False)
    return keys


def scan_keys(sensors: np.ndarray, number: int) -> np.ndarray:
    """A hash for each of these sensors and one scan, (n,) uint64."""
    return mixed(sensors + of_scan(number))


def of_scan(number: int) -> np.uint64:
    """What is added to the hash of each sensor for one scan."""
    return np.uint64((number + 1) * int(GOLDEN) % 2**64)


@lru_cache(maxsize=64)  # as of `_sensor_keys`
def _biases(noise, seed, ids, scanner):
    return biases(noise, _sensor_keys(seed, ids, scanner))


def biases(noise: Noise, sensors: np.ndarray) -> np.ndarray:
    """The constant error of each sensor, (n,) [m]."""
    return noise.bias * gauss(mixed(sensors))


def perturbed(model, first_beam, ranges, hits, keys, bias):
    """Ranges with the errors of a LidarModel, (n, k) float64; new memory.

    first_beam : number of the first column in the whole scan
    ranges     : true distances, or ±inf, (n, k)
    hits       : owners of the surfaces met, (n, k)
    keys, bias : hash of each sensor and scan, see `scan_keys`, and its constant error, (n,)
    """
    noise, range_min, range_max = model.noise, model.range_min, model.range_max
    met = np.isfinite(ranges)
    r = np.where(met, ranges, 0.0)
    counter = np.arange(first_beam, first_beam + ranges.shape[1], dtype=np.uint64) * np.uint64(PURPOSES)

    measured = r + bias[:, None]
    if noise.sigma or noise.sigma_per_metre:
        draw = gauss(mixed(keys[:, None] + (counter + np.uint64(GAUSS)) * GOLDEN))
        measured = measured + (noise.sigma + noise.sigma_per_metre * r) * draw
    if noise.resolution:
        measured = np.rint(measured / noise.resolution) * noise.resolution
    too_far, too_close = measured > range_max * (1 + ROUNDING), measured < range_min * (1 - ROUNDING)
    measured = np.clip(measured, range_min, range_max)
    measured[too_far], measured[too_close] = np.inf, -np.inf

    chance = noise.dropout + noise.dropout_at_range_max * ((r / range_max) * (r / range_max))
    if noise.dropout_grazing:
        limit = math.cos(noise.grazing_from) ** 2
        squared = incidence_cosine_squared(r, hits, met, model.angle_increment)
        chance = chance + noise.dropout_grazing * np.maximum(1.0 - squared / limit, 0.0)
    draw = uniform(mixed(keys[:, None] + (counter + np.uint64(DROPOUT)) * GOLDEN))
    measured = np.where(draw < chance, noise.lost, measured)
    return np.where(met, measured, ranges)


def incidence_cosine_squared(ranges, hits, met, increment):
    """Square of the cosine of the angle between each beam and the normal of the surface it meets, (n, k).

    ranges    : true distances, any finite number where nothing was met, (n, k)
    hits, met : owners of the surfaces, and whether there is one, (n, k)
    increment : angle between neighbouring beams [rad]

    The incidence follows from the point where the neighbouring beam meets the same owner: two sides of the triangle
    sensor, point, neighbour and the angle between them are known. The neighbour that gives the less oblique incidence
    is on the same face. A surface met by a single beam counts as met squarely; so does every surface if each beam is a
    sweep of its own.
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


# The raster engine compiles the following three functions: they serve arrays and single numbers alike.


def mixed(z):
    """The last step of SplitMix64 (Steele, Lea and Flood 2014): any change of z flips half of the bits on average."""
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
