"""The rules of Algorithm 1 of Soni & Hu."""

from __future__ import annotations

import numpy as np


def rule(front: float, front_left: float, front_right: float) -> int:
    """Number of the rule of Algorithm 1 that applies, by the ranges [m] of three of the five sectors.

    The rules are in the paper's order. Rule 5 never applies, since rule 1 takes all its cases; rule 7 can apply for
    ever, for example with front > 2 and front_left < 1.
    """
    if front > 1 and front_left > 1 and front_right > 0.5:
        return 1
    if front < 2 and front_left < 3 and front_right > 0.5:
        return 2
    if front < 1 and front_left < 1 and front_right < 1:
        return 3
    if front < 1 and front_left > 1 and front_right < 1:
        return 4
    if front_right > 0.7 and front > 1 and front_left > 1:
        return 5
    if front_right < 0.5 and front > 1 and front_left > 1:
        return 6
    return 7


# (drive, angular) of rules 1 to 7 as printed, in units of `speed` and `turn_rate`.
ACTIONS = np.array([(1, 0), (1, 0), (0, -1), (0, -1), (0, +1), (0, -1), (0, 0)])

SECTORS = ("smallest", "mean", "middle")  # range of its beams that counts for a sector
