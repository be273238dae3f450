"""The drive line of the own vehicle, modelled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Body


class DriveLine(NamedTuple):
    """Acceleration by the engine, and deceleration by the brakes [m/s2], (n,)."""

    drive: np.ndarray
    brake: np.ndarray

    @classmethod
    def at_rest(cls, n: int) -> DriveLine:
        return cls(np.zeros(n), np.zeros(n))

    @property
    def acceleration(self) -> np.ndarray:
        return self.drive - self.brake

    def after(self, command: np.ndarray, body: Body, dt: float) -> DriveLine:
        """dt [s] under one command [m/s2]: engine and brakes each follow their part of it by a first-order lag."""
        return DriveLine(
            approach(self.drive, np.maximum(command, 0.0), body.drive_lag, dt),
            approach(self.brake, np.maximum(-command, 0.0), body.brake_lag, dt),
        )


def approach(value, demand, lag, dt):
    """A value that follows a demand by a first-order lag [s], dt [s] later: floats, or arrays (n,)."""
    return demand + (value - demand) * np.exp(-dt / np.maximum(lag, 1e-9))
