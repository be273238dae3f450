"""Who is in the way of a platoon that is to depart: on its places, on its lanes, and beside it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.sumo.departures import in_the_way
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import constant, platoon

CAR = VEHICLES["car"]


def around(x: float, y: float, lateral: float) -> tuple[Fleet, TrafficSnapshot, SimpleNamespace]:
    """A platoon of two at the origin and behind it, and a car at a place with a lateral speed [m/s]."""
    fleet = Fleet.deployed(platoon(constant(0.0), constant(0.0), 1, distance=20.0, model=CAR), 0.1)
    one = np.ones(1)
    traffic = TrafficSnapshot(0.0, ("car",), x * one, y * one, 0 * one, 25 * one, CAR.length * one, CAR.width * one)
    vehicle = SimpleNamespace(getIDList=lambda: ("car", "robot.0"), getLateralSpeed=lambda name: lateral)
    return fleet, traffic, SimpleNamespace(vehicle=vehicle, lane=SimpleNamespace(getLastStepVehicleIDs=lambda lane: ()))


@pytest.mark.parametrize(
    ("x", "y", "lateral", "waits"),
    [
        (0.0, 3.2, 0.0, False),  # beside the leader, and stays there
        (0.0, 3.2, -1.0, True),  # begins to come over
        (-12.0, -3.2, 0.5, True),  # between the two, from the other side
        (0.0, 6.4, -1.0, False),  # on the lane after the next
        (60.0, 3.2, -1.0, False),  # far ahead
        (0.0, 0.5, 0.0, True),  # on its place
    ],
)
def test_a_platoon_waits_for_a_vehicle_that_changes_lanes_beside_it(x, y, lateral, waits):
    assert in_the_way(*around(x, y, lateral)) == (["car"] if waits else [])
