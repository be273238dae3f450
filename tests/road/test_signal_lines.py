"""Stop lines of traffic lights."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic import shipped
from platoontraffic.road.network import Network


@pytest.mark.parametrize("name", ["corridor", "grid"])
def test_every_link_of_a_light_has_its_part_of_the_end_of_its_lane(name):
    network = Network.read(shipped.networks()[name])
    lines = network.signal_lines()
    of_lights = {}
    for line, light, number in lines:
        of_lights.setdefault(light, set()).add(number)
        (ax, ay), (bx, by) = line.coords
        assert network.drivable.buffer(0.05).covers(line), (light, number)
        assert 0.3 < np.hypot(bx - ax, by - ay) < 4.0
    for light, numbers in of_lights.items():
        assert numbers == set(range(len(numbers))), light


def test_parts_of_a_lane_make_up_its_width():
    network = Network.read(shipped.networks()["corridor"])
    total = sum(line.length for line, *_ in network.signal_lines())
    arms = 4  # of the junction with the light, with a lane each
    assert total == pytest.approx(arms * network.lane_width("west_light"))
