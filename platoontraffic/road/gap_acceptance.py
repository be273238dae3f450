"""Gap acceptance: whether a vehicle that must yield can cross before or behind another one."""

from __future__ import annotations

import math
from typing import NamedTuple

ACCELERATION = 1.5  # assumed of the crossing vehicle [m/s2]
TURNING_SPEED = 6.0  # to which it accelerates, unless it is faster already [m/s]
MARGIN = 1.0  # between the two vehicles at the conflict area [s]
STANDING = 0.1  # speed below which a vehicle counts as standing [m/s]


class Foe(NamedTuple):
    """A vehicle with right of way. Distances are from each vehicle's front bumper [m]; negative: passed."""

    to_conflict: float  # own distance to where the two paths meet
    to_exit: float  # own distance to where they part again
    foe_to_conflict: float
    foe_to_exit: float
    foe_speed: float
    foe_length: float
    hurries: bool = False  # it may set out or accelerate now; else it keeps its speed, and waits if it stands


def may_cross(foe: Foe, speed: float, length: float, margin: float = MARGIN) -> bool:
    """Whether the vehicle clears the conflict area before the foe arrives, or arrives after the foe has cleared it.

    speed, length : of the vehicle [m/s], [m]
    margin        : between the two [s]

    A foe that hurries arrives after `time_for` its distance, and clears the area at its present speed.
    """
    if foe.to_exit + length < 0 or foe.foe_to_exit + foe.foe_length < 0:
        return True
    stands = foe.foe_speed < STANDING
    if stands and not (foe.hurries and foe.foe_to_conflict > 0):
        return foe.foe_to_conflict > 0  # it waits; otherwise it blocks the path
    arrives = time_for(foe.foe_to_conflict, foe.foe_speed) if foe.hurries else foe.foe_to_conflict / foe.foe_speed
    clears = math.inf if stands else (foe.foe_to_exit + foe.foe_length) / foe.foe_speed
    before = arrives > time_for(foe.to_exit + length, speed) + margin
    return before or clears + margin < time_for(foe.to_conflict, speed)


def time_for(distance: float, speed: float) -> float:
    """Time to drive a distance [m] from a speed [m/s], accelerating up to TURNING_SPEED [s]."""
    if distance <= 0:
        return 0.0
    top = max(speed, TURNING_SPEED)
    to_top = (top**2 - speed**2) / (2 * ACCELERATION)
    if distance <= to_top:
        return (math.sqrt(speed**2 + 2 * ACCELERATION * distance) - speed) / ACCELERATION
    return (top - speed) / ACCELERATION + (distance - to_top) / top
