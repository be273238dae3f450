"""The greatest speed from which a vehicle still stops before something that its laser has just begun to see.

Drivers are asked for the same: to be able to stop within the distance that they can see.
"""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar import LidarModel

SCANS = 3.0  # from the first return to braking: two until the speed of an obstacle is known, one as brakes build up
STOPS_BEFORE = 0.5  # distance to the obstacle at rest [vehicle lengths]


def reaction_time(lidar: LidarModel) -> float:
    """Time from when the laser could see an obstacle to the braking for it, but for the lag of the brakes [s]."""
    return SCANS / lidar.rate + lidar.delay


def reach_of(range_max, mount, length):
    """Distance from the front bumper, less the one that is kept at rest, within which it must stop [m].

    range_max : of the laser [m]
    mount     : of the laser ahead of the body's centre [m]; it looks ahead
    length    : of the body [m]

    A laser that sees hardly any farther than its own bumper leaves a tenth of its range.
    """
    return np.maximum(range_max + mount - length / 2 - STOPS_BEFORE * length, 0.1 * range_max)


def greatest_speed(reach, reaction, braking):
    """The speed v with  v reaction + v^2 / (2 braking) = reach  [m/s].

    reach    : `reach_of` [m]
    reaction : from when the laser could see the obstacle to the full braking [s]
    braking  : hardest [m/s2]
    """
    return braking * (np.sqrt(reaction**2 + 2 * reach / braking) - reaction)
