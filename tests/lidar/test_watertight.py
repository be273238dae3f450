"""No beam passes between two faces that share a corner, however exactly it is aimed at it."""

import math

import numpy as np
import pytest

from platoontraffic.lidar import Boxes, Carriers, LidarModel, Scene, scan

ROUND = LidarModel(720, -math.pi, math.pi - math.radians(0.5), 0.05, 60.0)
AIMED = np.arange(10, 720, 36)  # 20 beams; what stands on one of them hides no other
BACKDROP = 50.0  # half the side of the square of walls behind everything [m]
WALLS = BACKDROP * np.array([[-1, -1, 1, -1], [1, -1, 1, 1], [1, 1, -1, 1], [-1, 1, -1, -1]])

# Chipmunk, behind the engine pymunk, is not watertight itself.
watertight = pytest.mark.parametrize(("engine", "scans"), [("raster", 250), ("numpy", 250), ("shapely", 20)])


def ranges_at_corners(engine, segments, boxes):
    scene = Scene(np.concatenate([WALLS, segments]))
    return scan(ROUND, scene, boxes, Carriers(0, 0, 0, 99), engine=engine, dtype=np.float64).ranges[0, AIMED]


def aimed_points(rng):
    """A point on each aimed beam, nearer than the backdrop, (20, 2), and its distance, (20,)."""
    distance = rng.uniform(10, 30, len(AIMED))
    return distance[:, None] * ROUND.directions[:, AIMED].T, distance


@watertight
def test_no_beam_passes_the_corner_that_two_faces_of_a_turned_box_share(engine, scans):
    rng = np.random.default_rng(1)
    for _ in range(scans):
        corner, distance = aimed_points(rng)
        heading = ROUND.angles[AIMED] + rng.uniform(0.2, math.pi / 2 - 0.2, len(AIMED))  # the near corner is aimed at
        length, width = rng.uniform(0.3, 1.5, (2, len(AIMED)))
        x = corner[:, 0] + length / 2 * np.cos(heading) + width / 2 * np.sin(heading)
        y = corner[:, 1] + length / 2 * np.sin(heading) - width / 2 * np.cos(heading)
        boxes = Boxes(x, y, heading, length, width, np.arange(len(AIMED)))
        np.testing.assert_allclose(ranges_at_corners(engine, np.empty((0, 4)), boxes), distance, rtol=0, atol=1e-9)


@watertight
def test_no_beam_passes_the_point_that_two_walls_share(engine, scans):
    rng = np.random.default_rng(2)
    for _ in range(scans):
        point, distance = aimed_points(rng)
        bearing = ROUND.angles[AIMED]
        ends = []
        for side in (-1, 1):  # to the right and to the left of the beam, towards or away from the sensor
            leg = bearing + side * rng.uniform(0.3, math.pi - 0.3, len(AIMED))
            ends.append(point + rng.uniform(0.1, 1.0, (len(AIMED), 1)) * np.stack([np.cos(leg), np.sin(leg)], axis=1))
        walls = np.concatenate([np.hstack([point, ends[0]]), np.hstack([ends[1], point])])
        turned = rng.random(len(walls)) < 0.5
        walls[turned] = walls[turned][:, [2, 3, 0, 1]]
        found = ranges_at_corners(engine, walls, Boxes.empty())
        np.testing.assert_allclose(found, distance, rtol=0, atol=1e-9)


@watertight
def test_no_beam_passes_the_point_at_which_the_engine_cuts_a_long_wall(engine, scans):
    # The raster engine cuts a wall of 119 m in two; the cut, amid the wall, is aimed at.
    rng = np.random.default_rng(3)
    for _ in range(scans):
        point, distance = aimed_points(rng)
        k = rng.integers(len(AIMED))
        along = ROUND.angles[AIMED[k]] + rng.uniform(0.5, math.pi - 0.5)
        half = 59.5 * np.array([math.cos(along), math.sin(along)])
        wall = np.concatenate([point[k] - half, point[k] + half])
        found = ranges_at_corners(engine, [wall], Boxes.empty())
        np.testing.assert_allclose(found[k], distance[k], rtol=0, atol=1e-9)
