"""Yardsticks of the engines: the least that any scan costs, and the plain way to do it."""

from __future__ import annotations

import numpy as np

from ..pose import compose
from ..scene import STATIC, blocks, bounds, pairs_near
from .timing import first

YARDSTICKS = ("brute force", "brute force in view", "floor")


def empty_scan(model, sensors):
    """A call that clears, divides and stores as many numbers as the scans have."""
    from .kernels import floor  # here, because it imports numba

    ranges = np.empty((sensors, model.samples))
    return lambda: floor(model.directions, 0.1, ranges)


def every_beam_on_every_surface(model, sensor, ends, owner, sensors):
    """A call that tries every beam on every candidate, and the ranges it fills.

    Its time does not include finding and turning the candidates, checks and errors: real brute force is slower.
    """
    from .kernels import brute_force  # here, because it imports numba

    begin = np.searchsorted(sensor, np.arange(sensors + 1))
    faces = np.ascontiguousarray(ends.transpose(1, 0, 2).reshape(4, -1))
    ranges, hits = np.empty((sensors, model.samples)), np.empty((sensors, model.samples), np.int32)
    # In one block: separate arrays may lie a multiple of 4 KiB apart, which the processor mistakes for the same place
    # at first. One of twenty layouts took two to four times as long.
    room = np.concatenate([model.directions, np.empty((2, model.samples))])
    arguments = begin, faces, owner.astype(float), *room, model.range_min, model.range_max, ranges, hits
    return lambda: brute_force(*arguments), ranges


def candidates(model, scene, boxes, sensors):
    """Surfaces that the first vehicles could see: all with a bounding box within reach of the sensor's x and y.

    returns: row of the sensor, increasing, (c,); the ends as x and y in its frame, counter-clockwise, (2, 2, c); owner,
             (c,); whether it is a wall or the near side of a box, and in the bounding box of the sector in view, (c,)
    """
    carriers = first(sensors, boxes)
    x, y, yaw = compose(carriers.x, carriers.y, carriers.heading, model.mount)
    edges = np.concatenate([scene.columns, boxes.faces], axis=1)
    edge_owner = np.concatenate([np.full(len(scene.segments), STATIC), np.repeat(boxes.owner, 4)])
    edge_bounds = bounds(edges)
    near = []
    for rows in blocks(sensors, edges.shape[1]):
        sensor, edge = pairs_near(edge_bounds, x[rows], y[rows], model.reach)
        near.append((sensor + rows.start, edge))
    sensor, edge = (np.concatenate(parts) for parts in zip(*near, strict=True))
    others = edge_owner[edge] != carriers.owner[sensor]
    sensor, edge = sensor[others], edge[others]
    owner = edge_owner[edge]

    east, north = edges[0::2, edge] - x[sensor], edges[1::2, edge] - y[sensor]
    cos, sin = np.cos(yaw[sensor]), np.sin(yaw[sensor])
    ends = np.stack([cos * east + sin * north, cos * north - sin * east])
    area = ends[0, 0] * ends[1, 1] - ends[1, 0] * ends[0, 1]
    # The sector's box: the beams' ends, the sensor, and straight ahead, where the arc of all views passes an axis.
    corners = model.reach * np.hstack([model.directions, [[0.0, 1.0], [0.0, 0.0]]])
    low, high = corners.min(axis=1)[:, None], corners.max(axis=1)[:, None]
    in_view = ((ends.min(axis=1) <= high) & (ends.max(axis=1) >= low)).all(axis=0)
    in_view &= (owner == STATIC) | (area < 0)
    return sensor, np.where(area < 0, ends[:, ::-1], ends), owner, in_view
