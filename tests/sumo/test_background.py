"""The list of vehicles near members, which is kept up to date from step to step."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.simulation import Simulation
from platoontraffic.sumo.background import STRETCHED, Background, _farther
from platoontraffic.sumo.world import World

REACH, DT = 50.0, 0.1  # [m], [s]


@pytest.mark.parametrize(("own", "its", "stretched", "jump"), [
    (40.0, 0.0, 1.0, 0.0), (0.0, 40.0, 1.0, 0.0), (30.0, 30.0, 1.0, 0.0), (0.0, 40.0, STRETCHED, 0.0),
    (0.0, 0.0, 1.0, 6.4),
])  # fmt: skip
def test_one_that_comes_is_on_the_list_before_it_is_in_range(own, its, stretched, jump):
    """Whenever the distances were measured last. jump: by which it changes over two lanes towards the member [m]"""
    for begin in np.arange(50.5, 130.0, 0.5):
        time = 0.0

        def place():
            return begin - stretched * its * time - jump * (time > 0.3), 0.0  # noqa: B023

        vehicle = SimpleNamespace(
            getIDList=lambda: ("a", "m"), getPosition=lambda name: place(), getSpeed=lambda name: its,
            getLength=lambda name: 1.0, getWidth=lambda name: 2.0,
        )  # fmt: skip
        background, members = Background(SimpleNamespace(vehicle=vehicle), None), (SimpleNamespace(id="m"),)
        while time < 3.0:
            here = np.array([own * time])
            motion = SimpleNamespace(x=here, y=np.zeros(1), speed=np.array([own]))
            fleet = SimpleNamespace(members=members, motion=motion, model=SimpleNamespace(length=np.array([1.0])))
            background._time = time
            near, _ = background._names(fleet, REACH, frozenset())
            assert "a" in near or abs(place()[0] - here[0]) > REACH, (begin, time)
            time += DT


@pytest.mark.parametrize(("vehicles", "members"), [(200, 60), (50, 1), (9, 0), (0, 3)])
def test_what_is_farther_than_its_reach_from_every_member(vehicles, members):
    rng = np.random.default_rng(vehicles)
    fronts, (x, y) = rng.uniform(0, 1000, (vehicles, 2)), rng.uniform(0, 1000, (2, members))
    x[1::2] = x[:-1:2][: len(x[1::2])]  # pairs have one x
    reach = rng.uniform(0, 200, vehicles)
    away = np.hypot(fronts[:, :1] - x, fronts[:, 1:] - y)
    np.testing.assert_array_equal(_farther(fronts, x, y, reach), (away > reach[:, None]).all(axis=1))


@pytest.mark.sumo
def test_the_list_of_near_vehicles_is_that_of_sumo_as_they_come_and_go():
    came = went = 0
    with Simulation.load("grid_platoons", "sumo.warm_up_s=200") as simulation:
        simulation.reset()
        sumo, background = simulation.sumo, simulation.world._background
        for step in range(200):
            if step == 100:  # by somebody else: SUMO counts no arrival
                sumo.vehicle.remove(background._near[7])
            simulation.step()
            came += sumo.simulation.getDepartedNumber()
            went += sumo.simulation.getArrivedNumber()
            known = [name for name in sumo.vehicle.getIDList() if name not in background._skipped]
            assert background._near == known
    assert came > 20
    assert went > 1


@pytest.mark.sumo
def test_what_is_observed_is_the_same_with_all_vehicles_and_whatever_is_recorded(monkeypatch):
    """Post-encroachment times above 4 s were missing where nobody has a laser, unless all traffic was recorded."""

    def observed(every: float):
        sumo_drives = "platoon.leader=sumo", "platoon.follower=sumo"
        changes = f"record.traffic_every_s={every}", "run.duration_s=301"
        with Simulation.load("highway_traffic", *changes, *sumo_drives) as simulation:
            log, clearance = [simulation.reset()], []
            while log[-1].time < 22.0:
                clearance.append(log[-1].measures.clearance.copy())
                log.append(simulation.step())
        return [now.events for now in log], np.array(clearance), log

    events, clearance, log = observed(0.5)
    assert any(event.kind == "encroachment" and event.duration > 4.0 for now in events for event in now)
    assert 1.0 < np.nanmin(clearance) < 10.0
    assert [now.whole is not None for now in log] == [now.step % 5 == 0 for now in log]
    assert {*log[-1].traffic.ids} < {*log[-1].whole.ids}
    snapshot = World.snapshot
    monkeypatch.setattr(World, "snapshot", lambda world, fleet, *_: snapshot(world, fleet))
    with_all, its_clearance, _ = observed(1000.0)
    assert with_all == events
    np.testing.assert_array_equal(its_clearance, clearance)


@pytest.mark.sumo
def test_no_vehicle_in_range_of_a_member_is_left_out_and_most_others_are():
    left_out = near = 0
    with Simulation.load("highway_platoon", "run.duration_s=40", "record.traffic_every_s=1000") as simulation:
        for instant in simulation:
            sumo, background = simulation.sumo, simulation.world._background
            own = instant.fleet.motion
            known = {*instant.traffic.ids}
            for name in sumo.vehicle.getIDList():
                x, y = sumo.vehicle.getPosition(name)
                if np.hypot(own.x - x, own.y - y).min() < instant.fleet.sight:
                    near += 1
                    assert name in known, (instant.time, name)
                left_out += name in background._skipped and name not in instant.fleet.row_of
    assert near > 1000
    assert left_out > near
