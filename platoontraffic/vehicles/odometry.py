"""Own speed and yaw rate as a vehicle measures them, with errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.noise import GOLDEN, gauss, mixed, scan_keys, sensor_keys
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


class _Draws(NamedTuple):
    """Random numbers, nearly normal, of standard deviation 1. Arrays (n,)."""

    speed_scale: np.ndarray
    yaw_rate_bias: np.ndarray
    speed_noise: np.ndarray
    yaw_rate_noise: np.ndarray


def measured(
    errors: Sequence[OdometryErrors],
    ids: tuple[str, ...],
    speed: np.ndarray,
    yaw_rate: np.ndarray,
    seed: int,
    step: int,
) -> Twist:
    """Speed [m/s] and yaw rate [rad/s] as n vehicles measure them in a step. Arrays (n,).

    Equal seed, id and step give equal errors.
    """
    draws = _draws(seed, ids, step)
    sigma = [(one.speed_scale, one.speed_noise, one.yaw_rate_bias, one.yaw_rate_noise) for one in errors]
    scale, noise, bias, turning = np.array(sigma).reshape(-1, 4).T
    driven = speed * (1 + scale * draws.speed_scale) + noise * draws.speed_noise
    turned = yaw_rate + bias * draws.yaw_rate_bias + turning * draws.yaw_rate_noise
    stands = speed == 0
    return Twist(np.where(stands, 0.0, np.maximum(driven, 0.0)), np.where(stands, 0.0, turned))


def _draws(seed: int, ids: tuple[str, ...], step: int) -> _Draws:
    vehicles = sensor_keys(seed, tuple(f"{name} odometry" for name in ids))
    now = scan_keys(vehicles, step)
    return _Draws(*(gauss(mixed(keys + offset)) for keys in (vehicles, now) for offset in (np.uint64(0), GOLDEN)))
