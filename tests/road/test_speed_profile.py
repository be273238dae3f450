"""When a vehicle is expected to be where, against closed forms and against what the law `path` drives."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from platoontraffic.controllers.path import PathLeader
from platoontraffic.road.gap_acceptance import Pace
from platoontraffic.road.route import Route
from platoontraffic.road.speed_profile import Driving, SpeedProfile
from platoontraffic.vehicles.bicycle import CARS
from tests.support.bench import FAR, NO_WALLS, drive, platoon

CAR, LAW = CARS["car"], PathLeader()
STRAIGHT = np.array([(0.0, 0.0), (500.0, 0.0)])
CORNER = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 140.0)])
SWERVE = np.array([(0.0, 0.0), (50.0, 0.0), (70.0, 12.0), (90.0, 0.0), (190.0, 0.0)])


class Seen(NamedTuple):
    """Of a vehicle on its route."""

    time: np.ndarray  # [s]
    station: np.ndarray  # [m]
    speed: np.ndarray  # [m/s]


def route_of(line: np.ndarray, limit: float = 13.9, factor: float = 1.0) -> Route:
    return replace(Route.along(("road",), line, np.full(len(line), limit)).drivable_by(CAR), speed_factor=factor)


def profile(route: Route, station: float, speed: float, starts_within: float = 0.4, **changes: float) -> SpeedProfile:
    gains = LAW.acceleration, LAW.braking, LAW.lateral_acceleration, CAR.curvature_rate, CAR.length
    return SpeedProfile(Driving(route, station, speed, starts_within, *gains)._replace(**changes))


def driven(route: Route, speed: float) -> Seen:
    (member,) = platoon(LAW, at=(-CAR.axle, 0.0, 0.0), leader_eye=FAR, model=CAR)
    log = drive([replace(member, route=route, speed=speed)], NO_WALLS, 40.0, 0.1)
    steps = np.hypot(np.diff(log.x[:, 0]), np.diff(log.y[:, 0]))
    return Seen(log.time, np.concatenate([[0.0], np.cumsum(steps)]), log.speed[:, 0])


@settings(deadline=None)  # the first call may compile
@given(st.floats(0.1, 55), st.floats(0, 20), st.floats(0, 0.4), st.floats(3, 20))
@example(1.0, 2.0, 0.25, 3.0)
@example(1.75, 0.0, 0.0, 3.0)
def test_on_a_straight_road_it_is_the_closed_form(distance, speed, starts_within, limit):
    """But for the piece in which it comes to the limit: that has one acceleration, so it takes 0.02 s longer, and is up
    to 0.3 m/s slower in it."""
    route, pace = route_of(STRAIGHT, limit), Pace(min(speed, limit), LAW.acceleration, limit, starts_within)
    expected = profile(route, 10.0, pace.speed, starts_within)
    for one, closed_form in (expected, pace), (expected.at_once, pace.at_once):
        assert one.time_for(distance) == pytest.approx(closed_form.time_for(distance), rel=0.02, abs=0.02)
    time = expected.time_for(distance)
    assert expected.speed_after(time) == pytest.approx(pace.speed_after(time), abs=0.3)


@pytest.mark.parametrize("speed", [0.0, 5.0, 12.0])
@pytest.mark.parametrize("line", [STRAIGHT, CORNER, SWERVE], ids=["straight", "corner", "swerve"])
def test_it_is_what_the_law_drives(line, speed):
    """From any place on, over the next 40 m."""
    route = route_of(line)
    seen, compared = driven(route, speed), 0
    for k in range(0, len(seen.time), 7):
        here, v, station = seen.time[k], seen.speed[k], seen.station[k]
        if station + 40.0 > min(seen.station[-1], route.length):
            break
        rate = (seen.speed[k] - seen.speed[k - 1]) / 0.1 if k else 0.0
        expected = profile(route, station, v, 0.4 * (1 - np.clip(rate / LAW.acceleration, 0.0, 1.0)))
        for distance in (5.0, 15.0, 25.0, 40.0):
            took = np.interp(station + distance, seen.station, seen.time) - here
            assert expected.time_for(distance) == pytest.approx(took, rel=0.08, abs=0.15)
            compared += 1
    assert compared > 12


def test_it_is_slower_in_a_bend_and_beside_a_body_that_it_goes_round():
    corner, straight = (profile(route_of(line), 40.0, 10.0) for line in (CORNER, STRAIGHT))
    assert corner.time_for(50.0) > straight.time_for(50.0) + 2.0
    beside = profile(route_of(STRAIGHT), 40.0, 2.0, top=2.0)
    assert beside.time_for(20.0) == pytest.approx(10.0)
    assert beside.time_for(200.0) == pytest.approx(100.0)  # beyond its last point


def test_a_faster_one_slows_down_to_the_limit():
    """From 13.9 to 8 m/s by three quarters of the comfortable braking."""
    expected, rate = profile(route_of(STRAIGHT, 8.0), 10.0, 13.9, 0.0), 0.75 * LAW.braking
    until, over = (13.9 - 8.0) / rate, (13.9**2 - 8.0**2) / (2 * rate)
    assert expected.time_for(50.0) == pytest.approx(until + (50.0 - over) / 8.0, rel=0.01)
    assert expected.speed_after(until / 2) == pytest.approx((13.9 + 8.0) / 2, rel=0.02)


def test_it_drives_by_its_factor_of_the_limits():
    assert profile(route_of(STRAIGHT, 10.0, 0.8), 10.0, 8.0).time_for(40.0) == pytest.approx(5.0)


def test_a_limit_may_be_lower_than_any_bend_asks_for():
    assert profile(route_of(STRAIGHT, 0.2), 10.0, 0.2).time_for(2.0) == pytest.approx(10.0)


def test_on_a_loop_it_looks_past_the_first_point():
    """A square: 3 m before that point the corner lies ahead as it does before each other one."""
    square = np.array([(0.0, 0.0), (80.0, 0.0), (80.0, 80.0), (0.0, 80.0)])
    route = Route.along(("road",), square, np.full(4, 13.9), closed=True).drivable_by(CAR)
    side = route.length / 4
    before = [profile(route, (k + 1) * side - 12.0, 8.0).time_for(30.0) for k in range(4)]
    assert before == pytest.approx([before[0]] * 4, rel=0.02)
    assert before[0] > 30.0 / 8.0 + 0.5


@settings(deadline=None)
@given(st.floats(0, 15), st.floats(0, 60), st.floats(0.1, 60), st.floats(0.1, 60))
def test_a_longer_distance_takes_longer(speed, station, one, other):
    expected = profile(route_of(CORNER), station, speed)
    near, far = sorted((one, other))
    assert expected.time_for(near) <= expected.time_for(far) < math.inf
    assert expected.time_for(0.0) == expected.time_for(-1.0) == 0.0
