"""Stop lines that are far ahead: what is remembered of them changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.simulation import Simulation
from platoontraffic.sumo.stoplines import StopLines

pytestmark = pytest.mark.sumo


def driven() -> np.ndarray:
    """Where the members of two platoons come to on a street with lights, junctions and lane changes."""
    with Simulation.load("corridor_two_platoons", "run.duration_s=40") as simulation:
        return np.array([(*now.fleet.motion.x, *now.fleet.motion.y) for now in simulation])


def test_members_drive_as_if_each_line_were_looked_at_in_every_step(monkeypatch):
    expected, times = driven(), []
    still_far = StopLines._still_far
    monkeypatch.setattr(StopLines, "_still_far", lambda *given: times.append(still_far(*given)))
    assert (driven() == expected).all()
    assert sum(state is not None for state in times) > 100
