"""The list of vehicles near members, which is kept up to date from step to step."""

from __future__ import annotations

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
