"""First return on the strip along a route, compiled; rows (n,) of vehicles, in frames of their driven axles."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def first_on_strip(ranges, beams, laser, aside, strip, front, free):
    """Fill in the distance along the route from each front bumper to the first return on the strip [m], (n,).

    ranges       : inf or NaN for no return, (n, k)
    beams        : directions, x and y, (2, k)
    laser, aside : place of the laser, x (n,) and y
    strip        : points (n, m, 2) of the routes, their stations (n, m), half the width (n,)
    front        : front bumpers, x (n,)
    free         : greatest distance of interest, then the result
    """
    points, distance, half_width = strip
    for i in range(len(free)):
        low, high = points[i, :, 1].min() - half_width[i], points[i, :, 1].max() + half_width[i]
        for k in range(ranges.shape[1]):
            if not ranges[i, k] < np.inf:
                continue
            x, y = laser[i] + ranges[i, k] * beams[0, k], aside + ranges[i, k] * beams[1, k]
            if low < y < high and x > 0:
                station, offset = project(points[i], distance[i], x, y)
                if offset < half_width[i] and front[i] < station < front[i] + free[i]:
                    free[i] = station - front[i]


@compiled
def project(points, distance, x, y):
    """Station of the nearest place on a polyline (m, 2) with stations (m,), and the distance from it."""
    nearest, station = np.inf, 0.0
    for j in range(len(points) - 1):
        step_x, step_y = points[j + 1, 0] - points[j, 0], points[j + 1, 1] - points[j, 1]
        from_x, from_y = x - points[j, 0], y - points[j, 1]
        size = max(step_x * step_x + step_y * step_y, 1e-12)
        along = min(max((from_x * step_x + from_y * step_y) / size, 0.0), 1.0)
        away_x, away_y = from_x - along * step_x, from_y - along * step_y
        away = away_x * away_x + away_y * away_y
        if away < nearest:
            nearest, station = away, distance[j] + along * (distance[j + 1] - distance[j])
    return station, math.sqrt(nearest)
