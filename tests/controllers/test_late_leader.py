"""The law `path` with scans and odometry that are used late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.path import PathLeader
from platoontraffic.lidar import PRESETS, Mount
from platoontraffic.road.route import Route
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import OdometryErrors
from tests.support.bench import BLIND, NO_WALLS, Prescribed, drive, platoon

CAR, DT = CARS["car"], 0.1
EYE = replace(PRESETS["car-leader"], mount=Mount(CAR.length / 2 - 0.03))
ROUTE = Route.along(("road",), np.array([[-50.0, 0.0], [1000.0, 0.0]]), np.full(2, 20.0))


def led(delay: float, seconds: float, begins: float, standing: float, **gains):
    """A leader at the origin, and a car that stands ahead of it [m]."""
    late = OdometryErrors(delay=delay)
    (leader,) = platoon(
        PathLeader(**gains), model=CAR, leader_eye=replace(EYE, delay=delay), speed=begins, odometry=late
    )
    (ahead,) = platoon(
        Prescribed(lambda time: Drive(0.0, 0.0)), model=CAR, leader_eye=replace(BLIND, rate=10.0), at=(standing, 0.0, 0)
    )
    some = [replace(leader, route=ROUTE), replace(ahead, id="stands", platoon="stands")]
    return drive(some, NO_WALLS, seconds, DT)


@pytest.mark.parametrize("delay", [0.1, 0.3])
def test_it_stops_behind_a_standing_car_as_without_a_delay(delay):
    """It first sees that car nearer, by the way in the delay and a scan; the IDM brakes by the gap squared."""
    speed, seen = 15.0, EYE.range_max
    at_once, log = (led(one, 20.0, speed, 100.0, speed=speed) for one in (0.0, delay))
    assert log.speed[-1, 0] < 1e-3
    assert log.x[-1, 0] == pytest.approx(at_once.x[-1, 0], abs=0.3)
    nearer = seen - (delay + DT) * speed
    assert log.acceleration[:, 0].min() > at_once.acceleration[:, 0].min() * (seen / nearer) ** 2


@pytest.mark.parametrize("delay", [0.1, 0.3])
def test_it_reaches_its_speed_without_swinging_about_it(delay):
    at_once, log = (led(one, 20.0, 0.0, 900.0, speed=12.0) for one in (0.0, delay))
    assert log.speed[:, 0].max() == pytest.approx(at_once.speed[:, 0].max(), abs=0.02)
    assert log.acceleration[:, 0].min() == pytest.approx(at_once.acceleration[:, 0].min(), abs=0.05)
    assert log.speed[-50:, 0] == pytest.approx(12.0, abs=0.01)
