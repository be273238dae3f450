"""Events of obstacles: kinds, and whether contact is avoidable; without SUMO."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.road.route import Route
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.obstacles import Crossing
from tests.support.bench import BLIND, NO_WALLS, Prescribed, platoon

STRAIGHT = Route.along(["e"], np.array([(-500.0, 0.0), (5000.0, 0.0)]), np.array([40.0, 40.0]))


@pytest.mark.parametrize(("x", "what"), [(60.0, "avoidable"), (25.0, "unavoidable")])
def test_a_pedestrian_who_steps_out_close_ahead_is_an_unavoidable_encounter(x, what):
    """A car at 10 m/s; the pedestrian steps onto its strip after about 1.5 s, with the car at about 15 m."""
    law = Prescribed(lambda _: Drive(0.0, 0.0))
    lidar = replace(BLIND, rate=10.0)
    members = [replace(m, route=STRAIGHT) for m in platoon(law, model=CARS["car"], leader_eye=lidar, speed=10.0)]
    pedestrian = Crossing(
        id="walker", kind="pedestrian", length=0.3, width=0.5, start=(x, 4.0), end=(x, -4.0), speed=2.0, sets_out=0.0
    )
    with Simulation(Setting(members, NO_WALLS, 0.1, steps=40, obstacles=[pedestrian])) as simulation:
        events = [event for now in simulation for event in now.events]
        (encounter,) = simulation.encounters.rows()
    assert [(e.kind, e.vehicle, e.what) for e in events if e.kind != "obstacle_gone"] == [
        ("obstacle", "walker", "pedestrian"),
        ("steps_out", "robot.0", what),
    ]
    assert encounter.avoidable == (what == "avoidable")
