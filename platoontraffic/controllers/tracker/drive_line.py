"""The drive line of the own vehicle, modelled, and the command that makes it accelerate as wanted."""

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

        def approach(value, demand, lag):
            return demand + (value - demand) * np.exp(-dt / np.maximum(lag, 1e-9))

        return DriveLine(
            approach(self.drive, np.maximum(command, 0.0), body.drive_lag),
            approach(self.brake, np.maximum(-command, 0.0), body.brake_lag),
        )

    def command(self, wanted: np.ndarray, rate: np.ndarray, body: Body, dt: float) -> np.ndarray:
        """The command by which the acceleration a approaches the wanted one w, which changes at a rate w' [m/s3].

        With lag T of the part that acts, a' = (w - a) / T + w', so an error of a falls as exp(-t / T), whatever w does.
        For the engine d and the brakes b, a = d - b, of lags T_d and T_b that is

            w + T_d w' - b (T_d / T_b - 1)    if it is positive,     or else    w + T_b w' - d (1 - T_b / T_d).

        A command holds for dt, so it comes dt / 2 late on the mean: w' is also added over that time.
        """
        drive_lag, brake_lag = np.maximum(body.drive_lag, 1e-3), np.maximum(body.brake_lag, 1e-3)
        by_drive = wanted + (drive_lag + dt / 2) * rate - self.brake * (drive_lag / brake_lag - 1)
        by_brake = wanted + (brake_lag + dt / 2) * rate - self.drive * (1 - brake_lag / drive_lag)
        return np.where(by_drive > 0, by_drive, np.minimum(by_brake, 0.0))
