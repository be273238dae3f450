"""Motion of robots: how a command becomes motion, for many vehicles at once. Cars are in `bicycle`.

World frame: x east, y north, heading counter-clockwise from east. The pose of a vehicle is that of the centre of its
footprint. Everything is SI and radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, NamedTuple, TypeVar

import numpy as np
from pydantic import Field

from platoontraffic.lidar.pose import wrap

# Vehicles at least this long are of full size; for smaller ones, distances shrink as from a car to them.
FULL_SIZE, CAR_LENGTH = 2.0, 4.74  # [m]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Model = TypeVar("Model")  # a dataclass of floats


def scale(length):
    """1 for vehicles of full size; of smaller ones, their size beside a car."""
    return np.where(length >= FULL_SIZE, 1.0, length / CAR_LENGTH)


class Twist(NamedTuple):
    """A command, or a motion, of the body: floats, or arrays (n,)."""

    speed: np.ndarray  # forward [m/s]
    yaw_rate: np.ndarray  # to the left [rad/s]


class Drive(NamedTuple):
    """A command to what drives and steers as cars do: floats, or arrays (n,)."""

    acceleration: np.ndarray  # of the driven axle, forward [m/s2]; negative brakes
    curvature: np.ndarray  # of the driven axle's path, to the left [1/m]


class Command(NamedTuple):
    """One command a vehicle, of either kind: where the drive is NaN, the twist holds. Arrays (n,)."""

    twist: Twist
    drive: Drive

    @classmethod
    def of(cls, given: Twist | Drive) -> Command:
        if isinstance(given, Drive):
            still = np.zeros(np.shape(given.acceleration))
            return cls(Twist(still, still), given)
        nothing = np.full(np.shape(given.speed), np.nan)
        return cls(given, Drive(nothing, nothing))

    def rows(self, rows: np.ndarray) -> Command:
        """The commands of some of them."""
        return Command(*(type(kind)(*(values[rows] for values in kind)) for kind in self))

    def braked(self, rate: np.ndarray, motion: Motion, dt: float) -> Command:
        """With some brought to a stand by no less than a rate [m/s2]; NaN: as it is.

        On the curvature commanded to what steers, or else that on which it is.
        """
        twist, drive = self
        speed, broken = motion.speed, ~np.isnan(rate)
        stop = -speed / dt
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.where(speed == 0, 0.0, motion.yaw_rate / speed)
        forwards = np.clip(np.fmin(drive.acceleration, -rate), stop, 0.0)
        acceleration = np.where(speed >= 0, forwards, np.minimum(rate, stop))
        curvature = np.where(np.isnan(drive.curvature), bend, drive.curvature)
        return Command(
            twist,
            Drive(*(np.where(broken, new, old) for new, old in zip((acceleration, curvature), drive, strict=True))),
        )


@dataclass(frozen=True)
class Motion:
    """Where vehicles are and how they move, at one instant. Arrays (n,)."""

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray  # in (-pi, pi]
    turned: np.ndarray  # heading since the start, not wrapped
    speed: np.ndarray  # of the driven axle's middle
    yaw_rate: np.ndarray
    acceleration: np.ndarray
    steering: np.ndarray  # of cars: angle of the front wheel, to the left; of robots 0
    braking: np.ndarray  # of cars: the brakes' part of the acceleration, not negative; of robots 0

    @classmethod
    def at_rest(cls, x, y, heading) -> Motion:
        x, y, heading = (np.array(value, dtype=float) for value in (x, y, heading))
        still = np.zeros_like(x)
        return cls(x, y, heading, still, still, still, still, still, still)

    def of(self, rows: np.ndarray) -> Motion:
        """The motion of some of them."""
        return Motion(*(getattr(self, f.name)[rows] for f in fields(self)))


@dataclass(frozen=True)
class DifferentialDrive:
    """A robot on two driven rear wheels and a castor in front; the paper's robot.

    Each field is a float, or an array (n,) for n robots at once (`stack`). The defaults are those of `paper-robot`:
    the paper names its robot (like an EMoRo) and gives no size. Length, width and wheels are this project's
    assumption, chosen so that the closed forms of the follower (width 0.15 m) have room on a 1 m lane.
    """

    length: Positive = 0.20  # of the footprint rectangle [m]
    width: Positive = 0.15
    axle: float = -0.06  # driven axle, ahead of the centre [m]; negative: behind it
    wheel_separation: Positive = 0.13  # between the two driven wheels [m]
    wheel_radius: Positive = 0.03
    max_wheel_speed: Positive = 40.0  # [rad/s]; 1.2 m/s straight ahead
    lag: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0  # first order, of both wheel speeds [s]; 0: none

    @property
    def top_speed(self) -> float:
        """Straight ahead [m/s]."""
        return self.max_wheel_speed * self.wheel_radius

    @property
    def turning_radius(self) -> float:
        """It turns on the spot [m]."""
        return 0.0

    def twist_for(self, command: Command | Drive | Twist, motion: Motion, dt: float) -> Twist:
        """The twist that a command comes to: a drive's acceleration is that of the coming step, its curvature kept."""
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
        """The middle of the driven axle, the point whose path the wheels draw. Arrays (n,)."""
        return motion.x + self.axle * np.cos(motion.heading), motion.y + self.axle * np.sin(motion.heading)

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt under one command.

        The axle's middle drives an arc: exact for a constant twist, and, since both wheels share one lag, exact too
        for a start from rest at constant curvature. With a lag, distance and turned angle are exact always.
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
        return replace(
            motion, x=x, y=y, heading=wrap(heading), turned=turned, speed=speed, yaw_rate=yaw_rate,
            acceleration=acceleration,
        )  # fmt: skip


ROBOTS = {"paper-robot": DifferentialDrive()}


def stack(models: Sequence[Model]) -> Model:
    """Many vehicles of one class as one model with arrays (n,)."""
    kind = type(models[0])
    return kind(*(np.array([getattr(m, f.name) for m in models]) for f in fields(kind)))


def _relax(value, target, left_over, mean_left_over):
    """First-order approach to a target over one step: the value at its end, and its mean over the step."""
    return target + (value - target) * left_over, target + (value - target) * mean_left_over
