"""Readings of odometry for all vehicles at once; compiled."""

from __future__ import annotations

from platoontraffic.lidar import noise
from platoontraffic.lidar.compiled import compiler
from platoontraffic.lidar.noise import GOLDEN, gauss, mixed

compiled = compiler(__file__, noise.__file__)

_mixed, _gauss = compiled(mixed), compiled(gauss)


@compiled
def read(errors, once, keys, reading, speed, yaw_rate, measured):
    """Fill in the measured speed and yaw rate, (2, n); arrays (n,).

    errors  : speed_scale, speed_noise, yaw_rate_bias, yaw_rate_noise of `OdometryErrors`
    once    : what is drawn once for each vehicle, for speed and yaw rate
    keys    : a hash for each vehicle
    reading : what is added to it for this reading
    """
    speed_scale, speed_noise, yaw_rate_bias, yaw_rate_noise = errors
    scale, bias = once
    for i in range(len(speed)):
        measured[0, i] = measured[1, i] = 0.0
        if speed[i] == 0 and yaw_rate[i] == 0:  # it stands
            continue
        now = _mixed(keys[i] + reading)
        noise, turning = _gauss(_mixed(now)), _gauss(_mixed(now + GOLDEN))
        found = speed[i] * (1 + speed_scale[i] * scale[i]) + speed_noise[i] * noise
        measured[0, i] = found if speed[i] < 0 else max(found, 0.0)  # it is not taken for one that reverses
        measured[1, i] = yaw_rate[i] + yaw_rate_bias[i] * bias[i] + yaw_rate_noise[i] * turning
