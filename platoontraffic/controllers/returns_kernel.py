"""Returns of a laser, compiled."""

from __future__ import annotations

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def some_nearer(ranges, reach):
    """Whether one of the ranges of a scan, (k,), is less than that [m]; NaN, a lost one, is not.

    It has no branches, so that the processor compares several at once: in most scans none is.
    """
    found = 0
    for beam in range(len(ranges)):
        found += ranges[beam] < reach
    return found > 0
