"""Members that stand before a body in a part of their path go round it, whatever law drives them; without SUMO."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import shapely
from shapely import affinity

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount, Noise, ScanBatch, Scene
from platoontraffic.observation.observer import Observer
from platoontraffic.road.route import Route
from platoontraffic.road.way_round import MOST, SPEED, Body, _ways, blocked_at, corners, way_round
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world import ways_round
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import NOTHING, Fleet
from platoontraffic.world.manoeuvres import Order
from platoontraffic.world.sensing import Measurements
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen
from platoontraffic.world.ways_round import AFTER, AFTER_FOLLOWING, EVERY, LITTLE, LONG, VERGE, WaysRound, _behind
from tests.support.bench import NO_WALLS, Prescribed, StopLine, constant, drive, platoon
from tests.support.observed import ROAD

CAR = CARS["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise())
ROUTE = Route.along(("road",), np.array([[-200.0, 0.0], [400.0, 0.0]]), np.full(2, 12.0))
LAWS = {"path": PathLeader(), "tracking": TrackingFollower(policy="obey", on_loss="drive")}
PLACE = 60.0


class Street:
    """A map of one straight road along the x axis, so wide on each side [m]."""

    def __init__(self, half: float) -> None:
        self._area = shapely.box(-1e3, -half, 1e3, half)

    def own_side(self, edge: str) -> shapely.Geometry:
        return self._area


def driven(law, body, half: float = 6.0, seconds: float = 40.0, **setting):
    (member,) = platoon(LAWS[law], at=(0.0, 0.0, 0.0), leader_eye=EYE, model=CAR)
    member = replace(member, route=ROUTE, speed=8.0, single=True, equip="equip")
    scene = Scene.from_shapely(solids=[body])
    return drive([member], scene, seconds, 0.1, map=Street(half), **setting)


def footprints(log) -> np.ndarray:
    n = len(log.time)
    size = np.full(n, CAR.length), np.full(n, CAR.width)
    rows = tuple(map(str, range(n)))
    return shapely.polygons(
        TrafficSnapshot(0.0, rows, log.x[:, 0], log.y[:, 0], log.heading[:, 0], log.speed[:, 0], *size)
        .boxes()
        .corners()
    )


def box(overlap: float, side: int = 1, length: float = 4.0) -> shapely.Polygon:
    """A body at x = PLACE that covers so much of the path from the left (1) or from the right (-1) [m]."""
    inner, outer = sorted((side * (CAR.width / 2 - overlap), side * (CAR.width / 2 + 3.0)))
    return shapely.box(PLACE, inner, PLACE + length, outer)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("ahead", "waits"), [(1.5, True), (30.0, False)])
def test_at_a_closed_line_before_the_body_it_waits(monkeypatch, law, ahead, waits):
    """At a red light in Bologna, members planned to go round what crossed, and drove so when it had gone."""
    red, line = 45.0, PLACE - ahead if waits else PLACE + ahead
    times, planned = [0.0], []

    def way(*given):
        planned.append(times[-1])
        return way_round(*given)

    monkeypatch.setattr(ways_round, "way_round", way)
    ground = partial(StopLine, 0.1, line, lambda time: time > red)
    log = driven(law, box(0.4), seconds=80.0, ground=ground, observe=lambda now: times.append(now.time))
    assert (planned[0] > red - 0.2) == waits
    assert log.x[-1, 0] > PLACE + 30


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("overlap", "side", "after"), [(0.4, 1, 0.0), (1.0, -1, AFTER)])
def test_it_goes_round_a_body_and_returns(law, overlap, side, after):
    """It does not stop where a shift within its lane is enough: a member that stands in a junction holds it up."""
    body = box(overlap, side)
    log = driven(law, body)
    stood = log.time[(log.speed[:, 0] < 0.05) & (log.time > 2.0)]
    assert (len(stood) == 0) == (after == 0.0)
    assert after == 0.0 or after - EVERY < stood[-1] - stood[0] < after + 2.0
    assert log.x[-1, 0] > PLACE + 30
    assert abs(log.y[-1, 0]) < 0.05
    assert shapely.distance(footprints(log), body).min() > 0.1
    beside = (np.abs(log.y[:, 0]) > 0.2) & (log.x[:, 0] - CAR.length / 2 < PLACE + 4.0)
    assert log.speed[beside, 0].max() < SPEED + 0.3
    assert 0.3 < np.abs(log.y[:, 0]).max() < MOST + 0.1


def following(aside: float, seconds: float):
    """A member behind a vehicle that it has followed and that comes to a stand so far to the left of its path [m]."""
    (member,) = platoon(LAWS["tracking"], leader_eye=EYE, model=CAR)
    stops = Prescribed(lambda time: Drive(0.0 if time < 9.0 else -3.0, 0.0))
    (ahead,) = platoon(stops, at=(20.0, aside, 0.0), model=CAR)
    member = replace(member, route=ROUTE, speed=8.0, single=True, equip="equip")
    ahead = replace(ahead, id="ahead", speed=8.0, single=True)
    ground = partial(StopLine, 0.1, 15.0, lambda time: time > 3.0)  # after a line it follows along its route
    return drive([member, ahead], NO_WALLS, seconds, 0.1, map=Street(6.0), ground=ground)


@pytest.mark.parametrize("side", [1, -1])
def test_it_stays_for_long_behind_a_vehicle_that_it_has_followed(side):
    """As a left-turner that waits midway for a gap; beside it others drive, and before it opposed left-turners wait."""
    log = following(side * 0.7, AFTER_FOLLOWING + 40.0)
    stands = log.time[(log.speed[:, 0] < 0.05) & (log.x[:, 0] > 40.0)]
    assert abs(stands[-1] - stands[0] - AFTER_FOLLOWING) < 3.0
    assert log.x[-1, 0] > log.x[-1, 1] + 20.0


@pytest.mark.parametrize("side", [1, -1])
def test_it_does_not_stay_for_long_before_one_that_faces_it(side):
    """As a left-turner before a car that had stopped for it: to its laser that is the end of a queue."""
    (member,) = platoon(LAWS["tracking"], leader_eye=EYE, model=CAR)
    (faces,) = platoon(constant(0.0), at=(PLACE, side * 0.7, np.pi), model=CAR)
    member = replace(member, route=ROUTE, speed=8.0, single=True, equip="equip")
    faces = replace(faces, id="faces", single=True)
    log = drive([member, faces], NO_WALLS, 40.0, 0.1, map=Street(6.0))
    stands = log.time[(log.speed[:, 0] < 0.05) & (log.x[:, 0] > 30.0)]
    assert AFTER - EVERY < stands[-1] - stands[0] < AFTER + 3.0
    assert log.x[-1, 0] > PLACE + 20.0


@pytest.mark.parametrize("law", LAWS)
def test_a_body_whose_place_is_found_differently_each_time_stands_all_the_same(monkeypatch, law):
    """Places are 0.25 m apart: a member looked every 10 s, and found the body at another one each time."""
    looks = []

    def flickers(*given):
        looks.append(0)
        found = blocked_at(*given)
        return found._replace(distance=found.distance + 0.25 * (len(looks) % 2))

    monkeypatch.setattr(ways_round, "blocked_at", flickers)
    assert driven(law, box(1.0)).x[-1, 0] > PLACE + 30


def test_it_does_not_go_round_what_crosses_its_path(monkeypatch):
    """A car that turned was met twice at one place of the path: a member crossed a junction at 2 m/s beside nothing."""
    (member,) = platoon(LAWS["path"], at=(0.0, 0.0, 0.0), leader_eye=EYE, model=CAR)
    (crosses,) = platoon(constant(0.6), at=(16.0, -3.5, np.pi / 2), model=CAR)
    member = replace(member, route=ROUTE, speed=2.0, single=True, equip="equip")
    crosses = replace(crosses, id="crosses", speed=0.6, single=True)
    planned = []
    monkeypatch.setattr(ways_round, "way_round", lambda *given: planned.append(given))
    log = drive([member, crosses], NO_WALLS, 25.0, 0.1, map=Street(8.0))
    assert not planned
    assert log.speed[:, 0].min() < 0.05  # it waits
    assert log.x[-1, 0] > 20.0


@pytest.mark.parametrize("side", [1, -1])
def test_it_does_not_stay_where_a_little_to_the_side_is_enough(side):
    """As past a left-turner that waits midway, a little beside the path: it waits for the member in turn."""
    log = following(side * 1.4, 45.0)
    assert log.x[-1, 0] > log.x[-1, 1] + 20.0
    assert 0.3 < np.abs(log.y[:, 0]).max() < LITTLE + 0.1


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("side", [1, -1])
def test_what_drives_away_ahead_is_not_in_the_way(law, side):
    """As members in a row past a left-turner that waits midway: each stood until the one before it was far away."""
    (member,) = platoon(
        {**LAWS, "tracking": replace(LAWS["tracking"], keeps_to="route")}[law],
        at=(0.0, 0.0, 0.0),
        leader_eye=EYE,
        model=CAR,
    )
    member = replace(member, route=ROUTE, speed=3.0, single=True, equip="equip")
    (ahead,) = platoon(constant(2.0), at=(20.0, side * -0.5, 0.0), leader_eye=EYE, model=CAR)
    ahead = replace(ahead, id="ahead", speed=2.0, single=True)
    body = box(0.4, side)
    log = drive([member, ahead], Scene.from_shapely(solids=[body]), 60.0, 0.1, map=Street(6.0))
    assert (log.speed[log.time > 2.0, 0] > 0.3).all()
    assert log.x[-1, 0] > PLACE + 30
    assert shapely.distance(footprints(log), body).min() > 0.1


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("side", [1, -1])
def test_it_goes_on_beside_a_further_body_that_the_first_one_hid(law, side):
    """As opposed left-turners that wait midway in a junction; it stood before the second one."""
    first, second = box(1.0, side), affinity.translate(box(0.6, side), 15.0)
    log = driven(law, shapely.union(first, second), seconds=50.0)
    assert log.x[-1, 0] > PLACE + 50
    assert abs(log.y[-1, 0]) < 0.05
    assert shapely.distance(footprints(log), shapely.union(first, second)).min() > 0.1
    between = (log.x[:, 0] > PLACE + 5) & (log.x[:, 0] < PLACE + 15)
    assert np.abs(log.y[between, 0]).min() > 0.8


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("stays", [True, False])
def test_a_way_on_which_something_stands_is_given_up_when_the_body_has_gone(law, stays):
    """In Bologna a car came beside a member on its way round another one; both stood there for minutes."""
    (member,) = platoon(LAWS[law], at=(0.0, 0.0, 0.0), leader_eye=EYE, model=CAR)
    member = replace(member, route=ROUTE, speed=8.0, single=True, equip="equip")
    body = Prescribed(lambda time: Drive(0.0 if stays or time < 30.0 else 1.0, 0.0))
    beside = Prescribed(lambda time: Drive(-9.0 if time > 8.0 else 0.0, 0.0))
    (ahead,) = platoon(body, at=(PLACE, -1.4, 0.0), leader_eye=EYE, model=CAR)
    (left,) = platoon(beside, at=(50.5, 2.1, 0.0), leader_eye=EYE, model=CAR)  # it drives away ahead, and stops
    ahead, left = replace(ahead, id="ahead", single=True), replace(left, id="left", speed=0.7, single=True)
    log = drive([member, ahead, left], NO_WALLS, 45.0, 0.1, map=Street(6.0))
    assert log.speed[(log.time > 20.0) & (log.time < 29.0), 0].max() < 0.05
    assert log.x[-1, 2] < PLACE
    assert (log.x[-1, 0] > PLACE + 20) == (not stays)


@pytest.mark.parametrize("since", [np.inf, 3.0])
def test_the_body_is_known_while_it_drives_round_it(since):
    ways = WaysRound(Street(6.0))
    for name, body in (("m.0", "bus"), ("m.1", "")):
        ways._under_way[name] = ways_round._UnderWay(None, ROUTE, body, 1.0, since=since)
    assert ways.passed == ({"bus"} if since == np.inf else set())


def test_the_body_is_known_no_longer_once_the_member_has_left():
    ways = WaysRound(Street(6.0))
    ways._under_way["m.0"] = ways_round._UnderWay(None, ROUTE, "bus", 1.0)
    ways.followed(Fleet.deployed([], 0.1), [], Measurements([], [], None), None, 2.0)
    assert not ways.passed


@pytest.mark.parametrize("law", LAWS)
def test_it_stands_where_there_is_no_room(law):
    body = box(1.0)
    log = driven(law, body, half=CAR.width / 2 + 0.6, seconds=2 * LONG)
    assert log.speed[-1, 0] < 0.01
    assert shapely.distance(footprints(log), body).min() > 0.5


@pytest.mark.parametrize("law", LAWS)
def test_one_that_has_stood_for_long_leaves_the_road_by_a_little_if_it_must(law):
    """It stood for ever in a turn, before a car that waited for it: a corner of its front would have been 4 cm off."""
    body, half = box(1.0), CAR.width / 2 + 1.7
    log = driven(law, body, half=half, seconds=LONG + 40.0)
    stood = log.time[(log.speed[:, 0] < 0.05) & (log.time > 2.0)]
    assert LONG - EVERY < stood[-1] - stood[0] < 1.5 * LONG
    assert log.x[-1, 0] > PLACE + 30
    assert shapely.distance(footprints(log), body).min() > 0.1
    off = shapely.get_coordinates(footprints(log))[:, 1].min() + half
    assert -VERGE - 0.05 < off < 0


@pytest.mark.parametrize("law", LAWS)
def test_the_longer_it_stands_the_less_often_it_looks(monkeypatch, law):
    looks = []
    monkeypatch.setattr(ways_round, "blocked_at", lambda *given: looks.append(0) or blocked_at(*given))
    driven(law, box(1.0), half=CAR.width / 2 + 0.6, seconds=10.0 + 60.0)
    assert 15 < len(looks) < 40


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("beside", "waits"), [(0.5, True), (1.0, False)])
def test_it_waits_for_what_comes_from_behind_and_would_pass_closely(side, beside, waits):
    """A few centimetres of a car's front were in the strip, between two beams: it was touched at 10 m/s in Bologna."""
    shift, body = side * 1.2, Body(*(float(getattr(CAR, key)) for key in Body._fields))
    comes = np.array([[-CAR.length / 2 - 15.0, side * (CAR.width / 2 + 1.2 + beside)]])
    may_use = WaysRound(Street(6.0))._may_use(ROUTE, 200.0, body, comes)
    assert may_use(shift, np.array([[[0.0, 0.0], [2.0, side * (CAR.width / 2 + 1.2)]]])) == (not waits)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("shift", "beside", "waits"), [(0.7, 1.5, True), (0.6, 1.5, True), (0.3, 1.5, False), (0.7, 2.4, False)]
)
def test_it_waits_for_what_would_pass_its_front_as_that_swings_out(side, shift, beside, waits):
    """The front of a car swings out farther than the car goes aside: one in Bologna was touched at 15 m/s, from behind,
    by one that drove on the lane beside."""
    body = Body(*(float(getattr(CAR, key)) for key in Body._fields))
    (way,) = [*_ways(ROUTE, 200.0, 0.0, body, side * shift, 10.0, 0.0)][:1]
    comes = np.array([[-30.0, side * (CAR.width / 2 + beside)]])
    may_use = WaysRound(Street(6.0))._may_use(ROUTE, 200.0, body, comes)
    assert may_use(side * shift, corners(way.section, body)) == (not waits)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("speed", "behind", "rate", "waits"),
    [
        (12.0, 50.0, 10.0, True),
        (12.0, 50.0, 5.0, True),  # that laser measures in every second step only
        (12.0, 75.0, 10.0, False),
        (0.0, 10.0, 10.0, False),
    ],
)
def test_it_waits_for_what_comes_soon(side, speed, behind, rate, waits):
    """In Bologna a car pulled out 26 m before one that came at 13 m/s. Else it sets out after 17 s."""
    eye = replace(PRESETS["car-around"], mount=Mount(0.0), noise=Noise(), name="around", rate=rate)
    (member,) = platoon(LAWS["tracking"], at=(0.0, 0.0, 0.0), leader_eye=EYE, model=CAR)
    member = replace(member, route=ROUTE, speed=8.0, single=True, equip="equip", further_lidars=(eye,))
    at = 50.0 - behind - 17.0 * speed, 3.0 * side, 0.0
    (other,) = platoon(Prescribed(lambda _: Drive(0.0, 0.0)), at=at, model=CAR)
    other = replace(other, id="comes", speed=speed, single=True)
    log = drive([member, other], Scene.from_shapely(solids=[box(1.0, -side)]), 40.0, 0.1, map=Street(6.0))
    goes_out = log.time[np.abs(log.y[:, 0]) > 0.2][0]
    assert goes_out > 21.0 if waits else goes_out == pytest.approx(18.2, abs=0.5)


ON_ITS_WAY = 22.0  # round the body, from 17 to 28 s [s]


@pytest.mark.parametrize("kind", ["split", "join"])
def test_an_order_on_the_way_round_a_body_holds(kind):
    """The order to split off was rejected, since it led already; that to join was undone at the end of the way."""
    ahead, member = platoon(constant(0.0), LAWS["tracking"], 1, at=(20.0, 0.0, 0.0), model=CAR, eye=EYE)
    ahead = replace(ahead, law=Prescribed(lambda _: Drive(0.0, 0.0)), pose=(110.0, 0.0, 0.0), speed=2.0)
    member = replace(member, pose=(0.0, 0.0, 0.0), route=ROUTE, speed=8.0)
    if kind == "join":
        member = replace(member, id="late.0", platoon="late", place=0)
    order = Order(ON_ITS_WAY, kind, member.id, ahead.id if kind == "join" else "", None)
    seen = []

    def look(now):
        told = [event.done for event in now.events if event.kind == "told"]
        seen.append((now.time, told, now.fleet.predecessor[1], now.fleet.leads[1], now.fleet.goes_round[1]))

    observer = partial(Observer, [ahead, member], ROAD, Contacts(NO_WALLS, {ahead.id, member.id}))
    solids = Scene.from_shapely(solids=[box(1.0, 1)])
    drive([ahead, member], solids, 45.0, 0.1, observe=look, map=Street(6.0), orders=[order], observer=observer)
    time, told, predecessor, leads, goes_round = map(list, zip(*seen, strict=True))
    k = np.searchsorted(time, ON_ITS_WAY - 1e-6)
    assert goes_round[k]
    assert not goes_round[-1]
    assert told[k] == [1]
    assert set(leads[k:]) == {kind == "split"}
    assert set(predecessor[k:]) == {-1 if kind == "split" else 0}


@pytest.mark.parametrize("more", [0, 1, -1])
def test_what_a_laser_sees_behind_is_read_with_what_was_there_when_it_measured(more):
    """The main laser is late, and had seen one more or one less: another row was taken for the one that comes, or a run
    ended with an IndexError."""
    (member,) = platoon(LAWS["tracking"], leader_eye=EYE, model=CAR)
    sight = replace(PRESETS["car-around"], mount=Mount(0.0), noise=Noise())
    no_return, no_hit = np.full((1, sight.samples), np.inf), np.full((1, sight.samples), -2)
    around = ScanBatch(sight, 0.0, (member.id,), no_return, no_hit, np.zeros(1))
    around.ranges[0, 0], around.hits[0, 0] = 60.0, 2  # straight back
    now, then = (
        TrafficSnapshot(0.0, tuple("abcd"[:n]), *np.zeros((3, n)), np.array([0.0, *[0.0] * (n - 2), 15.0]),
                        *np.ones((2, n)))
        for n in (3, 3 + more)
    )  # fmt: skip
    readings = NOTHING._replace(scans={"around": around}, seen={"around": Seen(now, np.array([0]))})
    assert len(_behind(Fleet.deployed([member], 0.1), 0, 0, then, readings)) == 1


@pytest.mark.parametrize(("x", "heading", "counts"), [(-40.0, 0.0, True), (-40.0, np.pi, False), (-20.0, np.pi, True)])
def test_what_drives_away_behind_does_not_count_from_25_m_on(x, heading, counts):
    (member,) = platoon(LAWS["tracking"], leader_eye=EYE, model=CAR)
    sight = replace(PRESETS["car-around"], mount=Mount(0.0), noise=Noise())
    no_return, no_hit = np.full((1, sight.samples), np.inf), np.full((1, sight.samples), -2)
    around = ScanBatch(sight, 0.0, (member.id,), no_return, no_hit, np.zeros(1))
    around.ranges[0, 0], around.hits[0, 0] = -x, 1  # straight back
    both = np.ones(2)
    traffic = TrafficSnapshot(
        0.0, (member.id, "c"), x * np.arange(2), 0 * both, heading * both, 12.0 * both, 5.0 * both, 2.0 * both
    )
    readings = NOTHING._replace(scans={"around": around})
    assert len(_behind(Fleet.deployed([member], 0.1), 0, 0, traffic, readings)) == counts


def test_without_a_map_it_stands():
    (member,) = platoon(LAWS["path"], leader_eye=EYE, model=CAR)
    log = drive([replace(member, route=ROUTE, speed=8.0)], Scene.from_shapely(solids=[box(0.4)]), 30.0, 0.1)
    assert log.speed[-1, 0] < 0.01
