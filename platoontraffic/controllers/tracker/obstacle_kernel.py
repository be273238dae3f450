"""Speed and acceleration of an obstacle ahead, from successive free distances, compiled; rows (n,)."""

from __future__ import annotations

import math

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

SAME = 1.0  # greatest difference of the free distance from its prediction, for one obstacle [m]
MEMORY = 0.1  # time constant with which errors of speed and acceleration fade [s]
FASTEST = 40.0  # greatest speed of anything towards the vehicle, or away from it beyond its own [m/s]
HARDEST = 12.0  # greatest braking of any vehicle [m/s2]


@compiled
def follow_obstacle(free, own_speed, last, last_own_speed, dt, speed, acceleration):
    """Fill in speeds of obstacles along the strip [m/s] and their braking, at most 0 [m/s2], (n,); NaN: not known yet.

    The speed is first known from two scans, where the acceleration is 0. From then on the distance is predicted, and
    with its difference s from the prediction

        speed <- speed + acceleration dt + k s / dt,      acceleration <- acceleration + q s / dt^2

    where k = 1 - f^2 + (1 - f)^2 / 2 and q = (1 - f)^2 let errors of both fade by f = exp(-dt / MEMORY) a scan, without
    overshoot (fading memory: E. Brookner, "Tracking and Kalman filtering made easy", 1998). Only braking is estimated:
    while a body moves into the strip sideways, its first return runs along its side and seems to accelerate.

    free           : distance in this scan [m]; inf: nothing is there
    last           : `tracking.Obstacle` of the scan before
    own_speed      : in this scan, and `last_own_speed` in the scan before [m/s]
    """
    f = math.exp(-dt / MEMORY)
    k, q = 1 - f * f + (1 - f) ** 2 / 2, (1 - f) ** 2
    for i in range(len(free)):
        speed[i] = acceleration[i] = math.nan
        driven = (own_speed[i] + last_own_speed[i]) / 2 * dt
        u, a = last.speed[i], last.acceleration[i]
        if math.isnan(u):
            u, a = (free[i] - last.free[i] + driven) / dt, 0.0
        surprise = free[i] - (last.free[i] + (u + a * dt / 2) * dt - driven)
        if math.isfinite(free[i]) and abs(surprise) < SAME:
            u += a * dt + k * surprise / dt
            a += q * surprise / dt**2
            if -FASTEST < u < own_speed[i] + FASTEST:
                speed[i], acceleration[i] = u, min(max(a, -HARDEST), 0.0)
