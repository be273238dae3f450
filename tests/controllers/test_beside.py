"""A follower that knows its route looks beside and behind before it goes over to another lane, without SUMO."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import beside, beside_kernel
from platoontraffic.controllers.beside import Beside
from platoontraffic.controllers.lane_room import HEADWAY, REACTION, room_needed
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import AROUND, TrackingFollower
from platoontraffic.lidar import PRESETS, Boxes, Mount
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.road.route import Route, Routes
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.odometry import ODOMETRY
from platoontraffic.world.fleet import Member
from tests.support.bench import BLIND, NO_WALLS, Log, StopLine, drive, platoon

DT, SPEED, LANE = 0.1, 25.0, 3.2
CAR = VEHICLES["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03))
SIGHT = replace(PRESETS["car-around"], name=AROUND)
FOLLOWER = TrackingFollower(on_loss="drive")
BEGINS, LASTS = 8.0, 4.0  # of the leader's lane change [s]; at most 1.3 m/s sideways
BENDS = 6.0  # when the leader comes to the bend of the road [s]
ROUND = 3.0  # how far aside a leader goes that comes back [m]
LEAVES = 16.0  # when the other car goes over to a third lane [s]
BETWEEN_LANES = LANE - CAR.width  # clearance of cars in the middle of both lanes [m]
LEAST_CLEARANCE = 0.9  # between the follower that stays and the car on the other lane, of that [m]
UNSEEING = replace(BLIND, rate=10.0)


def road(bend: float, begin: float, aside=0.0) -> Route:
    """Straight from -500 m to a place on the x axis, then a circle; `aside` (k,) of that, 1 m apart [m]."""
    along = np.arange(-500.0, 900.0)
    turn = bend * np.maximum(along, 0.0)
    middle = np.column_stack([np.minimum(along, 0.0), 0 * along])
    middle += np.where(along > 0, along, 0)[:, None] * np.column_stack(
        [np.sinc(turn / math.pi), turn / 2 * np.sinc(turn / 2 / math.pi) ** 2]
    )
    points = middle + np.column_stack([-np.sin(turn), np.cos(turn)]) * np.broadcast_to(aside, along.shape)[:, None]
    return Route.along(("road",), points + np.array([begin, 0.0]), np.full(len(along), 40.0)).drivable_by(CAR)


def scene(side: float = 1.0, other: tuple[float, float] | None = None, bend: float = 0.0, seed: int = 0,
          lasts: float = LASTS, leaves: float = LEAVES, speed: float = SPEED, returns=False) -> Log:  # fmt: skip
    """A leader that changes lanes to the left (1), the right (-1) or not (0), its follower, and a car on the left lane.

    other: where that car begins, ahead of the follower [m], and its speed above the follower's [m/s]; it goes over to
           a third lane
    bend : curvature of the road [1/m]
    lasts: the leader's lane change [s]
    leaves: when the other car begins to go over to the third lane [s]
    speed : of the leader [m/s]
    returns: the leader does not change lanes, but goes aside by ROUND and comes back
    """
    members = platoon(
        PathLeader(speed=speed), FOLLOWER, 1, distance=FOLLOWER.desired_distance(speed), model=CAR,
        leader_eye=UNSEEING, eye=EYE, speed=speed, odometry=ODOMETRY["car"],
    )  # fmt: skip
    start, begin = members[0].pose[0], members[0].pose[0] + speed * BENDS

    def over(place: float) -> np.ndarray:
        """Aside of a road on which a lane change begins at a place on the x axis [m]."""
        return LANE * (1 - np.cos(math.pi * share_from(place))) / 2

    def share_from(place: float) -> np.ndarray:
        return np.clip((np.arange(-500.0, 900.0) + begin - place) / (speed * lasts), 0.0, 1.0)

    place = start + speed * BEGINS
    leads = ROUND * (1 - np.cos(2 * math.pi * share_from(place))) / 2 if returns else over(place)
    members[0] = replace(members[0], route=road(bend, begin, side * leads))
    members[1] = replace(members[1], further_lidars=(SIGHT,), route=road(bend, begin))
    if other:
        ahead, faster = other
        x, its = members[1].pose[0] + ahead, speed + faster
        members.append(
            Member("other.0", "other", 0, CAR, UNSEEING, PathLeader(speed=its), "", 0, 0.0, (x, LANE, 0.0),
                   speed=its, route=road(bend, begin, LANE + over(x + its * leaves)))
        )  # fmt: skip
    return drive(members, NO_WALLS, 24.0, DT, seed=seed, ground=lambda: StopLine(DT))


def clearance(log: Log, i: int, k: int) -> float:
    """Least distance between the outlines of two vehicles [m]."""
    shapes = [
        shapely.polygons(
            Boxes(log.x[:, j], log.y[:, j], log.heading[:, j], *(np.full(len(log.time), size) for size in SIZE),
                  owner=np.arange(len(log.time))).corners()
        )
        for j in (i, k)
    ]  # fmt: skip
    return float(shapely.distance(*shapes).min())


SIZE = CAR.length, CAR.width


def aside(log: Log, member: int = 1) -> np.ndarray:
    return log.axle[:, member, 1]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lane_change_is_repeated_where_nobody_is_beside(side):
    log = scene(side)
    path = shapely.LineString(log.axle[:, 0])
    after = (log.x[:, 1] > log.x[0, 0]) & (log.x[:, 1] < log.x[-1, 0])
    assert shapely.distance(path, shapely.points(log.axle[after, 1])).max() < 0.2
    assert aside(log)[-1] == pytest.approx(aside(log, 0)[-1], abs=0.2)


def test_the_middle_between_two_lanes_is_no_lane(monkeypatch):
    """A car from behind has passed, and the follower goes over, while the leader is still half over."""
    lanes, look = [], beside.look

    def noted(before, seen):
        after = look(before, seen)
        lanes.append(after.lane[0])
        return after

    monkeypatch.setattr(beside, "look", noted)
    faster = 6.0
    log = scene(1.0, (-faster * (BEGINS + 3.0), faster), lasts=10.0)
    assert np.minimum(np.abs(lanes), np.abs(np.array(lanes) - LANE)).max() < 0.45
    assert lanes[-1] == pytest.approx(LANE, abs=0.3)
    assert clearance(log, 1, 2) > BETWEEN_LANES - beside_kernel.COMMITTED - 0.1


@pytest.mark.parametrize("ahead", [-4.0, 0.0, 4.0])
def test_it_stays_beside_a_car_that_keeps_abreast_and_falls_back_to_open_a_gap(ahead):
    log = scene(1.0, (ahead, 0.0))
    assert clearance(log, 1, 2) > LEAST_CLEARANCE
    assert log.speed[:, 1].min() < SPEED - 1.0


@pytest.mark.parametrize("seed", range(2))
def test_it_waits_for_a_car_that_comes_from_behind(seed):
    """The car would be abreast 4 s after the leader has begun to go over."""
    faster = 6.0
    # It has gone over when it passes the leader: outlines less than 0.5 m apart would be measured as one.
    log = scene(1.0, (-faster * (BEGINS + 4.0), faster), seed=seed, leaves=14.0)
    assert clearance(log, 1, 2) > LEAST_CLEARANCE
    passed = log.x[:, 2] - CAR.length > log.x[:, 1]
    assert np.abs(aside(log)[~passed]).max() < 0.3
    assert aside(log)[-1] == pytest.approx(aside(log, 0)[-1], abs=0.3)  # then it goes over as well


@pytest.mark.parametrize("faster", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_street_it_stops_beside_what_is_abreast_where_its_predecessor_left_the_lane(side, faster):
    """As slowly as that it does not stay on its lane for long; it drove into the car beside it at 5 m/s."""
    speed, lasts = 5.0, 6.0
    ahead = -faster * (BEGINS + 0.5 * lasts)
    log, alone = (scene(side, one, lasts=lasts, leaves=60.0, speed=speed) for one in ((ahead, faster), None))
    if side > 0:
        assert clearance(log, 1, 2) > 0.5
        assert log.speed[:, 1].min() < 1.0
        assert log.x[-1, 1] > log.x[0, 1] + 40.0  # and goes on when that has passed
    else:  # it is on the other side
        np.testing.assert_allclose(aside(log), aside(alone), atol=0.05)


@pytest.mark.parametrize("ahead", [-3.0, 0.0, 2.0])
def test_it_stops_before_its_trail_leads_beside_its_lane_into_what_is_abreast(ahead):
    """Its predecessor has come back when it gets there; it looked at where that was, and drove into the car."""
    log, alone = (
        scene(1.0, one, lasts=3.2, leaves=60.0, speed=5.0, returns=True) for one in ((ahead, 0.0), None)
    )  # fmt: skip
    assert aside(alone).max() > BETWEEN_LANES
    assert clearance(log, 1, 2) > 0.5
    assert log.x[-1, 1] > log.x[0, 1] + 40.0  # and goes on when that has passed


def test_it_does_not_wait_for_a_car_that_falls_behind():
    alone, followed = scene(1.0), scene(1.0, (-25.0, -2.0))
    np.testing.assert_allclose(aside(followed), aside(alone), atol=0.01)


@pytest.mark.parametrize("side", [0.0, 1.0])
@pytest.mark.parametrize("radius", [300.0, -300.0, 1000.0])
def test_in_a_bend_it_stays_on_its_lane_as_well(radius, side):
    """A bend is no lane change, whoever is abreast; and where there is no room in a bend it keeps to its lane."""
    log = scene(side, (0.0, 0.0), bend=1 / radius)
    assert clearance(log, 1, 2) > LEAST_CLEARANCE


def test_the_route_that_it_stays_on_is_a_circle_about_the_same_centre():
    radius, offset = 50.0, 3.0
    angle = np.linspace(0, math.pi, 2000)
    points = np.column_stack([radius * np.sin(angle), radius * (1 - np.cos(angle))])
    given = Routes([Route.along(("a",), points, np.full(len(points), 20.0))], np.array([4.0])).ahead(*np.zeros((4, 1)))
    driven = Beside.none(1)._replace(stays=np.array([offset])).drives(given)
    inside = given.distance[0] < 0.9 * math.pi * radius
    away = np.hypot(*(driven.points[0] - [0.0, radius]).T)
    np.testing.assert_allclose(away[inside], radius - offset, atol=0.02)
    np.testing.assert_allclose(driven.curvature[0, 4:][inside[4:]], 1 / (radius - offset), rtol=1e-3)


def test_it_goes_over_by_a_cosine_of_the_length_of_three_seconds():
    points = np.column_stack([np.linspace(0, 400, 401), np.zeros(401)])
    given = Routes([Route.along(("a",), points, np.full(401, 30.0))], np.array([4.0])).ahead(*np.zeros((4, 1)))
    one = np.ones(1)
    goes = Beside.none(1)._replace(stays=0 * one, goal=LANE * one, driven=30.0 * one, length=75.0 * one)
    driven = goes.drives(given)
    share = np.clip((30.0 + given.distance[0]) / 75.0, 0, 1)
    np.testing.assert_allclose(driven.points[0, :, 1], LANE * (1 - np.cos(math.pi * share)) / 2, atol=1e-9)
    change = np.gradient(np.gradient(driven.points[0, :, 1], given.distance[0]), given.distance[0])
    steady = (share > 0.45) & (share < 0.9)
    np.testing.assert_allclose(driven.curvature[0, steady], change[steady], atol=3e-5)


def test_a_line_is_closed_to_what_would_come_to_it_on_another_lane_than_its_route():
    points = np.column_stack([np.linspace(0, 400, 401), np.zeros(401)])
    change = Line(40.0, CHANGING, "", 0, "a_0", "a_1", (), 20.0, aside=LANE)
    route = Route.along(("a",), points, np.full(401, 30.0), [change])
    given = Routes([route], np.array([4.0])).ahead(*np.zeros((4, 1)))
    np.testing.assert_allclose(given.aside[0], np.interp(given.distance[0], [40, 60], [0, LANE]))
    stays = Beside.none(1)._replace(stays=np.zeros(1))
    assert [stays.closes(given, np.array([at]))[0] for at in (30.0, 70.0)] == [False, True]
    goes = stays._replace(driven=np.zeros(1), length=np.full(1, 50.0))
    assert [goes.closes(given, np.array([at]))[0] for at in (30.0, 70.0)] == [False, False]
    assert not Beside.none(1).closes(given, np.array([70.0]))[0]


def test_room_needed_is_that_of_the_braking_of_the_one_behind():
    """It keeps HEADWAY when it reacts, and then brakes, until it is as slow as the one ahead."""
    speed, closing, braking, dt = 30.0, 8.0, 4.5, 1e-4
    gap, rate = float(room_needed(4.7, speed, closing)), closing
    gap -= closing * REACTION
    while rate > 0:
        gap, rate = gap - rate * dt, rate - braking * dt
    assert gap == pytest.approx(HEADWAY * speed, abs=1e-2)
    assert room_needed(4.7, 2.0, -3.0) == 4.7 / 2


@pytest.mark.parametrize("rate", [10.0, 5.0, 2.0])
def test_a_rate_is_taken_over_the_time_between_two_scans_of_the_laser_that_looks_beside(monkeypatch, rate):
    """It was taken over that between two decisions: a slow laser saw what comes come five times as fast."""
    monkeypatch.setattr(sys.modules[__name__], "SIGHT", replace(SIGHT, rate=rate))
    seen, look, faster = [], beside.look, 6.0

    def noted(before, now):
        after = look(before, now)
        seen.append((after.side.side[0], after.side.behind_closing[0]))
        return after

    monkeypatch.setattr(beside, "look", noted)
    scene(1.0, (-faster * (BEGINS + 4.0), faster), leaves=14.0)
    rates = [closing for side, closing in seen if side and np.isfinite(closing)]
    assert np.median(rates) == pytest.approx(faster, abs=0.3)
