"""How fast the way to something ahead becomes less, learnt from its change from scan to scan."""

from __future__ import annotations

import numpy as np

OTHERS = 40.0  # nobody comes nearer faster than by that and the own speed [m/s]


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
    """Filtered [m/s], (n,); NaN at the first look at something.

    free, before  : the way to it [m], and that in the scan before; inf: nothing is there
    closing       : what was returned then
    same          : by which the way may differ from what is expected, of the same thing [m]
    time_constant : of the filter [s]
    """
    with np.errstate(invalid="ignore"):
        known = np.where(np.isnan(closing), (before - free) / dt, closing)
        known = np.where((known > -OTHERS) & (known < speed + OTHERS), known, np.nan)  # else it is another thing
        surprise = free - (before - known * dt)
        is_same = np.isfinite(free) & (np.abs(surprise) < same)
        return np.where(is_same, known + np.expm1(-dt / time_constant) * surprise / dt, np.nan)
