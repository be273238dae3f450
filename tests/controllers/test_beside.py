"""A follower looks beside and behind before it repeats a lane change, on bare ground, without SUMO."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers.lane_room import HEADWAY, REACTION, room_needed
from platoontraffic.controllers.tracking import AROUND, TrackingFollower
from platoontraffic.lidar import PRESETS, Boxes, Mount
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import ODOMETRY
from platoontraffic.world.fleet import Member
from tests.support.bench import BLIND, NO_WALLS, Log, Prescribed, drive, platoon

DT, SPEED, LANE = 0.1, 25.0, 3.2
CAR = VEHICLES["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03))
SIGHT = replace(PRESETS["car-around"], name=AROUND)
FOLLOWER = TrackingFollower()
BEGINS, LASTS = 8.0, 4.0  # of the leader's lane change [s]; at most 1.6 m/s sideways
LEAST_CLEARANCE = 0.25  # between the follower that stays and the car on the other lane [m]


def changing(side: float, bend: float = 0.0):
    """A leader at steady speed that changes lanes to the left (1), the right (-1) or not (0), in a bend from 6 s on."""
    most = side * LANE * 2 * math.pi / (SPEED * LASTS) ** 2

    def at(time: float) -> Drive:
        share = (time - BEGINS) / LASTS
        return Drive(0.0, (most * math.sin(2 * math.pi * share) if 0 <= share < 1 else 0.0) + bend * (time > 6.0))

    return Prescribed(at)


def scene(side: float = 1.0, other: tuple[float, float] | None = None, bend: float = 0.0, seed: int = 0) -> Log:
    """A leader, its follower and, in the lane to the left, another car.

    other: where that car begins, ahead of the follower [m], and its speed above the follower's [m/s]
    bend : curvature of the road [1/m]
    """
    members = platoon(
        changing(side, bend), FOLLOWER, 1, distance=FOLLOWER.desired_distance(SPEED), model=CAR,
        leader_eye=replace(BLIND, rate=10.0), eye=EYE, speed=SPEED, odometry=ODOMETRY["car"],
    )  # fmt: skip
    members[1] = replace(members[1], further_lidars=(SIGHT,))
    if other:
        ahead, faster = other
        own = bend / (1 - bend * LANE)  # of the circle about the same centre
        drives = Prescribed(lambda time: Drive(0.0, own * (time * (SPEED + faster) > 6.0 * SPEED)))
        x = members[1].pose[0] + ahead
        members.append(
            Member("other.0", "other", 0, CAR, replace(BLIND, rate=10.0), drives, "", 0, 0.0, (x, LANE, 0.0),
                   speed=SPEED + faster)
        )  # fmt: skip
    return drive(members, NO_WALLS, 24.0, DT, seed=seed)


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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lane_change_is_repeated_where_nobody_is_beside(side, seed):
    log = scene(side, seed=seed)
    path = shapely.LineString(log.axle[:, 0])
    after = (log.x[:, 1] > log.x[0, 0]) & (log.x[:, 1] < log.x[-1, 0])
    assert shapely.distance(path, shapely.points(log.axle[after, 1])).max() < 0.4
    assert aside(log)[-1] == pytest.approx(aside(log, 0)[-1], abs=0.8)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("ahead", [-4.0, 0.0, 4.0])
def test_it_stays_beside_a_car_that_keeps_abreast_and_falls_back_to_open_a_gap(ahead, seed):
    log = scene(1.0, (ahead, 0.0), seed=seed)
    assert clearance(log, 1, 2) > LEAST_CLEARANCE
    assert log.speed[:, 1].min() < SPEED - 1.0


@pytest.mark.parametrize("seed", range(3))
def test_it_waits_for_a_car_that_comes_from_behind(seed):
    """The car would be abreast 4 s after the leader has begun to go over."""
    faster = 6.0
    log = scene(1.0, (-faster * (BEGINS + 4.0), faster), seed=seed)
    assert clearance(log, 1, 2) > LEAST_CLEARANCE
    passed = log.x[:, 2] - CAR.length > log.x[:, 1]
    assert aside(log)[~passed].max() < LANE / 2
    assert aside(log)[-1] == pytest.approx(aside(log, 0)[-1], abs=1.0)  # then it goes over as well


def test_it_does_not_wait_for_a_car_that_falls_behind():
    alone, followed = scene(1.0), scene(1.0, (-25.0, -2.0))
    np.testing.assert_allclose(aside(followed), aside(alone), atol=0.2)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("radius", [300.0, 1000.0])
def test_a_bend_is_no_lane_change_whoever_is_abreast(radius, seed):
    log = scene(0.0, (0.0, 0.0), bend=1 / radius, seed=seed)
    path = shapely.LineString(log.axle[:, 0])
    after = log.x[:, 1] > log.x[0, 0]
    assert shapely.distance(path, shapely.points(log.axle[after, 1])).max() < 0.6
    assert clearance(log, 1, 2) > 0.5


def test_room_needed_is_that_of_the_braking_of_the_one_behind():
    """It keeps HEADWAY when it reacts, and then brakes, until it is as slow as the one ahead."""
    speed, closing, braking, dt = 30.0, 8.0, 4.5, 1e-4
    gap, rate = float(room_needed(4.7, speed, closing)), closing
    gap -= closing * REACTION
    while rate > 0:
        gap, rate = gap - rate * dt, rate - braking * dt
    assert gap == pytest.approx(HEADWAY * speed, abs=1e-2)
    assert room_needed(4.7, 2.0, -3.0) == 4.7 / 2
