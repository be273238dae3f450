"""The first laser return on the strip along a route, compiled; rows (n,) of vehicles, frames of their driven axles."""

from __future__ import annotations

import numpy as np

from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import nearest
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, polyline.__file__)


@compiled
def first_on_strip(ranges, beams, laser, aside, strip, front, free, beam):
    """Fill in the distance along the route from each front bumper to the first return on the strip [m], (n,).

    ranges       : inf or NaN for no return [m], (n, k)
    beams        : unit vectors, x and y, (2, k)
    laser, aside : position of the laser, x (n,) and y [m]
    strip        : points of the routes (n, m, 2), their distances along them (n, m), half the width (n,) [m]
    front        : x of the front bumpers [m], (n,)
    free         : filled in; returns farther ahead than its values are left out
    beam         : filled in: the beam of that return, (n,); unchanged where there is none
    """
    points, distance, half_width = strip
    for i in range(len(free)):
        low, high = points[i, :, 1].min() - half_width[i], points[i, :, 1].max() + half_width[i]
        for k in range(ranges.shape[1]):
            if not ranges[i, k] < np.inf:
                continue
            x, y = laser[i] + ranges[i, k] * beams[0, k], aside + ranges[i, k] * beams[1, k]
            if low < y < high and x > 0:
                piece, share, squared, _ = nearest(points[i], 0, len(distance[i]) - 1, x, y, 0.0, 1.0)
                station = distance[i, piece] + share * (distance[i, piece + 1] - distance[i, piece])
                if np.sqrt(squared) < half_width[i] and front[i] < station < front[i] + free[i]:
                    free[i], beam[i] = station - front[i], k
