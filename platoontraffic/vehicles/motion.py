"""Commands to vehicles, their motion, and what every model of a vehicle declares.

World frame: x east, y north, heading counter-clockwise from east. The pose of a vehicle is that of the centre of its
footprint. All quantities are SI and radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from pydantic import Field

# A vehicle at least as long as FULL_SIZE is of full size; for a smaller one, distances shrink by its length beside
# CAR_LENGTH.
FULL_SIZE, CAR_LENGTH = 2.0, 4.74  # [m]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def scale(length):
    """Factor for distances: 1 for a vehicle of full size; for a smaller one, its length [m] beside a car's."""
    if isinstance(length, float):  # asked for often, and an array of one number takes ten times as long
        return 1.0 if length >= FULL_SIZE else length / CAR_LENGTH
    return np.where(length >= FULL_SIZE, 1.0, length / CAR_LENGTH)


class Twist(NamedTuple):
    """A command by speed, or a measured motion: floats, or arrays (n,)."""

    speed: np.ndarray  # forward [m/s]
    yaw_rate: np.ndarray  # to the left [rad/s]


class Drive(NamedTuple):
    """A command as cars take it: floats, or arrays (n,)."""

    acceleration: np.ndarray  # of the driven axle, forward [m/s2]; negative brakes
    curvature: np.ndarray  # of the driven axle's path, to the left [1/m]


class Command(NamedTuple):
    """One command for each vehicle, of either kind: where the drive is NaN, the twist applies. Arrays (n,)."""

    twist: Twist
    drive: Drive

    @classmethod
    def of(cls, given: Twist | Drive) -> Command:
        if isinstance(given, Drive):
            still = np.zeros(np.shape(given.acceleration))
            return cls(Twist(still, still), given)
        nothing = np.full(np.shape(given.speed), np.nan)
        return cls(given, Drive(nothing, nothing))

    def replaced(self, rows: Sequence[np.ndarray | int], given: Sequence[Twist | Drive]) -> Command:
        """A copy with each of the given commands, (m,) or numbers, in its rows, (m,) or one."""
        speed, yaw_rate, acceleration, curvature = [values.copy() for values in (*self.twist, *self.drive)]
        for where, one in zip(rows, given, strict=True):
            driven = type(one) is Drive
            speed[where], yaw_rate[where] = (0.0, 0.0) if driven else one
            acceleration[where], curvature[where] = one if driven else (np.nan, np.nan)
        return Command(Twist(speed, yaw_rate), Drive(acceleration, curvature))

    def braked(self, rate: np.ndarray, motion: Motion, dt: float) -> Command:
        """The command with some vehicles brought to rest, whatever was commanded to them.

        Such a vehicle keeps the curvature of its drive command, or else the curvature that it drives now.

        rate : least deceleration [m/s2], (n,); NaN: the vehicle is not braked
        """
        twist, drive = self
        speed, braked = motion.speed, ~np.isnan(rate)
        stop = -speed / dt
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.where(speed == 0, 0.0, motion.yaw_rate / speed)
        forwards = np.clip(np.fmin(drive.acceleration, -rate), stop, 0.0)
        acceleration = np.where(speed >= 0, forwards, np.minimum(rate, stop))
        curvature = np.where(np.isnan(drive.curvature), bend, drive.curvature)
        return Command(
            twist,
            Drive(*(np.where(braked, new, old) for new, old in zip((acceleration, curvature), drive, strict=True))),
        )


@dataclass(frozen=True)
class Motion:
    """Poses of vehicles and how they move, at one instant. Arrays (n,)."""

    x: np.ndarray  # of the footprint's centre, east [m]
    y: np.ndarray  # of it, north [m]
    heading: np.ndarray  # counter-clockwise from east [rad], in (-pi, pi]
    turned: np.ndarray  # heading since the start, not wrapped [rad]
    speed: np.ndarray  # of the driven axle's middle, forward [m/s]
    yaw_rate: np.ndarray  # to the left [rad/s]
    acceleration: np.ndarray  # of the driven axle's middle [m/s2]
    steering: np.ndarray  # angle of the front wheel, to the left [rad]; 0 if it steers by its driven wheels
    braking: np.ndarray  # the brakes' part of the acceleration, not negative [m/s2]; 0 if it has no brakes of their own

    @classmethod
    def at_rest(cls, x, y, heading) -> Motion:
        x, y, heading = (np.array(value, dtype=float) for value in (x, y, heading))
        still = np.zeros_like(x)
        return cls(x, y, heading, still, still, still, still, still, still)


def rows(values: Sequence[Any]) -> tuple[tuple[int, ...], tuple[np.ndarray, ...]]:
    """Their common shape, and arrays of its size (n,) that a kernel may read: those that are one already, else copies.

    values: floats or arrays
    """
    if _are_rows(values):
        return values[0].shape, tuple(values)
    shape = np.broadcast_shapes(*map(np.shape, values))
    return shape, tuple(np.array(np.broadcast_to(v, shape), dtype=float).ravel() for v in values)


def _are_rows(values: Sequence[Any]) -> bool:
    first = values[0]
    for one in values:  # without a call for each: it is asked in every step
        if type(one) is not np.ndarray or one.ndim != 1 or one.dtype != float or not one.flags.carray:
            return False
        if one.shape != first.shape:
            return False
    return True


class VehicleModel(Protocol):
    """A kind of vehicle: a frozen dataclass of floats, or of arrays (n,) for n vehicles (`records.stack`)."""

    length: float  # of the footprint rectangle [m]
    width: float
    axle: float  # the driven one, ahead of the centre [m]; negative: behind it

    @property
    def top_speed(self) -> float:
        """On the level, straight ahead [m/s]."""

    @property
    def turning_radius(self) -> float:
        """Least turning radius of the driven axle's middle [m]."""

    @property
    def curvature_rate(self) -> float:
        """Greatest rate at which the curvature of its path changes, straight ahead [1/(m s)]; inf: at once."""

    @property
    def steering_lag(self) -> float:
        """Of the curvature behind its command, first order [s]."""

    @property
    def drive_lag(self) -> float:
        """Of the drive's acceleration behind its command, first order [s]."""

    @property
    def brake_lag(self) -> float:
        """The same of the brakes [s]."""

    @property
    def hardest_braking(self) -> float:
        """[m/s2]; inf: it stops at once."""

    def strongest_acceleration(self, speed: np.ndarray) -> np.ndarray:
        """Greatest acceleration at a speed [m/s2]; inf: any."""

    def braking_delay(self, scan: float, braking: float) -> float:
        """T [s]: the vehicle stops within v T + v^2 / 2 b of what the laser could see at a speed v.

        scan    : from then until the brakes are applied [s]
        braking : b, the full one [m/s2]
        """

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt [s] under one command."""
