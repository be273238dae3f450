"""Room on an adjacent lane: the gap that a lane change must leave to each vehicle there."""

from __future__ import annotations

import numpy as np

HEADWAY = 0.5  # time gap that a lane change leaves on the adjacent lane [s]
REACTION, COMFORTABLE_BRAKING = 1.0, 4.5  # of SUMO's drivers: tau [s], decel [m/s2]


def room_needed(length, rear_speed, closing):
    """Least gap, bumper to bumper, to a vehicle ahead or behind on the adjacent lane [m]; floats, or arrays (n,).

    The vehicle in the rear keeps half a length or HEADWAY after it has reacted and braked in comfort.

    length     : of the vehicle that changes lanes [m]
    rear_speed : of the one in the rear [m/s]
    closing    : rate at which the gap shrinks [m/s]; negative: it grows
    """
    closing = np.maximum(closing, 0.0)
    return np.maximum(length / 2, HEADWAY * rear_speed) + closing * REACTION + closing**2 / (2 * COMFORTABLE_BRAKING)
