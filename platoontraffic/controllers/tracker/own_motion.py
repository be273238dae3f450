"""Own motion: the measured one, with the bias of the yaw rate as far as it is known by now.

Where scans or readings of the odometry are used late, own motion is wanted at two instants: that of the scan, to place
the returns, and that of their use, to drive by. It is known up to the last reading; since then it is modelled by the
commands.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Body, Sensed
from platoontraffic.controllers.tracker.drive_line import DriveLine
from platoontraffic.controllers.tracker.track import Odometry
from platoontraffic.vehicles.motion import Drive

STILL = 0.1  # speed below which a vehicle stands, if it does not accelerate [m/s]
UNKNOWN = math.radians(2)  # standard deviation of the bias of the yaw rate at first [rad/s]


class YawBias(NamedTuple):
    """Of the measured yaw rate, estimated by a Kalman filter of one state, arrays (n,)."""

    mean: np.ndarray  # [rad/s]
    variance: np.ndarray  # [rad2/s2]

    @classmethod
    def unknown(cls, n: int) -> YawBias:
        return cls(np.zeros(n), np.full(n, UNKNOWN**2))


class Moved(NamedTuple):
    """Own motion a decision later, arrays (n,): a `DriveLine`, a `YawBias` and an `Odometry`."""

    drive: np.ndarray
    brake: np.ndarray
    bias: np.ndarray
    variance: np.ndarray
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    yaw_rate: np.ndarray


def steered(curvature, command, lag, rate, dt):
    """A curvature dt [s] after a command, and its mean until then [1/m]: floats, or arrays (n,).

    It approaches the command by a first-order lag [s] within a rate [1/(m s)].
    """
    lag, rate, gap = np.maximum(lag, 1e-9), np.minimum(rate, 1e3), np.abs(command - curvature)
    at_rate = np.minimum(np.maximum(gap / rate - lag, 0.0), dt)
    left = gap - rate * at_rate
    decayed = -np.expm1((at_rate - dt) / lag)
    mean_gap = ((gap + left) / 2 * at_rate + left * lag * decayed) / dt
    side = np.sign(command - curvature)
    return command - side * left * (1 - decayed), command - side * mean_gap


class Past(NamedTuple):
    """The last decisions, the newest first, arrays (n, k): of k = 0 columns where all that is given is new.

    The first five are an `Odometry` at the reading that was given then; the others are modelled, up to then.
    """

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    yaw_rate: np.ndarray
    gained: np.ndarray  # speed since the decision before [m/s]
    curvature: np.ndarray  # driven [1/m]

    @classmethod
    def begin(cls, sensed: Sensed, dt: float) -> Past:
        """Straight ahead at the first speed, up to the origin of the odometry frame."""
        late = sensed.odometry_age
        back = max(sensed.age, *sensed.ages.values(), late) - late
        size = math.ceil(max(late, back) / dt) + 2 if late or back else 0
        speed = np.repeat(sensed.speed[:, None], size, axis=1)
        zero = np.zeros_like(speed)
        return cls(-speed * dt * np.arange(size), zero, zero, speed, zero, zero, zero)

    def driven(self, gained: np.ndarray, command: np.ndarray, body: Body, dt: float) -> Past:
        """After dt in which the speed was to change and a curvature was commanded, (n,); read as before."""
        curvature, _ = steered(self.curvature[:, 0], command, body.steering_lag, body.curvature_rate, dt)
        newest = *(column[:, 0] for column in self[:5]), gained, curvature
        return Past(*(np.column_stack([new, old[:, :-1]]) for new, old in zip(newest, self, strict=True)))

    def read(self, odometry: Odometry) -> Past:
        """With the newest reading."""
        read = (np.column_stack([new, old[:, 1:]]) for new, old in zip(odometry, self[:5], strict=True))
        return Past(*read, self.gained, self.curvature)

    def at_reading(self) -> Odometry:
        return Odometry(*(column[:, 0].copy() for column in self[:5]))

    def curvature_at(self, age: float, dt: float) -> np.ndarray:
        """Driven `age` ago [1/m], (n,)."""
        k = min(int(age / dt + 1e-9), self.curvature.shape[1] - 2)
        share = age / dt - k
        return self.curvature[:, k] * (1 - share) + self.curvature[:, k + 1] * share

    def at(self, age: float, read: float, dt: float) -> Odometry:
        """Own motion `age` ago [s]; read: since the last reading [s]."""
        if age > read:
            return self._before_reading((age - read) / dt, dt)
        odometry, left = self.at_reading(), read
        drifts = odometry.yaw_rate - odometry.speed * self.curvature_at(read, dt)  # of the model from what is measured
        while left > age + 1e-9:
            k = math.ceil(left / dt - 1e-9) - 1
            until = max(k * dt, age)
            speed = np.maximum(odometry.speed + self.gained[:, k] * (left - until) / dt, 0.0)
            yaw_rate = np.where(speed > 0, drifts + speed * self.curvature_at(until, dt), 0.0)
            odometry, left = odometry.moved(speed, yaw_rate, left - until), until
        return odometry

    def _before_reading(self, decisions: float, dt: float) -> Odometry:
        k = int(decisions + 1e-9)
        share = decisions - k
        newer, older = (Odometry(*(column[:, j].copy() for column in self[:5])) for j in (k, k + 1))
        speed, yaw_rate = (share * b + (1 - share) * a for a, b in zip(newer[3:], older[3:], strict=True))
        return older.moved(speed, yaw_rate, (1 - share) * dt)


class Driven(NamedTuple):
    """Own motion by late readings and by the commands since."""

    command: Drive  # the last one
    drive_line: DriveLine
    past: Past

    @classmethod
    def begin(cls, sensed: Sensed, dt: float) -> Driven:
        n = len(sensed.speed)
        return cls(Drive(*np.zeros((2, n))), DriveLine.at_rest(n), Past.begin(sensed, dt))

    def until_now(self, sensed: Sensed, dt: float) -> tuple[Driven, Odometry]:
        """dt later, and own motion then."""
        drive_line = self.drive_line.after(self.command.acceleration, sensed.body, dt)
        gained = (self.drive_line.acceleration + drive_line.acceleration) / 2 * dt
        past = self.past.driven(gained, self.command.curvature, sensed.body, dt)
        past = past.read(past.at_reading().moved(sensed.speed, sensed.yaw_rate, dt))
        return Driven(self.command, drive_line, past), past.at(0.0, sensed.odometry_age, dt)


def seen_from(points: np.ndarray, here: Odometry, there: Odometry) -> np.ndarray:
    """Points (n, k, 2) that are seen from own axles here, as they are seen from there [m]."""
    turn = (here.heading - there.heading)[:, None]
    cos, sin = np.cos(turn), np.sin(turn)
    dx, dy = here.x - there.x, here.y - there.y
    ahead = np.cos(there.heading) * dx + np.sin(there.heading) * dy
    aside = np.cos(there.heading) * dy - np.sin(there.heading) * dx
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y + ahead[:, None], sin * x + cos * y + aside[:, None]], axis=-1)
