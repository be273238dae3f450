"""Closing speed to whatever is ahead, filtered from successive measurements of its distance."""

from __future__ import annotations

import numpy as np

FASTEST_OBJECT = 40.0  # greatest speed of anything else, towards the vehicle or away from it [m/s]


def closing_speed(
    distance: np.ndarray,
    last_distance: np.ndarray,
    last_closing: np.ndarray,
    speed: np.ndarray,
    dt: float,
    *,
    same: float | np.ndarray,
    time_constant: float,
) -> np.ndarray:
    """Rate at which a distance falls [m/s], (n,), by a first-order filter; NaN at the first measurement of an object.

    distance, last_distance : now and dt earlier [m], (n,); inf: nothing is there
    last_closing            : the closing speed returned dt earlier [m/s], (n,)
    speed                   : own [m/s], (n,)
    same                    : a distance that differs by more from the expected one is that of another object [m]
    time_constant           : of the filter [s]
    """
    with np.errstate(invalid="ignore"):
        known = np.where(np.isnan(last_closing), (last_distance - distance) / dt, last_closing)
        possible = (known > -FASTEST_OBJECT) & (known < speed + FASTEST_OBJECT)
        known = np.where(possible, known, np.nan)  # a faster change is that from one object to another
        surprise = distance - (last_distance - known * dt)
        is_same = np.isfinite(distance) & (np.abs(surprise) < same)
        return np.where(is_same, known + np.expm1(-dt / time_constant) * surprise / dt, np.nan)
