"""Speed in the bends of a trail."""

from __future__ import annotations

import numpy as np

from platoontraffic.controllers.tracker.trail import Ahead

SETTLING = 0.6  # time constant with which an allowed speed is approached [s]
PLANNED = 0.92  # share of the lateral acceleration that the speed is planned for; the rest is for steering back
BRAKING = 0.6  # share of the comfortable braking that is planned with


def fastest_in(bend: np.ndarray, distance: np.ndarray, lateral: float, steepest: np.ndarray) -> np.ndarray:
    """Speed that curvatures along a path allow [m/s], (n, k).

    bend, distance : curvature [1/m] at distances [m], (n, k)
    lateral        : acceleration [m/s2]
    steepest       : change of the curvature that the steering follows [1/(m s)], (n,)
    """
    by_bend = np.sqrt(lateral / np.maximum(np.abs(bend), 1e-6))
    change = np.abs(np.diff(bend)) / np.maximum(np.diff(distance), 1e-3)
    by_change = steepest[:, None] / np.maximum(change, 1e-9)
    by_bend[:, :-1] = np.minimum(by_bend[:, :-1], by_change)
    by_bend[:, 1:] = np.minimum(by_bend[:, 1:], by_change)
    return by_bend


def acceleration_to(
    fastest: np.ndarray, distance: np.ndarray, speed: np.ndarray, braking: float, reaction
) -> np.ndarray:
    """Greatest acceleration that keeps to allowed speeds ahead [m/s2], (n,).

    fastest, distance : allowed speeds [m/s] at distances [m], (n, k)
    braking           : comfortable one [m/s2]
    reaction          : time until a command to brake has its effect [s], (n,)

    With the planned braking b, the speed u = sqrt(v_j^2 + 2 b s) is allowed at a distance s before the speed v_j, and
    falls at b v / u. It is approached with the time constant SETTLING: a = (u - v) / SETTLING - b v / u; but v_j itself
    may be approached anywhere, a = (v_j - v) / SETTLING.
    """
    planned, v = BRAKING * braking, speed[:, None]
    left = np.maximum(distance - v * np.reshape(reaction, (-1, 1)), 0.0)
    allowed = np.sqrt(fastest**2 + 2 * planned * left)
    slowing = (allowed - v) / SETTLING - planned * v / np.maximum(allowed, 1e-3)
    return np.maximum(slowing, (fastest - v) / SETTLING).min(axis=1)


def acceleration_along(ahead: Ahead, curvature: np.ndarray, speed: np.ndarray, limits: tuple) -> np.ndarray:
    """Greatest acceleration in the bends of a trail, and in the one that is steered now [m/s2], (n,).

    curvature : that is steered, before it is limited [1/m], (n,)
    limits    : lateral acceleration [m/s2], comfortable braking [m/s2], reaction [s] (n,), change of curvature (n,)
    """
    lateral, braking, reaction, steepest = limits
    planned = PLANNED * lateral
    fastest = fastest_in(ahead.bend, ahead.distance, planned, steepest)
    here = np.sqrt(planned / np.maximum(np.abs(curvature), 1e-6))
    return np.minimum(acceleration_to(fastest, ahead.distance, speed, braking, reaction), (here - speed) / SETTLING)
