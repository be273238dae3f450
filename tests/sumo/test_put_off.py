"""Lane changes that a platoon puts off to the next edge."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.controllers.law import Body, Sensed, Signals
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.road.lane_routes import CHANGING
from platoontraffic.road.later_change import latest
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.shipped import networks
from platoontraffic.simulation import Simulation
from platoontraffic.sumo import later_changes
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.lane_choice import LaneChoice
from platoontraffic.sumo.later_changes import Blocked, LaterChanges
from platoontraffic.sumo.room_to_change import Slowest
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.records import changed
from platoontraffic.world.fleet import Fleet
from tests.support.bench import platoon

BODY = 4.74, 1.76, -1.27, 4.3, 0.15, 0.1, 0.2, 0.2, 9.0  # of a car, as `Body`
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


def test_a_slow_one_without_room_stays_on_a_lane_that_it_need_not_leave(fleet_and_later):
    """Two members, each of which wanted to go over to the lane of the other, stood side by side for good."""
    fleet, _, change = fleet_and_later
    choice, blocked = LaneChoice(Network.read(networks()["highway"]), None, None), Blocked(change, -5.0, False, inf)
    choice._may_stay = dict.fromkeys(fleet.ids[:3], change.lane)
    assert choice.given_up(fleet, {}) is fleet
    slow = changed(fleet, motion=changed(fleet.motion, speed=np.array([0.0, 8.0, 0.0, 0.0])))
    after = choice.given_up(slow, {name: blocked for name in fleet.ids if name != fleet.ids[2]})
    assert changes(after) == ["e1_e2", "e0_e1", "e0_e1", "e0_e1"]  # the second is not slow, the last has to leave it
    assert choice.given_up(after, {fleet.ids[2]: blocked._replace(over=0.2 * change.across)}) is after  # it is over


def test_in_a_queue_one_with_room_changes_lanes_where_it_is_and_leaves_the_trail_ahead(fleet_and_later):
    fleet, later, change = fleet_and_later
    left = []
    law = SimpleNamespace(
        off_trail=lambda memory, rows: left.append(rows.tolist()) or memory, braking_for=lambda _: None
    )
    fleet = changed(fleet, groups=tuple(group._replace(law=law, memory="memory") for group in fleet.groups))
    later.note_in_queue(change, 7.3, Ego(fleet.ids[2], change.lane, 1.0, 5.0))
    after = later.put_off(fleet)
    first = [next(one.station for one in m.route.lines if one.state == CHANGING) for m in after.members]
    assert first == pytest.approx([change.station] * 2 + [change.station - 7.0, change.station], abs=0.4)
    assert left == [[1, 2]]  # of the followers: also that behind it, which would follow it over, beside a car there
    later.forget()
    assert later.put_off(fleet) is fleet


def test_one_with_room_in_a_queue_may_be_gone_or_have_another_route_by_then(fleet_and_later):
    """Members are removed, and led round bodies, after lines are judged."""
    fleet, later, change = fleet_and_later
    later.note_in_queue(change._replace(station=1.0), 7.3, Ego(fleet.ids[2], change.lane, 1.0, 5.0))
    later.note_in_queue(change, 7.3, Ego("gone", change.lane, 1.0, 5.0))
    assert later.put_off(fleet) is fleet


def test_one_with_room_in_a_queue_does_not_put_its_change_off(fleet_and_later):
    fleet, later, change = fleet_and_later
    later._blocked = {fleet.ids[2]: Blocked(change, -10.0, False, inf)}
    later.note_in_queue(change, 7.3, Ego(fleet.ids[2], change.lane, 1.0, 5.0))
    assert not later._blocked


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


@pytest.mark.parametrize("further", [True, False])
def test_one_that_drove_past_its_change_gets_another_one_ahead_of_it(fleet_and_later, further):
    fleet, later, change = fleet_and_later
    over = change.across + 30.0
    fleet.progress.station[0] = change.station + over - fleet.progress.front[0]
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), 5.0)))
    blocked = Blocked(change, over, further, 25.0)
    assert blocked.missed
    later._blocked = {fleet.ids[0]: blocked}
    after = later.put_off(fleet)
    new = next(one for one in after.members[0].route.lines if one.state == CHANGING)
    assert new.lane == change.lane
    assert change.station + over + 5.0 < new.station < change.station + over + 5.0 + 16.1
    assert new.across < change.across


@pytest.mark.parametrize(("left", "free", "is_later"), [(15.0, inf, True), (-1.0, inf, False), (15.0, 2.0, False)])
def test_one_that_drove_past_its_change_keeps_it_where_another_one_fits_no_more(fleet_and_later, left, free, is_later):
    """Before its lane ends, or before the queue ahead. One got a change most of which was behind it, and went over
    without looking for room; another one, with room beside it, waited in a queue for a change beyond that.

    left: distance from the shortest change that fits last [m]
    """
    fleet, later, change = fleet_and_later
    over = latest(fleet.members[0].route, change, 3.2, 4.74) - left
    fleet.progress.station[0] = change.station + over - fleet.progress.front[0]
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), 10.0)))
    later._blocked = {fleet.ids[0]: Blocked(change, over, True, free)}
    after = later.put_off(fleet)
    assert (after is not fleet) == is_later
    if is_later:
        new = next(one for one in after.members[0].route.lines if one.state == CHANGING)
        assert change.station + over < new.station


def test_beside_a_change_that_it_drove_past_room_is_looked_for_where_it_is(fleet_and_later):
    fleet, later, change = fleet_and_later
    looked = []
    later._room = SimpleNamespace(
        has_missed=lambda *_: True,
        free_road=lambda line, distance, _: looked.append((line.to_end, distance)) or inf,
        slowest_beside=lambda line, distance, _: looked.append((line.to_end, distance)) or Slowest(inf, inf),
        goes_back=lambda *_: False,
        is_better_later=lambda line, distance, *_: looked.append((line.to_end, distance)) or True,
        is_fast=lambda _: False,
    )
    later.note(change, -60.0, Ego("m.0", change.lane, 5.0, 4.74), fleet.members[0].route)
    assert looked == [(change.to_end - 60.0, 0.0)] * 3
    assert later._blocked["m.0"].missed


def test_of_several_blocked_changes_the_first_one_counts(fleet_and_later):
    fleet, later, change = fleet_and_later
    later._room = SimpleNamespace(
        has_missed=lambda *_: False,
        goes_back=lambda *_: False,
        is_better_later=lambda *_: True,
        slowest_beside=lambda *_: Slowest(0.0, 0.0),
        free_road=lambda *_: inf,
        is_fast=lambda _: True,
    )
    for line in (change, change._replace(lane=change.onto)):
        later.note(line, 10.0, Ego("m.0", change.lane, 0.0, 4.74), fleet.members[0].route)
    assert later._blocked["m.0"].line == change


def room_beside(slowest: float, free: float = inf, is_fast: bool = True) -> SimpleNamespace:
    """Of a lane change that is blocked by vehicles of a least speed [m/s]."""
    return SimpleNamespace(
        has_missed=lambda *_: False,
        goes_back=lambda *_: False,
        is_better_later=lambda *_: False,
        slowest_beside=lambda *_: Slowest(slowest, slowest),
        free_road=lambda *_: free,
        is_fast=lambda _: is_fast,
    )


def test_beside_traffic_that_flows_it_drives_on_to_where_its_lane_ends(fleet_and_later):
    """5 lane widths and a length are left there. It stops at the begin of its change beside a queue, or in one, if it
    can: from 15 m/s within 25 m.
    """
    fleet, later, change = fleet_and_later
    route = fleet.members[0].route
    loop = Route.along((), np.array([(0.0, 0.0), (500.0, 0.0), (0.0, 500.0)]), np.full(3, 30.0), [change], closed=True)
    ends = change.to_end - 5 * 3.2 - 4.74
    cases = [(inf, inf, 40.0, True), (7.9, inf, 40.0, False), (0.0, inf, 40.0, False), (25.0, 40.0, 40.0, False)]
    for slowest, free, distance, drives_on in [
        *cases,
        (0.0, inf, 24.0, True),
        (25.0, 40.0, 24.0, True),
        (0.0, inf, -1.0, False),
    ]:
        later.forget()
        later._room = room_beside(slowest, free)
        stop = later.note(change, distance, Ego("m.0", change.lane, 15.0, 4.74), route)
        assert stop == pytest.approx(distance + ends if drives_on else distance)
        later.forget()
        later._room = room_beside(slowest, free, is_fast=False)
        assert later.note(change, distance, Ego("m.0", change.lane, 15.0, 4.74), route) == distance
        later.forget()
        later._room = room_beside(slowest, free)
        assert later.note(change, distance, Ego("m.0", change.lane, 15.0, 4.74), loop) == distance


@pytest.mark.parametrize(("free", "is_fast", "further"), [(inf, True, True), (40.0, True, False), (inf, False, False)])
def test_on_a_free_lane_of_a_fast_road_it_does_not_wait_beside_a_queue(fleet_and_later, free, is_fast, further):
    """Before an exit a platoon stood on the lane of those that drive on, beside the queue's first 60 m of 380 m."""
    fleet, later, change = fleet_and_later
    later._room = room_beside(0.5, free, is_fast)
    later.note(change, 40.0, Ego("m.0", change.lane, 8.0, 4.74), fleet.members[0].route)
    assert later._blocked["m.0"].further is further
    assert not later._blocked["m.0"].drives_on


def test_one_that_puts_its_change_off_leaves_the_trail_of_its_predecessor(fleet_and_later):
    """That one had gone over: it followed past its own change, and touched a car beside that had not let it in."""
    fleet, later, change = fleet_and_later
    left = []
    law = SimpleNamespace(
        off_trail=lambda memory, rows: left.append(rows.tolist()) or memory,
        braking_for=lambda _: SimpleNamespace(reason=np.zeros(3)),  # not for a line: that it would leave for anyway
    )
    fleet = changed(fleet, groups=tuple(group._replace(law=law, memory="memory") for group in fleet.groups))
    over = change.across + 30.0
    fleet.progress.station[2] = change.station + over - fleet.progress.front[2]
    later._blocked = {fleet.ids[2]: Blocked(change, over, True, inf)}
    later._room = SimpleNamespace()
    assert later.put_off(fleet).members[2].route is not fleet.members[2].route
    assert left == [[1]]
    left.clear()
    later._blocked = {fleet.ids[2]: Blocked(change, over, True, 2.0)}  # it stays before a queue
    assert later.put_off(fleet) is fleet
    assert not left


@pytest.mark.parametrize(("speed", "across"), [(2.0, 35.3), (5.0, 37.2)])
def test_a_change_to_which_it_drives_on_is_made_for_the_speed_that_it_has_there(fleet_and_later, speed, across):
    """After 10 m, or 26 m on: at 2.5 m/s2. One made for 5 m/s was driven at 6 m/s, after hard braking from 8.5 m/s."""
    fleet, later, change = fleet_and_later
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), speed)))
    later._blocked = {fleet.ids[0]: Blocked(change, -10.0, True, inf, drives_on=True)}
    route = later._put_off_one(fleet, 0).members[0].route
    new = next(line for line in route.lines if line.state == CHANGING)
    assert new.station == pytest.approx(change.station + 16.0, abs=0.3)
    assert new.across == pytest.approx(across, abs=3.2)  # whole lane widths


def test_two_changes_are_made_as_long_as_fits_before_the_lane_ends(fleet_and_later):
    """Longer ones would have begun too early to be worth another route, and the member went over without room."""
    _, later, _ = fleet_and_later
    network, car, edges = Network.read(networks()["highway"]), VEHICLES["car"], ("e1_e2", "e2_e_exit")
    route = Route.along(edges, *network.route_lanes(edges, 2)).drivable_by(car)
    change = next(line for line in route.lines if line.state == CHANGING)
    over = latest(route, change, 3.2, car.length) - 36.0
    x, y = route.line.at(np.array([change.station + over - car.length]))[0]
    (member,) = platoon(PathLeader(), at=(float(x), float(y), 0.0), model=car)
    fleet = Fleet.deployed([replace(member, route=route)], 0.1)
    fleet = changed(fleet, progress=fleet.progress.located(fleet.model, fleet.motion, np.inf))
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(1, 12.0)))
    later._blocked = {fleet.ids[0]: Blocked(change, over, True, inf, drives_on=True)}
    after = later._put_off_one(fleet, 0)
    assert after is not fleet
    first, second = (line for line in after.members[0].route.lines if line.state == CHANGING)
    assert first.station > change.station + over + 12.0 - 0.3
    assert second.station + second.across < change.station + change.to_end - car.length + 0.5


def test_a_change_over_two_lanes_needs_room_for_both_before_its_lane_ends(fleet_and_later):
    """With 3 lane widths between the two. It came there at 12 m/s, and went over without room."""
    fleet, _, change = fleet_and_later
    first = change._replace(onto="e0_e1_1", lane="e0_e1_2", to_end=500.0)
    second = first._replace(lane="e0_e1_1", onto="e0_e1_0", station=first.station + 50.0, to_end=450.0)
    for lines, left in [((first,), 5 * 3.2), ((first, second), (5 + 3 + 5) * 3.2)]:
        route = changed(fleet.members[0].route, lines=lines)
        assert latest(route, first, 3.2, 4.74) == pytest.approx(500.0 - left - 4.74)


@pytest.mark.parametrize(("speed", "slowest"), [(33.0, 25.0), (25.0, 25.0), (12.0, 9.0)])
@pytest.mark.parametrize("comfortable", [1.5, 3.0, 5.0])
def test_beside_traffic_as_fast_as_itself_it_falls_back(fleet_and_later, speed, slowest, comfortable):
    """As the law `path` drives before the line that it is given: gently, to 2 m/s less."""
    fleet, later, change = fleet_and_later
    later._room, law, dt = room_beside(slowest), PathLeader(braking=comfortable), 0.1
    change, v, braking = change._replace(to_end=1e4), speed, []
    route = changed(fleet.members[0].route, lines=(change,))
    for _ in range(200):
        later.forget()
        far = later.note(change, 500.0, Ego("m.0", change.lane, v, 4.74, braking=comfortable), route)
        signals = Signals(*(np.array([value]) for value in (far, False, False, False, 0)))
        sensed = Sensed(None, np.array([v]), np.zeros(1), Body(*(np.array([x]) for x in BODY)), signals=signals)
        braking.append(float(law.acceleration_for_lines(sensed, np.zeros(1))[0]))
        v += min(braking[-1], 0.0) * dt
    assert v == pytest.approx(slowest - 2.0, abs=0.4)
    assert min(braking) > -2.0


def test_lines_are_given_as_the_law_path_drives_before_them():
    assert Ego._field_defaults["braking"] == PathLeader().braking


@pytest.mark.parametrize(("over", "is_later"), [(-40.0, False), (-20.0, True)])
def test_in_flow_it_looks_for_room_further_on_when_it_comes_to_its_change_without_braking(
    fleet_and_later, over, is_later
):
    fleet, later, change = fleet_and_later
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), 25.0)))
    law = SimpleNamespace(braking_for=lambda _: None)  # it does not say what it brakes for
    later._beyond[fleet.members[0].route, change, fleet.members[0].model] = None
    group = SimpleNamespace(law=law, memory=(), rows=np.array([0]))
    later._blocked = {fleet.ids[0]: Blocked(change, over, True, inf, True)}
    asked = []
    later._put_off_one = lambda fleet, row: asked.append(row) or fleet
    later.put_off(SimpleNamespace(groups=[group], ids=fleet.ids, members=fleet.members, motion=fleet.motion))
    assert asked == ([0] if is_later else [])


def test_a_member_that_drives_on_has_its_change_at_last_where_its_lane_ends(fleet_and_later):
    """The nearer it is to that place the slower it will be there, and the shorter is its lane change.

    This lane leads on, but it is not asked to change beyond.
    """
    fleet, later, change = fleet_and_later
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), 25.0)))
    later._beyond = defaultdict(lambda: None)
    for _ in range(100):
        before, across = change, change.across
        later._blocked = {fleet.ids[0]: Blocked(change, -10.0, True, inf, True)}
        fleet = later._put_off_one(fleet, 0)
        change = next(one for one in fleet.members[0].route.lines if one.state == CHANGING)
        if change is before:
            break
        assert change.station > before.station
        assert change.across <= across + 0.1
    assert before.to_end == pytest.approx(5 * 3.2 + 4.74, abs=4.74)  # later by less than a length is not worth it
    assert before.across == pytest.approx(5 * 3.2, abs=0.5)


def test_a_member_that_drives_on_changes_on_the_next_edge_before_it_brakes_for_the_end_of_its_lane(fleet_and_later):
    """It braked from 25 to 8 m/s there, though the lane leads on. It must brake 104 m before the end."""
    fleet, later, change = fleet_and_later
    fleet = changed(fleet, motion=replace(fleet.motion, speed=np.full(len(fleet), 25.0)))
    for _ in range(100):
        before = change
        later._blocked = {fleet.ids[0]: Blocked(change, -10.0, True, inf, True)}
        fleet = later._put_off_one(fleet, 0)
        change = next(one for one in fleet.members[0].route.lines if one.state == CHANGING)
        if change.lane != before.lane:
            break
    assert change.lane.startswith("e1_e2")
    assert before.to_end + 10.0 - 5 * 3.2 - 4.74 > 25.0**2 / (2 * 3.0)


def test_routes_that_no_member_drives_any_more_are_forgotten(fleet_and_later, monkeypatch):
    fleet, later, change = fleet_and_later
    monkeypatch.setattr(later_changes, "KEPT", 3)
    route = fleet.members[0].route
    for key in [(route, change, 0.0), *((changed(route), change, float(k)) for k in range(5))]:
        dict.__setitem__(later._later, key, None)
    later._blocked["another"] = None  # then the routes are looked at
    later.put_off(fleet)
    assert [key[0] for key in later._later] == [route]


ENTRY = """[sumo]
net = "highway"
warm_up_s = 120.0
demand = 1.5
[run]
duration_s = 70.0
step_s = 0.1
""" + "".join(
    f"""[[platoon]]
id = "p{k}"
size = 1
vehicle = "car"
start = {{ time_s = {8.0 * k}, edge = "e_entry_e3", position_m = 20.0, speed_mps = 20.0 }}
to = "e4_e5"
leader = {{ law = "tracking", on_loss = "drive", policy = "obey", keeps_to = "route" }}
"""
    for k in range(4)
)


@pytest.mark.sumo
def test_members_that_enter_a_motorway_among_traffic_drive_on_until_there_is_room(tmp_path):
    """They stood at the begin of the lane that ends, or in their lane change, while 2,900 vehicles an hour passed."""
    file, least, over = tmp_path / "entry.toml", {}, set()
    file.write_text(ENTRY)
    with Simulation.load(file, seed=2) as simulation:
        for now in simulation:
            assert not [event for event in now.events if event.kind == "collision"]
            for name, (_, lane), speed in zip(now.fleet.ids, now.roads, now.fleet.motion.speed, strict=True):
                if lane == "e3_e4_0":
                    least[name] = min(speed, least.get(name, math.inf))
                elif lane == "e3_e4_1":
                    over.add(name)
    assert len(over) == 4
    assert min(least.values()) > 10.0
