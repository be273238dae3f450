"""Motion of robots on two driven wheels, for many robots at once. Frames and units are those of `motion`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from operator import attrgetter
from typing import ClassVar

import numpy as np

from platoontraffic.vehicles.differential_formulas import turned_by_wheels
from platoontraffic.vehicles.motion import Command, Drive, Motion, NotNegative, Positive, Twist, rows

_MOVES = attrgetter("x", "y", "heading", "turned", "speed", "yaw_rate")


@dataclass(frozen=True)
class DifferentialDrive:
    """A robot on two driven rear wheels and a castor in front: the paper's robot.

    Each field is a float, or an array (n,) for n robots at once (`records.stack`). The defaults are those of
    `paper-robot`: the paper names its robot (like an EMoRo) and gives no size. Length, width and wheels are this
    project's assumption, chosen so that the closed forms of the follower (width 0.15 m) have room on a 1 m lane.
    """

    hardest_braking: ClassVar[float] = math.inf  # both wheels obey at once, but for their lag

    length: Positive = 0.20  # of the footprint rectangle [m]
    width: Positive = 0.15
    axle: float = -0.06  # driven axle, ahead of the centre [m]; negative: behind it
    wheel_separation: Positive = 0.13  # between the two driven wheels [m]
    wheel_radius: Positive = 0.03
    max_wheel_speed: Positive = 40.0  # [rad/s]; 1.2 m/s straight ahead
    lag: NotNegative = 0.0  # first order, of both wheel speeds [s]; 0: none

    @property
    def top_speed(self) -> float:
        """Straight ahead [m/s]."""
        return self.max_wheel_speed * self.wheel_radius

    @property
    def turning_radius(self) -> float:
        """0 m: it turns on the spot."""
        return 0.0

    @property
    def curvature_rate(self) -> float:
        """Inf: both wheels have their speeds at once, but for their lag."""
        return np.inf

    @property
    def steering_lag(self) -> float:
        """First order [s]: it steers, drives and brakes by its wheels."""
        return self.lag

    drive_lag = brake_lag = steering_lag

    def strongest_acceleration(self, speed: np.ndarray) -> np.ndarray:
        """Inf: both wheels obey at once, but for their lag."""
        return np.full(np.shape(speed), np.inf)

    def braking_delay(self, scan: float, braking: float) -> float:
        """The delay of the scan [s], since the wheels obey at once."""
        return scan

    def saturated(self, twist: Twist) -> Twist:
        """The nearest twist of the same curvature that both wheels can turn."""
        return Twist(*turned_by_wheels(*twist, self.wheel_separation, self.wheel_radius, self.max_wheel_speed))

    def axle_position(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The middle of the driven axle, the point that the wheels steer, x and y [m]. Arrays (n,)."""
        return motion.x + self.axle * np.cos(motion.heading), motion.y + self.axle * np.sin(motion.heading)

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt [s] under one command.

        The axle's middle drives an arc: exact for a constant twist, and, since both wheels share one lag, exact too
        for a start from rest at constant curvature. With a lag, distance and turned angle are still exact.
        """
        twist, drive = command if isinstance(command, Command) else Command.of(command)
        wheels = self.wheel_separation, self.wheel_radius, self.max_wheel_speed
        shape, values = rows((*_MOVES(motion), *twist, *drive, self.axle, *wheels, *self._left_over(dt)))
        after = np.empty((7, values[0].size))
        _kernel().move(values[:6], values[6:10], values[10], values[11:14], *values[14:], dt, after)
        return Motion(*after.reshape(7, *shape), motion.steering, motion.braking)

    def _left_over(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Share of the difference of wheel speeds that is still there after dt, and its mean over dt."""
        if dt not in self._of_steps:
            lag = np.maximum(self.lag, 1e-12)
            self._of_steps[dt] = np.exp(-dt / lag), -np.expm1(-dt / lag) * lag / dt
        return self._of_steps[dt]

    @cached_property
    def _of_steps(self) -> dict[float, tuple[np.ndarray, np.ndarray]]:
        return {}


@cache
def _kernel():
    """Imported when it is first used: importing numba takes half a second."""
    from platoontraffic.vehicles import differential_kernel

    return differential_kernel


ROBOTS = {"paper-robot": DifferentialDrive()}
