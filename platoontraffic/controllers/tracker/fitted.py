"""Gains of the law `tracking` that follow from the vehicle and from the interval of its scans."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Body

LAGS = 4.0  # time in which an offset falls to 1/e [lags of the steering]; a shorter one makes it swing
LENGTHS = 0.5  # least distance for that [vehicle lengths]
OFFSET = 0.5  # offset that the steering, at its rate, still corrects in that distance [m]
WINDOW = 0.3  # least distance each way over which the trail is smoothed [vehicle lengths]
POINTS = 4  # least number of scans over which it is smoothed each way
WINDOW_TIME = 0.4  # least time of that [s]: noise of the curvature grows with its inverse square
BEND_WINDOW = 0.5  # least distance each way for its curvature, which the steering has to follow [vehicle lengths]
STEERED = 1.6  # change of a trail's curvature [steering rates] that is still followed: feedback takes the rest


class Fitted(NamedTuple):
    """Arrays (n,)."""

    catch_up: np.ndarray  # distance in which an offset from the trail falls to 1/e [m]
    window: np.ndarray  # distance each way over which the trail is smoothed, for the offset from it [m]
    bend_window: np.ndarray  # the same for its curvature [m]
    steering_lag: np.ndarray  # from a scan to the curvature driven [s]
    gentle: np.ndarray  # curvature that may be used to return to the trail [1/m]
    steepest_bend: np.ndarray  # greatest change of a trail's curvature that the steering follows [1/(m s)]


def fitted(body: Body, speed: np.ndarray, dt: float, recovery: float) -> Fitted:
    """The gains of vehicles at their speeds [m/s], (n,).

    dt       : interval of the scans [s]
    recovery : lateral acceleration of the return to the trail [m/s2]

    An offset e that falls as exp(-s / c) needs curvatures of e / c^2, which change at v e / c^3: at the steering rate r
    the least distance c is (v e / r)^(1/3). The steering lags by T, so c is also at least LAGS v T. A return by the
    curvature u is over in a distance of about c only if the steering gets there in it: u <= r c / v.
    """
    lag, rate = body.steering_lag + dt / 2, np.minimum(body.curvature_rate, 1e3)
    catch_up = np.maximum(LENGTHS * body.length, np.maximum(np.cbrt(speed * OFFSET / rate), LAGS * lag * speed))
    window = np.maximum(WINDOW * body.length, max(POINTS * dt, WINDOW_TIME) * speed)
    gentle = np.minimum(recovery / np.maximum(speed, 2.0) ** 2, rate * catch_up / np.maximum(speed, 2.0))
    return Fitted(catch_up, window, np.maximum(BEND_WINDOW * body.length, window), lag, gentle, STEERED * rate)
