"""The nearest group of neighbouring returns of each scan, and the command towards its middle, compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers import printed
from platoontraffic.controllers.printed import arc_speed
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, printed.__file__)
_arc_speed = compiled(arc_speed)


@compiled
def nearest_groups(scans, range_min, group_step, ranges, ends):
    """Fill in ranges (n, k) and the first and last beam of the run of neighbouring returns around the nearest, (2, n).

    A lost return (NaN) ends no group: it takes the range of the return before it. A group ends on a sound one.

    scans      : ranges [m]; inf: no return, -inf: nearer than range_min, (n, k)
    group_step : greatest difference of neighbouring ranges in a group [m]
    ends       : -1 for a scan without a return
    """
    for i in range(len(scans)):
        ends[0, i], ends[1, i] = _nearest_group(scans[i], 0, scans.shape[1], range_min, group_step, ranges[i])


@compiled
def middles(scans, view, range_min, group_step, whole, fan, x, y):
    """Fill in the middle of the first and last return of those groups in the frame of `printed.points`, (n,).

    view  : first beam that counts, and the one after the last
    whole : only groups of which both ends are seen count
    fan   : angle of the first beam, and increment [rad]
    x, y  : [m]; NaN without a group
    """
    ranges = np.empty(scans.shape[1])
    for i in range(len(scans)):
        first, last = _nearest_group(scans[i], *view, range_min, group_step, ranges)
        if first < 0 or (whole and not (first > 0 and last < scans.shape[1] - 1)):
            x[i] = y[i] = np.nan
            continue
        begin, end = fan[0] + fan[1] * first + np.pi / 2, fan[0] + fan[1] * last + np.pi / 2
        x[i] = (ranges[first] * math.cos(begin) + ranges[last] * math.cos(end)) / 2
        y[i] = (ranges[first] * math.sin(begin) + ranges[last] * math.sin(end)) / 2


@compiled
def commands(distance, theta, stand_off, sufficient, heading_gain, speed, yaw_rate):
    """Fill in the command of `repaired.RepairedFollower` towards middles, which are polar; arrays (n,).

    sufficient : it stands where the middle is nearer [m]
    """
    for i in range(len(distance)):
        speed[i] = yaw_rate[i] = 0.0
        if distance[i] > sufficient:
            speed[i] = _arc_speed(max(distance[i] - stand_off, 0.0), theta[i])
            yaw_rate[i] = heading_gain * (theta[i] - np.pi / 2)


@compiled
def _nearest_group(scan, begin, stop, range_min, group_step, ranges):
    """Fill in the ranges of beams begin to stop - 1, (k,); first and last beam of the nearest group among them."""
    before, nearest, at = np.inf, np.inf, -1
    for k in range(begin, stop):
        value = np.float64(scan[k])
        if math.isnan(value):
            value = before
        elif value == -np.inf:
            value = range_min
        ranges[k] = before = value
        if value < nearest:
            nearest, at = value, k
    first = last = at
    if at >= 0:
        while first > begin and abs(ranges[first] - ranges[first - 1]) <= group_step:
            first -= 1
        while last + 1 < stop and abs(ranges[last + 1] - ranges[last]) <= group_step:
            last += 1
        while math.isnan(scan[last]):
            last -= 1
    return first, last
