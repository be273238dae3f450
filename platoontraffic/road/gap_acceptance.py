"""Whether there is a gap in the traffic that a vehicle must yield to."""

from __future__ import annotations

import math
from typing import NamedTuple

ACCELERATION = 1.5  # with which it is reckoned that the vehicle crosses [m/s2]
TURNING_SPEED = 6.0  # up to this speed, or the present one if that is more [m/s]
MARGIN = 1.0  # between the one and the other at the place where their ways cross [s]
STANDING = 0.1  # slower counts as standing [m/s]


class Foe(NamedTuple):
    """Somebody to whom this vehicle must yield. Ways are from each one's front bumper [m]; negative: it is past."""

    to_conflict: float  # own way to where the two ways meet
    to_exit: float  # own way to where they part again
    foe_to_conflict: float
    foe_to_exit: float
    foe_speed: float
    foe_length: float
    hurries: bool = False  # it may set out now, or accelerate; else it keeps its speed, and waits if that is none


def may_cross(foe: Foe, speed: float, length: float, margin: float = MARGIN) -> bool:
    """Whether the vehicle gets across before the foe comes, or the foe is gone before it comes itself.

    A foe that hurries comes as `time_for` says, and goes at the speed that it has.
    """
    if foe.to_exit + length < 0 or foe.foe_to_exit + foe.foe_length < 0:
        return True
    stands = foe.foe_speed < STANDING
    if stands and not (foe.hurries and foe.foe_to_conflict > 0):
        return foe.foe_to_conflict > 0  # it waits; or it stands in the way
    comes = time_for(foe.foe_to_conflict, foe.foe_speed) if foe.hurries else foe.foe_to_conflict / foe.foe_speed
    goes = math.inf if stands else (foe.foe_to_exit + foe.foe_length) / foe.foe_speed
    return comes > time_for(foe.to_exit + length, speed) + margin or goes + margin < time_for(foe.to_conflict, speed)


def time_for(way: float, speed: float) -> float:
    """To drive a way [m] from a speed [m/s], accelerating up to TURNING_SPEED [s]."""
    if way <= 0:
        return 0.0
    top = max(speed, TURNING_SPEED)
    to_top = (top**2 - speed**2) / (2 * ACCELERATION)
    if way <= to_top:
        return (math.sqrt(speed**2 + 2 * ACCELERATION * way) - speed) / ACCELERATION
    return (top - speed) / ACCELERATION + (way - to_top) / top
