"""The own lane, from the path driven last: a parabola, along which the lane goes on if nobody leaves it. Compiled."""

from __future__ import annotations

import math

from platoontraffic.controllers.tracker import trail_kernel
from platoontraffic.controllers.tracker.trail_kernel import BEHIND, _append, _append_arc, _nearest, _station
from platoontraffic.geometry import polyline
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, trail_kernel.__file__, polyline.__file__)

STRAIGHT = 0.06  # rms distance of the points from the parabola, up to which they are of one lane [m]
LEAST = 5  # points
SHORTEST = 0.6  # share of BEHIND that must have been driven


@compiled
def fit_lanes(trail, odometry, weight, bend, lane):
    """Fill in `beside.Lane` from the trail behind each own axle; known only where it fits.

    With the own axle as origin and x along the own heading, y = a + b x + c x^2 by least squares. Over so short a
    distance c is uncertain, so it is filtered, and a and b are those that fit best to the filtered one.

    weight : of the new c in the filter, (n,)
    bend   : 2 c, filtered [1/m], (n,); NaN: not known yet. Changed in place
    """
    for i in range(len(trail.size)):
        points, size = trail.points[i], trail.size[i]
        x, y, heading = odometry.x[i], odometry.y[i], odometry.heading[i]
        cos, sin = math.cos(heading), math.sin(heading)
        piece, share = _nearest(points, size, x, y)
        here = _station(points, piece, share)
        lane.station[i] = here
        lane.x[i], lane.y[i], lane.heading[i], lane.curvature[i], lane.known[i] = x, y, heading, 0.0, False
        s0 = s1 = s2 = s3 = s4 = t0 = t1 = t2 = tt = oldest = 0.0
        for k in range(piece + 1):
            if points[k, 2] < here - BEHIND:
                continue
            dx, dy = points[k, 0] - x, points[k, 1] - y
            u, v = (dx * cos + dy * sin) / BEHIND, dy * cos - dx * sin
            s0, s1, s2, s3, s4 = s0 + 1.0, s1 + u, s2 + u * u, s3 + u**3, s4 + u**4
            t0, t1, t2, tt = t0 + v, t1 + u * v, t2 + u * u * v, tt + v * v
            oldest = max(oldest, here - points[k, 2])
        if s0 < LEAST or oldest < SHORTEST * BEHIND:
            continue
        i00, i01, i02 = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
        i11, i12, i22 = s0 * s4 - s2 * s2, s1 * s2 - s0 * s3, s0 * s2 - s1 * s1
        scale = 1 / (s0 * i00 + s1 * i01 + s2 * i02)
        a = scale * (i00 * t0 + i01 * t1 + i02 * t2)
        b = scale * (i01 * t0 + i11 * t1 + i12 * t2)
        c = scale * (i02 * t0 + i12 * t1 + i22 * t2)
        if tt - a * t0 - b * t1 - c * t2 < s0 * STRAIGHT**2:
            new = 2 * c / BEHIND**2
            bend[i] = new if math.isnan(bend[i]) else bend[i] + weight[i] * (new - bend[i])
        if math.isnan(bend[i]):
            continue
        c = bend[i] * BEHIND**2 / 2
        r0, r1 = t0 - c * s2, t1 - c * s3
        rr = tt - 2 * c * t2 + c * c * s4
        a, b = (s2 * r0 - s1 * r1) / (s0 * s2 - s1 * s1), (s0 * r1 - s1 * r0) / (s0 * s2 - s1 * s1)
        lane.x[i], lane.y[i] = x - a * sin, y + a * cos
        lane.heading[i] = heading + math.atan(b / BEHIND)
        lane.curvature[i] = bend[i]
        lane.known[i] = rr - a * r0 - b * r1 < s0 * STRAIGHT**2


@compiled
def lay_on_lane(trail, lane, offset, rows):
    """Move the points of some trails from the anchor of their lanes on to an offset beside the lane, in place."""
    for i in rows:
        cos, sin = math.cos(lane.heading[i]), math.sin(lane.heading[i])
        for k in range(trail.size[i]):
            point = trail.points[i, k]
            if point[2] > lane.station[i]:
                dx, dy = point[0] - lane.x[i], point[1] - lane.y[i]
                u = dx * cos + dy * sin
                aside = dy * cos - dx * sin - lane.curvature[i] * u * u / 2 - offset[i]
                point[0] += aside * sin
                point[1] -= aside * cos


@compiled
def lay_across(trail, shift, begin, length, rows):
    """Move the points of some trails from a station on sideways, along a cosine of a length up to the shift."""
    for i in rows:
        size = trail.size[i]
        old_x, old_y = trail.points[i, 0, 0], trail.points[i, 0, 1]
        for k in range(1, size):
            point = trail.points[i, k]
            dx, dy = point[0] - old_x, point[1] - old_y
            old_x, old_y = point[0], point[1]
            away = math.hypot(dx, dy)
            aside = shift[i] * across((point[2] - begin[i]) / length[i])
            if away > 0:
                point[0] -= aside * dy / away
                point[1] += aside * dx / away


@compiled
def lay_anew(trail, odometry, axle, rows):
    """Lay some trails on an arc from the own axles to those of the predecessors, (n, 2), in place."""
    for i in rows:
        x, y, heading = odometry.x[i], odometry.y[i], odometry.heading[i]
        cos, sin = math.cos(heading), math.sin(heading)
        dx, dy = axle[i, 0] - x, axle[i, 1] - y
        trail.points[i, 0] = x - cos, y - sin, -1.0
        trail.points[i, 1] = x, y, 0.0
        trail.size[i] = 2
        _append_arc(trail.points[i], trail.size, i, (dx * cos + dy * sin, dy * cos - dx * sin), (cos, sin))
        _append(trail.points[i], trail.size, i, axle[i, 0], axle[i, 1])


@compiled
def across(share):
    """Share of a lane change after a share of its length."""
    return (1 - math.cos(math.pi * min(max(share, 0.0), 1.0))) / 2


@compiled
def stations(trail, odometry, here):
    """Fill in the stations beside the own axles, (n,)."""
    for i in range(len(here)):
        piece, share = _nearest(trail.points[i], trail.size[i], odometry.x[i], odometry.y[i])
        here[i] = _station(trail.points[i], piece, share)
