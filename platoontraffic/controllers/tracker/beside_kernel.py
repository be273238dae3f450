"""Places beside the route, for `controllers.beside`: of the predecessor, and of returns on a strip. Compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers.tracker import records
from platoontraffic.controllers.tracker.records import X, Y
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import nearest, project
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, records.__file__, polyline.__file__)

DETOUR, NEAR = 1.5, 20.0  # a place is looked for on the route up to DETOUR times its distance, and NEAR [m]
NEXT = 2.0  # a place of a trail is looked for up to that far from the next one [m]


@compiled
def find_places(points, distance, mean, odometry, station, offset, heading):
    """Fill in distance along the route, offset to its left and heading of the route where the predecessors are, (n,).

    points, distance : of the routes as seen from the own driven axles (n, k, 2), and along them (n, k) [m]
    mean             : of the tracks, (n, 6); rows of NaN are left out
    """
    for i in range(len(station)):
        if math.isnan(mean[i, X]):
            continue
        cos, sin = math.cos(odometry.heading[i]), math.sin(odometry.heading[i])
        dx, dy = mean[i, X] - odometry.x[i], mean[i, Y] - odometry.y[i]
        x, y = dx * cos + dy * sin, dy * cos - dx * sin
        k, share, away, side = _place(points[i], distance[i], x, y)
        step_x, step_y = points[i, k + 1, 0] - points[i, k, 0], points[i, k + 1, 1] - points[i, k, 1]
        station[i] = distance[i, k] + share * (distance[i, k + 1] - distance[i, k])
        offset[i] = math.copysign(math.sqrt(away), side)
        heading[i] = math.atan2(step_y, step_x)


@compiled
def _place(points, distance, x, y):
    """The nearest place of the route to a point, as of `nearest`, where it has not come back from elsewhere."""
    limit, last = DETOUR * math.hypot(x, y) + NEAR, 1
    while last + 1 < len(distance) and distance[last] < limit:
        last += 1
    return nearest(points, 0, last, x, y, -math.inf, math.inf)


@compiled
def find_trails(given, trail, odometry, station, rows, soon, trails):
    """Fill in `beside.Trails`.

    station : of the predecessors, as of `find_places`
    rows    : for which it is wanted, bool (n,)
    soon    : distance ahead of `trails.soon` [m], (n,)
    """
    for i in range(len(station)):
        trails.least[i] = trails.greatest[i] = trails.soon[i] = math.nan
        if not rows[i]:
            continue
        points, distance, places = given.points[i], given.distance[i], trail.points[i]
        cos, sin, along = math.cos(odometry.heading[i]), math.sin(odometry.heading[i]), station[i]
        for k in range(trail.size[i] - 1, -1, -1):
            dx, dy = places[k, 0] - odometry.x[i], places[k, 1] - odometry.y[i]
            along, offset = project(points, distance, dx * cos + dy * sin, dy * cos - dx * sin, along, NEXT)
            if along <= 0.0:
                break
            offset += given.aside[i, max(np.searchsorted(distance, along, side="right") - 1, 0)]
            trails.least[i], trails.greatest[i] = np.fmin(trails.least[i], offset), np.fmax(trails.greatest[i], offset)
            if along >= soon[i] or math.isnan(trails.soon[i]):
                trails.soon[i] = offset


@compiled
def first_returns(points, distance, aside, curvature, strip, laser, ranges, directions, ahead, behind):
    """Fill in the distances from the bumpers to the first returns on strips beside the own bodies [m], (n,).

    Behind the own axle the road is an arc of the route's curvature beside it.

    aside, curvature : of the routes, (n, k)
    strip            : side (0: none), lane offset from which the strip is measured, its inner and outer distance, how
                       far ahead it ends, own rear and front bumper ahead of the axle, arrays (n,)
    laser            : ahead and left of the own axle, (n, 2) [m]
    ranges           : (n, m) [m]; directions (2, m) of the beams, in the vehicle's frame
    """
    sides, base, inner, outer, reach, rear, front = strip
    for i in range(len(ahead)):
        if sides[i] == 0:
            continue
        first_x, first_y = points[i, 0, 0], points[i, 0, 1]
        step_x, step_y = points[i, 1, 0] - first_x, points[i, 1, 1] - first_y
        size = math.hypot(step_x, step_y)
        cos, sin, bend = step_x / size, step_y / size, curvature[i, 0]
        middle = (rear[i] + front[i]) / 2
        for j in range(ranges.shape[1]):
            far = ranges[i, j]
            if not 0 < far < math.inf:
                continue
            x, y = laser[i, 0] + far * directions[0, j], laser[i, 1] + far * directions[1, j]
            along = (x - first_x) * cos + (y - first_y) * sin
            if along < 0:
                offset = (y - first_y) * cos - (x - first_x) * sin - bend * along * along / 2
                offset += aside[i, 0]
            else:
                k, share, away, left = _place(points[i], distance[i], x, y)
                along = distance[i, k] + share * (distance[i, k + 1] - distance[i, k])
                offset = math.copysign(math.sqrt(away), left) + aside[i, k]
            beyond = sides[i] * (offset - base[i])
            if not inner[i] < beyond < outer[i] or along > reach[i]:
                continue
            if along >= middle:
                ahead[i] = min(ahead[i], along - front[i])
            else:
                behind[i] = min(behind[i], rear[i] - along)
