"""Speed in the bends of a trail, compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

SETTLING = 0.6  # time constant with which an allowed speed is approached [s]
PLANNED = 0.92  # share of the lateral acceleration that the speed is planned for; the rest is for steering back
BRAKING = 0.6  # share of the comfortable braking that is planned with


@compiled
def acceleration_in(curvature, speed, gains):
    """Greatest acceleration in a bend that is steered now, by its curvature before it is limited [m/s2]."""
    lateral = PLANNED * gains.lateral_acceleration
    return (math.sqrt(lateral / np.maximum(abs(curvature), 1e-6)) - speed) / SETTLING


@compiled
def acceleration_along(bend, distance, speed, reaction, steepest, gains):
    """Greatest acceleration in the bends of a trail [m/s2].

    bend, distance : curvature [1/m] at distances [m] along the trail, (k,)
    reaction       : time until a command to brake has its effect [s]
    steepest       : change of the curvature that the steering follows [1/(m s)]
    gains          : lateral_acceleration, and the comfortable braking [m/s2]

    With the planned braking b, the speed u = sqrt(v_j^2 + 2 b s) is allowed at a distance s before the speed v_j, and
    falls at b v / u. It is approached with the time constant SETTLING: a = (u - v) / SETTLING - b v / u; but v_j itself
    may be approached anywhere, a = (v_j - v) / SETTLING.
    """
    acceleration, lateral, braking = math.inf, PLANNED * gains.lateral_acceleration, BRAKING * gains.braking
    before = math.inf  # speed by the change of curvature from the place before
    for k in range(len(bend)):
        fastest, after = math.sqrt(lateral / np.maximum(abs(bend[k]), 1e-6)), math.inf
        if k + 1 < len(bend):
            change = abs(bend[k + 1] - bend[k]) / np.maximum(distance[k + 1] - distance[k], 1e-3)
            after = steepest / np.maximum(change, 1e-9)
        fastest, before = np.minimum(np.minimum(fastest, after), before), after
        left = np.maximum(distance[k] - speed * reaction, 0.0)
        allowed = math.sqrt(fastest**2 + 2 * braking * left)
        slowing = (allowed - speed) / SETTLING - braking * speed / np.maximum(allowed, 1e-3)
        acceleration = np.minimum(acceleration, np.maximum(slowing, (fastest - speed) / SETTLING))
    return acceleration
