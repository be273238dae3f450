"""The law `tracking`: distance, path and sight, on bare ground, without SUMO."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import Law
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.controllers.tracking_kernel import APPROACH, FIRM, _comfort
from platoontraffic.lidar import PRESETS, LidarModel, Mount, Noise, Scene
from platoontraffic.lidar.pose import wrap
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import ODOMETRY
from tests.support.bench import BLIND, NO_WALLS, Log, Prescribed, Unseeing, amplitude, drive, platoon

DT = 0.1
CAR = VEHICLES["car"]
TRACKER = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), range_max=60.0)
NOISY, EXACT = TRACKER, replace(TRACKER, noise=Noise())
FOLLOWER = TrackingFollower()
BEHIND_BUMPER = CAR.length / 2 - TRACKER.mount.x


def cars(
    at,
    seconds: float,
    speed: float,
    followers: int = 9,
    eye: LidarModel = EXACT,
    odometry: str = "none",
    law: Law = FOLLOWER,
    seed: int = 0,
) -> Log:
    """A platoon at steady speed; at: the leader's acceleration and curvature as a function of time."""
    members = platoon(
        Prescribed(lambda time: Drive(*at(time))),
        law,
        followers,
        distance=FOLLOWER.desired_distance(speed),
        model=CAR,
        leader_eye=replace(BLIND, rate=10.0),
        eye=eye,
        speed=speed,
        odometry=ODOMETRY[odometry],
    )
    return drive(members, NO_WALLS, seconds, DT, seed=seed)


def gaps(log: Log) -> np.ndarray:
    """Gaps on a straight road, bumper to bumper [m], (k, n - 1)."""
    return log.x[:, :-1] - log.x[:, 1:] - CAR.length


def off_path(log: Log, member: int, other: int) -> float:
    """Greatest distance of a rear axle from the path of another [m]."""
    path = shapely.LineString(log.axle[:, other])
    points = shapely.points(log.axle[:, member])
    beside = (shapely.line_locate_point(path, points) > 0) & (shapely.line_locate_point(path, points) < path.length)
    return shapely.distance(points, path)[beside].max()


def turn(radius: float, angle: float, speed: float, begins: float = 5.0):
    """Acceleration and curvature over time: a turn to the right after a straight."""
    return lambda time: (0.0, -1 / radius if begins <= time < begins + angle * radius / speed else 0.0)


def s_bend(speed: float, begins: float = 5.0):
    """Acceleration and curvature over time: arcs of 0.9 rad of falling radius, left and right in turn."""
    stations = np.cumsum([begins * speed, *(0.9 * radius for radius in RADII)])

    def at(time: float) -> tuple[float, float]:
        i = int(np.searchsorted(stations, speed * time, side="right"))
        return (0.0, 0.0) if not 0 < i <= len(RADII) else (0.0, (-1) ** i / RADII[i - 1])

    return at


RADII = (60.0, 40.0, 30.0, 20.0, 15.0, 12.0)


def straight_on(time: float) -> tuple[float, float]:
    return 0.0, 0.0


# ---- distance


@pytest.mark.parametrize("speed", [0.0, 5.0, 15.0, 30.0])
@pytest.mark.parametrize("eye", [EXACT, NOISY], ids=["exact", "noisy"])
def test_a_steady_gap_is_the_desired_distance(speed, eye):
    log = cars(straight_on, 15.0, speed, eye=eye)
    wanted = FOLLOWER.desired_distance(speed) - BEHIND_BUMPER
    assert gaps(log)[50:].mean(axis=0) == pytest.approx(wanted, rel=0.005)
    assert log.locked().all()


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [0.02, 0.05, 0.1, 0.2, 0.3, 0.5])
def test_no_disturbance_of_speed_grows_along_ten_followers(frequency):
    omega = 2 * np.pi * frequency
    most = min(1.5 / omega, 1.5)  # [m/s], within comfortable acceleration
    # 20 s for the ends of the straight, and whole periods after these.
    log = cars(
        lambda time: (most * omega * math.cos(omega * time), 0.0), 20 + max(40, 3 / frequency), 20.0, followers=10
    )
    late = log.time > 20
    of = amplitude(log.time[late], log.speed[late], omega)
    ratio = of[1:5] / of[:4]
    assert (ratio < 1).all()
    assert ratio == pytest.approx(ratio[0], rel=0.03)  # each damps like its predecessor
    deviation = log.speed - 20.0
    assert (np.diff(np.linalg.norm(deviation, axis=0)) <= 1e-6).all()  # L2
    assert (np.diff(np.abs(deviation).max(axis=0)) <= 1e-3).all()  # L-infinity


@pytest.mark.parametrize("seed", [None, *range(20)])
def test_a_leader_that_brakes_as_hard_as_it_can_is_not_hit(seed):
    def brake(time: float) -> tuple[float, float]:
        return (-8.0 if time > 3 else 0.0), 0.0

    log = cars(brake, 26.0, 25.0, eye=EXACT if seed is None else NOISY, seed=seed or 0)
    assert (log.speed[-1] < 0.05).all()
    assert gaps(log).min() > 2.0
    assert log.acceleration[:, 0].min() == pytest.approx(-8.0, abs=0.01)


@pytest.mark.parametrize("eye", [EXACT, NOISY], ids=["exact", "noisy"])
def test_it_stops_at_the_stand_off_behind_a_leader_that_brakes_in_comfort(eye):
    log = cars(lambda time: ((-3.0 if time > 3 else 0.0), 0.0), 35.0, 20.0, eye=eye)
    assert gaps(log)[-1] == pytest.approx(FOLLOWER.stand_off - BEHIND_BUMPER, abs=0.3)


@pytest.mark.parametrize("eye", [EXACT, NOISY], ids=["exact", "noisy"])
@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_it_stops_behind_a_standing_car_first_seen_at_sixty_metres(speed, eye):
    members = platoon(
        Prescribed(lambda _: Drive(0.0, 0.0)), FOLLOWER, 1, distance=80.0, model=CAR, eye=eye, speed=speed,
        leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    members[0] = replace(members[0], speed=0.0)
    log = drive(members, NO_WALLS, 35.0, DT)
    assert log.speed[-1, 1] < 0.05
    assert gaps(log)[-1, 0] == pytest.approx(FOLLOWER.stand_off - BEHIND_BUMPER, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [3.08, 3.11, 3.2])
def test_in_a_queue_it_neither_creeps_nor_turns(distance):
    """In three minutes, errors of the measured yaw rate would turn it by up to 18 degrees."""
    members = platoon(
        Prescribed(lambda time: Drive(1.0 if 180 <= time < 188 else 0.0, 0.0)), FOLLOWER, 4, distance=distance,
        model=CAR, leader_eye=replace(BLIND, rate=10.0), eye=NOISY, odometry=ODOMETRY["car"],
    )  # fmt: skip
    log = drive(members, NO_WALLS, 210.0, DT)
    stands = log.time < 180
    still = gaps(log)[stands]
    assert still.min() > FOLLOWER.stand_off - BEHIND_BUMPER - 0.02
    assert np.ptp(still[100:], axis=0).max() < 0.05
    assert np.abs(log.y).max() < 0.1


def test_catching_up_is_bounded_in_speed():
    members = platoon(
        Prescribed(lambda _: Drive(0.0, 0.0)), FOLLOWER, 1, distance=55.0, model=CAR, eye=EXACT, speed=15.0,
        leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    log = drive(members, NO_WALLS, 60.0, DT)
    assert 17 < log.speed[:, 1].max() < 15 + FOLLOWER.catching_up + 0.1
    assert gaps(log)[-1, 0] == pytest.approx(FOLLOWER.desired_distance(15.0) - BEHIND_BUMPER, rel=0.02)


@pytest.mark.parametrize("speed", [3.0, 7.0, 15.0])
def test_it_catches_up_as_fast_as_it_could_stop_behind_its_predecessor(speed):
    """Gipps (1981): by the same braking b of both, v^2 <= u^2 + 2 b s over the distance s beyond the wanted one."""
    members = platoon(
        Prescribed(lambda time: Drive(-APPROACH if time > 6 else 0.0, 0.0)), FOLLOWER, 1, distance=55.0, model=CAR,
        eye=EXACT, speed=speed, leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    log = drive(members, NO_WALLS, 40.0, DT)
    beyond = gaps(log)[:, 0] + BEHIND_BUMPER - FOLLOWER.desired_distance(log.speed[:, 1])
    fastest = np.sqrt(speed**2 + 2 * APPROACH * np.maximum(beyond, 0))
    closes = (log.time < 6) & (log.speed[:, 1] > 0.9 * log.speed[:, 1].max())
    assert 0.9 < (log.speed[:, 1] / fastest)[closes].mean() < 1.05
    assert log.acceleration[:, 1].min() > -FOLLOWER.braking
    assert gaps(log)[-1, 0] == pytest.approx(FOLLOWER.stand_off - BEHIND_BUMPER, abs=0.1)


# ---- path


@pytest.mark.parametrize("eye", [EXACT, NOISY], ids=["exact", "noisy"])
@pytest.mark.parametrize(
    ("path", "speed", "seconds"),
    [(turn(8.0, math.pi / 2, 5.0), 5.0, 30.0), (s_bend(6.0), 6.0, 50.0), (turn(500.0, math.pi / 4, 30.0), 30.0, 25.0)],
    ids=["junction turn", "S-bend", "motorway bend"],
)
def test_no_corner_is_cut(path, speed, seconds, eye):
    log = cars(path, seconds, speed, eye=eye)
    assert max(off_path(log, i, i - 1) for i in range(1, 10)) < 0.15
    assert off_path(log, 9, 0) < 0.6
    assert log.locked().mean(axis=0).min() >= 0.99


@pytest.mark.parametrize(
    ("path", "speed", "seconds"),
    [(turn(8.0, math.pi / 2, 5.0), 5.0, 30.0), (s_bend(6.0), 6.0, 50.0), (turn(500.0, math.pi / 4, 30.0), 30.0, 25.0)],
    ids=["junction turn", "S-bend", "motorway bend"],
)
def test_no_corner_is_cut_by_a_car_whose_odometry_errs(path, speed, seconds):
    log = cars(path, seconds, speed, eye=NOISY, odometry="car")
    assert max(off_path(log, i, i - 1) for i in range(1, 10)) < 0.3
    assert off_path(log, 9, 0) < 0.6
    assert log.locked().mean(axis=0).min() >= 0.99


@pytest.mark.parametrize("eye", [EXACT, NOISY], ids=["exact", "noisy"])
def test_a_fast_bend_below_the_lateral_limit_is_held(eye):
    """3.5 m/s2 sideways; the speed is planned for 3.7 m/s2."""
    log = cars(turn(260.0, math.pi / 2, 30.0), 25.0, 30.0, eye=eye)
    assert log.locked().mean(axis=0).min() >= 0.99
    assert max(off_path(log, i, i - 1) for i in range(1, 10)) < 0.15


def test_nothing_grows_along_the_string_in_a_steady_curve():
    log = cars(lambda time: (0.0, 1 / 60), 60.0, 10.0)
    for i in range(1, 10):
        ahead = shapely.LineString(log.axle[:, i - 1])
        assert shapely.distance(shapely.points(log.axle[-200:, i]), ahead).max() < 0.03
    assert shapely.distance(shapely.points(log.axle[-200:, 9]), shapely.LineString(log.axle[:, 0])).max() < 0.15


def test_left_and_right_are_the_same():
    path = turn(15.0, math.pi / 2, 6.0)
    one = cars(path, 25.0, 6.0, followers=3)
    other = cars(lambda time: (0.0, -path(time)[1]), 25.0, 6.0, followers=3)
    assert other.x == pytest.approx(one.x, abs=1e-3)
    assert other.y == pytest.approx(-one.y, abs=1e-3)


# ---- sight


@pytest.mark.parametrize(("radius", "speed", "centre", "corner"), [(8.0, 5.0, 63, 69), (6.0, 4.0, 68, 75)])
def test_bearing_of_the_predecessor_in_the_smallest_turns(radius, speed, centre, corner):
    """Bearings of centre and corners of its rear [deg]; the preset sees up to 90 on both sides."""
    log = cars(turn(radius, math.pi / 2, speed), 30.0, speed, eye=NOISY)
    ahead, own = slice(None, -1), slice(1, None)
    laser_x = log.x[:, own] + TRACKER.mount.x * np.cos(log.heading[:, own])
    laser_y = log.y[:, own] + TRACKER.mount.x * np.sin(log.heading[:, own])
    cos, sin = np.cos(log.heading[:, ahead]), np.sin(log.heading[:, ahead])
    most = []
    for side in (0, -CAR.width / 2, CAR.width / 2):
        x = log.x[:, ahead] - CAR.length / 2 * cos - side * sin - laser_x
        y = log.y[:, ahead] - CAR.length / 2 * sin + side * cos - laser_y
        most.append(np.degrees(np.abs(wrap(np.arctan2(y, x) - log.heading[:, own]))).max())
    assert most[0] == pytest.approx(centre, abs=3)
    assert max(most) == pytest.approx(corner, abs=3)


def test_it_keeps_its_predecessor_with_a_third_of_the_returns_lost():
    rainy = replace(NOISY, noise=replace(NOISY.noise, dropout=0.3))
    log = cars(lambda time: (math.sin(0.5 * time), 0.0), 40.0, 20.0, eye=rainy)
    assert log.locked().mean() >= 0.99  # of all nine; a single one may lose it for a second
    assert log.locked()[-1].all()


@pytest.mark.parametrize(
    ("path", "speed"), [(straight_on, 20.0), (turn(8.0, math.pi / 2, 5.0), 5.0)], ids=["straight", "turn"]
)
def test_it_keeps_its_predecessor_through_a_second_of_blindness(path, speed):
    log = cars(path, 25.0, speed, eye=NOISY, law=Unseeing(FOLLOWER, 5.5, 6.5))
    assert log.locked()[70:].mean(axis=0).min() >= 0.99
    assert max(off_path(log, i, i - 1) for i in range(1, 10)) < 0.3


def test_lasting_blindness_makes_it_stop():
    log = cars(straight_on, 20.0, 20.0, followers=1, eye=NOISY, law=Unseeing(FOLLOWER, 5.0, 30.0))
    at = {time: log.speed[round(time / DT), 1] for time in (6.0, 10.0, 19.0)}
    assert at[6.0] == pytest.approx(20.0, abs=0.3)  # it follows the prediction
    assert at[10.0] < 15
    assert at[19.0] == 0
    assert log.acceleration[:, 1].min() > -FOLLOWER.braking  # not an emergency
    assert np.abs(log.y[:, 1]).max() < 1.5  # after 150 m, the direction last seen is known to 0.01 rad


def test_it_sets_out_with_the_comfortable_jerk_at_once():
    """By the lag T of its drive a command a that is given at once is v = a (t - T (1 - exp(-t / T)))."""
    members = platoon(
        Prescribed(lambda _: Drive(0.0, 0.0)), FOLLOWER, 1, distance=40.0, model=CAR, eye=EXACT, speed=0.0,
        leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    log = drive(members, NO_WALLS, 2.0, DT)
    since = DT * (np.arange(len(log.speed)) - (log.acceleration[:, 1] > 0).argmax() + 1)
    driven = FOLLOWER.acceleration * (since - CAR.lag * (1 - np.exp(-since / CAR.lag)))
    assert log.speed[since > 0.5, 1] == pytest.approx(driven[since > 0.5], abs=0.1)
    assert np.diff(log.acceleration[:, 1]).max() / DT < FOLLOWER.jerk


@pytest.mark.parametrize(
    ("lag", "last", "wanted", "command"),
    [
        (0.5, -FIRM, 2.5, 2.5),  # 2.5 m/s2 by a lag of 0.5 s is 5 m/s3
        (0.2, -FIRM, 2.5, 1.0),
        (0.0, -FIRM, 2.5, 0.5),  # 5 m/s3 over one step
        (0.5, -FIRM, 0.3, 0.3),
        (0.5, 0.0, -FIRM, -0.5),  # it is held, as gently as before
        (0.5, 2.5, -FIRM, -0.5),  # the way was free in one scan only
    ],
)
def test_a_standing_vehicle_sets_out_without_having_released_its_brakes_first(lag, last, wanted, command):
    assert _comfort(0.0, last, wanted, math.inf, lag, FOLLOWER._gains, DT) == pytest.approx(command)


def test_without_a_predecessor_it_does_not_start():
    law = TrackingFollower()
    alone = platoon(law, eye=NOISY, leader_eye=NOISY, model=CAR)
    log = drive(alone, NO_WALLS, 3.0, DT)
    assert (log.speed == 0).all()
    assert np.isnan(log.distance).all()


def test_it_brakes_for_an_obstacle_on_its_path():
    """A pole between the two cars, which the predecessor has passed by."""
    pole = Scene.from_shapely(solids=[shapely.Point(-1.0, 0.3).buffer(0.15)])
    members = platoon(
        Prescribed(lambda _: Drive(0.0, 0.0)), FOLLOWER, 1, distance=32.0, model=CAR, eye=NOISY, speed=15.0,
        leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    log = drive(members, pole, 10.0, DT)
    assert log.speed[-1, 1] == 0
    assert log.x[-1, 1] + CAR.length / 2 < -1.0


@pytest.mark.parametrize("ahead", [0.1, 0.25])
@pytest.mark.parametrize("aside", [0.3, -0.8])
def test_it_stands_before_an_obstacle_though_its_predecessor_drives_away(ahead, aside):
    members = platoon(
        Prescribed(lambda _: Drive(0.5, 0.0)), FOLLOWER, 1, distance=6.0, model=CAR, eye=NOISY, speed=0.0,
        leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    front = members[1].pose[0] + CAR.length / 2
    pole = shapely.Point(front + ahead + 0.15, aside).buffer(0.15)
    log = drive(members, Scene.from_shapely(solids=[pole]), 15.0, DT)
    assert log.x[-1, 0] > front + 30.0
    assert log.x[-1, 1] + CAR.length / 2 < front + ahead


def test_a_pole_beside_its_path_is_passed():
    pole = Scene.from_shapely(solids=[shapely.Point(10.0, 1.6).buffer(0.15)])
    members = platoon(
        Prescribed(lambda _: Drive(0.0, 0.0)), FOLLOWER, 1, distance=18.0, model=CAR, eye=NOISY, speed=15.0,
        leader_eye=replace(BLIND, rate=10.0),
    )  # fmt: skip
    log = drive(members, pole, 5.0, DT)
    assert log.speed[:, 1] == pytest.approx(15.0, abs=0.1)
