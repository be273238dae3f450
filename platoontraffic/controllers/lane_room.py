"""Room on an adjacent lane: the gap that a lane change must leave to each vehicle there."""

from __future__ import annotations

ANOTHER = 1.0  # lane offset from which a place is on another lane [m]
HEADWAY = 0.5  # time gap that a lane change leaves on the adjacent lane [s]
REACTION, COMFORTABLE_BRAKING = 1.0, 4.5  # of SUMO's drivers: tau [s], decel [m/s2]


def room_needed(length, rear_speed, closing):
    """Least gap, bumper to bumper, to a vehicle ahead or behind on the adjacent lane [m]. Of floats.

    The vehicle in the rear keeps half a length or HEADWAY after it has reacted and braked in comfort.

    length     : of the vehicle that changes lanes [m]
    rear_speed : of the one in the rear [m/s]
    closing    : rate at which the gap shrinks [m/s]; negative: it grows
    """
    closing = 0.0 if closing < 0.0 else closing  # NaN stays
    least = length / 2 if HEADWAY * rear_speed < length / 2 else HEADWAY * rear_speed
    return least + closing * REACTION + closing * closing / (2 * COMFORTABLE_BRAKING)
