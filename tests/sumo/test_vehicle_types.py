"""SUMO drives a member as its vehicle can, and its drivers take a member for its vehicle."""

from __future__ import annotations

import libsumo
import numpy as np
import pytest

from platoontraffic import Simulation
from platoontraffic.vehicles.catalogue import VEHICLES

EMPTY_ROAD = """
[sumo]
net = "highway"
traffic = false
[scene]
walls = "none"
[run]
duration_s = 25
[[platoon]]
size = 2
route = ["w0_w1"]
leader = { law = "sumo", imperfection = 0.0 }
follower = "tracking"
[platoon.start]
edge = "w0_w1"
position_m = 100
"""


@pytest.fixture
def simulated(tmp_path):
    """A platoon led by SUMO from rest, on an empty road."""

    def simulation(*changes: str) -> Simulation:
        file = tmp_path / "empty_road.toml"
        file.write_text(EMPTY_ROAD)
        return Simulation.load(file, *changes)

    return simulation


@pytest.mark.sumo
@pytest.mark.parametrize("vehicle", ["car", "van", "truck"])
@pytest.mark.parametrize("imperfection", [0.0, 0.5])
def test_a_follower_keeps_up_with_its_like_that_sumo_drives(simulated, vehicle, imperfection):
    changes = f"platoon.0.vehicle={vehicle}", f"platoon.0.leader.imperfection={imperfection}"
    with simulated(*changes) as simulation:
        for instant in simulation:
            gap, speed = instant.measures.gap[1], instant.fleet.motion.speed[1]
            assert 1.5 < gap < 6 + 1.3 * speed  # a stand-off, and a headway of 1 s


@pytest.mark.sumo
@pytest.mark.parametrize("vehicle", ["car", "van", "truck"])
def test_sumo_accelerates_a_member_with_a_share_of_what_the_vehicle_can(simulated, vehicle):
    model = VEHICLES[vehicle]
    with simulated(f"platoon.0.vehicle={vehicle}") as simulation:
        speed = np.array([instant.fleet.motion.speed[0] for instant in simulation])
    driven = speed[:-1] < min(33.0, model.top_speed) - 0.5  # the limit of the road is 33.3 m/s
    expected = 0.65 * np.minimum(model.strongest_acceleration(speed[:-1]), model.max_acceleration)
    assert (np.diff(speed) / 0.1)[driven] == pytest.approx(expected[driven], rel=0.01)


@pytest.mark.sumo
@pytest.mark.parametrize(("vehicle", "braking"), [("car", (4.5, 9.0)), ("van", (4.5, 9.0)), ("truck", (3.5, 7.0))])
def test_sumo_s_drivers_know_how_hard_a_member_brakes(simulated, vehicle, braking):
    with simulated(f"platoon.0.vehicle={vehicle}") as simulation:
        simulation.reset()
        for name in ("platoon.0", "platoon.1"):  # driven by SUMO, and moved
            of = libsumo.vehicle
            assert (of.getDecel(name), of.getEmergencyDecel(name)) == braking
            assert of.getApparentDecel(name) == braking[0]
            assert (of.getLength(name), of.getWidth(name)) == (VEHICLES[vehicle].length, VEHICLES[vehicle].width)
