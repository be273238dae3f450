"""The motion of one car after the other, compiled: the equations of `bicycle`, sub-step by sub-step.

A car and its motion are records with the fields of those classes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.vehicles import bicycle_formulas, motion
from platoontraffic.vehicles.motion import Drive, Motion, Twist

MOTION = np.dtype([(name, float) for name in Motion.__dataclass_fields__])

compiled = compiler(__file__, bicycle_formulas.__file__, motion.__file__)

_strongest_acceleration = compiled(bicycle_formulas.strongest_acceleration)
_drive_for = compiled(bicycle_formulas.drive_for)
_within_limits = compiled(bicycle_formulas.within_limits)


class _Pace(NamedTuple):
    """The part of a motion that the drive line changes."""

    speed: float  # [m/s]
    acceleration: float  # drive - brake [m/s2]
    braking: float  # brake [m/s2]


class _Lag(NamedTuple):
    """A lag of first order with a bounded rate, and a time h for which it acts; see `_approach`."""

    lag: float  # [s]
    fastest: float  # rate [1/s] times the unit of the value
    h: float  # [s]
    decayed: float  # 1 - exp(-h / lag)


class _Lags(NamedTuple):
    """Of a car's drive line, for one time h."""

    drive: _Lag
    brake: _Lag


@compiled
def move(motion, cars, command, count, h, spare, after):
    """Advance every row by `count` sub-steps of h [s].

    motion  : the fields of `Motion`, (n,) each
    cars    : records (n,)
    command : the fields of a twist and of a drive, (n,) each; where the drive is NaN, the twist is obeyed
    spare   : memory for a record of MOTION, (1,)
    after   : filled in, a row for each field of `Motion`, (9, n)
    """
    x, y, heading, turned, speed, yaw_rate, acceleration, steering, braking = motion
    now = spare[0]
    for i in range(len(x)):
        now.x, now.y, now.heading, now.turned, now.speed = x[i], y[i], heading[i], turned[i], speed[i]
        now.yaw_rate, now.acceleration, now.steering, now.braking = (
            yaw_rate[i],
            acceleration[i],
            steering[i],
            braking[i],
        )
        twist, drive = Twist(command[0][i], command[1][i]), Drive(command[2][i], command[3][i])
        car = cars[i]
        half, whole = _lags(car, h / 2), _lags(car, h)
        steering_lag = _lag(car.steering_lag, car.max_steering_rate, h)
        for _ in range(count):
            _substep(now, car, twist, drive, half, whole, steering_lag)
        after[0, i], after[1, i], after[3, i], after[4, i] = now.x, now.y, now.turned, now.speed
        after[2, i] = now.heading - 2 * np.pi * np.ceil((now.heading - np.pi) / (2 * np.pi))  # as `lidar.pose.wrap`
        after[5, i], after[6, i], after[7, i] = now.yaw_rate, now.acceleration, now.steering
        after[8, i] = now.braking


@compiled
def _substep(motion, car, twist, drive, half, whole, steering_lag):
    """Advance one car by h [s], in place; the demand is that at the middle of h, with which the error is of order h^3.

    half, whole  : lags of its drive line for h / 2, and for h
    steering_lag : for h

    For a mean steering angle delta the rear axle drives an arc of length s and angle theta, along its chord c:

        theta = s kappa        c = s sin(theta / 2) / (theta / 2)        psi += theta
        (x, y) += c (cos, sin)(psi + theta / 2)        psi' = v kappa
    """
    now = _Pace(motion.speed, motion.acceleration, motion.braking)
    lateral = motion.speed * motion.yaw_rate
    half_way, _ = _driven(now, _saturated(car, twist, drive, now, lateral).acceleration, half)
    wanted = _saturated(car, twist, drive, half_way, lateral)
    after, distance = _driven(now, wanted.acceleration, whole)

    steering, mean_steering = _approach(motion.steering, math.atan(car.wheelbase * wanted.curvature), steering_lag)
    angle = distance * _gripped(car, math.tan(mean_steering) / car.wheelbase, half_way.speed)
    chord = distance * np.sinc(angle / (2 * np.pi))  # numpy's sinc(x) is sin(pi x) / (pi x)
    along, heading = motion.heading + angle / 2, motion.heading + angle
    # The axle moves along the chord; the centre keeps its place before the axle.
    motion.x += chord * math.cos(along) + car.axle * (math.cos(motion.heading) - math.cos(heading))
    motion.y += chord * math.sin(along) + car.axle * (math.sin(motion.heading) - math.sin(heading))
    motion.heading, motion.turned, motion.steering = heading, motion.turned + angle, steering
    motion.speed, motion.acceleration, motion.braking = after
    motion.yaw_rate = after.speed * _gripped(car, math.tan(steering) / car.wheelbase, after.speed)


@compiled
def _gripped(car, curvature, speed):
    """The part of a curvature that the tyres hold at a speed [1/m]."""
    most = car.grip / max(speed * speed, 1e-9)
    return min(max(curvature, -most), most)


@compiled
def _saturated(car, twist, drive, pace, lateral):
    """The demand, by drive or else by twist, within the limits of engine, brakes, tyres and steering lock.

    lateral: acceleration [m/s2]
    """
    by_twist = math.isnan(drive.acceleration)
    wanted = _drive_for(car, twist, pace) if by_twist else Drive(drive.acceleration, drive.curvature)
    return _within_limits(car, wanted, _strongest_acceleration(car, pace.speed), lateral)


@compiled
def _driven(pace, demand, lags):
    """Pace after the time h [s] of the lags, under a constant demand of acceleration [m/s2]; the distance driven [m].

        v(h) = v + (mean drive - mean brake) h        s = (v + v(h)) / 2 h

    with the means of `_approach`. The brakes hold at v = 0: the car then stands, after s = v / 2 t with t = v h /
    (v - v(h)), and does not roll back.
    """
    drive = pace.acceleration + pace.braking
    drive, mean_drive = _approach(drive, max(demand, 0.0), lags.drive)
    braking, mean_braking = _approach(pace.braking, max(-demand, 0.0), lags.brake)
    h = lags.drive.h
    speed = pace.speed + (mean_drive - mean_braking) * h
    if speed <= 0:
        to_rest = pace.speed * h / max(pace.speed - speed, 1e-300)  # time [s]
        return _Pace(0.0, 0.0, 0.0), pace.speed / 2 * to_rest
    return _Pace(speed, drive - braking, braking), (pace.speed + speed) / 2 * h


@compiled
def _lags(car, h):
    return _Lags(_lag(car.lag, car.max_jerk, h), _lag(car.brake_lag, car.max_jerk, h))


@compiled
def _lag(lag, fastest, h):
    lag = max(lag, 1e-12)
    return _Lag(lag, fastest, h, -math.expm1(-h / lag))


@compiled
def _approach(value, target, first_order):
    """First-order approach to a target with a bounded rate, exact: the value after h [s], and its mean over h.

        y' = (target - y) / lag,  |y'| <= fastest

    While the gap is more than lag * fastest the value changes at `fastest`; the rest then decays as exp(-t / lag).
    """
    lag, fastest, h, decayed = first_order
    gap = abs(target - value)
    run = min(max(gap / fastest - lag, 0.0), h)  # time at the greatest rate [s]
    left = gap - fastest * run
    if run > 0.0:
        decayed = -math.expm1((run - h) / lag)
    mean_gap = ((gap + left) / 2 * run + left * lag * decayed) / h
    side = np.sign(target - value)
    return target - side * (left * (1 - decayed)), target - side * mean_gap
