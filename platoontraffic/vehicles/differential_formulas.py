"""Formulas of a differential drive: functions of floats or arrays, which the kernel compiles."""

from __future__ import annotations

import numpy as np


def turned_by_wheels(speed, yaw_rate, separation, radius, fastest):
    """Speed [m/s] and yaw rate [rad/s] of the same curvature, as two driven wheels can turn them.

    separation, radius : of the wheels [m]
    fastest            : that a wheel turns [rad/s]
    """
    swing = yaw_rate * separation / 2
    wheel = np.maximum(np.abs(speed - swing), np.abs(speed + swing)) / radius
    keep = np.minimum(1.0, fastest / np.maximum(wheel, 1e-300))
    return speed * keep, yaw_rate * keep
