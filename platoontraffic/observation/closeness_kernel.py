"""Distances between the outlines of bodies, which are boxes, and times until these touch. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.observation import nearby_kernel
from platoontraffic.observation.nearby_kernel import in_cells, nearby, sort_few

EQUAL = 1e-9  # distances that differ by less are equal [m]

compiled = compiler(__file__, nearby_kernel.__file__)


class Bodies(NamedTuple):
    """Of N bodies, arrays (N,)."""

    x: np.ndarray  # centre [m]
    y: np.ndarray
    cos: np.ndarray  # of the heading
    sin: np.ndarray
    half_length: np.ndarray  # [m]
    half_width: np.ndarray
    speed: np.ndarray  # forward [m/s]


@compiled
def look_around(bodies, n, reach, horizon, near, moving, clearance, closest, contact_in, pairs):
    """Fill in what is closest to each of the first n bodies, (n,); returns the number of pairs that are near.

    bodies     : the fields of Bodies, but whole lengths and widths
    reach      : distance between outlines up to which bodies are looked for [m]
    horizon    : time up to which touching is looked for [s]
    near       : distance below which a pair is near [m], (n,)
    moving     : least relative speed of a pair that is near [m/s]
    clearance  : distance to the closest body [m]; NaN: none within reach
    closest    : its row; -1: none
    contact_in : least time until it touches a body if all go straight on [s]; NaN: none within the horizon
    pairs      : the rows of pairs that are near, the lower first, (capacity, 2); those beyond it are left out
    """
    x, y, cos, sin, length, width, speed = bodies
    bodies = Bodies(x, y, cos, sin, length / 2, width / 2, speed)
    fastest, largest, count = 0.0, 0.0, 0
    radius = np.empty(len(bodies.x))
    for k in range(len(bodies.x)):
        radius[k] = math.hypot(bodies.half_length[k], bodies.half_width[k])
        fastest, largest = max(fastest, abs(bodies.speed[k])), max(largest, radius[k])
    cells = in_cells(bodies.x, bodies.y)
    rows = np.empty(len(radius), np.intp)
    for i in range(n):
        clearance[i], closest[i], contact_in[i] = math.nan, -1, math.nan
        least, soonest = reach, horizon
        widest = radius[i] + largest + max(reach, (abs(bodies.speed[i]) + fastest) * horizon)
        vx, vy = bodies.speed[i] * bodies.cos[i], bodies.speed[i] * bodies.sin[i]
        count_near = nearby(bodies.x[i], bodies.y[i], cells, widest, rows)
        sort_few(rows[:count_near])
        for k in rows[:count_near]:
            if k == i:
                continue
            dx, dy = bodies.x[k] - bodies.x[i], bodies.y[k] - bodies.y[i]
            far = max(least, near[i], (abs(bodies.speed[i]) + abs(bodies.speed[k])) * soonest)
            far += radius[i] + radius[k]
            if dx * dx + dy * dy > far * far:
                continue
            wx, wy = bodies.speed[k] * bodies.cos[k] - vx, bodies.speed[k] * bodies.sin[k] - vy
            apart, closing = math.sqrt(dx * dx + dy * dy) - radius[i] - radius[k], math.hypot(wx, wy)
            if apart < max(least, near[i]):
                away = _distance(bodies, i, k)
                if away < least - EQUAL or (away < least + EQUAL and _is_ahead(bodies, i, k, closest[i])):
                    closest[i] = k
                if away < least:
                    least, clearance[i] = away, away
                if away < near[i] and closing > moving and (k >= n or i < k) and count < len(pairs):
                    pairs[count] = i, k
                    count += 1
            nearing = dx * wx + dy * wy < 0.0
            if apart < closing * soonest and (nearing or apart < 0.0):
                # Long bodies may touch although their middles move apart; those that overlap and part do not anew.
                time = _touches_in(bodies, i, k, wx, wy)
                if time < soonest and (time > 0.0 or nearing):
                    soonest, contact_in[i] = time, time
    return count


@compiled
def look(bodies, number, close, reach, horizon, near, moving, clearance, closest, contact_in, pairs):
    """`look_around` of the members with these numbers, (n,), the first of the bodies.

    close : distance below which the outline of a body may touch [m]
    near  : of all members, (N,), as are clearance and contact_in

    returns: the number of pairs that are near, and whether a body is close
    """
    n = len(number)
    own_near, away, soon = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        own_near[i] = near[number[i]]
    count = look_around(bodies, n, reach, horizon, own_near, moving, away, closest, soon, pairs)
    any_close = False
    for i in range(n):
        clearance[number[i]], contact_in[number[i]] = away[i], soon[i]
        any_close |= away[i] < close
    return count, any_close


@compiled
def _is_ahead(bodies, i, k, other):
    """Whether body k is farther ahead of body i than another one: of bodies equally far, that is the closest."""
    cos, sin = bodies.cos[i], bodies.sin[i]
    return other >= 0 and (bodies.x[k] - bodies.x[other]) * cos + (bodies.y[k] - bodies.y[other]) * sin > 0.0


@compiled
def _distance(bodies, i, k):
    """Between two outlines [m]; 0 if they overlap."""
    if _touches_in(bodies, i, k, 0.0, 0.0) == 0.0:
        return 0.0
    # Of two convex shapes apart, the least distance is from a corner of one.
    return math.sqrt(min(_from_corners(bodies, i, k), _from_corners(bodies, k, i)))


@compiled
def _from_corners(bodies, i, k):
    """Least squared distance of the corners of body i from body k [m2]."""
    least = math.inf
    for a in (-1.0, 1.0):
        for b in (-1.0, 1.0):
            along, aside = a * bodies.half_length[i], b * bodies.half_width[i]
            x = bodies.x[i] + along * bodies.cos[i] - aside * bodies.sin[i] - bodies.x[k]
            y = bodies.y[i] + along * bodies.sin[i] + aside * bodies.cos[i] - bodies.y[k]
            ahead, left = x * bodies.cos[k] + y * bodies.sin[k], y * bodies.cos[k] - x * bodies.sin[k]
            out_x = max(abs(ahead) - bodies.half_length[k], 0.0)
            out_y = max(abs(left) - bodies.half_width[k], 0.0)
            least = min(least, out_x * out_x + out_y * out_y)
    return least


@compiled
def _touches_in(bodies, i, k, wx, wy):
    """Time until body k, which moves by (wx, wy) against body i, touches it [s]; inf: never, 0: they overlap.

    Two boxes overlap while their shadows on the axes of both do.
    """
    dx, dy = bodies.x[k] - bodies.x[i], bodies.y[k] - bodies.y[i]
    cross = abs(bodies.cos[i] * bodies.sin[k] - bodies.sin[i] * bodies.cos[k])
    along = abs(bodies.cos[i] * bodies.cos[k] + bodies.sin[i] * bodies.sin[k])
    begin, end = 0.0, math.inf
    for axis in range(4):
        own, other = (i, k) if axis < 2 else (k, i)
        if axis % 2 == 0:
            ax, ay = bodies.cos[own], bodies.sin[own]
            reach = bodies.half_length[own] + along * bodies.half_length[other] + cross * bodies.half_width[other]
        else:
            ax, ay = -bodies.sin[own], bodies.cos[own]
            reach = bodies.half_width[own] + cross * bodies.half_length[other] + along * bodies.half_width[other]
        apart, rate = dx * ax + dy * ay, wx * ax + wy * ay
        if rate == 0.0:
            if abs(apart) > reach:
                return math.inf
            continue
        first, last = (-reach - apart) / rate, (reach - apart) / rate
        if first > last:
            first, last = last, first
        begin, end = max(begin, first), min(end, last)
    return begin if begin <= end else math.inf
