"""Compiled yardsticks of `lidar.benchmark`: the least that any scan costs, and the plain way to do it."""

import numpy as np

from ..compiled import compiled
from ..laserscan import NO_HIT


@compiled
def floor(directions, start, ranges):
    """The rest of a scan in an empty world: a buffer is cleared, divided and stored, (n, k) float64.

    start : what the buffer is cleared with, positive; handed in so that the quotient is not known when compiling
    """
    inverse = np.empty(directions.shape[1])
    for i in range(len(ranges)):
        inverse[:] = start
        for beam in range(np.uint64(len(inverse))):
            ranges[i, beam] = 1.0 / inverse[beam]


@compiled
def brute_force(first, faces, owners, dx, dy, inverse, met, range_min, range_max, ranges, hits):
    """Each beam against each candidate; ranges (n, k) and hits (n, k) are filled.

    first        : candidates of sensor i are first[i] to first[i + 1] − 1, (n + 1,)
    faces        : their ends in the sensor frame, counter-clockwise as seen from it, rows ax, ay, bx, by, (4, c)
    owners       : (c,) float64, in which they are exact
    dx, dy       : directions of the beams in the sensor frame, (k,)
    inverse, met : room for inverse ranges and owners, (k,)

    No division a beam and face: 1/r is linear in the direction, as in the raster engine; a beam meets a face where it
    passes between its ends. The inner loop has no branches, unsigned indices, and is vectorised.
    """
    beams = np.uint64(len(dx))
    for i in range(len(first) - 1):
        inverse[:] = 0.0
        met[:] = NO_HIT
        for k in range(first[i], first[i + 1]):
            ax, ay, bx, by = faces[0, k], faces[1, k], faces[2, k], faces[3, k]
            scale = 1.0 / (ax * by - ay * bx)
            normal_x, normal_y = (by - ay) * scale, (ax - bx) * scale
            owner = owners[k]
            for beam in range(beams):
                value, best = normal_x * dx[beam] + normal_y * dy[beam], inverse[beam]
                between = (ax * dy[beam] >= ay * dx[beam]) & (bx * dy[beam] <= by * dx[beam])
                nearer = between & (value > best)
                inverse[beam] = value if nearer else best
                met[beam] = owner if nearer else met[beam]
        for beam in range(beams):
            r = 1.0 / inverse[beam]
            far = r > range_max
            ranges[i, beam] = np.inf if far else (-np.inf if r < range_min else r)
            hits[i, beam] = NO_HIT if far else np.int32(met[beam])
