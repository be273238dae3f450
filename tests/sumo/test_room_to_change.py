"""Room for lane changes, among vehicles on the lanes beside."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.controllers.lane_room import room_needed
from platoontraffic.controllers.path import PathLeader
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.road.route import Route
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.reads import Reads
from platoontraffic.sumo.room_to_change import COMES_OVER, Here, RoomToChange, Wanted
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.catalogue import VEHICLES
from tests.support.bench import FAR, NO_WALLS, drive, platoon

CAR = VEHICLES["car"]
AHEAD = RoomToChange._ahead


@pytest.fixture(autouse=True)
def _on_straight_lanes(monkeypatch):
    """Scenes without SUMO have positions on lanes only, which are straight, and begin side by side."""
    monkeypatch.setattr(RoomToChange, "_ahead", lambda _, name, along, ego: along)


@pytest.mark.parametrize(
    ("along", "its_place", "its_angle", "ahead"),
    [
        (-9.2, (3.0, -2.4), 0.0, -2.4),  # SUMO has it behind, in a bend; it is beside
        (-9.2, (3.0, -2.4), 25.0, -2.4),
        (3.0, (3.0, 5.5), -10.0, 5.5),
        (-9.2, (3.0, -2.4), 90.0, -9.2),  # round a corner
        (-30.0, (3.0, -28.0), 0.0, -30.0),  # far away
    ],
)
@pytest.mark.parametrize("turned", [0.0, 130.0, 300.0])
def test_vehicles_side_by_side_are_compared_by_their_places(along, its_place, its_angle, turned, ahead):
    """A member changed lanes into another one beside it: in a junction of 70 m that was 7 m farther back for SUMO."""
    (x, y), turn = its_place, np.radians(turned)  # angles are clockwise
    place = 100.0 + x * np.cos(turn) + y * np.sin(turn), 50.0 - x * np.sin(turn) + y * np.cos(turn)
    now = SimpleNamespace(
        front={"m.0": (100.0, 50.0), "c": place}, angle={"m.0": turned, "c": (its_angle + turned) % 360.0}
    )
    ego = Ego("m.0", "road_0", 8.0, CAR.length)
    assert AHEAD(RoomToChange(SimpleNamespace(), now), "c", along, ego) == pytest.approx(ahead)


def test_a_lane_change_over_two_lanes_is_judged_on_each_of_them():
    """The first lane beside is full, the one beyond is empty; once there, only that one counts."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("c", 31.0)], "road_2": []}
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 200.0, getMaxSpeed=lambda _: 13.9,
            getLastStepVehicleIDs=lambda lane: [name for name, _ in places[lane]],
        ),
        vehicle=SimpleNamespace(
            getSpeed=lambda _: 10.0, getLength=lambda _: 5.0,
            getWaitingTime=lambda _: 0.0,
            getLanePosition=lambda name: {k: v for lane in places.values() for k, v in lane}[name],
        ),
    )  # fmt: skip
    now = Reads(client)
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), now)
    first = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 40.0, 160.0)  # it begins at 40 m
    second = first._replace(lane="road_1", onto="road_2", to_end=120.0)
    ego = Ego("m.0", "road_0", 10.0, 5.0)
    assert change.may_change(first, 10.0, ego) == pytest.approx(10.0 + 0.25 * 40.0)
    slow = ego._replace(speed=1.0)
    assert change.may_change(first, -1.0, slow) == pytest.approx(1.0 / 9)  # it has begun, and one is beside it: at once
    places["road_1"], places["road_2"] = [], [("c", 31.0)]
    now.renew()
    change.wanted.clear()
    assert change.may_change(first, -1.0, slow) == np.inf
    assert change.may_change(second, 39.0, slow) == pytest.approx(39.0 + 0.25 * 40.0)  # on the lane between
    assert change.wanted["m.0"].lane == "road_1"  # the first one counts
    places["road_1"], places["road_2"] = [("c", 31.0)], []
    now.renew()
    change.wanted.clear()
    assert change.may_change(first, -15.0, ego._replace(lane="road_1")) == np.inf  # it is on that lane
    assert change.may_change(second, 25.0, ego) == np.inf  # and the next one is free
    assert not change.wanted
    assert change.may_change(second, -1.0, ego._replace(lane="road_1")) == np.inf
    # It is not on the last one yet: vehicles there stop behind its rear, or on a fast road drive on so far behind it.
    assert change.wanted == {"m.0": ("road_2", pytest.approx(5.0 + 2.5 - 19.0), True, True, 0.0)}
    change.wanted.clear()
    now.max_speed["road_1"] = 25.0
    assert change.may_change(second, -1.0, ego._replace(lane="road_1")) == np.inf
    assert change.wanted == {"m.0": ("road_2", pytest.approx(5.0 + 0.5 * 10.0), True, True, 10.0)}
    now.max_speed["road_1"] = 13.9
    change.wanted.clear()
    assert change.may_change(second, -1.0, ego._replace(lane="road_2")) == np.inf
    assert not change.wanted
    places["road_2"] = [("c2", 53.0)]
    now.renew()
    assert change.may_change(second, 25.0, ego) == pytest.approx(25.0 + 0.25 * 40.0)


def test_a_lane_change_is_judged_by_the_first_vehicle_behind_since_the_others_follow_it():
    """It stands beside the member's rear; one that comes fast has to stop behind it."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("fast", 10.0), ("stands", 24.0)], "before_1": [("faster", 90.0)]}
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 100.0, getMaxSpeed=lambda _: 13.9,
            getLastStepVehicleIDs=lambda lane: [name for name, _ in places[lane]],
        ),
        vehicle=SimpleNamespace(
            getSpeed=lambda name: {"fast": 12.0, "faster": 13.9}.get(name, 0.0), getLength=lambda _: 5.0,
            getWaitingTime=lambda _: 0.0,
            getLanePosition=lambda name: {k: v for lane in places.values() for k, v in lane}[name],
        ),
    )  # fmt: skip
    now = Reads(client)
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0), ("before_1", 100.0)]), now)
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 65.0)  # it begins at 35 m
    ego = Ego("m.0", "road_0", 0.0, 5.0)
    assert change.may_change(line, 5.0, ego) == np.inf
    assert not change.wanted
    places["road_1"].pop()
    now.renew()
    assert change.may_change(line, 5.0, ego) < np.inf
    assert change.wanted == {"m.0": ("road_1", pytest.approx(5.0 + 2.5 - (5.0 + 8.0)), False, True, 0.0)}
    places["road_1"].clear()
    now.renew()
    change.wanted.clear()
    assert change.may_change(line, 5.0, ego) < np.inf  # for the one that comes from the lane before


def on_two_lanes(places: dict[str, list[tuple[str, float]]], speeds: dict[str, float], aside: float = 0.0):
    """Values of SUMO's for vehicles at places on lanes of 200 m [m], at their speeds [m/s], else 10 m/s."""
    return Reads(
        SimpleNamespace(
            lane=SimpleNamespace(
                getLength=lambda _: 200.0, getMaxSpeed=lambda _: 13.9, getWidth=lambda _: 3.2,
                getLastStepVehicleIDs=lambda lane: [name for name, _ in places[lane]],
            ),
            vehicle=SimpleNamespace(
                getSpeed=lambda name: speeds.get(name, 10.0), getLength=lambda _: 5.0, getWaitingTime=lambda _: 0.0,
                getLanePosition=lambda name: dict(chain.from_iterable(places.values()))[name],
                getLateralLanePosition=lambda _: aside,
            ),
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "speed"), [("car", 0.5), ("car", 4.0), ("car", 13.0), ("truck", 0.5), ("truck", 13.0)]
)
def test_from_a_lane_beside_its_line_a_vehicle_comes_over_as_far_on_as_is_counted_on(kind, speed):
    """Driven by the law `path`: where its front is half a lane nearer to the line."""
    model = CARS[kind]
    route = Route.along(("road",), np.array([(0.0, 0.0), (600.0, 0.0)]), np.full(2, 13.9)).drivable_by(model)
    (member,) = platoon(PathLeader(), at=(-model.axle, 3.2, 0.0), leader_eye=FAR, model=model)
    log = drive([replace(member, route=route, speed=speed)], NO_WALLS, 20.0, 0.1)
    x = log.x[:, 0] + model.length / 2 * np.cos(log.heading[:, 0])
    y = log.y[:, 0] + model.length / 2 * np.sin(log.heading[:, 0])
    half = float(np.interp(-1.6, -y, x)) - x[0]
    assert 0.7 < half / max(model.length, COMES_OVER * speed) < 1.05


@pytest.mark.parametrize(("front", "has_room"), [(24.0, True), (29.0, False), (33.0, False), (38.0, True)])
def test_a_vehicle_that_stands_past_its_lane_change_does_not_count_on_a_long_one(front, has_room):
    """It stands, its change of 38 m behind it, and comes over within 5 m: not beside one that stands 3 m ahead."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("c", front)]}
    now = on_two_lanes(places, {"m.0": 0.0, "c": 0.0})
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), now)
    line, ego = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 38.0, 210.0), Ego("m.0", "road_0", 0.0, 5.0)
    assert change.has_missed(line, -40.0, ego)
    assert (change.may_change(line, -40.0, ego) == np.inf) == has_room
    if not has_room:
        assert change.wanted["m.0"].behind == pytest.approx(5.0 + 2.5 - 5.0)


def test_a_lane_change_that_was_missed_is_put_off_unless_the_vehicle_is_going_over():
    line, ego = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 40.0, 160.0), Ego("m.0", "road_0", 5.0, 5.0)
    for aside, going_over in ((0.3, False), (0.4, True)):
        change = RoomToChange(SimpleNamespace(), on_two_lanes({}, {}, aside))
        for has_room in (True, False):
            assert change.may_put_off(line, 45.0, ego, has_room=has_room) != going_over
            assert not change.may_put_off(line, 45.0, ego._replace(lane="road_1"), has_room=has_room)
            assert not change.may_put_off(line, 20.0, ego, has_room=has_room)
        assert change.may_put_off(line, 3.0, ego, has_room=False)
        assert not change.may_put_off(line, 3.0, ego, has_room=True)
        assert not change.may_put_off(line, 5.0, ego, has_room=False)  # a car's front is soon over the border


@pytest.mark.parametrize(("waited", "puts_off"), [(59.0, False), (61.0, True)])
def test_a_lane_change_that_has_begun_is_put_off_where_the_vehicle_has_stood_for_long(waited, puts_off):
    """In Bologna one stood until the end, a third over, beside one of SUMO's that waited for it to be over."""
    line, ego = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 160.0), Ego("m.0", "road_0", 0.0, 5.0)
    change = RoomToChange(SimpleNamespace(), on_two_lanes({}, {}, 1.1))
    change._now.waited["m.0"] = waited
    assert change.may_put_off(line, 7.4, ego, has_room=False) == puts_off
    assert not change.may_put_off(line, 7.4, ego, has_room=True)
    assert not change.may_put_off(line, 7.4, ego._replace(lane="road_1"), has_room=False)


@pytest.mark.parametrize(
    ("was", "front", "goes"),
    [
        ("c", 91.0, True),
        ("", 91.0, False),  # it had no room
        ("c", 96.0, False),  # they would touch
        ("other", 91.0, False),  # it has just come
        ("c", 106.0, False),  # it is ahead now
    ],
)
@pytest.mark.parametrize("limit", [13.9, 25.0])
def test_one_that_had_room_and_cannot_stop_goes_over_unless_it_touches_the_one_behind(was, front, goes, limit):
    """Both accelerate, and the room that there was is a little less than what is needed at the new speed. In a city one
    braked for that, and went over all the same, onto the vehicle that it had let come beside it."""
    places = {"road_0": [("m.0", 100.0)], "road_1": [(was, 80.0)]}
    now = on_two_lanes(places, {"m.0": 9.0, "c": 9.0, "other": 9.0})
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), now)
    line, ego = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 98.0), Ego("m.0", "road_0", 9.0, 5.0)
    now.max_speed["road_0"] = limit
    if was:
        assert change.may_change(line, 2.0, ego) == np.inf
    change.begin_look()
    places["road_1"] = [("c", front)]
    now.renew()
    now.max_speed["road_0"] = limit
    assert (change.may_change(line, 2.0, ego) == np.inf) == goes
    change.begin_look()
    slow = ego._replace(speed=5.0)  # it can stop
    assert change.may_change(line, 2.0, slow) == pytest.approx(2.0 + 0.25 * 16.0)


def test_one_that_had_room_is_not_bound_to_a_change_that_is_more_than_a_second_ahead():
    """At 25 m/s it cannot stop any more 60 m before it, and drives on along its lane where it has no room."""
    places = {"road_0": [("m.0", 100.0)], "road_1": [("c", 30.0)]}
    now = on_two_lanes(places, {"m.0": 25.0, "c": 25.0})
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), now)
    ego = Ego("m.0", "road_0", 25.0, 5.0)
    for distance, goes in ((20.0, True), (30.0, False)):
        line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 38.4, 100.0 - distance)
        for front, answer in ((30.0, True), (90.0, goes)):
            change.begin_look()
            places["road_1"] = [("c", front)]
            now.renew()
            now.max_speed["road_0"] = 33.0
            assert (change.may_change(line, distance, ego) == np.inf) == answer


@pytest.mark.parametrize(
    ("front", "speed", "lane", "is_beside"),
    [
        (33.0, 1.0, "road_0", True),  # its rear is beside the own front
        (35.2, 1.0, "road_0", True),  # and must be half a metre before it
        (36.0, 1.0, "road_0", False),
        (29.0, 1.0, "road_0", False),  # it sees the member, and waits
        (33.0, 8.0, "road_0", False),
        (33.0, 1.0, "road_1", False),  # the member is on its lane
        (33.0, 1.0, "other_0", False),
    ],
)
def test_a_slow_vehicle_waits_beside_one_that_came_in_between_on_its_lane(front, speed, lane, is_beside):
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 200.0, getLastStepVehicleIDs=lambda lane: ["c"] if lane == "road_1" else []
        ),
        vehicle=SimpleNamespace(getLength=lambda _: 5.0, getLanePosition=lambda name: front if name == "c" else 30.0),
    )  # fmt: skip
    now = Reads(client)
    change = RoomToChange(SimpleNamespace(), now)
    line = Line(100.0, "M", "", 0, "road_1", "next_0", (":a_0",), 10.0)
    assert change.is_beside(line, Ego("m.0", lane, speed, CAR.length)) == is_beside


@pytest.mark.parametrize(
    ("behind", "comes", "speed", "lane", "aside", "goes"),
    [
        (3.0, 2.0, 0.5, "road_0", 0.0, False),
        (9.0, 2.0, 0.5, "road_0", 0.0, False),  # it will accelerate
        (40.0, 2.0, 0.5, "road_0", 0.0, True),
        (3.0, 0.0, 0.5, "road_0", 0.0, True),  # it stands, and will see the member
        (3.0, 2.0, 0.5, "road_0", 0.9, True),  # the member is half over
        (3.0, 2.0, 0.5, "road_1", 0.0, True),  # ... or on its lane
        (3.0, 2.0, 0.5, "before_0", 0.0, True),
        (3.0, 2.0, 4.0, "road_0", 0.0, True),  # it drives on
        (-3.0, 2.0, 0.5, "road_0", 0.0, True),  # the other one is ahead
    ],
)
def test_a_slow_vehicle_beside_its_lane_waits_for_who_comes_there_from_behind(behind, comes, speed, lane, aside, goes):
    """It had driven past its lane change and the junction beyond behind another one, and went over into a car."""
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 200.0, getMaxSpeed=lambda _: 13.9, getWidth=lambda _: 3.2,
            getLastStepVehicleIDs=lambda lane: {"road_1": ["c"], "road_0": ["m.0"]}[lane],
        ),
        vehicle=SimpleNamespace(
            getSpeed=lambda name: {"m.0": speed, "c": comes}[name], getLength=lambda _: 5.0,
            getLateralLanePosition=lambda _: aside, getAccel=lambda _: 2.6,
            getLanePosition=lambda name: {"m.0": 60.0, "c": 60.0 - behind}[name],
        ),
    )  # fmt: skip
    change = RoomToChange(SimpleNamespace(), Reads(client))
    line = Line(300.0, "M", "", 0, "road_1", "next_1", (":a_1",), 10.0)
    assert change.may_go_over(line, Ego("m.0", lane, speed, CAR.length)) == goes
    assert [wanted.lane for wanted in change.wanted.values()] == ["road_1"] * (not goes)  # others leave room for it


def test_a_slow_member_waits_for_another_one_abreast_and_of_two_only_one_waits():
    """They are on each other's lanes, the second one a little behind the first."""
    places = {"m.0": ("road_0", 30.0), "m.1": ("road_1", 28.0)}
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 200.0,
            getLastStepVehicleIDs=lambda lane: [name for name, (there, _) in places.items() if there == lane],
        ),
        vehicle=SimpleNamespace(getLength=lambda _: CAR.length, getLanePosition=lambda name: places[name][1]),
    )
    now = Reads(client)
    change = RoomToChange(SimpleNamespace(), now)
    change.members = frozenset(places)
    first, second = (Line(100.0, "M", "", 0, lane, "next_0", (":a_0",), 10.0) for lane in ("road_1", "road_0"))
    ahead, behind = Ego("m.0", "road_0", 1.0, CAR.length), Ego("m.1", "road_1", 1.0, CAR.length)
    assert change.is_beside(first, ahead)
    for _ in range(3):
        assert change.is_beside(second, behind)  # the first one's rear is beside its front
        assert not change.is_beside(first, ahead)
    places["m.1"] = "road_1", 20.0
    now.renew()
    assert not change.is_beside(second, behind)


@pytest.mark.parametrize(
    ("wanted", "place", "speed", "is_beside"),
    [
        (Wanted("road_0", 5.0, begun=False), 29.0, 0.0, False),
        (Wanted("road_0", 5.0, begun=False), 31.0, 0.0, True),  # it is ahead
        (Wanted("road_0", 5.0, begun=False), 29.0, 0.5, True),  # it drives
        (Wanted("road_0", 5.0, begun=True), 29.0, 0.0, True),  # it is going over
        (Wanted("road_2", 5.0, begun=False), 29.0, 0.0, True),
        (None, 29.0, 0.0, True),
    ],
)
def test_a_member_goes_over_beside_one_that_stands_behind_and_waits_for_room_on_its_lane(
    wanted, place, speed, is_beside
):
    """Each of two waited for the other one until the end of a run, and 64 vehicles of a city with them."""
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 200.0, getLastStepVehicleIDs=lambda lane: ["m.1"] if lane == "road_1" else []
        ),
        vehicle=SimpleNamespace(
            getLength=lambda _: CAR.length, getSpeed=lambda _: speed,
            getLanePosition=lambda name: {"m.0": 30.0, "m.1": place}[name],
        ),
    )  # fmt: skip
    change = RoomToChange(SimpleNamespace(), Reads(client))
    change.members = frozenset({"m.0", "m.1"})
    change.wanted = {"m.1": wanted} if wanted else {}
    change.begin_look()
    line = Line(100.0, "M", "", 0, "road_1", "next_0", (":a_0",), 10.0)
    assert change.is_beside(line, Ego("m.0", "road_0", 0.0, CAR.length)) == is_beside


@pytest.mark.parametrize(
    ("let_in", "place", "is_beside"),
    [
        ({"m.0": "m.1"}, 27.0, False),
        ({"m.0": "m.1"}, 31.0, True),  # it could not stop
        ({"m.2": "m.1"}, 27.0, True),
        ({}, 27.0, True),
    ],
)
def test_a_member_goes_over_before_one_that_lets_it_in_and_stands_a_little_behind(let_in, place, is_beside):
    """Both stood for 30 s: the other one could not stop behind the rear of the one that it let in."""
    client = SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: 200.0, getLastStepVehicleIDs=lambda lane: ["m.1"] if lane == "road_1" else []
        ),
        vehicle=SimpleNamespace(
            getLength=lambda _: CAR.length, getSpeed=lambda _: 0.0,
            getLanePosition=lambda name: {"m.0": 30.0, "m.1": place}[name],
        ),
    )  # fmt: skip
    change = RoomToChange(SimpleNamespace(), Reads(client), let_in)
    change.members = frozenset({"m.0", "m.1"})
    line = Line(100.0, "M", "", 0, "road_1", "next_0", (":a_0",), 10.0)
    assert change.is_beside(line, Ego("m.0", "road_0", 0.0, CAR.length)) == is_beside


@pytest.mark.parametrize("let_in", [True, False])
def test_a_member_that_is_let_in_beside_a_queue_goes_over_at_once(let_in):
    """It waited 20 s for the queue to leave, and the vehicle that let it in 20 s for the member; then that drove on."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("polite", 26.0), ("queue", 45.0)]}
    network = SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)])
    change = RoomToChange(network, Reads(client_of(places)), {"m.0": "polite"} if let_in else {})
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 69.0)  # it begins at 31 m
    assert (change.may_change(line, 1.0, Ego("m.0", "road_0", 0.0, 5.0)) == np.inf) == let_in


@pytest.mark.parametrize(("distance", "lane"), [(3.0, "road_0"), (1.0, "road_0"), (-10.0, "road_1")])
@pytest.mark.parametrize("let_in", [True, False])
def test_a_member_that_is_let_in_wants_the_room_until_it_is_over(let_in, distance, lane):
    """A vehicle that had stopped for a member drove on 1 s before its lane change, and the member stood for 70 s."""
    change = RoomToChange(
        SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]),
        Reads(client_of({"road_0": [("m.0", 30.0)], "road_1": [("polite", 20.0)]})),
        {"m.0": "polite"} if let_in else {},
    )
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 69.0)
    assert change.may_change(line, distance, Ego("m.0", lane, 1.0, 5.0)) == np.inf
    assert list(change.wanted) == (["m.0"] if let_in and lane == "road_0" else [])


@pytest.mark.parametrize(
    ("aside", "begun", "left"),
    [
        (0.1, False, 0.469),  # share of the lane change that is left until half of it is over
        (-0.8, True, 0.25),
        (1.6, True, 0.0),
    ],
)
@pytest.mark.parametrize(("behind", "goes"), [(28.0, False), (8.0, True)])
def test_a_member_that_has_driven_past_its_lane_change_looks_for_room_where_it_is(behind, goes, aside, begun, left):
    """It had followed another one on its lane, and went over before a member that came from behind at 12 m/s."""
    places = {"road_0": [("m.0", 60.0)], "road_1": [("comes", 60.0 - behind)]}
    client = client_of(places)
    client.vehicle.getSpeed = lambda name: 2.0 if name == "m.0" else 12.0 if not goes else 0.0
    client.vehicle.getLateralLanePosition, client.lane.getWidth = lambda _: aside, lambda _: 3.2
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 90.0)  # from 10 to 26 m
    ego = Ego("m.0", "road_0", 2.0, 5.0)
    assert change.may_change(line, -50.0, ego) == (np.inf if goes else pytest.approx(ego.stops_within))
    assert change.wanted["m.0"].lane == "road_1"
    assert change.wanted["m.0"].begun == begun
    assert change.wanted["m.0"].behind == pytest.approx(5.0 + room_needed(5.0, 0.0, 0.0) - left * 10.0, abs=0.01)
    assert change.may_change(line, -50.0, ego._replace(lane="road_1")) == np.inf
    change.members = frozenset({"m.0"})
    change.begin_look()  # others know of it on the lane that it goes over to
    assert ("m.0" in change._over.get("road_1", [])) == begun


def test_a_member_that_is_going_over_is_not_the_first_vehicle_behind_itself():
    """To SUMO it was on the other lane already, a little farther back; so nobody behind it counted."""
    places = {"road_0": [], "road_1": [("comes", 20.0), ("m.0", 29.8)]}
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places)))
    assert next(change._on_adjacent("road_1", 70.0, "m.0")) == ("comes", 80.0)


def test_one_that_has_only_begun_to_go_over_hides_nobody_behind():
    """A truck that came fast drove past two members at the border of its lane, into a third one ahead of them."""
    places = {"road_0": [("m.1", 20.0), ("m.0", 30.0)], "road_1": [("truck", 5.0), ("first", 60.0)]}
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places)))
    change._over["road_1"] = ["m.1"]
    assert [name for name, _ in change._on_adjacent("road_1", 70.0, "m.0")] == ["first", "m.1", "truck"]
    places["road_1"].insert(1, ("m.1", 20.0))  # now it is over
    change._now.renew()
    assert [name for name, _ in change._on_adjacent("road_1", 70.0, "m.0")] == ["first", "m.1"]


@pytest.mark.parametrize(
    ("lane", "rear", "has_room"),
    [
        ("road_0", 39.0, False),  # in the own lane, before the member has left it
        ("road_0", 48.0, True),
        ("road_1", 48.0, False),  # in the lane that it changes to, before it is there
        ("road_1", 52.0, True),
    ],
)
def test_a_queue_blocks_a_lane_change_only_where_it_stands_in_its_path(lane, rear, has_room):
    """Members stood for 20 s far behind a queue that they were to leave, with free lanes beside them."""
    places = {"road_0": [("m.0", 30.0)], "road_1": []}
    places[lane] = [*places[lane], ("queue", rear + 5.0)]
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places)))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 69.0)  # from 31 to 47 m
    ego = Ego("m.0", "road_0", 0.0, 5.0)
    assert (change.may_change(line, 1.0, ego) == np.inf) == has_room
    assert change.free_road(line, 1.0, ego) == (rear - 31.0 if lane == "road_0" else np.inf)


@pytest.mark.parametrize(
    ("ahead", "its_speed", "beside", "let_in", "here"),
    [
        (55.0, 2.0, 90.0, False, Here.GOES_OVER),  # a queue creeps before the place of the change
        (55.0, 0.0, 90.0, False, Here.GOES_OVER),
        (50.0, 1.2, 90.0, False, Here.DRIVES_ON),  # it has just set out, and its road is free
        (42.0, 0.0, 90.0, False, Here.DRIVES_ON),  # it stands so close ahead that there is no way past it
        (None, 0.0, 90.0, False, Here.DRIVES_ON),  # the way to that place is free
        (55.0, 2.0, 33.0, False, Here.DRIVES_ON),  # another one is beside
        (55.0, 2.0, 33.0, True, Here.STAYS),  # the next one lets it in behind that one, which drives on
        (None, 0.0, 33.0, True, Here.STAYS),
        (None, 0.0, 90.0, True, Here.GOES_OVER),
    ],
)
def test_in_a_queue_a_member_goes_over_where_it_is(ahead, its_speed, beside, let_in, here):
    """Members of a platoon went over at one place, one after the other: one with each green light."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("polite", 19.0), ("beside", beside)]}
    places["road_0"] += [("queue", ahead)] if ahead else []
    places["road_0"] += [("head", 70.0)] if its_speed == 2.0 else []
    client, speed = client_of(places), {"m.0": 0.0, "queue": its_speed, "beside": 2.0, "polite": 0.0, "head": 0.0}
    client.vehicle.getSpeed = speed.__getitem__
    client.vehicle.getWaitingTime = lambda name: 8.0 if speed[name] == 0.0 else 0.0
    network = SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)])
    change = RoomToChange(network, Reads(client), {"m.0": "polite"} if let_in else {})
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 45.0, 3.2)  # it begins at 55 m
    ego = Ego("m.0", "road_0", 0.0, 5.0)
    assert change.where_it_is(line, 25.0, ego) == here
    wants = here == Here.STAYS or (here == Here.DRIVES_ON and ahead is not None and its_speed != 1.2)
    assert [(one.lane, round(one.behind, 1)) for one in change.wanted.values()] == [("road_1", -0.5)] * wants
    assert change.where_it_is(line, 25.0, ego._replace(speed=4.0)) == Here.DRIVES_ON
    assert change.where_it_is(line._replace(to_end=200.0), 25.0, ego) == Here.DRIVES_ON  # its lane does not end soon


@pytest.mark.parametrize("lane", ["road_1", "road_2"])
def test_a_change_over_a_lane_for_buses_is_judged_on_both_lanes(lane):
    places = {"road_0": [("m.0", 30.0)], "road_1": [], "road_2": []}
    places[lane] = [("bus", 33.0)]
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places)))
    over = Line(0.0, CHANGING, "", 0, "road_0", "road_2", (), 32.0, 69.0)  # it begins at 31 m
    assert change.may_change(over, 1.0, Ego("m.0", "road_0", 0.0, 5.0)) < np.inf
    assert change.wanted["m.0"].lane == "road_2"


@pytest.mark.parametrize(
    ("begins", "length", "further"),
    [(30.0, 300.0, True), (50.0, 300.0, False), (30.0, 120.0, False)],
    ids=["at the begin of a long lane", "further on", "on a short lane"],
)
def test_at_the_begin_of_a_long_lane_it_does_not_wait_beside_a_queue(begins, length, further):
    """One stood there for six minutes, and those behind it on the junction."""
    places = {"road_0": [("m.0", begins - 1.0)], "road_1": [("queue", begins + 5.0)]}
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places, length)))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, length - begins)
    ego = Ego("m.0", "road_0", 0.0, 5.0)
    assert change.may_change(line, 1.0, ego) < np.inf
    assert change.is_better_later(line, 1.0, 0.0, ego) == further


@pytest.mark.parametrize(
    ("its_place", "its_wish", "further"),
    [(97.0, "road_0", True), (98.0, "road_0", False), (97.0, "road_2", False), (103.0, "road_0", False)],
    ids=["a little behind", "ahead by its name", "to a lane beyond", "ahead"],
)
def test_of_two_that_wait_for_each_others_lanes_the_one_ahead_drives_on(its_place, its_wish, further):
    """They stood side by side in the middle of a free road for good, and a direction of a city behind them."""
    places = {"road_0": [("m.0", 98.0)], "road_1": [("m.1", its_place)], "road_2": []}
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places, 300.0)))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 205.0)  # on its route it is farther back
    ego = Ego("m.0", "road_0", 0.0, 5.0)
    assert change.may_change(line, 1.0, ego) < np.inf
    assert not change.is_better_later(line, 1.0, 0.0, ego)
    change.wanted["m.1"] = Wanted(its_wish, 10.0, False)
    change.begin_look()
    assert change.is_better_later(line, 1.0, 0.0, ego) == further


def test_of_two_members_that_go_over_to_one_lane_from_both_sides_one_waits():
    """SUMO has each on its own lane until it is over, so neither was seen by the other."""
    places = {"road_0": [("m.0", 31.0)], "road_1": [], "road_2": [("m.1", 30.0)]}
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places)))
    change.members = frozenset(("m.0", "m.1"))
    right = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 69.5)  # it begins at 30.5 m
    left = right._replace(lane="road_2", to_end=69.0)  # at 31 m
    first, second = Ego("m.0", "road_0", 0.0, 5.0), Ego("m.1", "road_2", 0.0, 5.0)
    change.begin_look()
    assert change.may_change(right, -0.5, first) == np.inf
    assert change.may_change(left, 1.0, second) == np.inf  # it does not know yet
    change.begin_look()
    assert change.may_change(right, -0.5, first) == np.inf
    assert change.may_change(left, 1.0, second) < np.inf
    change.begin_look()
    change.may_change(left._replace(to_end=70.5), -0.5, second)  # both have begun
    assert change.may_change(right, -0.5, first) == np.inf
    change.begin_look()
    assert change.may_change(right, -0.5, first) == np.inf  # it is ahead
    assert change.may_change(left._replace(to_end=70.5), -0.5, second) < np.inf
    del places["road_0"][0]
    change.members = frozenset({"m.1"})
    change.begin_look()
    assert change.may_change(left._replace(to_end=70.5), -0.5, second) == np.inf  # the other one has left


def client_of(places: dict[str, list[tuple[str, float]]], length: float = 100.0, speed: float = 0.0) -> SimpleNamespace:
    """places: vehicles of 5 m and their fronts, by lane; length: of the lanes [m]; speed: of all [m/s]"""
    fronts = {name: front for lane in places.values() for name, front in lane}
    return SimpleNamespace(
        lane=SimpleNamespace(
            getLength=lambda _: length, getMaxSpeed=lambda _: 13.9,
            getLastStepVehicleIDs=lambda lane: [name for name, _ in places[lane]],
        ),
        vehicle=SimpleNamespace(
            getSpeed=lambda _: speed, getLength=lambda _: 5.0, getWaitingTime=lambda _: 8.0,
            getLanePosition=fronts.__getitem__,
        ),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("places", "let_in", "slowest"),
    [
        ({"a": (60.0, 20.0)}, {}, (np.inf, np.inf)),  # far enough ahead
        ({"a": (32.0, 20.0)}, {}, (20.0, 20.0)),
        ({"a": (32.0, 20.0), "b": (22.0, 14.0)}, {}, (14.0, 14.0)),
        ({"a": (32.0, 20.0), "b": (22.0, 14.0)}, {"m.0": "b"}, (14.0, 20.0)),  # b lets it in
        ({"a": (32.0, 20.0), "b": (28.0, 11.0)}, {}, (11.0, 20.0)),  # b is left behind
        ({"a": (32.0, 0.5), "b": (22.0, 14.0)}, {}, (0.0, 0.0)),  # a is in a queue
    ],
)
def test_a_member_falls_back_behind_the_slowest_vehicle_beside_it(places, let_in, slowest):
    """It drives 12 m/s with its front at 30 m, and is to begin its change at 31 m. Vehicles by front and speed."""
    client = client_of({"road_0": [("m.0", 30.0)], "road_1": [(name, at) for name, (at, _) in sorted(
        places.items(), key=lambda one: one[1])]})  # fmt: skip
    client.vehicle.getSpeed = lambda name: {"m.0": 12.0, **{k: speed for k, (_, speed) in places.items()}}[name]
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client), let_in)
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 69.0)
    assert change.slowest_beside(line, 1.0, Ego("m.0", "road_0", 12.0, 5.0)) == slowest


@pytest.mark.parametrize(
    ("distance", "its_front", "to_left", "to_end", "speed", "stops_after"),
    [
        (1.0, 32.0, -1, 45.0, 6.0, 6.0),  # beside it, a little ahead: the member falls back by 3 m/s2
        (-20.0, 32.0, -1, 45.0, 1.0, np.inf),  # it would stand beside it, for good
        (-20.0, 32.0, -1, 45.0, 6.0, 6.0),  # the own change has begun, and was not driven
        (1.0, 32.0, 0, 45.0, 0.0, 6.0),  # it goes straight on: the member stops at the last place for its change
        (-20.0, 32.0, 0, 45.0, 6.0, np.inf),
        (-20.0, 29.0, -1, 45.0, 6.0, np.inf),  # a little behind: it lets the member go first
        (-20.0, 37.6, -1, 45.0, 0.0, np.inf),  # there is room
        (-20.0, 32.0, -1, 90.0, 6.0, np.inf),  # far from the end of the lanes
    ],
)
def test_of_two_that_swap_lanes_near_their_ends_the_one_behind_falls_back(
    distance, its_front, to_left, to_end, speed, stops_after
):
    """Side by side at their line a car of SUMO's and a member waited for each other's lane, with queues behind them."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("c", its_front)]}
    client = client_of(places, 30.0 + to_end, speed)
    client.vehicle.getBestLanes = lambda _: [("road_0", 9.0, 0.0, 0, True, ()), ("road_1", 9.0, 0.0, to_left, True, ())]
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 20.0, to_end - distance)
    assert change.may_change(line, distance, Ego("m.0", "road_0", speed, 5.0)) == pytest.approx(stops_after)


def test_room_is_wanted_behind_the_front_where_sumo_has_it():
    """An askew member's front was a metre farther on there: the car that let it in stopped 0.2 m too far, for good."""
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 16.0, 69.0)  # it begins at 31 m
    behind = []
    for front in (32.0, 33.0):
        places = {"road_0": [("m.0", front)], "road_1": [("c", 26.0)]}
        change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client_of(places)))
        change.may_change(line, -1.0, Ego("m.0", "road_0", 0.0, 5.0))
        behind.append(change.wanted["m.0"].behind)
    assert behind[1] - behind[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("distance", "its_front", "its_speed", "stops"),
    [
        (-6.0, 27.0, 6.0, True),  # it is abreast
        (-6.0, 34.0, 6.0, True),
        (-6.0, 20.0, 12.0, True),  # it could not brake in time
        (-6.0, 10.0, 12.0, False),
        (-6.0, 60.0, 0.0, False),
        (-10.5, 27.0, 6.0, False),  # half over: SUMO's drivers see it by now
    ],
)
def test_a_lane_change_is_broken_off_where_another_vehicle_has_come_beside(distance, its_front, its_speed, stops):
    """SUMO inserted a car at 11 m/s beside a member that had done a quarter of its change: they touched."""
    places = {"road_0": [("m.0", 30.0)], "road_1": [("c", its_front)]}
    client = client_of(places)
    client.vehicle.getSpeed = lambda name: its_speed if name == "c" else 6.0
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 20.0, 70.0 - distance)
    assert change.may_change(line, distance, Ego("m.0", "road_0", 6.0, 5.0)) == (4.0 if stops else np.inf)
    assert change.wanted["m.0"].begun


@pytest.mark.parametrize(("speed", "stops"), [(6.0, True), (12.0, False)])
def test_a_lane_change_goes_on_where_it_could_be_broken_off_only_beyond_its_half(speed, stops):
    """On a highway a member braked by 6 m/s2 in a change that it could not stop, before a faster one behind."""
    client = client_of({"road_0": [("m.0", 30.0)], "road_1": [("c", 27.0)]})
    client.vehicle.getSpeed = lambda name: speed
    change = RoomToChange(SimpleNamespace(upstream=lambda lane, reach: [(lane, 0.0)]), Reads(client))
    line = Line(0.0, CHANGING, "", 0, "road_0", "road_1", (), 20.0, 76.0)
    assert np.isfinite(change.may_change(line, -6.0, Ego("m.0", "road_0", speed, 5.0))) == stops
