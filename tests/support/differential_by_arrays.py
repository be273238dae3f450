"""The motion of a differential drive by whole arrays: the second implementation of `differential_kernel.move`."""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar.pose import wrap
from platoontraffic.vehicles.differential import DifferentialDrive
from platoontraffic.vehicles.motion import Command, Motion, Twist
from platoontraffic.vehicles.records import changed


def moved(model: DifferentialDrive, motion: Motion, command: Command, dt: float) -> Motion:
    lag = np.maximum(model.lag, 1e-12)
    left_over = np.exp(-dt / lag)  # share of the difference that is still there after dt
    wanted = model.saturated(_twist_for(command, motion, dt, left_over))
    mean_left_over = -np.expm1(-dt / lag) * lag / dt
    speed, mean_speed = _relax(motion.speed, wanted.speed, left_over, mean_left_over)
    yaw_rate, mean_yaw_rate = _relax(motion.yaw_rate, wanted.yaw_rate, left_over, mean_left_over)

    angle = mean_yaw_rate * dt
    chord = mean_speed * dt * np.sinc(angle / (2 * np.pi))  # numpy's sinc(x) is sin(pi x) / (pi x)
    along = motion.heading + angle / 2
    heading = motion.heading + angle
    # The axle moves along the chord; the centre keeps its place before the axle.
    x = motion.x + chord * np.cos(along) + model.axle * (np.cos(motion.heading) - np.cos(heading))
    y = motion.y + chord * np.sin(along) + model.axle * (np.sin(motion.heading) - np.sin(heading))
    turned, acceleration = motion.turned + angle, (speed - motion.speed) / dt
    return changed(
        motion, x=x, y=y, heading=wrap(heading), turned=turned, speed=speed, yaw_rate=yaw_rate,
        acceleration=acceleration,
    )  # fmt: skip


def _twist_for(command: Command, motion: Motion, dt: float, left_over: np.ndarray) -> Twist:
    twist, drive = command
    gained = drive.acceleration * dt
    reached, speed = motion.speed + gained, motion.speed + gained / (1.0 - left_over)
    with np.errstate(divide="ignore", invalid="ignore"):
        kept = motion.yaw_rate * (reached / motion.speed - 1.0)
        slower = reached * drive.curvature + kept * left_over / (1.0 - left_over)
    turning = np.where((gained < 0) & (reached > 0), slower, speed * drive.curvature)
    driven = ~np.isnan(drive.acceleration)
    return Twist(np.where(driven, speed, twist.speed), np.where(driven, turning, twist.yaw_rate))


def _relax(value, target, left_over, mean_left_over):
    """First-order approach to a target over one step: the value at its end, and its mean over the step."""
    return target + (value - target) * left_over, target + (value - target) * mean_left_over
