"""The nearest group of neighbouring returns of each scan, compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def nearest_groups(scans, range_min, group_step, ranges, ends):
    """Fill in ranges (n, k) and the first and last beam of the run of neighbouring returns around the nearest, (2, n).

    A lost return (NaN) ends no group: it takes the range of the return before it. A group ends on a sound one.

    scans      : ranges [m]; inf: no return, -inf: nearer than range_min, (n, k)
    group_step : greatest difference of neighbouring ranges in a group [m]
    ends       : -1 for a scan without a return
    """
    for i in range(len(scans)):
        before, nearest, at = np.inf, np.inf, -1
        for k in range(scans.shape[1]):
            value = np.float64(scans[i, k])
            if math.isnan(value):
                value = before
            elif value == -np.inf:
                value = range_min
            ranges[i, k] = before = value
            if value < nearest:
                nearest, at = value, k
        first = last = at
        if at >= 0:
            while first > 0 and abs(ranges[i, first] - ranges[i, first - 1]) <= group_step:
                first -= 1
            while last + 1 < scans.shape[1] and abs(ranges[i, last + 1] - ranges[i, last]) <= group_step:
                last += 1
            while math.isnan(scans[i, last]):
                last -= 1
        ends[0, i], ends[1, i] = first, last
