"""Closing speed, filtered from successive measurements of a free distance."""

from __future__ import annotations

import numpy as np

FASTEST = 40.0  # greatest speed of anything that comes towards the vehicle or drives away from it [m/s]


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
    with np.errstate(invalid="ignore"):
        known = np.where(np.isnan(closing), (before - free) / dt, closing)
        known = np.where((known > -FASTEST) & (known < speed + FASTEST), known, np.nan)  # else another obstacle
        surprise = free - (before - known * dt)
        is_same = np.isfinite(free) & (np.abs(surprise) < same)
        return np.where(is_same, known + np.expm1(-dt / time_constant) * surprise / dt, np.nan)
