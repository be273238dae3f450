"""Events of obstacles: kinds, and whether contact is avoidable; without SUMO."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.road.route import Route
from platoontraffic.simulation import Setting, Simulation, Then
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.obstacles import Crossing
from tests.support.bench import BLIND, NO_WALLS, Prescribed, platoon

STRAIGHT = Route.along(["e"], np.array([(-500.0, 0.0), (5000.0, 0.0)]), np.array([40.0, 40.0]))


class Gentle(Prescribed):
    hardest_braking = 0.5


def met_by_a_car(x: float) -> Setting:
    law, lidar = Prescribed(lambda _: Drive(0.0, 0.0)), replace(BLIND, rate=10.0)
    members = [replace(m, route=STRAIGHT) for m in platoon(law, model=CARS["car"], leader_eye=lidar, speed=10.0)]
    pedestrian = Crossing(
        id="walker", kind="pedestrian", length=0.3, width=0.5, start=(x, 4.0), end=(x, -4.0), speed=2.0, sets_out=0.0
    )
    return Setting(members, NO_WALLS, 0.1, steps=40, obstacles=[pedestrian])


@pytest.mark.parametrize(("x", "what"), [(60.0, "avoidable"), (25.0, "unavoidable")])
def test_a_pedestrian_who_steps_out_close_ahead_is_an_unavoidable_encounter(x, what):
    """A car at 10 m/s; the pedestrian steps onto its strip after about 1.5 s, with the car at about 15 m."""
    with Simulation(met_by_a_car(x)) as simulation:
        events = [event for now in simulation for event in now.events]
        (encounter,) = simulation.encounters.rows()
    assert [(e.kind, e.vehicle, e.what) for e in events if e.kind != "obstacle_gone"] == [
        ("obstacle", "walker", "pedestrian"),
        ("steps_out", "robot.0", what),
    ]
    assert encounter.avoidable == (what == "avoidable")


def test_after_a_branch_avoidable_is_what_the_new_law_could_avoid():
    setting = met_by_a_car(60.0)
    weaker = [replace(m, law=Gentle(m.law.twist_at)) for m in setting.members]
    with Simulation(replace(setting, then=Then(5, weaker, ()))) as simulation:
        assert list(simulation)
        (encounter,) = simulation.encounters.rows()
    assert not encounter.avoidable
