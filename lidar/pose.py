"""Poses in the plane. World: x east, y north. Body: x forward, y left. Angles counter-clockwise [rad]."""

import numpy as np


def wrap(angle):
    """The same direction in (−π, π]; values already there come back unchanged."""
    angle = np.asarray(angle, dtype=float)
    return angle - 2 * np.pi * np.ceil((angle - np.pi) / (2 * np.pi))


def compose(x, y, heading, mount):
    """Sensor pose in the world, from body poses and the mount on the body.

    x, y, heading : body poses, world frame, (n,)
    mount         : pose of the sensor in the body frame, with x, y, yaw
    returns       : x, y, yaw of the sensor, world frame, (n,) each
    """
    cos, sin = np.cos(heading), np.sin(heading)
    yaw = wrap(heading + mount.yaw) if mount.yaw else heading
    if not mount.y:  # as most; poses are composed in every step
        return x + cos * mount.x, y + sin * mount.x, yaw
    return x + cos * mount.x - sin * mount.y, y + sin * mount.x + cos * mount.y, yaw
