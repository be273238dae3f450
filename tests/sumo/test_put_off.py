"""Lane changes that a platoon puts off to the next edge."""

from __future__ import annotations

import math
from dataclasses import replace
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.road.lane_routes import CHANGING
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.shipped import networks
from platoontraffic.sumo import later_changes
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.later_changes import Blocked, LaterChanges
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.records import changed
from platoontraffic.world.fleet import Fleet
from tests.support.bench import platoon

EDGES = "e0_e1", "e1_e2", "e2_e_exit"


@pytest.fixture
def fleet_and_later():
    """Four cars before the place at which they are to leave their lane; and what gives them later lane changes."""
    network, car, law = Network.read(networks()["highway"]), VEHICLES["car"], TrackingFollower(on_loss="drive")
    route = Route.along(EDGES, *network.route_lanes(EDGES, 1, position=60.0)).drivable_by(car)
    change = next(line for line in route.lines if line.state == CHANGING)
    (x, y), (ahead_x, ahead_y) = route.line.at(np.array([change.station - 10.0, change.station - 9.0]))
    at = float(x), float(y), math.atan2(ahead_y - y, ahead_x - x)
    members = platoon(PathLeader(), law, 3, at=at, distance=4.0, model=car)
    fleet = Fleet.deployed([replace(m, route=route) for m in members], 0.1)
    fleet = changed(fleet, progress=fleet.progress.located(fleet.model, fleet.motion, np.inf))
    later = LaterChanges(network, SimpleNamespace(lane=SimpleNamespace(getWidth=lambda _: 3.2)), None)
    return fleet, later, change


def changes(fleet: Fleet) -> list[str]:
    """Edge of the first lane change of each member."""
    return [next(one.lane for one in m.route.lines if one.state == CHANGING).rpartition("_")[0] for m in fleet.members]


def test_the_members_behind_put_it_off_too(fleet_and_later):
    fleet, later, change = fleet_and_later
    later._blocked = {name: Blocked(change, -10.0, False, inf) for name in fleet.ids}
    after = later._put_off_one(fleet, 1)
    assert changes(after) == ["e0_e1", "e1_e2", "e1_e2", "e1_e2"]
    assert later._put_off_one(after, 2) is after  # it was blocked as well, and has another route now
    np.testing.assert_allclose(after.progress.station, fleet.progress.station, atol=0.1)


def test_those_that_have_begun_it_keep_it(fleet_and_later):
    fleet, later, change = fleet_and_later
    later._blocked = {fleet.ids[0]: Blocked(change, -10.0, False, inf)}
    fleet.progress.station[2] = change.station  # of its rear axle
    assert changes(later._put_off_one(fleet, 0)) == ["e1_e2", "e1_e2", "e0_e1", "e1_e2"]


@pytest.mark.parametrize(("free", "is_later"), [(200.0, True), (40.0, False)])
def test_it_moves_on_beside_vehicles_that_pass_but_not_into_a_queue(fleet_and_later, free, is_later):
    fleet, later, change = fleet_and_later
    later._blocked = {fleet.ids[0]: Blocked(change, -10.0, True, free)}
    speed = np.full(len(fleet), 12.0)
    fleet = changed(fleet, motion=replace(fleet.motion, speed=speed))
    after = later._put_off_one(fleet, 0).members[0].route
    (station,) = (one.station for one in after.lines if one.state == CHANGING and one.lane == change.lane)
    assert (station > change.station + 10.0) == is_later


@pytest.mark.parametrize("free", [40.0, inf])
def test_it_is_put_off_only_where_no_queue_stands_on_the_lane(fleet_and_later, free):
    fleet, later, change = fleet_and_later
    later._blocked = {fleet.ids[0]: Blocked(change, -10.0, False, free)}
    assert changes(later._put_off_one(fleet, 0))[0] == ("e1_e2" if free == inf else "e0_e1")


@pytest.mark.parametrize(("further", "free", "is_later"), [(True, inf, True), (True, 30.0, False), (False, inf, False)])
def test_one_that_has_hardly_begun_drives_on_or_keeps_its_change(fleet_and_later, further, free, is_later):
    """It stood at the begin of its lane, where the vehicles that came by were soon gone."""
    fleet, later, change = fleet_and_later
    over = 14.0  # farther than one step
    fleet.progress.station[0] = change.station + over - fleet.progress.front[0]
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), 5.0)))
    later._blocked = {fleet.ids[0]: Blocked(change, over, further, free)}
    after = later._put_off_one(fleet, 0)
    assert (after is not fleet) == is_later
    if is_later:
        new = next(one for one in after.members[0].route.lines if one.state == CHANGING)
        assert new.lane == change.lane
        assert new.station > change.station + over + 5.0  # what it drives in a second


def test_of_several_blocked_changes_the_first_one_counts(fleet_and_later):
    _, later, change = fleet_and_later
    later._room = SimpleNamespace(is_better_later=lambda *_: True, free_road=lambda *_: inf)
    for line in (change, change._replace(lane=change.onto)):
        later.note(line, 10.0, Ego("m.0", change.lane, 0.0, 4.74))
    assert later._blocked["m.0"].line == change


def test_routes_that_no_member_drives_any_more_are_forgotten(fleet_and_later, monkeypatch):
    fleet, later, change = fleet_and_later
    monkeypatch.setattr(later_changes, "KEPT", 3)
    route = fleet.members[0].route
    for key in [(route, change, 0.0), *((changed(route), change, float(k)) for k in range(5))]:
        dict.__setitem__(later._later, key, None)
    later.put_off(fleet)
    assert [key[0] for key in later._later] == [route]
