"""Gaps and cross-track errors along the paths that predecessors drove; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.geometry import driven_paths, polyline
from platoontraffic.geometry.driven_paths import end_of, extend, located
from platoontraffic.lidar.compiled import compiler

DETOUR = 2.0  # longest path to a new predecessor, over the straight distance to it [1]
SIDEWAYS = 0.5  # greatest offset from a path that is prolonged backwards, over the distance from its begin [1]

compiled = compiler(__file__, driven_paths.__file__, polyline.__file__)


class Followers(NamedTuple):
    """The arrays (N,) of `gaps.Gaps`."""

    gap: np.ndarray
    cross_track: np.ndarray
    end: np.ndarray
    station: np.ndarray
    ahead: np.ndarray
    beside: np.ndarray
    passed: np.ndarray


@compiled
def locate(paths, state, number, predecessor, x, y, reversing, body, native):
    """Extend all paths to where the members are now; locate each follower on its predecessor's path: `Gaps.observe`.

    paths  : `DrivenPaths.arrays`
    state  : the fields of Followers
    number : of the members on the road, (n,), as the following ones
    body   : length, width, axle
    """
    state, (points, size, _) = Followers(*state), paths
    extend(paths, number, x, y, reversing)
    length, width, axle = body
    for i in range(len(number)):
        k, front = number[i], predecessor[i]
        state.gap[k], state.cross_track[k], state.beside[k] = math.nan, math.nan, False
        if front < 0:
            state.ahead[k], state.end[k], state.passed[k] = -1, end_of(points, size, k), False
            continue
        end, k_front = end_of(points, size, k), number[front]
        end_front, driven = end_of(points, size, k_front), end - state.end[k]
        near, reach = state.station[k], 2 * (length[i] + abs(driven))
        if state.ahead[k] != k_front:
            # On the path of a new predecessor it is searched behind that, not where the predecessor was laps ago.
            away = math.hypot(x[front] - x[i], y[front] - y[i])
            near, reach = end_front - away, DETOUR * (away + length[i])
        station, offset = located(points, size, k_front, x[i], y[i], near, reach)
        gap = (end_front - length[front] / 2 - axle[front]) - (station + length[i] / 2 - axle[i])
        state.beside[k] = beside = abs(offset) > (width[i] + width[front]) / 2
        # Behind the begin of its predecessor's path it may come round a corner.
        elsewhere = station < 0.0 and abs(offset) > width[i] + width[front] - SIDEWAYS * station
        # One that has passed its predecessor may be beside the path that this drives then, and behind its end.
        passes = gap < 0.0 and (beside or station > end_front)
        before = state.passed[k] and state.ahead[k] == k_front
        state.passed[k] = passes or (before and (beside or gap < 0.0))
        # SUMO's cars change lanes as they like.
        if not (elsewhere or state.passed[k] or (native[i] and (beside or gap < 0.0))):
            state.gap[k], state.cross_track[k] = gap, offset
        state.station[k] = state.station[k] + driven if math.isnan(station) else station
        state.ahead[k], state.end[k] = k_front, end
