"""Own motion: the measured one, with the bias of the yaw rate as far as it is known by now."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Sensed

STILL = 0.1  # speed below which a vehicle stands, if it does not accelerate [m/s]
CREEPING = 0.5  # speed below which the yaw rate follows better from steering than from measurement [m/s]

UNKNOWN = math.radians(2)  # standard deviation of the bias at first [rad/s]
DRIFTS = math.radians(0.02)  # its change in a second [rad/s]
NOISE = math.radians(0.3)  # standard deviation of the difference from the steering's yaw rate, straight ahead [rad/s]
TURNING = 0.3  # growth of that with the steering's yaw rate: tyres slip, and the steering lags


class YawBias(NamedTuple):
    """Of the measured yaw rate, estimated by a Kalman filter of one state, arrays (n,)."""

    mean: np.ndarray  # [rad/s]
    variance: np.ndarray  # [rad2/s2]

    @classmethod
    def unknown(cls, n: int) -> YawBias:
        return cls(np.zeros(n), np.full(n, UNKNOWN**2))

    def after(self, sensed: Sensed, curvature: np.ndarray, dt: float) -> YawBias:
        """After dt in which the vehicle was steered along a curvature [1/m], (n,).

        While it drives straight ahead, what is measured is the bias. A standing vehicle's sensor reads 0.
        """
        turning = sensed.speed * curvature
        variance = self.variance + DRIFTS**2 * dt
        noise = NOISE**2 + (TURNING * turning) ** 2
        gain = np.where(sensed.speed > CREEPING, variance / (variance + noise), 0.0)
        return YawBias(self.mean + gain * (sensed.yaw_rate - turning - self.mean), variance * (1 - gain))


def own_motion(
    sensed: Sensed, bias: YawBias, curvature: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Speed and yaw rate, (n,): as measured; at walking pace and below, modelled, since noise would dominate.

    curvature, acceleration : last commands [1/m], [m/s2], (n,)
    """
    still = (np.abs(sensed.speed) < STILL) & (acceleration <= 0)
    speed = np.where(still, 0.0, sensed.speed)
    lock = 1 / sensed.body.length  # greatest curvature of a car, roughly [1/m]
    steered = np.clip(curvature, -lock, lock)
    return speed, np.where(speed < CREEPING, speed * steered, sensed.yaw_rate - bias.mean)
