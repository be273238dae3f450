"""The cut-ins of the study `cut_ins`: their gaps, and who could avoid them."""

from __future__ import annotations

import pytest

from platoontraffic import Simulation


@pytest.mark.sumo
@pytest.mark.parametrize("gap", [20.0, 10.0, 5.0])
def test_they_come_at_their_gap_and_sumo_s_cacc_avoids_them(gap):
    follower = '{ law = "sumo", model = "CACC", imperfection = 0.0, overtakes = false }'
    changes = f"platoon.follower={follower}", f"platoon.gap_m={2 * gap + 4.7}"
    with Simulation.load("cut_ins", *changes) as simulation:
        seen = {}
        for now in simulation:
            rows = [list(now.traffic.ids).index(name) for name in ("platoon.1", "cut_in.0")]
            (own, other), (length, its_length) = now.traffic.x[rows], now.traffic.length[rows]
            seen[round(now.time, 1)] = other - own - (length + its_length) / 2, now.traffic.speed[rows[1]]
        (met,) = simulation.encounters.rows()
    assert seen[0.0][0] == pytest.approx(gap, abs=1.5)  # SUMO drives its vehicles for a step before time 0
    assert seen[0.4][1] == pytest.approx(25.0, abs=2.0)  # it drives as the two about its gap do
    assert seen[6.0][1] <= 0.5
    assert (met.vehicle, met.avoidable, met.contact) == ("platoon.1", 1, 0)


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("gap", "seed"),
    [
        (20.0, 1),
        (10.0, 1),
        (5.0, 1),
        *(pytest.param(g, s, marks=pytest.mark.slow) for g in (20.0, 15.0, 10.0, 5.0) for s in (2, 3)),
    ],
)
def test_followers_by_laser_do_not_touch_a_car_that_cuts_in_and_brakes(gap, seed):
    changes = 'platoon.follower={ law = "tracking", odometry = "car" }', f"platoon.gap_m={2 * gap + 4.7}"
    with Simulation.load("cut_ins", *changes, seed=seed) as simulation:
        touched = [event for now in simulation for event in now.events if event.kind == "collision"]
        (met,) = simulation.encounters.rows()
    assert (met.vehicle, met.avoidable) == ("platoon.1", 1)
    assert touched == []
    assert met.least_gap > 1.0
