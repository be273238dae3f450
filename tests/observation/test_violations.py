"""Red lights run, and failures to yield."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.observation.violations import Violations
from platoontraffic.world.ground import GIVES_WAY, PRIORITY, RED, Entry


def noted(signal: str, has_gap: bool, places: list[float], speeds: list[float]) -> list[tuple[int, str]]:
    """Step and kind of what is noted of a member that enters a junction in step 0 and is at places in x [m]."""
    violations, found = Violations(), []
    for step, (place, speed) in enumerate(zip(places, speeds, strict=True)):
        x, v = np.array([50.0, place]), np.array([0.0, speed])
        fleet = SimpleNamespace(ids=("other", "m"), motion=SimpleNamespace(x=x, y=0 * x, speed=v))
        entries = [Entry(1, "a_0", signal, has_gap)] if step == 0 else []
        found += [(step, one.kind) for one in violations.observe(entries, fleet) if one.row == 1]
    return found


GOES, STOPS = [0.2, 0.5, 0.9, 1.4, 2.0], [0.2, 0.3, 0.35, 0.35, 3.0]
ROLLS, HALTS = [3.0] * 5, [1.0, 0.5, 0.05, 0.0, 3.0]


@pytest.mark.parametrize(
    ("signal", "has_gap", "places", "speeds", "expected"),
    [
        (RED, True, GOES, ROLLS, [(0, "red_light")]),
        (GIVES_WAY, True, GOES, ROLLS, []),
        (PRIORITY, True, GOES, ROLLS, []),
        (GIVES_WAY, False, GOES, ROLLS, [(3, "failed_to_yield")]),
        (GIVES_WAY, False, STOPS, HALTS, []),  # with its bumper over the line; it goes on when it may
        (GIVES_WAY, False, GOES, [3.0, 3.0, 3.0, 3.0, 0.0], [(3, "failed_to_yield")]),  # it stops too late
    ],
)
def test_a_member_that_stops_just_behind_the_line_gives_way(signal, has_gap, places, speeds, expected):
    assert noted(signal, has_gap, places, speeds) == expected


def test_a_member_that_has_left_the_road_is_not_waited_for():
    violations, nobody = Violations(), SimpleNamespace(x=np.empty(0), y=np.empty(0), speed=np.empty(0))
    one = SimpleNamespace(ids=("m",), motion=SimpleNamespace(x=np.zeros(1), y=np.zeros(1), speed=np.ones(1)))
    assert not list(violations.observe([Entry(0, "a_0", GIVES_WAY, False)], one))
    assert not list(violations.observe([], SimpleNamespace(ids=(), motion=nobody)))
