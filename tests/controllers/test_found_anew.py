"""Predecessors that are found on the route, dropped, and found anew."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers.tracker.track_kernel import _along_route
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount, Noise, Scene
from platoontraffic.road.route import Route
from platoontraffic.vehicles.bicycle import CARS
from tests.controllers.test_creeping import footprints
from tests.support.bench import drive, platoon

CAR = CARS["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise())
STRAIGHT = Route.along(("road",), np.array([[-200.0, 0.0], [2000.0, 0.0]]), np.full(2, 12.0))
# A turn to the right in Bologna, from where it was first seen that a car stood before it.
TURN = np.array([(0, 0), (18, 0.15), (27, 0.41), (31.5, -0.1), (35.8, -0.95), (39.3, -3.5), (42.6, -6.6), (46, -15)])


@pytest.mark.parametrize(("points", "found"), [(TURN, False), (np.array([(0.0, 0.0), (30.0, 0.0), (60.0, 0.0)]), True)])
def test_a_vehicle_whose_axle_is_beside_the_lane_is_no_predecessor(points, found):
    """It would be dropped in the next scan, and so in each."""
    rear = SimpleNamespace(x=35.4, y=0.6, heading=0.083)
    assert math.isfinite(_along_route.py_func(points.astype(float), rear, 0.0, 0.0)) == found


@pytest.mark.parametrize("dropped", [True, False])
def test_what_is_found_anew_in_scan_after_scan_is_an_obstacle(monkeypatch, dropped):
    """Its speed was taken for the own one in each scan: in Bologna a member drove into a standing car at 7 m/s."""
    predict = TrackingFollower._predict

    def drop(self, now):
        predicted = predict(self, now)
        return predicted.forgotten(predicted.known)

    if dropped:
        monkeypatch.setattr(TrackingFollower, "_predict", drop)
    (member,) = platoon(TrackingFollower(policy="obey", on_loss="drive"), leader_eye=EYE, model=CAR)
    member = replace(member, route=STRAIGHT, speed=12.0, single=True)
    body = shapely.box(60.0, -0.9, 64.7, 0.9)
    log = drive([member], Scene.from_shapely(solids=[body]), 20.0, 0.1)
    assert shapely.distance(footprints(log), body).min() > 1.5
    assert log.speed[-1, 0] < 0.05
    assert log.acceleration[:, 0].min() > -6.0
