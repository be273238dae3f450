"""Own motion from decision to decision, compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers.tracker import drive_line, own_motion
from platoontraffic.controllers.tracker.own_motion import STILL
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, drive_line.__file__, own_motion.__file__)

CREEPING = 0.5  # speed below which the yaw rate follows better from steering than from measurement [m/s]
DRIFTS = math.radians(0.02)  # change of the bias of the yaw rate in a second [rad/s]
NOISE = math.radians(0.3)  # standard deviation of the difference from the steering's yaw rate, straight ahead [rad/s]
TURNING = 0.3  # growth of that with the steering's yaw rate: tyres slip, and the steering lags

approach, _steered = compiled(drive_line.approach), compiled(own_motion.steered)


@compiled
def steer(curvature, command, lag, rate, dt, driven, mean):
    """Fill in curvatures dt [s] after commands, and their means until then [1/m], as `own_motion.steered`; (n,)."""
    for i in range(len(curvature)):
        driven[i], mean[i] = _steered(curvature[i], command[i], lag[i], rate[i], dt)


@compiled
def move_on(speed, yaw_rate, acceleration, steering, modelled, before, body, dt, moved):
    """Fill in `own_motion.Moved`.

    speed, yaw_rate        : as measured [m/s], [rad/s], (n,)
    acceleration, steering : last commands, of acceleration [m/s2] and curvature [1/m], (n,)
    modelled               : curvature when the yaw rate was measured, and its mean since the last decision less the
                             mean of its values then and now [1/m], (n,) each
    before                 : `DriveLine`, `YawBias` and `Odometry` of the last decision
    """
    (line, bias, odometry), (curvature, more) = before, modelled
    for i in range(len(speed)):
        command = acceleration[i]
        moved.drive[i] = approach(line.drive[i], np.maximum(command, 0.0), body.drive_lag[i], dt)
        moved.brake[i] = approach(line.brake[i], np.maximum(-command, 0.0), body.brake_lag[i], dt)

        # A Kalman filter of one state: while it drives straight ahead, what is measured is the bias. A standing
        # vehicle's sensor reads 0.
        turning, variance = speed[i] * curvature[i], bias.variance[i] + DRIFTS**2 * dt
        changing = speed[i] * (steering[i] - curvature[i])
        noise2 = NOISE**2 + TURNING**2 * (turning**2 + changing**2)
        gain = variance / (variance + noise2) if speed[i] > CREEPING else 0.0
        moved.bias[i] = bias.mean[i] + gain * (yaw_rate[i] - turning - bias.mean[i])
        moved.variance[i] = variance * (1 - gain)

        # At walking pace and below own motion is modelled, since noise would dominate.
        now = 0.0 if abs(speed[i]) < STILL and command <= 0 else speed[i]
        turns = yaw_rate[i] - moved.bias[i]
        if now < CREEPING:
            lock = 1 / body.length[i]  # greatest curvature of a car, roughly [1/m]
            turns = now * np.minimum(np.maximum(curvature[i], -lock), lock)

        # As `Odometry.moved`; but the yaw rate does not change evenly: steering approaches its command.
        length = (odometry.speed[i] + now) / 2 * dt
        angle = (odometry.yaw_rate[i] + turns) / 2 * dt + more[i] * length
        chord, along = length * np.sinc(angle / (2 * np.pi)), odometry.heading[i] + angle / 2
        moved.x[i] = odometry.x[i] + chord * math.cos(along)
        moved.y[i] = odometry.y[i] + chord * math.sin(along)
        moved.heading[i] = odometry.heading[i] + angle
        moved.speed[i], moved.yaw_rate[i] = now, turns
