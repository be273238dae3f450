"""Stop lines that are far ahead: what is remembered of them changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.road.lane_routes import Line
from platoontraffic.simulation import Simulation
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.far_lines import FarLines, LineState
from platoontraffic.sumo.stoplines import RIGHT_OF_WAY


def driven() -> np.ndarray:
    """Where the members of two platoons come to on a street with lights, junctions and lane changes."""
    with Simulation.load("corridor_two_platoons", "run.duration_s=40") as simulation:
        return np.array([(*now.fleet.motion.x, *now.fleet.motion.y) for now in simulation])


@pytest.mark.sumo
def test_members_drive_as_if_each_line_were_looked_at_in_every_step(monkeypatch):
    expected, still, times = driven(), FarLines.still, []

    def never(*given):
        is_far, distance = still(*given)
        times.append(is_far.sum())
        return np.zeros_like(is_far), distance

    monkeypatch.setattr(FarLines, "still", never)
    assert (driven() == expected).all()
    assert sum(times) > 100


@pytest.mark.parametrize(
    ("station", "speed", "lane", "minor", "expected"),
    [
        (30.0, 10.0, "a_0", False, True),
        (30.0, 17.0, "a_0", False, False),  # it has to know from 72 m + 5 m on
        (30.0, 17.0, "a_0", True, True),  # cross traffic is not looked at from there
        (87.0, 17.0, "a_0", True, True),
        (88.0, 17.0, "a_0", True, False),
        (30.0, 10.0, "a_1", False, False),
        (9.0, 10.0, "a_0", False, False),  # it is not beyond the line before
    ],
)
def test_a_line_is_looked_at_again_where_something_has_changed(station, speed, lane, minor, expected):
    state = LineState(75.0, not minor, minor, False, RIGHT_OF_WAY)
    line, ego = Line(100.0, "m", "", 0, "a_0", "b_0", (":x_0",), 10.0), Ego("m", "a_0", 5.0, 5.0)
    far = FarLines([ego._replace(id="another"), ego])
    far.note(1, ego, 10.0, line, state, gives_way=minor)
    is_far, distance = far.still(np.array([0.0, station]), np.array([0.0, speed]), ["a_0", lane])
    assert (is_far == [False, expected]).all()
    assert distance[1] == 100.0 - station
    assert LineState(*(values[1] for values in far.state))[1:] == state[1:]
    others = FarLines([ego, ego, ego])
    others.take_over(far, [(2, 1)])
    assert others.lines == [None, None, line]
    assert (others.still(np.full(3, station), np.full(3, speed), [lane] * 3)[0] == [False, False, expected]).all()


def test_a_near_line_is_looked_at_in_every_step():
    ego = Ego("m", "a_0", 10.0, 5.0)
    far, line = FarLines([ego]), Line(100.0, "m", "", 0, "a_0", "b_0", (), 10.0)
    for gives_way, distance in ((False, 29.9), (True, 12.5)):
        far.note(0, ego, 10.0, line, LineState(distance, True, False, False, 0), gives_way)
        assert not far.still(np.array([50.0]), np.array([0.0]), ["a_0"])[0].any()
