"""Bare ground: members are where the fleet has them, and depart and arrive as in SUMO."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.native import SumoDriver
from platoontraffic.controllers.path import PathLeader
from platoontraffic.road.route import Route
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import BareGround
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import BLIND, constant, platoon

STEP = 0.1
ROUTE = Route.along(("road",), [(0.0, 0.0), (100.0, 0.0)], [10.0])


def fleet_of(size: int, *, departs: float = 0.0, name: str = "robot") -> Fleet:
    members = platoon(constant(0.5), constant(0.5), size - 1)
    renamed = [replace(m, id=f"{name}.{i}", platoon=name, departs=departs) for i, m in enumerate(members)]
    return Fleet.deployed(renamed, STEP)


def led_along_route(x: float) -> Fleet:
    """A leader that arrives by itself, with its centre at x, and a follower behind it without a route."""
    leader, follower = platoon(PathLeader(), constant(0.5), 1, at=(x, 0.0, 0.0), model=VEHICLES["car"])
    return Fleet.deployed([replace(leader, route=ROUTE), follower], STEP)


def bodies(name: str) -> TrafficSnapshot:
    return TrafficSnapshot(0.0, (name,), *(np.array([v]) for v in (5.0, 1.0, 0.0, 0.0, 0.6, 0.6)))


def test_members_are_seen_where_the_fleet_has_them():
    fleet, ground = fleet_of(3), BareGround(STEP)
    fleet = ground.deploy(fleet)
    for step in range(3):
        traffic = ground.snapshot(fleet, reach=1.0)
        assert traffic.time == pytest.approx(STEP * step)
        assert traffic.ids == ("robot.0", "robot.1", "robot.2")
        assert np.array_equal(traffic.x, fleet.motion.x)
        fleet = fleet.moved(STEP)
        ground.place(fleet)
        fleet = ground.advance(fleet)


def test_obstacles_stand_behind_the_members_until_they_are_held_no_more():
    ground = BareGround(STEP)
    fleet = ground.deploy(fleet_of(1))
    ground.hold(bodies("box"), {})
    assert ground.snapshot(fleet).ids == ("robot.0", "box")
    ground.hold(TrafficSnapshot(0.0, (), *np.empty((6, 0))), {})
    assert ground.snapshot(fleet).ids == ("robot.0",)


def test_a_platoon_departs_at_the_step_of_its_time():
    ground = BareGround(STEP)
    fleet = ground.deploy(fleet_of(1), [fleet_of(2, departs=0.5, name="c"), fleet_of(2, departs=0.3, name="b")])
    sizes = []
    for _ in range(6):
        sizes.append((round(ground.snapshot(fleet).time, 3), len(fleet), len(ground.waiting)))
        fleet = ground.advance(fleet)
    assert sizes == [(0.0, 1, 2), (0.1, 1, 2), (0.2, 1, 2), (0.3, 3, 1), (0.4, 3, 1), (0.5, 5, 0)]
    assert [m.platoon for m in fleet.members] == ["robot", "b", "b", "c", "c"]


def test_a_leader_that_arrives_takes_its_followers_with_it():
    ground = BareGround(STEP)
    fleet = ground.deploy(led_along_route(50.0))
    assert len(ground.advance(fleet)) == 2
    fleet = ground.deploy(led_along_route(100.0))
    assert len(ground.advance(fleet)) == 0


def test_there_are_no_roads_and_no_stop_lines():
    ground = BareGround(STEP)
    fleet = ground.deploy(fleet_of(2))
    assert ground.roads(fleet) == [("", "")] * 2
    assert ground.signals(fleet) is None
    assert ground.entries(fleet) == []


def test_a_member_that_only_sumo_can_drive_is_refused():
    member = Member("a.0", "a", 0, VEHICLES["car"], BLIND, SumoDriver(), "", 0, 0.0, (0.0, 0.0, 0.0), ROUTE)
    with pytest.raises(ValueError, match=r"a\.0: only SUMO can drive it"):
        BareGround(STEP).deploy(Fleet.deployed([member], STEP))
