"""Steering along a path, from any offset and heading. Arguments are floats or arrays; kernels compile the functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

STEEPEST = 0.6  # sine of the greatest angle at which the path is approached


class Errors(NamedTuple):
    """Where a vehicle is beside its path, arrays (n,)."""

    offset: np.ndarray  # of the driven axle from the path, to the left [m]
    off_heading: np.ndarray  # own heading less that of the path [rad]


def curvature_back(
    errors: Errors, catch_up: np.ndarray, greatest: np.ndarray, steepest: np.ndarray | float = STEEPEST
) -> np.ndarray:
    """Curvature that brings a vehicle to its path, beside that of the path itself [1/m], (n,).

    catch_up : distance in which an offset falls to 1/e, later at the least [m], (n,)
    greatest : curvature [1/m], (n,)
    steepest : sine of the greatest angle of approach

    For offset e, off-heading p and the arc length s that it drives, beside a path whose curvature is fed forward,

        e' = sin p        p' = u = -(2 / c) (2 sin(p / 2) + a(e) cos(p / 2))        a(e) = e / 2c within +- steepest

    Along it V = (2 / c) (integral of a) + 4 (1 - cos(p / 2)) falls, V' = -(8 / c) sin^2(p / 2), until p = 0 and with it
    e = 0: from any offset and any heading (C. Samson, Path following and time-varying feedback stabilization of a
    wheeled mobile robot, ICARCV 1992, for the form). Near the path it is critically damped, with both poles at -1/c.
    Where u is limited V still falls if the limit is above (2 / c) a, so a is kept to 0.9 of that.
    """
    offset, off_heading = errors
    approach = np.minimum(steepest, 0.45 * catch_up * greatest)
    towards = np.minimum(np.maximum(offset / (2 * catch_up), -approach), approach)
    half = off_heading / 2
    back = -2 / catch_up * (2 * np.sin(half) + towards * np.cos(half))
    return np.minimum(np.maximum(back, -greatest), greatest)


def curvature_along(errors: Errors, curvature: np.ndarray) -> np.ndarray:
    """Own curvature that keeps the offset from a path [1/m], (n,): that of a circle about the same centre.

    curvature : of the path, to the left [1/m], (n,)
    """
    offset, off_heading = errors
    nearer = np.maximum(1 - offset * curvature, 0.3)  # the centre of the bend is never reached
    return curvature * np.cos(off_heading) / nearer
