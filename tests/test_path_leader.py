"""The leader on a given path."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from bench import BLIND, LEADER_EYE, NO_WALLS, ROBOT, drive, platoon

from lidar import Scene
from platoontraffic.controllers.path import PathLeader
from platoontraffic.polyline import Polyline


def along(path, scene=NO_WALLS, seconds=20.0, at=(-ROBOT.axle, 0.0, 0.0), law=None, eye=BLIND):
    """One robot whose driven axle begins at the origin, heading east."""
    (robot,) = platoon(law or PathLeader(), at=at, leader_eye=eye)
    return drive([replace(robot, path=path)], scene, seconds)


def axle(log):
    """Where the driven axle's middle was, (k, 2)."""
    heading = log.heading[:, 0]
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    return np.column_stack([log.x[:, 0], log.y[:, 0]]) + ROBOT.axle * ahead


@pytest.mark.parametrize("radius", [0.5, 1.0])
@pytest.mark.parametrize("side", ["left", "right"])
def test_pure_pursuit_keeps_a_circle(radius, side):
    """The arc through two points of a circle, tangent to it at the first, is that circle."""
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    sign = 1 if side == "left" else -1
    path = Polyline(np.column_stack([radius * np.sin(angle), sign * radius * (1 - np.cos(angle))]), closed=True)
    log = along(path, seconds=30.0, law=PathLeader(speed=0.2))
    away = np.hypot(*(axle(log) - (0, sign * radius)).T)
    assert away == pytest.approx(radius, rel=1e-3)
    late = log.time > 5
    assert log.wanted_yaw_rate[late, 0] == pytest.approx(sign * 0.2 / radius, rel=0.01)


def test_started_beside_a_straight_path_it_comes_to_it():
    log = along(Polyline(np.array([(0.0, 0.1), (9.0, 0.1)])), at=(-ROBOT.axle, 0.0, 0.0))
    assert abs(axle(log)[-1, 1] - 0.1) < 1e-4


def test_stops_at_the_end_of_its_path():
    log = along(Polyline(np.array([(0.0, 0.0), (1.0, 0.0)])), seconds=12.0)
    assert log.wanted_speed[log.time < 9.9, 0] == pytest.approx(0.1)
    assert not log.wanted_speed[-60:].any()
    assert axle(log)[-1] == pytest.approx([1.0, 0.0], abs=0.1 * 0.025)


def test_stops_its_stop_distance_before_an_obstacle_and_only_for_one_in_its_way():
    road = Polyline(np.array([(0.0, 0.0), (9.0, 0.0)]))
    law = PathLeader()
    for aside, stands in ((0.0, True), (0.15, False)):
        box = Scene.from_shapely(solids=[shapely.box(1.0, aside - 0.04, 1.1, aside + 0.04)])
        log = along(road, box, 12.0, eye=LEADER_EYE)
        assert (log.wanted_speed[-1, 0] == 0) == stands
        laser = log.x[-1, 0] + LEADER_EYE.mount.x
        if stands:
            assert law.stop_distance - 0.1 * 0.025 - 1e-6 <= 1.0 - laser <= law.stop_distance + 1e-6
        else:
            assert laser > 1.1


def test_an_eye_that_sees_less_far_than_the_stop_distance_does_not_stop_it_on_an_empty_road():
    eye = replace(LEADER_EYE, range_min=0.1, range_max=0.3)
    log = along(Polyline(np.array([(0.0, 0.0), (9.0, 0.0)])), seconds=1.0, eye=eye)
    assert log.wanted_speed == pytest.approx(0.1)
