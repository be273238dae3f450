"""The list of vehicles near members, which is kept up to date from step to step."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.simulation import Simulation

pytestmark = pytest.mark.sumo


def test_the_list_of_near_vehicles_is_that_of_sumo_as_they_come_and_go():
    came = went = 0
    with Simulation.load("grid_platoons", "sumo.warm_up_s=200") as simulation:
        simulation.reset()
        sumo, background = simulation.sumo, simulation.world._background
        for step in range(200):
            if step == 100:  # by somebody else: SUMO counts no arrival
                sumo.vehicle.remove(background._near[7])
            simulation.step()
            came += sumo.simulation.getDepartedNumber()
            went += sumo.simulation.getArrivedNumber()
            known = [name for name in sumo.vehicle.getIDList() if name not in background._skipped]
            assert background._near == known
    assert came > 20
    assert went > 1


def test_no_vehicle_in_range_of_a_member_is_left_out_and_most_others_are():
    left_out = near = 0
    with Simulation.load("highway_platoon", "run.duration_s=40", "record.traffic_every_s=1000") as simulation:
        for instant in simulation:
            sumo, background = simulation.sumo, simulation.world._background
            own = instant.fleet.motion
            known = {*instant.traffic.ids}
            for name in sumo.vehicle.getIDList():
                x, y = sumo.vehicle.getPosition(name)
                if np.hypot(own.x - x, own.y - y).min() < instant.fleet.sight:
                    near += 1
                    assert name in known, (instant.time, name)
                left_out += name in background._skipped and name not in instant.fleet.row_of
    assert near > 1000
    assert left_out > near
