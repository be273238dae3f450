"""Closing speed, filtered from successive measurements of a free distance."""

from __future__ import annotations

import numpy as np


def closing_speed(
    free: np.ndarray,
    before: np.ndarray,
    closing: np.ndarray,
    speed: np.ndarray,
    dt: float,
    *,
    same: float | np.ndarray,
    time_constant: float,
) -> np.ndarray:
    """Rate at which the free distance shrinks [m/s], (n,); NaN at the first measurement of an obstacle.

    free, before  : free distance in this scan and in the one before [m]; inf: nothing is there
    closing       : result for the scan before
    speed         : own [m/s]
    same          : greatest difference of the distance from its prediction, for the same obstacle [m]
    time_constant : of the filter [s]
    """
    # Imported here: importing numba takes half a second.
    from platoontraffic.controllers.closing_kernel import closing_speeds

    found = np.empty(len(free))
    same = np.full(len(free), same) if np.ndim(same) == 0 else same
    closing_speeds(free, before, closing, speed, dt, same, time_constant, found)
    return found
