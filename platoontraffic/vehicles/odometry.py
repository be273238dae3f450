"""Own speed and yaw rate as a vehicle measures them, with errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from platoontraffic.lidar.noise import GOLDEN, gauss, mixed, of_scan, sensor_keys
from platoontraffic.vehicles.motion import Twist


@dataclass(frozen=True)
class OdometryErrors:
    """Standard deviations of errors: some are drawn once for a vehicle and run, some anew for every reading. A delay.

    A standing vehicle measures 0: wheels that do not turn give no pulses.
    """

    speed_scale: float = 0.0  # drawn once; share of the speed
    speed_noise: float = 0.0  # anew [m/s]
    yaw_rate_bias: float = 0.0  # drawn once [rad/s]
    yaw_rate_noise: float = 0.0  # anew [rad/s]
    delay: float = 0.0  # from a reading to its use [s]

    @property
    def exact(self) -> bool:
        return not any((self.speed_scale, self.speed_noise, self.yaw_rate_bias, self.yaw_rate_noise))


# Assumptions: tyres wear and warm up, 0.5 %; the bias of a yaw-rate sensor is known from the last stop.
ODOMETRY = {
    "none": OdometryErrors(),
    "car": OdometryErrors(
        speed_scale=0.005, speed_noise=0.02, yaw_rate_bias=np.radians(0.1), yaw_rate_noise=np.radians(0.1)
    ),
}


def measured(
    errors: OdometryErrors,
    ids: tuple[str, ...],
    speed: np.ndarray,
    yaw_rate: np.ndarray,
    seed: int,
    step: int,
) -> Twist:
    """Speed [m/s] and yaw rate [rad/s] as n vehicles measure them in a step. Arrays (n,), in `errors` too.

    Equal seed, id and step give equal errors.
    """
    from platoontraffic.vehicles.odometry_kernel import read  # importing numba takes half a second

    keys, *once = _of_vehicles(int(seed), ids)
    spreads = errors.speed_scale, errors.speed_noise, errors.yaw_rate_bias, errors.yaw_rate_noise
    read(spreads, tuple(once), keys, of_scan(step), speed, yaw_rate, own := np.empty((2, speed.size)))
    return Twist(*own)


@lru_cache(maxsize=64)  # the same vehicles measure again and again
def _of_vehicles(seed: int, ids: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Keys of vehicles, and what is drawn once for each: nearly normal, of standard deviation 1. Arrays (n,)."""
    keys = sensor_keys(seed, tuple(f"{name} odometry" for name in ids))
    return keys, gauss(mixed(keys)), gauss(mixed(keys + GOLDEN))
