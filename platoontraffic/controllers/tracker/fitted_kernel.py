"""Gains of the law `tracking` that follow from the vehicle and from the interval of its scans, compiled."""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

LAGS = 4.0  # time in which an offset falls to 1/e [lags of the steering]; a shorter one makes it swing
LENGTHS = 0.5  # least distance for that [vehicle lengths]
OFFSET = 0.5  # offset that the steering, at its rate, still corrects in that distance [m]
WINDOW = 0.3  # least distance each way over which the trail is smoothed [vehicle lengths]
POINTS = 4  # least number of scans over which it is smoothed each way
WINDOW_TIME = 0.4  # least time of that [s]: noise of the curvature grows with its inverse square
BEND_WINDOW = 0.5  # least distance each way for its curvature, which the steering has to follow [vehicle lengths]
# The same for the speed, by the square of the speed [s2/m]: errors of places grow with the distance at which they are
# seen, those of the lateral acceleration with the square of the speed; and the greatest of them decides.
PLAN_WINDOW = 0.02
STEERED = 0.8  # change of a trail's curvature that the speed is planned for [steering rates]; the rest steers back


@compiled
def fit(body, speed, dt, recovery, found):
    """Fill in `fitted.Fitted`.

    An offset e that falls as exp(-s / c) needs curvatures of e / c^2, which change at v e / c^3: at the steering rate r
    the least distance c is (v e / r)^(1/3). The steering lags by T, so c is also at least LAGS v T. A return by the
    curvature u is over in a distance of about c only if the steering gets there in it: u <= r c / v.

    On a trail y(s) the direction of a parabola through the points within w each way is y' + w^2 y''' / 10, and its
    curvature y''. Steered by the curvature at p beyond the place where the lag ends, the path driven is off by e, with

        e'' + 2 e' / c + e / c^2 = p y''' + w^2 y''' / (5 c),

    so with p = 0 each member would swing out by c w^2 y''' / 5 more than the one before it where a turn ends. With
    p = -w^2 / (5 c) it does not.
    """
    for i in range(len(speed)):
        v, length = speed[i], body.length[i]
        lag, rate = body.steering_lag[i] + dt / 2, np.minimum(body.curvature_rate[i], 1e3)
        catch_up = np.maximum(LENGTHS * length, np.maximum(np.cbrt(v * OFFSET / rate), LAGS * lag * v))
        window = np.maximum(WINDOW * length, max(POINTS * dt, WINDOW_TIME) * v)
        found.catch_up[i], found.window[i] = catch_up, window
        found.bend_window[i] = np.maximum(BEND_WINDOW * length, window)
        found.plan_window[i] = np.maximum(found.bend_window[i], PLAN_WINDOW * v * v)
        found.preview[i] = lag * v - window**2 / (5 * catch_up)
        found.gentle[i] = np.minimum(recovery / np.maximum(v, 2.0) ** 2, rate * catch_up / np.maximum(v, 2.0))
        found.steepest_bend[i] = STEERED * rate
