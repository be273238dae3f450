"""Motion of robots on two driven wheels, for many robots at once. Frames and units are those of `motion`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from platoontraffic.lidar.pose import wrap
from platoontraffic.vehicles.motion import Command, Drive, Motion, NotNegative, Positive, Twist
from platoontraffic.vehicles.records import changed


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

    def twist_for(self, command: Command | Drive | Twist, motion: Motion, dt: float) -> Twist:
        """The twist that follows a command: a drive's acceleration lasts one step, at its curvature."""
        if isinstance(command, Twist):
            return command
        twist, drive = command if isinstance(command, Command) else Command.of(command)
        speed = motion.speed + drive.acceleration * dt
        driven = ~np.isnan(drive.acceleration)
        return Twist(np.where(driven, speed, twist.speed), np.where(driven, speed * drive.curvature, twist.yaw_rate))

    def saturated(self, twist: Twist) -> Twist:
        """The nearest twist of the same curvature that both wheels can turn."""
        swing = twist.yaw_rate * self.wheel_separation / 2
        fastest = np.maximum(np.abs(twist.speed - swing), np.abs(twist.speed + swing)) / self.wheel_radius
        keep = np.minimum(1.0, self.max_wheel_speed / np.maximum(fastest, 1e-300))
        return Twist(twist.speed * keep, twist.yaw_rate * keep)

    def axle_position(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The middle of the driven axle, the point that the wheels steer, x and y [m]. Arrays (n,)."""
        return motion.x + self.axle * np.cos(motion.heading), motion.y + self.axle * np.sin(motion.heading)

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt [s] under one command.

        The axle's middle drives an arc: exact for a constant twist, and, since both wheels share one lag, exact too
        for a start from rest at constant curvature. With a lag, distance and turned angle are still exact.
        """
        wanted = self.saturated(self.twist_for(command, motion, dt))
        lag = np.maximum(self.lag, 1e-12)
        left_over = np.exp(-dt / lag)  # share of the difference that is still there after dt
        mean_left_over = -np.expm1(-dt / lag) * lag / dt
        speed, mean_speed = _relax(motion.speed, wanted.speed, left_over, mean_left_over)
        yaw_rate, mean_yaw_rate = _relax(motion.yaw_rate, wanted.yaw_rate, left_over, mean_left_over)

        angle = mean_yaw_rate * dt
        chord = mean_speed * dt * np.sinc(angle / (2 * np.pi))  # numpy's sinc(x) is sin(pi x) / (pi x)
        along = motion.heading + angle / 2
        heading = motion.heading + angle
        # The axle moves along the chord; the centre keeps its place before the axle.
        x = motion.x + chord * np.cos(along) + self.axle * (np.cos(motion.heading) - np.cos(heading))
        y = motion.y + chord * np.sin(along) + self.axle * (np.sin(motion.heading) - np.sin(heading))
        turned, acceleration = motion.turned + angle, (speed - motion.speed) / dt
        return changed(
            motion, x=x, y=y, heading=wrap(heading), turned=turned, speed=speed, yaw_rate=yaw_rate,
            acceleration=acceleration,
        )  # fmt: skip


ROBOTS = {"paper-robot": DifferentialDrive()}


def _relax(value, target, left_over, mean_left_over):
    """First-order approach to a target over one step: the value at its end, and its mean over the step."""
    return target + (value - target) * left_over, target + (value - target) * mean_left_over
