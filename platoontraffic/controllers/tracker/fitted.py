"""Gains of the law `tracking` that follow from the vehicle and from the interval of its scans."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Body


class Fitted(NamedTuple):
    """Arrays (n,)."""

    catch_up: np.ndarray  # distance in which an offset from the trail falls to 1/e [m]
    window: np.ndarray  # distance each way over which the trail is smoothed, for the offset from it [m]
    bend_window: np.ndarray  # the same for the curvature that is steered [m]
    plan_window: np.ndarray  # the same for the curvature that the speed is planned for [m]
    preview: np.ndarray  # distance ahead of the place whose curvature is steered now [m]; negative: behind
    gentle: np.ndarray  # curvature that may be used to return to the trail [1/m]
    steepest_bend: np.ndarray  # change of a trail's curvature that the speed is planned for [1/(m s)]


def fitted(body: Body, speed: np.ndarray, dt: float, recovery: float) -> Fitted:
    """The gains of vehicles at their speeds [m/s], (n,).

    dt       : interval of the scans [s]
    recovery : lateral acceleration of the return to the trail [m/s2]
    """
    # Imported here: importing numba takes half a second.
    from platoontraffic.controllers.tracker.fitted_kernel import fit

    found = Fitted(*np.empty((7, len(speed))))
    fit(body, speed, dt, recovery, found)
    return found
