"""Runs that would never end, since nobody on the road moves any more."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis.outcome import headline
from platoontraffic.shipped import networks
from platoontraffic.simulation import Simulation
from platoontraffic.sumo import gridlock
from platoontraffic.sumo.gridlock import Gridlock

TRIPS = """<routes>
    <vType id="private" vClass="private" sigma="0"/>
    <trip id="member" type="private" depart="1" from="west_light" to="light_prio" departSpeed="10"/>
    <trip id="later" type="private" depart="5000" from="west_light" to="light_prio"/>
</routes>
"""


@pytest.mark.sumo
def test_a_run_ends_when_nobody_has_moved_for_long_though_there_are_more_departures(tmp_path, monkeypatch):
    """Before a light that stays red."""
    monkeypatch.setattr(gridlock, "AFTER", 60.0)
    (tmp_path / "trips.rou.xml").write_text(TRIPS)
    file = tmp_path / "red.toml"
    net = networks()["corridor"].as_posix()  # by its path: without its traffic
    file.write_text(
        f'[sumo]\nnet = "{net}"\nroutes = ["trips.rou.xml"]\n[run]\nduration_s = 300\n[[equip]]\nshare = 1.0\n'
    )
    with Simulation.load(file) as simulation:
        stood = None
        for now in simulation:
            for light in simulation.sumo.trafficlight.getIDList():
                states = simulation.sumo.trafficlight.getRedYellowGreenState(light)
                simulation.sumo.trafficlight.setRedYellowGreenState(light, "r" * len(states))
            if stood is None and len(now.fleet) and now.time > 10.0 and now.fleet.motion.speed[0] < 0.1:
                stood = now.time
        assert now.ended == simulation.outcome.ended == "gridlock"
    assert 59.0 < now.time - stood < 60.0 + 10.1


def fleet_of(*speeds: float) -> Any:
    """Members with speeds [m/s]."""
    motion, row_of = SimpleNamespace(speed=np.array(speeds)), {f"m.{i}": i for i in range(len(speeds))}
    return type("Some", (), {"__len__": lambda _: len(speeds), "motion": motion, "row_of": row_of})()


@pytest.mark.parametrize(
    ("member", "speed", "is_stopped", "ends"),
    [
        (0.0, 0.0, False, True),
        (0.2, 0.0, False, False),
        (-0.2, 0.0, False, False),
        (None, 0.0, False, False),
        (0.0, 0.2, False, False),
        (0.0, 0.0, True, False),
    ],
)
def test_nobody_moves_or_stops_by_plan(member, speed, is_stopped, ends):
    vehicle = SimpleNamespace(
        getIDList=lambda: ["m.0", "c"], getSpeed={"m.0": 9.0, "c": speed}.get, isStopped=lambda _: is_stopped
    )
    fleet = fleet_of(*([] if member is None else [member]))
    lock = Gridlock(SimpleNamespace(vehicle=vehicle))
    found = [lock.observe(fleet, time) for time in np.arange(0.0, 640.0, 5.0)]
    assert found[:120] == [False] * 120
    assert found[-1] == ends


def test_a_move_between_starts_the_time_anew():
    vehicle = SimpleNamespace(getIDList=list, getSpeed=None, isStopped=None)
    moving, standing = fleet_of(1.0), fleet_of(0.0)
    lock = Gridlock(SimpleNamespace(vehicle=vehicle))
    found = {time: lock.observe(moving if time == 590.0 else standing, time) for time in np.arange(0.0, 1300.0, 10.0)}
    assert not any(found[time] for time in found if time < 1190.0)
    assert found[1190.0]


def test_the_headline_says_so():
    row = {"time_s": 812.0, "kind": "end", "vehicle_id": "", "other_id": "", "detail": "gridlock", "what": "gridlock"}
    events = pd.DataFrame([row])
    metrics = pd.DataFrame({"scope": [], "metric": [], "value": []})
    assert headline(events, metrics).endswith("It ended at 812 s in gridlock: nobody had moved for ten minutes.")
    assert "gridlock" not in headline(events.assign(detail="arrived"), metrics)
