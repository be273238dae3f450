"""Prediction by the extended Kalman filter of `track`, one predecessor after the other, compiled.

State x = (x, y, heading, speed, acceleration, curvature). The mean moves by the motion model f; the covariance P is
replaced by F P F' + Q with F = df/dx (Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking
and navigation", 2001).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.tracker import records
from platoontraffic.controllers.tracker.records import ACCELERATION, CURVATURE, HEADING, SPEED, X, Y
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, records.__file__)

# Changes of a driver's motion: standard deviations of random walks after one second.
JERK = 2.0  # of acceleration [m/s2]
EASING = 2.0  # time constant with which acceleration is expected to fade [s]
TURNING = 0.08  # of curvature [1/m]: steering of 0.2 rad in a second, at a wheelbase of 2.7 m
SIDEWAYS = 5.0  # of lateral acceleration [m/s2], which bounds the change of curvature at speed
DRIFT, SLIDING = 0.001, 0.01  # of the own odometry [rad, m]: 0.1 degrees, and noise of the speed
SLIP = 0.02  # lateral displacement of the axle for each metre driven [m]


class Arc(NamedTuple):
    """Motion of one predecessor in a time step."""

    length: float  # distance driven [m]
    cos: float  # of the heading halfway
    sin: float
    ease: float  # factor by which the acceleration fades
    change: float  # speed gained by an acceleration of 1 m/s2 [s]
    gain: float  # distance gained by it [s2]


@compiled
def predict(mean, cov, odometry, dt):
    """Advance all rows in place by dt [s].

    mean, cov : (n, 6), (n, 6, 6); rows of NaN stay
    odometry  : own driven axles after dt, `track.Odometry`
    """
    transition, noise, half = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for i in range(len(mean)):
        state = mean[i]
        if math.isnan(state[X]):
            continue
        arc = _arc(state, dt)
        _transition(state, arc, dt, transition)
        noise[:] = 0
        _add_jerk(arc, dt, noise)
        _add_turning(state, arc, dt, noise)
        _add_drift(state[X] - odometry.x[i], state[Y] - odometry.y[i], dt, noise)
        _advance(state, arc)
        _propagate(cov[i], transition, noise, half)


@compiled
def _arc(state, dt):
    """The step's arc: acceleration fades as exp(-t / EASING); no car rolls back."""
    ease = math.exp(-dt / EASING)
    change = EASING * (1 - ease)
    gain = EASING * (dt - change)
    length = state[SPEED] * dt + gain * state[ACCELERATION]
    if state[SPEED] + change * state[ACCELERATION] < 0:
        length = max(state[SPEED], 0.0) * dt / 2
    middle = state[HEADING] + state[CURVATURE] * length / 2
    return Arc(length, math.cos(middle), math.sin(middle), ease, change, gain)


@compiled
def _advance(state, arc):
    """f: along the chord of the arc; speed and acceleration by the fading acceleration."""
    state[X] += arc.length * arc.cos
    state[Y] += arc.length * arc.sin
    state[HEADING] += state[CURVATURE] * arc.length
    state[SPEED] = max(state[SPEED] + arc.change * state[ACCELERATION], 0.0)
    state[ACCELERATION] *= arc.ease
    if state[SPEED] == 0.0 and state[ACCELERATION] < 0:
        state[ACCELERATION] = 0.0


@compiled
def _transition(state, arc, dt, transition):
    """F = df/dx, (6, 6), filled in; the curvature also turns the chord."""
    cos, sin, length, curvature = arc.cos, arc.sin, arc.length, state[CURVATURE]
    along_x, along_y = cos - curvature * length / 2 * sin, sin + curvature * length / 2 * cos
    transition[:] = 0.0
    for a in range(6):
        transition[a, a] = 1.0
    transition[X, HEADING], transition[Y, HEADING] = -length * sin, length * cos
    transition[X, SPEED], transition[Y, SPEED], transition[HEADING, SPEED] = dt * along_x, dt * along_y, dt * curvature
    transition[X, ACCELERATION], transition[Y, ACCELERATION] = arc.gain * along_x, arc.gain * along_y
    transition[HEADING, ACCELERATION] = arc.gain * curvature
    transition[SPEED, ACCELERATION], transition[ACCELERATION, ACCELERATION] = arc.change, arc.ease
    transition[X, CURVATURE], transition[Y, CURVATURE] = -length * length / 2 * sin, length * length / 2 * cos
    transition[HEADING, CURVATURE] = length


@compiled
def _walk(dt):
    """Covariance of what a random walk w of unit rate integrates to in dt: entries of the symmetric

        | dt^5/20  dt^4/8  dt^3/6 |
        | .        dt^3/3  dt^2/2 |    for (double integral of w, integral of w, w),
        | .        .       dt     |

    row by row (the continuous Wiener process acceleration model: Bar-Shalom et al.).
    """
    return dt**5 / 20, dt**4 / 8, dt**3 / 6, dt**3 / 3, dt**2 / 2, dt


@compiled
def _add_jerk(arc, dt, noise):
    """Q of acceleration: the walk's matrix times JERK^2 for (distance along the heading, speed, acceleration).

    Only the upper half of Q is filled in, here and below.
    """
    cos, sin = arc.cos, arc.sin
    walk = _walk(dt)
    noise[X, X], noise[X, Y], noise[Y, Y] = cos * cos * walk[0], cos * sin * walk[0], sin * sin * walk[0]
    noise[X, SPEED], noise[Y, SPEED] = cos * walk[1], sin * walk[1]
    noise[X, ACCELERATION], noise[Y, ACCELERATION] = cos * walk[2], sin * walk[2]
    noise[SPEED, SPEED], noise[SPEED, ACCELERATION], noise[ACCELERATION, ACCELERATION] = walk[3], walk[4], walk[5]
    noise *= JERK * JERK


@compiled
def _add_turning(state, arc, dt, noise):
    """Q of curvature: for (distance across the heading, heading, curvature) at speed v, with G = diag(v^2, v, 1),

    Q = turning^2 G (the walk's matrix) G,      and SLIP^2 times the arc's length across the heading.
    """
    cos, sin = arc.cos, arc.sin
    walk = _walk(dt)
    fast = max(abs(state[SPEED]), 1.0)
    turning = min(TURNING, SIDEWAYS / (fast * fast)) ** 2
    v = max(abs(arc.length) / dt, 0.0)
    across = walk[0] * v**4 * turning + (SLIP * SLIP) * abs(arc.length)
    noise[X, X] += sin * sin * across
    noise[X, Y] -= cos * sin * across
    noise[Y, Y] += cos * cos * across
    noise[X, HEADING] -= sin * walk[1] * v**3 * turning
    noise[Y, HEADING] += cos * walk[1] * v**3 * turning
    noise[X, CURVATURE] -= sin * walk[2] * v**2 * turning
    noise[Y, CURVATURE] += cos * walk[2] * v**2 * turning
    noise[HEADING, HEADING] += walk[3] * v * v * turning
    noise[HEADING, CURVATURE] += walk[4] * v * turning
    noise[CURVATURE, CURVATURE] += walk[5] * turning


@compiled
def _add_drift(away_x, away_y, dt, noise):
    """Q of the own odometry, whose frame turns and slides under a predecessor at (dx, dy) from the own axle:

    Q = DRIFT^2 dt g g' + SLIDING^2 dt diag(1, 1, 0),      g = (-dy, dx, 1) for (x, y, heading).
    """
    slides, turns = SLIDING * SLIDING * dt, DRIFT * DRIFT * dt
    noise[X, X] += slides + turns * away_y * away_y
    noise[X, Y] -= turns * away_x * away_y
    noise[Y, Y] += slides + turns * away_x * away_x
    noise[X, HEADING] -= turns * away_y
    noise[Y, HEADING] += turns * away_x
    noise[HEADING, HEADING] += turns


@compiled
def _propagate(cov, transition, noise, half):
    """P <- F P F' + Q in place, of which Q is its upper half; half: room for F P, (6, 6)."""
    for a in range(6):
        for b in range(6):
            half[a, b] = 0.0
            for c in range(6):
                half[a, b] += transition[a, c] * cov[c, b]
    for a in range(6):
        for b in range(a, 6):
            total = noise[a, b]
            for c in range(6):
                total += half[a, c] * transition[b, c]
            cov[a, b] = cov[b, a] = total
