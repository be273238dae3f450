"""Walls that bodies may touch."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from platoontraffic.lidar import Boxes
from platoontraffic.world.walls_kernel import Walls, may_touch


@pytest.mark.parametrize("extent", [3.0, 60.0, 900.0])
def test_a_body_may_touch_a_wall_where_shapely_says_so(extent):
    """Walls of all lengths, over one cell and over many; also those along an axis."""
    rng = np.random.default_rng(4)
    segments = rng.uniform(-extent, extent, (200, 4))
    segments[:40, 2] = segments[:40, 0]
    segments[40:80, 3] = segments[40:80, 1]
    lines, walls = shapely.linestrings(segments.reshape(-1, 2, 2)), Walls.of(segments)
    touched = 0
    for _ in range(300):
        x, y = rng.uniform(-1.2 * extent, 1.2 * extent, (2, 1))
        heading, length, width = rng.uniform(-3, 3, 1), rng.uniform(0.1, 0.05 * extent, 1), rng.uniform(0.1, 2.0, 1)
        (box,) = shapely.polygons(Boxes(x, y, heading, length, width, [0]).corners())
        expected = shapely.intersects(box, lines).any()
        assert may_touch(walls, 1, x, y, (np.cos(heading), np.sin(heading)), length, width, 1e-9) == expected
        touched += expected
    assert 20 < touched < 280


def test_a_body_within_the_margin_of_a_wall_may_touch_it():
    walls = Walls.of(np.array([[0.0, 0.0, 1000.0, 0.0]]))
    for y, touches in ((1.001, False), (1.0 + 0.9e-6, True), (-0.999, True), (-1.1, False)):
        place = np.array([777.7]), np.array([y]), (np.ones(1), np.zeros(1))
        assert may_touch(walls, 1, *place, np.array([4.0]), np.array([2.0]), 1e-6) == touches
    assert not may_touch(
        walls, 1, np.array([1003.0]), np.zeros(1), (np.ones(1), np.zeros(1)), *np.full((2, 1), 4.0), 0.0
    )
