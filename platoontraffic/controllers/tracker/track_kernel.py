"""Correction by the extended Kalman filter of `track`, one predecessor after the other, compiled.

Measured are centre and heading of the predecessor's rear, z = h(x) + v:

    h(x) = (x - OVERHANG cos heading, y - OVERHANG sin heading, heading),      v ~ N(0, R)

with R diagonal along and across the measured heading. With H = dh/dx and the innovation z - h(x),

    S = H P H' + R,  K = P H' / S,  x <- x + K (z - h(x)),  P <- P - K S K',  nis = (z - h(x))' S^-1 (z - h(x))

(Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation", 2001). A group of
returns is taken for the predecessor only if its nis is within a gate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.tracker import prediction_kernel, rear_kernel, records
from platoontraffic.controllers.tracker.prediction_kernel import SIDEWAYS
from platoontraffic.controllers.tracker.rear_kernel import (
    NARROWEST,
    WIDEST,
    WIDTH,
    find_rear,
    group_of,
    no_rear,
    remainder,
)
from platoontraffic.controllers.tracker.records import (
    ACCELERATION,
    CUTS_IN,
    HEADING,
    HIDDEN,
    OVERHANG,
    SPEED,
    UNKNOWN_SPEED,
    X,
    Y,
)
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import nearest
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, prediction_kernel.__file__, rear_kernel.__file__, records.__file__, polyline.__file__)

SURPRISE = 11.3  # nis that chance exceeds once in a hundred (chi-squared, 3 degrees of freedom)
GATE = 30.0  # greatest nis of what is taken for the predecessor; chance exceeds 16 once in a thousand
BRAKE_STEP = 5.0  # standard deviation of the acceleration at the begin of a manoeuvre [m/s2]
BEND_STEP = 0.05  # standard deviation of the curvature there [1/m]
HARD, FAST = 5.0, 10.0  # braking that counts as hard [m/s2], and speed above which that matters at once [m/s]
HARDEST, STRONGEST = 12.0, 6.0  # greatest braking and acceleration of any vehicle [m/s2]
NEAR = 6.0  # greatest distance of a group from the predicted rear [m]
BETWEEN = 2.0  # greatest distance of a rear beyond the obstacle that hides the predecessor, for it to be that one's [m]
LANE = 1.5  # half the width in which a new predecessor, and its axle, are looked for [m]
OBLIQUE = math.radians(35)  # greatest angle of a new predecessor to the route
NEW = 0.1, 0.05, 0.05  # standard deviations of a new track: of the axle's place [m], heading [rad], curvature [1/m]
UNKNOWN_SHARE, STEADY = 0.5, 2.0  # of its speed, taken for the own: beyond UNKNOWN_SPEED, share of that; [m/s2]
MEASURED = 1.0, 5.0  # of its speed [m/s] and acceleration [m/s2], if they are known from free distances
LEARNING = 0.1  # share of a seen width by which the known one is corrected


class Pose(NamedTuple):
    """The laser in the odometry frame."""

    x: float
    y: float
    yaw: float
    cos: float  # of yaw
    sin: float


@compiled
def correct(track, sighting, odometry, laser, route, groups, ranges, hiding, dt):
    """Correct all rows in place by the groups of returns in their scans.

    track    : `track.Track`; rows of NaN begin with the nearest rear on the path ahead
    route    : as in `track.Track.corrected`
    hiding   : `records.Hiding`; its rear becomes the predecessor's, if it hides the predecessor
    sighting : `records.Sighting`, filled in where a predecessor is seen
    ranges   : (n, k) [m]; NaN: lost
    """
    state, cov = np.empty(6), np.empty((6, 6))
    for i in range(len(track.mean)):
        pose, own_speed = _pose(odometry, laser, i), odometry.speed[i]
        turning = odometry.yaw_rate[i] / own_speed if own_speed > 1.0 else 0.0  # curvature of the own path [1/m]
        if math.isnan(track.mean[i, X]):
            found, rear = _first_rear(i, laser, route, turning, groups, ranges)
            if found >= 0:
                sigma = UNKNOWN_SPEED + UNKNOWN_SHARE * own_speed, STEADY
                _begin(i, track, rear, pose, turning, (own_speed, 0.0), sigma)
        else:
            found, rear, nis, last = _best_rear(i, track, pose, laser, groups, ranges, dt, state, cov)
            if found >= 0:
                if last != found:
                    _fit(track.mean[i], track.cov[i], rear, pose, dt, state, cov)
                track.nis[i] = nis
                _copy(state, cov, track.mean[i], track.cov[i])
                track.mean[i, SPEED] = max(track.mean[i, SPEED], 0.0)
            elif track.blind[i] > HIDDEN and _hides(hiding, i, own_speed):
                found, rear = _first_rear(i, laser, route, turning, groups, ranges)
                if found >= 0 and math.hypot(rear.x, rear.y) > hiding.distance[i] + BETWEEN:
                    found = -1
                if found >= 0:
                    _begin(i, track, rear, pose, turning, (hiding.speed[i], hiding.acceleration[i]), MEASURED)
        if found < 0:
            continue
        if not math.isnan(rear.width):
            track.width[i] += LEARNING * (min(max(rear.width, NARROWEST), WIDEST) - track.width[i])
        track.blind[i] = 0.0
        sighting.rear[i, 0], sighting.rear[i, 1] = math.hypot(rear.x, rear.y), math.atan2(rear.y, rear.x)
        sighting.beams[i, 0], sighting.beams[i, 1] = groups.first[found], groups.last[found]


@compiled
def _hides(hiding, i, own_speed):
    """There is an obstacle on the strip, and it drives ahead."""
    return math.isfinite(hiding.distance[i]) and hiding.speed[i] > CUTS_IN * own_speed  # False where it is not known


@compiled
def _pose(odometry, laser, i):
    cos, sin = math.cos(odometry.heading[i]), math.sin(odometry.heading[i])
    x = odometry.x[i] + laser.forward[i] * cos - laser.left * sin
    y = odometry.y[i] + laser.forward[i] * sin + laser.left * cos
    yaw = odometry.heading[i] + laser.yaw
    return Pose(x, y, yaw, math.cos(yaw), math.sin(yaw))


# ---- a known predecessor


@compiled
def _best_rear(i, track, pose, laser, groups, ranges, dt, state, cov):
    """The group, its rear and its nis, with the least nis within the gate; -1 if none is.

    returns: also the last group that was fitted; state and cov, filled in, are by that one
    """
    mean = track.mean[i]
    back_x, back_y = mean[X] - OVERHANG * math.cos(mean[HEADING]), mean[Y] - OVERHANG * math.sin(mean[HEADING])
    least, found, best, last = GATE, -1, no_rear(), -1
    for k in range(groups.offset[i], groups.offset[i + 1]):
        group = group_of(groups, k)
        middle_x, middle_y = (group.x1 + group.x2) / 2, (group.y1 + group.y2) / 2
        dx = pose.x + middle_x * pose.cos - middle_y * pose.sin - back_x
        dy = pose.y + middle_x * pose.sin + middle_y * pose.cos - back_y
        if dx * dx + dy * dy > NEAR * NEAR:
            continue
        rear = find_rear(group, mean[HEADING] - pose.yaw, track.width[i], ranges[i], laser)
        if math.isnan(rear.x):
            continue
        nis, last = _fit(mean, track.cov[i], rear, pose, dt, state, cov), k
        if nis < least:
            least, found, best = nis, k, rear
    return found, best, least, last


@compiled
def _fit(mean, before, rear, pose, dt, state, cov):
    """Correct a track by a rear; returns the nis, inf if the rear asks for more than a vehicle can do.

    A nis too great for chance is taken for a manoeuvre that has just begun: a step of acceleration and of curvature
    (adjustable process noise: Bar-Shalom et al.). A correction beyond what vehicles can do is tried
    again with a manoeuvre that began a scan earlier, unnoticed, if it is then hard braking at speed, the only one that
    matters at once.

    mean, before : state and covariance, (6,) and (6, 6)
    state, cov   : the corrected ones, filled in
    """
    _copy(mean, before, state, cov)
    nis = _update(state, cov, rear, pose)
    if nis < SURPRISE:
        return nis
    for scans in range(1, 3 if mean[SPEED] > FAST else 2):
        _copy(mean, before, state, cov)
        _add_manoeuvre(mean, scans * dt, cov)
        nis = _update(state, cov, rear, pose)
        if -HARDEST < state[ACCELERATION] < (STRONGEST if scans == 1 else -HARD):
            return nis
    return math.inf


@compiled
def _copy(mean, cov, to_mean, to_cov):
    """Number by number: an assignment of arrays is compiled with texts of its errors, for seconds."""
    for a in range(6):
        to_mean[a] = mean[a]
        for b in range(6):
            to_cov[a, b] = cov[a, b]


@compiled
def _add_manoeuvre(mean, since, cov):
    """P <- P + BRAKE_STEP^2 a a' + turned^2 c c': effects on the state of unit steps, `since` ago [s], of acceleration,

    a = (cos t^2 / 2, sin t^2 / 2, 0, t, 1, 0), and of curvature, c = (-sin s^2 / 2, cos s^2 / 2, s, 0, 0, 1).
    """
    cos, sin = math.cos(mean[HEADING]), math.sin(mean[HEADING])
    turned = min(BEND_STEP, SIDEWAYS / max(mean[SPEED], 1.0) ** 2)
    s = mean[SPEED] * since
    _add_outer(cov, (cos * since * since / 2, sin * since * since / 2, 0.0, since, 1.0, 0.0), BRAKE_STEP**2)
    _add_outer(cov, (-sin * s * s / 2, cos * s * s / 2, s, 0.0, 0.0, 1.0), turned**2)


@compiled
def _add_outer(matrix, vector, factor):
    for a in range(6):
        for b in range(6):
            matrix[a, b] += vector[a] * vector[b] * factor


@compiled
def _update(state, cov, rear, pose):
    """Correct a state (6,) and its covariance in place by a rear; returns the nis.

    R is diagonal, so the three measurements are taken one by one (D. Simon, "Optimal state estimation", 2006), all
    linearized where the state was predicted.
    """
    heading = rear.heading + pose.yaw
    cos, sin = math.cos(heading), math.sin(heading)
    x = pose.x + rear.x * pose.cos - rear.y * pose.sin
    y = pose.y + rear.x * pose.sin + rear.y * pose.cos
    cos_s, sin_s = math.cos(state[HEADING]), math.sin(state[HEADING])
    dx, dy = x - (state[X] - OVERHANG * cos_s), y - (state[Y] - OVERHANG * sin_s)
    innovation = (dx * cos + dy * sin, dy * cos - dx * sin, remainder(heading - state[HEADING], 2 * math.pi))
    variance = (rear.along, rear.across, rear.turned)
    h = (
        (cos, sin, OVERHANG * (sin_s * cos - cos_s * sin)),
        (-sin, cos, -OVERHANG * (sin_s * sin + cos_s * cos)),
        (0.0, 0.0, 1.0),
    )  # H, of which the columns of speed, acceleration and curvature are 0
    change, gain, nis = np.zeros(6), np.empty(6), 0.0
    for j in range(3):
        for a in range(6):
            gain[a] = cov[a, 0] * h[j][0] + cov[a, 1] * h[j][1] + cov[a, 2] * h[j][2]
        s = h[j][0] * gain[0] + h[j][1] * gain[1] + h[j][2] * gain[2] + variance[j]
        left = innovation[j] - h[j][0] * change[0] - h[j][1] * change[1] - h[j][2] * change[2]
        nis += left * left / s
        for a in range(6):
            change[a] += gain[a] / s * left
            for b in range(6):
                cov[a, b] -= gain[a] * gain[b] / s
    state += change
    return nis


# ---- a new predecessor


@compiled
def _first_rear(i, laser, route, curvature, groups, ranges):
    """The group, and its rear, that is nearest on the path ahead and seen whole; -1 if none is."""
    least, found, first = math.inf, -1, no_rear()
    points = route[i]
    forward, left = laser.forward[i], laser.left
    for k in range(groups.offset[i], groups.offset[i + 1]):
        group = group_of(groups, k)
        if len(points):
            middle_x, middle_y = (group.x1 + group.x2) / 2, (group.y1 + group.y2) / 2
            expected = _beside_route(points, middle_x + forward, middle_y + left)[2]
        else:
            expected = 2 * math.atan(curvature * (group.x1 + group.x2) / 2)  # tangent to the arc there
        rear = find_rear(group, expected, WIDTH, ranges[i], laser)
        if math.isnan(rear.width):
            continue
        if len(points):
            distance = _along_route(points, rear, forward, left)
        else:
            distance = _along_arc(curvature, rear, forward, left)
        if distance < least:
            least, found, first = distance, k, rear
    return found, first


@compiled
def _along_route(points, rear, forward, left):
    """Distance of a rear along the route; inf if it is behind, or crosses the route, or if it or its axle is off the
    lane. With its axle there it would soon be dropped, as a vehicle that leaves the route."""
    x, y = rear.x + forward, rear.y + left
    station, offset, heading = _beside_route(points, x, y)
    if station <= 0 or abs(offset) > LANE or abs(remainder(rear.heading - heading, 2 * math.pi)) > OBLIQUE:
        return math.inf
    axle_x, axle_y = x + OVERHANG * math.cos(rear.heading), y + OVERHANG * math.sin(rear.heading)
    return math.inf if abs(_beside_route(points, axle_x, axle_y)[1]) > LANE else station


@compiled
def _along_arc(curvature, rear, forward, left):
    """Distance of a rear ahead; inf if it is behind or off the arc."""
    x, y = rear.x + forward, rear.y + left
    offset = y - curvature * (x * x + y * y) / 2
    return math.inf if x <= 0 or abs(offset) > LANE + 0.05 * x else x


@compiled
def _begin(i, track, rear, pose, curvature, motion, sigma):
    """A new track at a rear; its speed and acceleration, and their standard deviations, are given."""
    heading = rear.heading + pose.yaw
    x = pose.x + rear.x * pose.cos - rear.y * pose.sin + OVERHANG * math.cos(heading)
    y = pose.y + rear.x * pose.sin + rear.y * pose.cos + OVERHANG * math.sin(heading)
    mean = (x, y, heading, motion[0], motion[1], curvature)
    sigmas = (NEW[0], NEW[0], NEW[1], sigma[0], sigma[1], NEW[2])
    track.cov[i] = 0.0
    for a in range(6):
        track.mean[i, a] = mean[a]
        track.cov[i, a, a] = sigmas[a] ** 2
    track.width[i] = rear.width


# ---- geometry


@compiled
def _beside_route(points, x, y):
    """Station of the nearest place on a route (k, 2), offset of a point from it to the left, and the heading there.

    The route is straight before its first point, where stations are negative, and beyond its last.
    """
    k, share, squared, side = nearest(points, 0, len(points) - 1, x, y, -math.inf, math.inf)
    station = 0.0
    for j in range(k):
        station += math.hypot(points[j + 1, 0] - points[j, 0], points[j + 1, 1] - points[j, 1])
    step_x, step_y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
    station += share * math.hypot(step_x, step_y)
    return station, math.copysign(math.sqrt(squared), side), math.atan2(step_y, step_x)


@compiled
def offsets(points, axles, odometry, offset):
    """Fill in the distances of places from paths [m], (n,).

    points   : of the paths, as seen from the own driven axles [m], (n, k, 2)
    axles    : the places, in the odometry frames [m], (n, 2); rows of NaN are left out
    odometry : own driven axles, `track.Odometry`
    """
    for i in range(len(offset)):
        if math.isnan(axles[i, 0]):
            continue
        cos, sin = math.cos(odometry.heading[i]), math.sin(odometry.heading[i])
        dx, dy = axles[i, 0] - odometry.x[i], axles[i, 1] - odometry.y[i]
        offset[i] = abs(_beside_route(points[i], dx * cos + dy * sin, dy * cos - dx * sin)[1])
