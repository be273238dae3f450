"""A law is a function: the same call gives the same decision, and changes nothing that the law is given."""

from __future__ import annotations

import copy
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import Decision, Law, Sensed, Signals
from platoontraffic.controllers.registry import find_law, law_names
from platoontraffic.controllers.tracker.trail import Trail
from platoontraffic.lidar import PRESETS, Mount, Scene
from platoontraffic.road.route import Route
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Drive
from tests.support.bench import Prescribed, drive, platoon

CAR = CARS["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03))
ROUTE = Route.along(("road",), np.array([[-200.0, 0.0], [400.0, 0.0]]), np.full(2, 12.0))
ROAD = Scene.from_shapely(walls=[shapely.box(-200, -4, 400, 4)])
KINDS = {name: find_law(name, Path()).kind for name in law_names()}
LEARNED = Path("docs/examples/learned_follower/follower.npz")
LAWS = [kind() for name, kind in KINDS.items() if not kind.native and name != "policy"]
LAWS += [KINDS["policy"](file=LEARNED)]
LAWS += [KINDS["tracking"](on_loss="drive"), KINDS["tracking"](policy="obey"), KINDS["printed"](on_loss="hold")]


def counted(trail: Trail) -> list[np.ndarray]:
    return [points[:size] for points, size in zip(trail.points, trail.size, strict=True)]


def same(one: Any, other: Any) -> None:
    """Asserts that two nested records are equal in every array."""
    assert type(one) is type(other)
    if isinstance(one, Trail):  # points that do not count are undefined
        one, other = ([trail.size, *counted(trail)] for trail in (one, other))
    if is_dataclass(one):
        one, other = ([getattr(record, f.name) for f in fields(record)] for record in (one, other))
    if isinstance(one, list | tuple):
        for a, b in zip(one, other, strict=True):
            same(a, b)
    else:
        np.testing.assert_array_equal(one, other)


@dataclass(frozen=True)
class Twice(Law):
    """Calls another law twice in each step, and asserts that it is a function."""

    law: Law

    @property
    def needs(self) -> frozenset[str]:
        return frozenset(self.law.needs)

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        if "signals" in self.needs:
            n = len(sensed.speed)
            line = Signals(np.full(n, 60.0), np.ones(n, bool), *np.zeros((2, n), bool), np.zeros(n, int))
            sensed = replace(sensed, signals=line)
        given = copy.deepcopy((sensed, memory))
        first = self.law(sensed, memory, dt)
        same((sensed, memory), given)
        kept = copy.deepcopy(first)
        same(self.law(sensed, memory, dt), kept)
        same(first, kept)
        return first


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_law_called_twice_decides_the_same_and_changes_nothing_it_is_given(law):
    leader = Prescribed(lambda time: Drive(-1.0 if time > 1.0 else 0.5, 0.002))
    members = platoon(leader, Twice(law), 2, distance=12.0, model=CAR, eye=EYE, speed=8.0)
    log = drive([replace(member, route=ROUTE) for member in members], ROAD, 2.0, dt=0.1)
    assert len(log.time) == 21


def test_every_shipped_law_but_those_that_sumo_drives_is_called():
    assert {type(law) for law in LAWS} == {kind for kind in KINDS.values() if not kind.native}
