"""The interface of an engine, and the part of the work that most engines share.

An engine measures (model, beams, scene, boxes, sensors, ranges, hits) -> around:

beams   : which of the model's beams, a slice; only these columns are filled
sensors : poses of the sensors, and what their errors are drawn from
ranges  : (n, samples), to be filled with what the scanner reports: see `lidar.sense`
hits    : (n, samples) int32, to be filled with the owner of the surface met within range_max, the smallest if several
          are equally near
around  : owner of the box or wall that a sensor is inside of or touches, the smallest if several; NO_HIT if there is
          none, (n,) int32
"""

from typing import NamedTuple

import numpy as np

from ..laserscan import NO_HIT
from ..noise import ROUNDING, mixed, perturbed
from ..scene import STATIC, blocks, pairs_near

NOBODY = np.iinfo(np.int32).max  # no owner yet; every owner is smaller
TOUCHING = 1e-9  # distance at which a sensor touches a surface [m]


class Sensors(NamedTuple):
    """Poses, world frame [m, rad]; owners: their boxes are transparent; and the results of `noise.draws`.

    All are (n,) but `scan`.
    """

    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    owner: np.ndarray
    keys: np.ndarray
    scan: np.uint64
    bias: np.ndarray


def engine(cast):
    """An engine from a function (fan, scene, boxes, x, y, yaw, owner) -> (ranges, hits) that only measures distances.

    ranges : distance to the first surface on each beam, (n, k) float64, new memory. Exact up to the fan's reach;
             beyond, the distance to any surface there, or +inf
    hits   : owner of that surface, the smallest if several are equally near, (n, k) int32, new memory

    The values of sensors inside a solid are ignored.
    """

    def measure(model, beams, scene, boxes, sensors, ranges, hits):
        poses = sensors[:4]
        rays = [cast(fan.part(beams), scene, boxes, *poses) for fan in model.fans]
        farthest = model.range_max * (1 + ROUNDING)
        for ranges_of_ray, owners in rays:  # before sub-beams are merged: what is beyond the reach gives no echo
            beyond = ranges_of_ray > farthest
            ranges_of_ray[beyond], owners[beyond] = np.inf, NO_HIT
        exact, met = _merged(rays, model.merging)
        too_far, too_close = exact > farthest, exact < model.range_min * (1 - ROUNDING)
        exact = np.clip(exact, model.range_min, model.range_max)
        exact[too_far], met[too_far] = np.inf, NO_HIT
        exact[too_close] = -np.inf
        if not model.noise.none:
            keys = mixed(sensors.keys + sensors.scan)
            exact = perturbed(model, beams.start, exact, met, keys, sensors.bias)
        around = enclosing(scene, boxes, *poses)
        inside = around != NO_HIT
        exact[inside], met[inside] = -np.inf, around[inside, None]
        ranges[:, beams], hits[:, beams] = exact, met
        return around

    return measure


def _merged(rays, merging):
    """Range and owner of each beam from its rays: the mean of the nearest and those at most `merging` behind it."""
    if len(rays) == 1:
        return rays[0]
    ranges, owners = np.stack([r for r, _ in rays]), np.stack([h for _, h in rays])
    nearest = ranges.min(axis=0)
    owner = np.where(ranges == nearest, owners, NOBODY).min(axis=0)
    together = ranges <= nearest + merging
    total = np.zeros_like(nearest)
    for subbeam, merged in zip(ranges, together, strict=True):  # in the order in which the compiled engine adds
        total += np.where(merged, subbeam, 0.0)
    return total / together.sum(axis=0), owner


def enclosing(scene, boxes, x, y, yaw, owner):
    """Owner of the box or wall that a sensor is inside of or touches; see `around` above."""
    around = np.full(len(x), NOBODY, dtype=np.int32)
    for rows in blocks(len(x), max(len(boxes), len(scene.segments))):
        sensor, box = pairs_near(boxes.bounds, x[rows], y[rows], 2 * TOUCHING)  # a corner is √2 of it away
        sensor += rows.start
        others = boxes.owner[box] != owner[sensor]
        sensor, box = sensor[others], box[others]
        if len(sensor):
            dx, dy = x[sensor] - boxes.x[box], y[sensor] - boxes.y[box]
            cos, sin = np.cos(boxes.heading[box]), np.sin(boxes.heading[box])
            within = np.abs(cos * dx + sin * dy) <= boxes.length[box] / 2 + TOUCHING
            within &= np.abs(cos * dy - sin * dx) <= boxes.width[box] / 2 + TOUCHING
            np.minimum.at(around, sensor[within], boxes.owner[box[within]])
        sensor, wall = pairs_near(scene.bounds, x[rows], y[rows], TOUCHING)
        sensor += rows.start
        if len(sensor):
            distance = _distance(scene.segments[wall], x[sensor], y[sensor])
            around[sensor[distance <= TOUCHING]] = STATIC
    around[scene.enclosed(x, y)] = STATIC
    around[around == NOBODY] = NO_HIT
    return around


def _distance(segments, x, y):
    """Distance of point i from segment i, (p,) [m]."""
    x0, y0, x1, y1 = segments.T
    ex, ey, px, py = x1 - x0, y1 - y0, x - x0, y - y0
    along = np.clip((px * ex + py * ey) / (ex * ex + ey * ey), 0.0, 1.0)
    return np.hypot(px - along * ex, py - along * ey)
