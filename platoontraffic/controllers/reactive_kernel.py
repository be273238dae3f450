"""Rules of Algorithm 1 that apply to scans, compiled."""

from __future__ import annotations

import math

from platoontraffic.controllers import reactive_rules
from platoontraffic.controllers.reactive_rules import ACTIONS, SECTORS, rule
from platoontraffic.lidar.compiled import compiler

SMALLEST, MEAN, MIDDLE = map(SECTORS.index, ("smallest", "mean", "middle"))

compiled = compiler(__file__, reactive_rules.__file__)
_rule = compiled(rule)


@compiled
def commands(scans, limits, sector, rates, speed, yaw_rate):
    """Fill in the command of the rule that applies to each scan, (n,).

    scans  : ranges [m], (n, k): inf or NaN: no return, -inf: nearer than range_min
    limits : range_min and range_max [m]
    sector : which range of a sector counts, an index of SECTORS
    rates  : units of the rules' drive [m/s] and angular velocity [rad/s], and sign of the latter, 1 if to the left
    """
    (range_min, range_max), (speed_unit, turn_unit, sign), k = limits, rates, scans.shape[1]
    for i in range(len(scans)):
        right = _range(scans[i, k * 1 // 5 : k * 2 // 5], range_min, range_max, sector)
        front = _range(scans[i, k * 2 // 5 : k * 3 // 5], range_min, range_max, sector)
        left = _range(scans[i, k * 3 // 5 : k * 4 // 5], range_min, range_max, sector)
        drive, angular = ACTIONS[_rule(front, left, right) - 1]
        speed[i], yaw_rate[i] = drive * speed_unit, sign * angular * turn_unit


@compiled
def _range(beams, range_min, range_max, sector):
    """The range of one sector [m]."""
    if sector == MIDDLE:
        return _filled(beams[len(beams) // 2], range_min, range_max)
    smallest, total = math.inf, 0.0
    for beam in range(len(beams)):
        value = _filled(beams[beam], range_min, range_max)
        smallest, total = min(smallest, value), total + value
    return smallest if sector == SMALLEST else total / len(beams)


@compiled
def _filled(value, range_min, range_max):
    """As `ScanBatch.filled`."""
    if math.isnan(value) or value == math.inf:
        return range_max
    return range_min if value == -math.inf else float(value)
