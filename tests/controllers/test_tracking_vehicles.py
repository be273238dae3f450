"""The law `tracking` in cars, vans, trucks and mixed platoons: turns, lateral acceleration, gain of a string."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, LidarModel, Mount
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors
from platoontraffic.world.fleet import Member
from tests.controllers.test_tracking_follower import cars, off_path, turn
from tests.support.bench import BLIND, NO_WALLS, Log, Prescribed, amplitude, drive

DT = 0.1
TRACKER = PRESETS["car-tracker"]
LAW = TrackingFollower()
CAR_OFF, TRUCK_OFF = 0.3, 0.5  # greatest distance from the predecessor's path [m]


def mixed(
    kinds: Sequence[str],
    at,
    speed: float,
    seconds: float,
    laser: LidarModel = TRACKER,
    odometry: OdometryErrors = ODOMETRY["car"],
    step: float = DT,
) -> Log:
    """A platoon of these vehicles, each laser at a bumper; at: the leader's command as a function of time."""
    members, x, gap = [], 0.0, LAW.desired_distance(speed) - 0.03
    for place, kind in enumerate(kinds):
        model = VEHICLES[kind]
        eye = replace(laser, mount=Mount(model.length / 2 - 0.03))
        leader = Prescribed(lambda time: Drive(*at(time)))
        x -= model.length / 2
        members.append(
            Member(
                id=f"mixed.{place}", platoon="mixed", place=place, model=model,
                lidar=eye if place else replace(BLIND, rate=laser.rate), law=LAW if place else leader, edge="", lane=0,
                position=0.0, pose=(x, 0.0, 0.0), speed=speed, odometry=odometry,
            )
        )  # fmt: skip
        x -= model.length / 2 + gap
    return drive(members, NO_WALLS, seconds, step)


def lateral(log: Log) -> np.ndarray:
    """Greatest lateral acceleration of each member [m/s2], (n,)."""
    return np.abs(log.speed * log.yaw_rate).max(axis=0)


CARS, VANS, TRUCKS = ["car"] * 6, ["van"] * 6, ["truck"] * 7
CAR_FIRST, TRUCK_FIRST = ["car", "truck", "car", "truck", "van"], ["truck", "car", "van", "truck", "car"]


@pytest.mark.parametrize(
    ("kinds", "radius"), [(VANS, 8.0), (TRUCKS, 12.1), (CAR_FIRST, 12.1), (TRUCK_FIRST, 15.0)],
    ids=["vans", "trucks", "car first", "truck first"],
)  # fmt: skip
def test_each_vehicle_holds_through_the_turns_that_its_steering_allows(kinds, radius):
    """Trucks: from their least radius, and 20 %."""
    speed = min(math.sqrt(3 * radius), 6.0)
    log = mixed(kinds, turn(radius, math.pi / 2, speed), speed, 45.0)
    for i in range(1, len(kinds)):
        assert off_path(log, i, i - 1) < (TRUCK_OFF if kinds[i] == "truck" else CAR_OFF)
    assert log.locked().mean(axis=0).min() >= 0.99
    assert lateral(log)[1:].max() < LAW.lateral_acceleration


@pytest.mark.slow
@pytest.mark.parametrize("radius", [8.0, 10.0, 12.1, 15.0])
@pytest.mark.parametrize("kinds", [CARS, VANS, TRUCKS, CAR_FIRST, TRUCK_FIRST], ids=str)
@pytest.mark.parametrize("side", [-1, 1])
def test_all_of_them_left_and_right(kinds, radius, side):
    if radius < 1.2 * VEHICLES["truck"].turning_radius and "truck" in kinds:
        pytest.skip("tighter than a truck can turn")
    speed = min(math.sqrt(3 * radius), 6.0)
    path = turn(radius, side * math.pi / 2, speed)
    log = mixed(kinds, lambda time: (0.0, side * path(time)[1]) if side < 0 else path(time), speed, 45.0)
    for i in range(1, len(kinds)):
        assert off_path(log, i, i - 1) < (TRUCK_OFF if kinds[i] == "truck" else CAR_OFF)
    assert log.locked().mean(axis=0).min() >= 0.99


@pytest.mark.parametrize("radius", [6.0, 15.0])
def test_behind_a_leader_that_is_too_fast_in_a_bend_they_keep_their_own_limit(radius):
    speed = math.sqrt(4.5 * radius)
    log = mixed(["car"] * 5, turn(radius, math.pi / 2, speed), speed, 30.0)
    assert lateral(log)[0] == pytest.approx(4.5, rel=0.01)
    assert lateral(log)[1:].max() < LAW.lateral_acceleration
    assert max(off_path(log, i, i - 1) for i in range(1, 5)) < CAR_OFF
    assert log.locked().mean(axis=0).min() >= 0.99


def test_a_bend_that_its_limit_allows_does_not_slow_it():
    """Half of it: the gap stays as on the straight."""
    radius, speed = 40.0, math.sqrt(2 * 40.0)
    log = mixed(["car"] * 3, turn(radius, math.pi, speed), speed, 25.0)
    assert log.speed[20:].min() > 0.97 * speed


def followed(frequency: float, lag: float) -> float:
    """|G| of the docstring of `TrackingFollower`. lag: mean of drive and brakes, with half a scan [s]"""
    s, late, headway, gain = 2j * math.pi * frequency, 0.2, LAW.time_headway, LAW.distance_gain
    error = lag * late * s**2 / ((1 + lag * s) * (1 + late * s) * (1 + gain / s))
    return abs((1 - error) / (1 + headway * s))


@pytest.mark.parametrize("frequency", [0.05, 0.1, 0.2, 0.3])
def test_a_string_damps_by_the_closed_form(frequency):
    omega, car = 2 * math.pi * frequency, VEHICLES["car"]
    log = cars(lambda time: (0.5 * omega * math.cos(omega * time), 0.0), 20 + 2 / frequency, 15.0, followers=2)
    late = log.time > 20
    of = amplitude(log.time[late], log.speed[late], omega)
    assert of[1:] / of[:-1] == pytest.approx(followed(frequency, (car.lag + car.brake_lag + DT) / 2), abs=0.015)
