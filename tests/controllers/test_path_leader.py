"""The leader on a given path: steering, bends, speeds over time, obstacles, stop lines."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import path_kernel
from platoontraffic.controllers.law import Body, RouteAhead
from platoontraffic.controllers.path import STRONGEST, PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount, Scene
from platoontraffic.road.route import REACH, Route
from platoontraffic.vehicles.bicycle import CARS
from tests.support.bench import BLIND, DT, NO_WALLS, ROBOT, StopLine, amplitude, drive, platoon

CAR = replace(CARS["car"], lag=0.1, brake_lag=0.1)
EYE = replace(PRESETS["car-leader"], mount=Mount(CAR.length / 2), noise=PRESETS["paper-leader"].noise)
FAR = 1e4


def line(*points, limit: float = 100.0, closed: bool = False) -> Route:
    return Route.along(("road",), np.array(points, dtype=float), np.full(len(points), limit), closed=closed)


def circle(radius: float, sign: int = 1, limit: float = 100.0) -> Route:
    angle = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    points = np.column_stack([radius * np.sin(angle), sign * radius * (1 - np.cos(angle))])
    return Route.along(("road",), points, np.full(1000, limit), closed=True)


def along(route, law, scene=NO_WALLS, seconds=20.0, model=ROBOT, eye=BLIND, speed=0.0, dt=0.025, at=0.0):
    """Drives one vehicle; its driven axle starts at (at, 0), and it heads east."""
    (member,) = platoon(law, at=(at - model.axle, 0.0, 0.0), leader_eye=eye, model=model)
    return drive([replace(member, route=route, speed=speed)], scene, seconds, dt)


def axle(log, model=ROBOT):
    """Middle of the driven axle, (k, 2)."""
    heading = log.heading[:, 0]
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    return np.column_stack([log.x[:, 0], log.y[:, 0]]) + model.axle * ahead


@pytest.mark.parametrize("radius", [0.5, 1.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_pure_pursuit_keeps_a_circle(radius, sign):
    """The arc through two points of a circle, tangent to it at the first, is that circle."""
    log = along(circle(radius, sign), PathLeader(speed=0.2), seconds=30.0)
    away = np.hypot(*(axle(log) - (0, sign * radius)).T)
    assert away == pytest.approx(radius, rel=1e-3)
    yaw_rate = np.diff(log.turned[:, 0])[log.time[1:] > 5] / 0.025
    assert yaw_rate == pytest.approx(sign * 0.2 / radius, rel=0.01)


def test_a_vehicle_that_starts_beside_a_straight_path_converges_to_it():
    log = along(line((0.0, 0.1), (9.0, 0.1)), PathLeader(speed=0.1))
    assert abs(axle(log)[-1, 1] - 0.1) < 1e-3


def test_it_drives_straight_and_steadily_to_the_end_of_its_path():
    """Its look-ahead point lies beyond the end; it arrives when its front bumper does."""
    log = along(line((0.0, 0.0), (1.0, 0.0)), PathLeader(speed=0.1), seconds=18.0)
    assert log.x[-1, 0] + ROBOT.length / 2 == pytest.approx(1.0, abs=0.1 * DT + 1e-6)
    assert log.speed[log.time > 5] == pytest.approx(0.1, rel=1e-3)
    assert log.y == pytest.approx(0.0, abs=1e-9)


# ---- bends and limits


@pytest.mark.parametrize("radius", [12.0, 40.0])
def test_bends_are_driven_at_the_allowed_lateral_acceleration(radius):
    law = PathLeader(speed=30.0, lateral_acceleration=2.0)
    log = along(circle(radius), law, model=CAR, seconds=60.0, dt=0.1)
    speed = log.speed[log.time > 30, 0]
    assert speed == pytest.approx(np.sqrt(2.0 * radius), rel=0.02)
    assert np.hypot(*(axle(log, CAR) - (0, radius)).T)[log.time > 30] == pytest.approx(radius, abs=0.1)


def test_it_slows_down_before_a_bend_rather_than_in_it():
    quarter = np.linspace(-np.pi / 2, 0, 30)
    bend = [(200 + 12 * np.cos(a), 12 + 12 * np.sin(a)) for a in quarter]
    log = along(line((0, 0), *bend, (212, 120)), PathLeader(speed=15.0), model=CAR, seconds=40.0, speed=15.0, dt=0.1)
    x, speed = axle(log, CAR)[:, 0], log.speed[:, 0]
    in_it = (x > 205) & (x < 211.9)
    assert speed[in_it].max() < 1.1 * np.sqrt(PathLeader().lateral_acceleration * 12)
    assert speed[x < 120].min() > 14
    assert np.diff(speed).min() / 0.1 > -3.0
    assert speed[-1] > 12


def test_where_a_turn_begins_the_steering_rate_limits_the_acceleration_for_bends():
    """Followers drive by that acceleration: without it they took the begin of a turn too fast, and left their route."""
    distance, curvature = np.arange(6.0)[None], np.array([[0.0, 0.1, 0.1, 0.1, 0.1, 0.1]])
    points = np.stack([distance, np.zeros((1, 6))], axis=-1)
    route = RouteAhead(distance, points, np.full((1, 6), 100.0), curvature, np.zeros((1, 6)))
    body = Body(*(np.array([getattr(CAR, name)]) for name in Body._fields))
    scan = SimpleNamespace(model=EYE, ranges=np.full((1, 3), np.inf, np.float32))
    scan.ranges.setflags(write=False)  # as the laser's, or numba compiles once more
    none, law = np.zeros(1), PathLeader()
    for speed in (1.0, 2.0):
        sensed = SimpleNamespace(route=route, body=body, scan=scan, speed=np.array([speed]))
        bends = law.along_route(sensed, none, none, np.array([np.inf]), none, 0.1).bends[0]
        steered = path_kernel.STEERED * CAR.curvature_rate / 0.1
        assert bends == pytest.approx((steered - speed) / path_kernel.SETTLING)


@pytest.mark.parametrize("law", [PathLeader(), PathLeader(braking=1.5), PathLeader(acceleration=1.0, braking=5.0)])
@pytest.mark.parametrize("speed", [0.0, 4.0, 14.0, 28.0])
def test_what_is_farther_away_than_it_looks_along_its_route_does_not_slow_it(law, speed):
    """Neither its own acceleration, nor the strongest that a follower wants."""
    rng = np.random.default_rng(int(speed))
    body = Body(*(np.array([getattr(CAR, name)]) for name in Body._fields))
    scan = SimpleNamespace(model=EYE, ranges=np.full((1, 3), np.inf, np.float32))
    scan.ranges.setflags(write=False)
    none, slowed = np.zeros(1), []
    distance = REACH[None] * CAR.length
    points = np.stack([distance, np.zeros_like(distance)], axis=-1)
    nearest = distance[0].searchsorted(law.looks_along(speed)) + 1
    for begins in np.arange(0, distance.size, 3):  # of a slow bend, behind which anything may follow
        limit, curvature = np.full_like(distance, 40.0), np.zeros_like(distance)
        limit[0, begins:] = rng.uniform(0, 20, distance.size - begins)
        curvature[0, begins:] = rng.uniform(0, 0.1, distance.size - begins)
        whole = RouteAhead(distance, points, limit, curvature, np.zeros_like(distance))
        part = RouteAhead(*(np.ascontiguousarray(values[:, :nearest]) for values in whole))
        now = {"body": body, "scan": scan, "speed": np.array([speed])}
        one, other = (
            law.along_route(SimpleNamespace(route=route, **now), none, none, np.array([np.inf]), none, 0.1)
            for route in (whole, part)
        )
        assert min(one.bends[0], STRONGEST) == min(other.bends[0], STRONGEST)
        assert one.acceleration[0] == other.acceleration[0]
        slowed.append(one.bends[0] < STRONGEST)
    assert slowed[0] or speed == 0.0
    assert nearest > distance.size or not slowed[-1]


def test_it_drives_at_the_speed_limit_and_brakes_before_a_lower_one():
    limits = np.array([10.0, 5.0, 20.0, 20.0])
    route = Route.along(("a", "b", "c"), np.array([(0, 0), (200, 0), (300, 0), (900, 0)]), limits)
    log = along(route, PathLeader(), model=CAR, eye=EYE, seconds=80.0, dt=0.1)
    x, speed = axle(log, CAR)[:, 0], log.speed[:, 0]
    assert speed[(x > 80) & (x < 150)] == pytest.approx(10.0, rel=0.01)
    assert speed[(x > 200) & (x < 295)].max() < 5.0 * 1.1
    assert speed[-1] == pytest.approx(20.0, rel=0.01)
    faster = along(route, PathLeader(speed_factor=1.2), model=CAR, eye=EYE, seconds=80.0, dt=0.1)
    assert faster.speed[-1, 0] == pytest.approx(24.0, rel=0.01)


# ---- speeds over time

STRAIGHT = line((0.0, 0.0), (FAR, 0.0))


def speed_of(law: PathLeader, seconds: float, begin: float = 10.0):
    log = along(STRAIGHT, law, model=CAR, seconds=seconds, speed=begin, dt=0.05)
    return log.time, log.speed[:, 0]


@pytest.mark.parametrize("frequency", [0.05, 0.1, 0.2, 0.3, 0.5])
def test_a_sinusoid_is_driven_through_the_lags_of_the_vehicle(frequency):
    law, car = PathLeader(speed=15.0, profile="sinusoid", amplitude=0.5, frequency=frequency), CARS["car"]
    log = along(line((0.0, 0.0), (FAR, 0.0)), law, seconds=2 / frequency + 20.0, model=car, speed=15.0,
                eye=replace(BLIND, rate=10.0), dt=0.1)  # fmt: skip
    late = log.time > 20
    driven = amplitude(log.time[late], log.speed[late], 2 * np.pi * frequency)
    assert driven == pytest.approx(0.5, rel=0.05)


def test_a_sinusoid_is_driven_with_its_amplitude_and_frequency():
    law = PathLeader(speed=10.0, profile="sinusoid", amplitude=2.0, frequency=0.1, begins=5.0)
    time, speed = speed_of(law, 65.0)
    late = time >= 15.0
    assert speed[time < 5.0] == pytest.approx(10.0)
    fit = np.column_stack([np.sin(0.2 * np.pi * (time - 5)), np.cos(0.2 * np.pi * (time - 5)), np.ones_like(time)])
    sin, cos, mean = np.linalg.lstsq(fit[late], speed[late], rcond=None)[0]
    assert (np.hypot(sin, cos), mean) == pytest.approx((2.0, 10.0), rel=0.03)
    assert abs(np.arctan2(cos, sin)) < 0.1  # hardly late, since the rate is demanded too


def test_a_chirp_grows_from_the_first_to_the_last_frequency():
    law = PathLeader(speed=10.0, profile="chirp", amplitude=1.0, frequency=0.05, last_frequency=0.25, lasts=60.0)
    time, speed = speed_of(law, 70.0)
    crossings = time[1:][np.diff(np.sign(speed - 10.0)) != 0]
    crossings = crossings[(crossings > 1) & (crossings < 60)]
    phase = (0.05 + (0.2 / 60) * crossings / 2) * crossings  # [turns]: half a turn from one to the next
    assert np.diff(phase) == pytest.approx(0.5, abs=0.05)
    assert speed[time > 64] == pytest.approx(10.0, abs=0.02)


@pytest.mark.parametrize(("to", "rate"), [(4.0, 2.0), (0.0, 6.0), (16.0, 1.0)])
def test_braking_takes_its_rate_to_its_last_speed(to, rate):
    law = PathLeader(speed=10.0, profile="brake", begins=5.0, last_speed=to, rate=rate)
    time, speed = speed_of(law, 40.0)
    assert speed[time <= 5.0] == pytest.approx(10.0)
    assert speed[-1] == pytest.approx(to, abs=1e-3)
    half_way = np.interp(0.5, np.abs(speed - 10.0) / abs(to - 10.0), time)
    late = half_way - (5.0 + abs(to - 10.0) / rate / 2)
    assert -0.02 < late < CAR.lag + rate / CAR.max_jerk / 2 + 0.05  # lags of drive line and jerk, and a step


def test_a_step_is_driven_in_comfort():
    law = PathLeader(speed=10.0, profile="step", begins=5.0, last_speed=4.0, braking=2.0)
    _, speed = speed_of(law, 30.0)
    assert speed[-1] == pytest.approx(4.0, abs=1e-3)
    assert np.diff(speed).min() / 0.05 == pytest.approx(-2.0, rel=0.02)


def test_a_trace_from_a_file_is_driven(tmp_path):
    file = tmp_path / "cycle.csv"
    file.write_text("time_s,grade,speed_mps\n0,0,10\n10,0,14\n20,0,14\n40,0,4\n")
    time, speed = speed_of(PathLeader(trace=file), 60.0)
    wanted = np.interp(time, [0, 10, 20, 40], [10, 14, 14, 4])
    assert np.abs(speed - wanted).max() < 0.25
    assert speed[-1] == pytest.approx(4.0, abs=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,speed\n0,1\n", r"has no column speed_mps and time_s; must be a CSV file with columns"),
        ("time_s,speed_mps\n0,1\n1,fast\n", r"cycle.csv:3: time_s '1', speed_mps 'fast'; must be numbers"),
        ("time_s,speed_mps\n0,1\n0,2\n", "times must grow from row to row, and speeds be 0 or more"),
        ("time_s,speed_mps\n0,-1\n", "times must grow from row to row, and speeds be 0 or more"),
        ("time_s,speed_mps\n", "has no rows"),
    ],
)
def test_faults_of_a_trace_are_named(tmp_path, text, said):
    file = tmp_path / "cycle.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=said):
        PathLeader(trace=file)


# ---- obstacles


def test_the_first_return_on_its_strip_is_the_one_that_shapely_finds():
    rng = np.random.default_rng(1)
    n, k, front, half_width = 40, 90, 1.0, 1.1
    step = rng.uniform(0.5, 2.0, (n, 30))
    heading = np.cumsum(rng.normal(0, 0.1, (n, 30)), axis=1)
    steps = np.stack([step * np.cos(heading), step * np.sin(heading)], axis=2)
    points = np.concatenate([np.zeros((n, 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    distance = np.concatenate([np.zeros((n, 1)), np.cumsum(step, axis=1)], axis=1)
    ranges = rng.uniform(1.0, 40.0, (n, k))
    ranges[rng.random((n, k)) < 0.3] = np.inf
    ranges[rng.random((n, k)) < 0.1] = np.nan
    angle = np.linspace(-1.5, 1.5, k)
    beams = np.stack([np.cos(angle), np.sin(angle)])
    free, first, limits = np.empty(n), np.empty(n, int), (0.0, 40.0)
    strip, length = (points, distance, np.full(n, half_width)), np.full(n, 2 * front)
    path_kernel.first_on_strip(ranges, limits, beams, np.full(n, 0.5), 0.1, strip, length, length / 2, free, first)

    routes = shapely.linestrings(points)[:, None]
    to_there = np.where(np.isfinite(ranges), ranges, -9.0)  # returns from behind do not count
    x, y = 0.5 + to_there * beams[0], 0.1 + to_there * beams[1]
    met = shapely.points(x, y)
    distance = shapely.line_locate_point(routes, met) - front
    distance[(shapely.distance(routes, met) >= half_width) | (distance <= 0) | (x <= 0)] = np.inf
    assert free == pytest.approx(distance.min(axis=1), abs=1e-9)
    assert np.isfinite(free).sum() > 10
    nearest = np.where(np.isfinite(free), distance.argmin(axis=1), -1)
    assert first.tolist() == nearest.tolist()


@pytest.mark.parametrize("speed", [5.0, 13.9])
def test_it_stops_at_its_stand_off_before_an_obstacle(speed):
    wall = Scene.from_shapely(solids=[shapely.box(150, -1, 152, 1)])
    log = along(STRAIGHT, PathLeader(speed=speed, stand_off=3.0), wall, 60.0, CAR, EYE, speed, 0.1)
    front = log.x[:, 0] + CAR.length / 2
    assert log.speed[-1, 0] < 0.05
    assert 150 - front[-1] == pytest.approx(3.0, abs=0.3)
    assert front.max() < 150
    assert np.diff(log.speed[:, 0]).min() / 0.1 > -8.1


@pytest.mark.parametrize(("range_max", "brakes"), [(5.0, 9.0), (20.0, 9.0), (80.0, 9.0), (150.0, 9.0), (80.0, 5.0)])
@pytest.mark.parametrize("law", [PathLeader(), TrackingFollower(on_loss="drive", keeps_to="route")])
def test_by_speed_limits_it_stops_for_whatever_it_sees(law, range_max, brakes):
    """v (0.3 s + brake lag) + v^2 / 2 b = range - half a length, b: 8 m/s2, or by its brakes."""
    car = replace(CAR, max_braking=brakes)
    far = 1500.0 if range_max > 20.0 else 200.0  # far enough for that speed
    wall, eye = Scene.from_shapely(solids=[shapely.box(far, -1, far + 2, 1)]), replace(EYE, range_max=range_max)
    log = along(line((0.0, 0.0), (3000.0, 0.0), limit=60.0), law, wall, 100.0, car, eye, 1.0, 0.1)
    front, speed, lag = log.x[:, 0] + CAR.length / 2, log.speed[:, 0].max(), 0.3 + CAR.brake_lag
    assert speed * lag + speed**2 / 2 / min(8.0, brakes) == pytest.approx(range_max - CAR.length / 2, rel=0.01)
    assert log.speed[-1, 0] < 0.05
    assert 0.2 * CAR.length < far - front[-1] < 10.0
    assert np.diff(log.speed[:, 0]).min() / 0.1 > -9.1


def test_a_follower_need_not_see_farther_than_its_predecessor_in_a_platoon():
    """From 80 m it would stop from 31.5 m/s. Its leader drives 36 m/s."""
    law = TrackingFollower(on_loss="drive")
    eye, gap = replace(EYE, range_max=80.0), law.desired_distance(36.0)
    members = platoon(PathLeader(speed=36.0), law, 1, distance=gap, model=CAR, leader_eye=EYE, eye=eye, speed=36.0)
    route = line((-200.0, 0.0), (FAR, 0.0), limit=60.0)
    log = drive([replace(member, route=route) for member in members], NO_WALLS, 60.0, 0.1)
    assert log.speed[-1] == pytest.approx([36.0, 36.0], abs=0.1)


def test_a_given_speed_is_driven_however_little_it_sees():
    log = along(STRAIGHT, PathLeader(speed=30.0), NO_WALLS, 5.0, CAR, replace(EYE, range_max=20.0), 30.0, 0.1)
    assert log.speed[:, 0] == pytest.approx(30.0)


def test_it_passes_obstacles_beside_its_route():
    beside = Scene.from_shapely(solids=[shapely.box(60, 1.3, 70, 3), shapely.box(60, -3, 70, -1.3)])
    log = along(STRAIGHT, PathLeader(speed=10.0), beside, 15.0, CAR, EYE, 10.0, 0.1)
    assert log.speed[:, 0] == pytest.approx(10.0)


def test_in_a_bend_it_looks_along_its_route_and_not_straight_ahead():
    quarter = np.linspace(-np.pi / 2, 0, 30)
    route = line((0, 0), *[(50 + 15 * np.cos(a), 15 + 15 * np.sin(a)) for a in quarter], (65, 200))
    beyond = Scene.from_shapely(solids=[shapely.box(70, -3, 80, 5)])  # straight ahead, not on the route
    log = along(route, PathLeader(speed=5.0), beyond, 40.0, CAR, EYE, 5.0, 0.1)
    assert axle(log, CAR)[-1, 1] > 60
    in_it = Scene.from_shapely(solids=[shapely.box(64, 60, 66, 62)])
    log = along(route, PathLeader(speed=5.0), in_it, 60.0, CAR, EYE, 5.0, 0.1)
    assert 52 < axle(log, CAR)[-1, 1] + CAR.length / 2 - CAR.axle < 60


def test_it_follows_at_stand_off_and_headway():
    """At equal speeds the interaction term vanishes at s0 + v T."""
    law = PathLeader(speed=15.0, stand_off=3.0, time_headway=1.5)
    (one,) = platoon(law, at=(-CAR.axle, 0.0, 0.0), leader_eye=EYE, model=CAR)
    (ahead,) = platoon(PathLeader(speed=8.0), at=(60.0, 0.0, 0.0), model=CAR)
    other = replace(ahead, id="other", platoon="other", route=STRAIGHT, speed=8.0)
    log = drive([replace(one, route=STRAIGHT, speed=15.0), other], NO_WALLS, 60.0, 0.1)
    gap = log.x[:, 1] - log.x[:, 0] - CAR.length
    assert gap[-1] == pytest.approx(3.0 + 8.0 * 1.5, rel=0.01)
    assert gap.min() > 10
    assert log.speed[-1] == pytest.approx(8.0, rel=0.01)


# ---- stop lines


def before_a_line(at: float, opens: float, *, minor=False, changing=False, speed=12.0, seconds=40.0):
    """Time, x of the front bumper, and speed, at a stop line at x = `at` that is closed until it `opens` [s]."""
    (one,) = platoon(PathLeader(speed=12.0), at=(-CAR.axle, 0.0, 0.0), leader_eye=EYE, model=CAR, speed=speed)

    def ground() -> StopLine:
        return StopLine(0.1, at, lambda time: time >= opens, minor=minor, changing=changing)

    log = drive([replace(one, route=STRAIGHT)], NO_WALLS, seconds, 0.1, ground=ground)
    return log.time, log.x[:, 0] + CAR.length / 2, log.speed[:, 0]


def test_it_stops_at_a_closed_line_and_goes_when_it_opens():
    time, front, speed = before_a_line(100.0, opens=25.0)
    waits = (time > 18) & (time < 25)
    assert speed[waits].max() < 0.3
    assert 98.0 < front[waits].max() <= 100.0
    assert np.diff(speed).min() / 0.1 > -1.2 * PathLeader().braking
    assert front[-1] > 150


@pytest.mark.parametrize(
    ("law", "closes"),
    [(PathLeader(speed=12.0), 0.5), (TrackingFollower(policy="obey", on_loss="drive"), 0.9)],
)
def test_it_stops_again_if_its_line_closes_just_after_it_has_set_out(law, closes):
    """By then it drives at 1 m/s or more. A follower went on to accelerate: by its comfort it stops later."""
    (one,) = platoon(law, at=(-CAR.axle, 0.0, 0.0), leader_eye=EYE, model=CAR, speed=0.0)
    at = CAR.length / 2 - CAR.axle + 0.9
    log = drive(
        [replace(one, route=STRAIGHT)], NO_WALLS, 2.0, 0.1, ground=lambda: StopLine(0.1, at, lambda time: time < closes)
    )
    speed, front = log.speed[:, 0], log.x[:, 0] + CAR.length / 2
    assert speed.max() > 1.0
    stands = (log.time > closes) & (speed < 0.1)
    assert stands.any()
    assert front[stands].min() < at + 0.4


def test_it_keeps_its_speed_until_it_must_brake_in_comfort_for_a_line():
    _, front, speed = before_a_line(120.0, opens=np.inf)
    left, braking = 120 - path_kernel.STOP_BEFORE * CAR.length - front, PathLeader().braking
    assert speed[left > 12.0**2 / (2 * braking) + path_kernel.SETTLING * 12.0].min() > 0.98 * 12.0


@pytest.mark.parametrize("lag", [0.1, 0.5])
def test_it_moves_up_to_a_line_almost_as_fast_as_comfort_allows(lag):
    """From stand to stand over a distance s by acceleration a and braking b: at most sqrt(2 s / (1 / a + 1 / b))."""
    law, model, s = PathLeader(speed=20.0), replace(CAR, lag=lag, brake_lag=0.2), 30.0
    (one,) = platoon(law, at=(-model.axle, 0.0, 0.0), leader_eye=EYE, model=model)
    start = model.length / 2 - model.axle
    at = start + s + path_kernel.STOP_BEFORE * model.length
    log = drive(
        [replace(one, route=STRAIGHT)], NO_WALLS, 15.0, 0.1, ground=lambda: StopLine(0.1, at, lambda time: False)
    )
    fastest = np.sqrt(2 * s / (1 / law.acceleration + 1 / law.braking))
    assert 0.9 * fastest < log.speed.max() <= fastest
    assert np.diff(log.speed[:, 0]).min() / 0.1 > -1.25 * law.braking
    assert log.x[-1, 0] - log.x[0, 0] == pytest.approx(s, abs=0.1)


def test_an_open_line_changes_nothing():
    *_, speed = before_a_line(60.0, opens=0.0)
    assert speed == pytest.approx(12.0)


def test_at_yellow_it_goes_on_where_it_could_not_stop_in_comfort():
    *_, speed = before_a_line(15.0, opens=100.0, changing=True, seconds=5.0)
    assert speed == pytest.approx(12.0)
    _, front, speed = before_a_line(60.0, opens=100.0, changing=True)
    assert front[-1] < 60 + CAR.length
    assert speed[-1] < 0.3


def test_it_slows_down_before_a_line_without_right_of_way_on_an_empty_road():
    _, front, speed = before_a_line(100.0, opens=0.0, minor=True)
    assert speed[(front > 70) & (front < 95)].min() < 9
    assert speed.min() > 3  # it does not stop
    assert speed[-1] == pytest.approx(12.0, rel=0.01)
