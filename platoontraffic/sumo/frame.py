"""Conversions between SUMO's frame and the project's.

SUMO: middle of the front bumper; angle in degrees clockwise from north. The project: centre of the footprint; heading
counter-clockwise from east [rad]. Both have x to the east and y to the north [m]. All functions take floats or arrays.
"""

from __future__ import annotations

import numpy as np

from platoontraffic.lidar.pose import wrap


def sumo_angle(heading):
    """SUMO's angle, in [0, 360), of a heading."""
    return (90.0 - np.degrees(heading)) % 360.0


def heading_of(angle):
    """Heading in (-pi, pi] of a SUMO angle; the inverse of `sumo_angle`."""
    return wrap(np.radians(90.0 - angle))


def front_of(x, y, heading, length):
    """Front bumper, x and y [m], of a vehicle with its centre at x, y."""
    return x + length / 2 * np.cos(heading), y + length / 2 * np.sin(heading)


def centre_of(x, y, heading, length):
    """Centre, x and y [m], of a vehicle with its front bumper at x, y; the inverse of `front_of`."""
    return x - length / 2 * np.cos(heading), y - length / 2 * np.sin(heading)
