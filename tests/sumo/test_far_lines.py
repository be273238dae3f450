"""Stop lines that are far ahead: what is remembered of them changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.road.lane_routes import Line
from platoontraffic.simulation import Simulation
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.stoplines import RIGHT_OF_WAY, FarLine, LineState, StopLines


def driven() -> np.ndarray:
    """Where the members of two platoons come to on a street with lights, junctions and lane changes."""
    with Simulation.load("corridor_two_platoons", "run.duration_s=40") as simulation:
        return np.array([(*now.fleet.motion.x, *now.fleet.motion.y) for now in simulation])


@pytest.mark.sumo
def test_members_drive_as_if_each_line_were_looked_at_in_every_step(monkeypatch):
    expected, times = driven(), []
    still_far = StopLines._still_far
    monkeypatch.setattr(StopLines, "_still_far", lambda *given: times.append(still_far(*given)))
    assert (driven() == expected).all()
    assert sum(state is not None for state in times) > 100


@pytest.mark.parametrize(
    ("station", "speed", "lane", "route", "minor", "is_far"),
    [
        (30.0, 10.0, "a_0", "route", False, True),
        (30.0, 17.0, "a_0", "route", False, False),  # it has to know from 72 m + 5 m on
        (
            30.0,
            17.0,
            "a_0",
            "route",
            True,
            True,
        ),  # cross traffic is not looked at from there: the law may not count on it
        (87.0, 17.0, "a_0", "route", True, True),
        (88.0, 17.0, "a_0", "route", True, False),
        (30.0, 10.0, "a_1", "route", False, False),
        (30.0, 10.0, "a_0", "another", False, False),
        (9.0, 10.0, "a_0", "route", False, False),  # it is not beyond the line before
    ],
)
def test_a_line_is_looked_at_again_where_something_has_changed(station, speed, lane, route, minor, is_far):
    state = LineState(75.0, not minor, minor, False, RIGHT_OF_WAY)
    far = FarLine("route", "a_0", 10.0, Line(100.0, "m", "", 0, "a_0", "b_0", (":x_0",), 10.0), state)
    lines = StopLines(None, None)
    expected = state._replace(distance=100.0 - station) if is_far else None
    assert lines._still_far(far, route, station, lane, speed, Ego("m", "", 0.0, 5.0)) == expected
