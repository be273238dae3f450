"""What gets in the way: where it is at each instant, whether contact could be avoided, and that the laws then avoid it.

On bare ground, without SUMO. A human comes in on a straight road; pedestrians step out; a car stands behind a bend.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from platoontraffic.lidar import PRESETS, Mount, Scene

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.observation.avoidance import hardest, least_braking, least_gap, reaction, stopping_distance
from platoontraffic.observation.encounters import Encounter, Encounters
from platoontraffic.road.polyline import Polyline
from platoontraffic.road.route import Route
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import ODOMETRY
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.obstacles import Crossing, CuttingIn, Driving, Lying, Obstacles, Patrol, Plan, Speed, Way
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import BLIND, NO_WALLS, Prescribed, drive, platoon

DT = 0.1
CAR = VEHICLES["car"]
AT_BUMPER = Mount(CAR.length / 2 - 0.03)
TRACKER = replace(PRESETS["car-tracker"], mount=AT_BUMPER)
LEADING = replace(PRESETS["car-leader"], mount=AT_BUMPER)
STRAIGHT = Route.along(["e"], np.array([(-500.0, 0.0), (5000.0, 0.0)]), np.array([40.0, 40.0]))
WAY = Way(STRAIGHT)
NEVER = math.inf


def followers(speed: float, headway: float = 1.0, n: int = 2, route: Route = STRAIGHT) -> list[Member]:
    """Behind a leader that keeps its speed, with the car's laser and odometry and their errors."""
    law = TrackingFollower(time_headway=headway)
    members = platoon(
        Prescribed(lambda _: Drive(0.0, 0.0)), law, n, distance=law.desired_distance(speed), model=CAR, eye=TRACKER,
        leader_eye=replace(BLIND, rate=10.0), speed=speed, odometry=ODOMETRY["car"],
    )  # fmt: skip
    return [replace(m, route=route) for m in members]


def leader(speed: float, route: Route = STRAIGHT, at=(0.0, 0.0, 0.0)) -> list[Member]:
    law = PathLeader(speed=speed)
    members = platoon(law, model=CAR, leader_eye=LEADING, speed=speed, odometry=ODOMETRY["car"], at=at)
    return [replace(m, route=route) for m in members]


def cut_in(
    share: float = 0.5, relative: float = 0.0, takes: float = 3.0, comes: float = 4.0, brakes_after: float = NEVER,
    rate: float = 9.0, aside: float = 3.2, leaves_after: float = NEVER,
) -> CuttingIn:  # fmt: skip
    size, since = (CAR.length, CAR.width), max(comes - 3.0, 0.0)
    return CuttingIn(
        "human", "cut_in", *size, since, NEVER, (), WAY, "robot.1", "robot.0", comes, share, relative, aside, takes,
        brakes_after, rate, 0.5, leaves_after,
    )  # fmt: skip


def walk(x: float, speed: float, sets_out: float, side: float) -> Crossing:
    """From 4 m aside of the middle of the lane."""
    return Crossing("ped", "pedestrian", 0.3, 0.5, 0.0, NEVER, (), (x, side * 4.0), (x, -side * 4.0), speed, sets_out)


class Played(NamedTuple):
    met: list[Encounter]
    clearance: float  # least that any member ever had from the obstacle [m]
    seen: list[TrafficSnapshot]


def play(members: Sequence[Member], plan: Plan, seconds: float, seed: int = 0, scene: Scene = NO_WALLS) -> Played:
    least, seen, watching = [], [], []

    def observe(traffic, fleet, scans, others) -> None:
        if not watching:
            watching.append(Encounters(others, members))
        watching[0].observe(traffic, fleet, [])
        seen.append(traffic)
        if plan.id in traffic.ids:
            shapes = shapely.polygons(traffic.boxes().corners())
            least.append(shapely.distance(shapes[: len(members)], shapes[traffic.ids.index(plan.id)]).min())

    drive(members, scene, seconds, DT, observe=observe, seed=seed, plans=[plan])
    return Played(watching[0].rows(), min(least, default=NEVER), seen)


def of(seen: list[TrafficSnapshot], name: str) -> np.ndarray:
    """time, x, y, heading, speed of one of them, (k, 5)."""
    rows = [(t, t.ids.index(name)) for t in seen if name in t.ids]
    return np.array([(t.time, t.x[i], t.y[i], t.heading[i], t.speed[i]) for t, i in rows])


# ---- where they are


@settings(deadline=None, max_examples=50)
@given(st.floats(0, 40), st.floats(0, 20), st.floats(1, 9), st.floats(0, 1), st.floats(0, 60))
def test_the_way_is_the_integral_of_the_speed(first, brakes_at, rate, share, time):
    speed = Speed(first, brakes_at, rate, share * first)
    ticks = np.linspace(0, time, 2001)
    assert speed.way(time) == pytest.approx(np.trapezoid([speed.at(t) for t in ticks], ticks), rel=1e-5, abs=2e-3)
    assert speed.at(1e4) == pytest.approx(share * first if rate else first, abs=1e-9)


def test_a_car_brakes_on_its_way_and_ends_with_it():
    route = Route.along(["e"], np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 200.0)]), np.array([20.0] * 3))
    size = 4.74, 1.76
    car = Driving("c", "car", *size, 5.0, NEVER, (), Way(route), 10.0, 1.5, Speed(20.0, 3.0, 5.0, 10.0))
    assert car.pose(None, 6.0) == pytest.approx((30.0, 1.5, 0.0, 20.0))
    assert car.pose(None, 10.0)[3] == 10.0
    x, y, heading, _ = car.pose(None, 11.0)  # 10 + 60 + 30 + 10 m
    assert (x, y, heading) == pytest.approx((98.5, 10.0, math.pi / 2))
    assert car.pose(None, 100.0) is None


def test_a_robot_goes_to_and_fro_and_another_round():
    there_and_back = Polyline(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 0.0)]), closed=True)
    robot = Patrol("r", "robot", 0.2, 0.15, 2.0, NEVER, (), there_and_back, 0.1)
    assert robot.pose(None, 7.0) == pytest.approx((0.5, 0.0, 0.0, 0.1))
    assert robot.pose(None, 17.0) == pytest.approx((1.0, 0.5, math.pi / 2, 0.1))
    assert robot.pose(None, 27.0) == pytest.approx((1.0, 0.5, -math.pi / 2, 0.1))
    assert robot.pose(None, 37.0) == pytest.approx((0.5, 0.0, math.pi, 0.1))
    assert robot.pose(None, 47.0) == pytest.approx(robot.pose(None, 7.0))
    square = replace(robot, line=Polyline(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), closed=True))
    assert square.pose(None, 37.0) == pytest.approx((0.0, 0.5, -math.pi / 2, 0.1))


def test_a_pedestrian_waits_at_the_kerb_for_a_member_and_walks_straight_across():
    members = leader(10.0)
    standing = walk(100.0, 2.0, 0.0, -1)
    walker = replace(standing, sets_out=None, member="robot.0", within=50.0, way=WAY, station=600.0)
    seen = play(members, walker, 12.0).seen
    walked = of(seen, "ped")
    cars = of(seen, "robot.0")
    began = np.argmax(walked[:, 4] > 0)
    front = cars[began, 1] + CAR.length / 2
    assert 0 <= 50.0 - (100.0 - front) < 1.0  # within the way of one step
    assert walked[: began + 1, 2] == pytest.approx(-4.0)
    assert np.diff(walked[began:, 2]) == pytest.approx(0.2)
    assert walked[:, 3] == pytest.approx(math.pi / 2)
    assert walked[:, 1] == pytest.approx(100.0)
    assert len(walked) == began + 40  # then it is gone


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_one_who_cuts_in_comes_over_smoothly_at_its_share_of_the_gap(share):
    seen = play(followers(20.0), cut_in(share=share), 15.0).seen
    human, ahead, behind = (of(seen, name) for name in ("human", "robot.0", "robot.1"))
    first = round(human[0, 0] / DT)
    assert human[0, 0] == pytest.approx(1.0)
    front, rear = behind[first : first + 30, 1] + CAR.length / 2, ahead[first : first + 30, 1] - CAR.length / 2
    assert (human[:30, 1] - front) / (rear - front) == pytest.approx(share, abs=0.01)
    assert human[:30, 2] == pytest.approx(3.2)
    over = human[(human[:, 0] >= 4.0) & (human[:, 0] <= 7.0), 2]
    assert over[[0, 15, 30]] == pytest.approx([3.2, 1.6, 0.0], abs=1e-9)
    assert (np.diff(over) <= 0).all()
    assert np.abs(np.diff(over, 2)).max() / DT**2 < 10 / math.sqrt(3) * 3.2 / 9 * 1.01  # of the profile


def test_one_who_cuts_in_keeps_behind_who_is_ahead_and_drives_on_when_it_brakes_no_more():
    seen = play(followers(20.0), cut_in(brakes_after=6.0, rate=3.0, leaves_after=11.0, takes=2.0), 22.0).seen
    human, ahead = of(seen, "human"), of(seen, "robot.0")
    first = round(human[0, 0] / DT)
    n = len(human)
    assert (ahead[first : first + n, 1] - human[:, 1] - CAR.length).min() > 2.0
    slope = np.diff(human[:, 4]) / DT
    assert slope.min() == pytest.approx(-3.0, abs=1e-6)
    assert human[-1, 4] == pytest.approx(0.5)
    assert human[-1, 2] == pytest.approx(3.2)
    assert human[-1, 0] == pytest.approx(4 + 11 + 2 + 1)  # then it is gone


def test_nobody_cuts_into_a_gap_shorter_than_itself():
    members = followers(2.0, headway=0.5)  # 3.97 m
    played = play(members, cut_in(), 8.0)
    assert played.met == []
    assert "human" not in played.seen[-1].ids
    fleet = Fleet.deployed(members, DT)
    others = Obstacles([cut_in(comes=0.0)], fleet)
    assert others.given_up()["human"].startswith("the gap is 3.97 m")
    assert others.bodies.ids == ()


# ---- whether it could be avoided


@settings(deadline=None, max_examples=50)
@given(
    st.floats(0.1, 60), st.floats(1, 40), st.floats(0, 40), st.floats(0, 5), st.floats(1, 9), st.floats(0, 1)
)  # fmt: skip
def test_the_least_gap_is_that_of_the_two_motions(gap, speed, other, brakes_at, rate, share):
    (member,) = leader(10.0)
    ahead = Speed(other, brakes_at, rate, share * other)
    ticks = np.arange(0, 45, 0.005)
    own = Speed(speed, reaction(member), hardest(member))
    moved = np.array([gap + ahead.way(t) - own.way(t) for t in ticks])
    assert least_gap(gap, speed, member, ahead) == pytest.approx(moved.min(), abs=5e-3)


def test_before_what_stands_it_is_the_stopping_distance():
    for member in (*leader(10.0), followers(10.0)[1]):
        for speed in (3.0, 10.0, 30.0):
            enough = stopping_distance(speed, member)
            assert least_gap(enough, speed, member, Speed(0.0)) == pytest.approx(0.0, abs=1e-9)
            assert least_braking(enough, speed, member, Speed(0.0)) == pytest.approx(hardest(member), rel=1e-6)


def test_reaction_is_a_scan_the_brakes_lag_and_half_of_their_rise():
    assert reaction(followers(10.0)[1]) == pytest.approx(0.1 + 0.2 + 9.0 / 40)
    assert reaction(leader(10.0)[0]) == pytest.approx(0.1 + 0.2 + 8.0 / 40)  # of which its law uses 8 m/s2


# ---- nobody is hit who need not be


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(n, marks=pytest.mark.slow) for n in range(3, 20))])
def test_who_has_been_between_for_ten_seconds_and_brakes_at_9_is_not_hit(seed):
    played = play(followers(25.0), cut_in(brakes_after=13.0), 30.0, seed)
    human = of(played.seen, "human")
    late = human[human[:, 0] > 17.0]
    assert np.diff(late[:, 4]).min() == pytest.approx(-0.9, abs=1e-6)
    assert late[:, 4].min() <= 0.5
    assert played.clearance > 2.0


CUTS = [
    (speed, headway, share, relative, takes)
    for speed, headway, share, relative, takes in itertools.product(
        (8.0, 15.0, 25.0), (0.6, 1.0, 1.5), (0.3, 0.5, 0.7), (0.0, -3.0, -6.0, -10.0), (1.5, 3.0, 5.0)
    )
    if speed + relative >= 1
]


@pytest.mark.parametrize(
    "some", [pytest.param(CUTS[::23], id="some"), pytest.param(CUTS, id="all", marks=pytest.mark.soak)]
)
def test_of_cut_ins_of_every_size_the_avoidable_ones_end_well(some):
    hit, avoidable = [], 0
    for n, (speed, headway, share, relative, takes) in enumerate(some):
        played = play(followers(speed, headway), cut_in(share, relative, takes), 14.0, seed=n)
        if played.met and played.met[0].avoidable:
            avoidable += 1
            if played.clearance == 0:  # and nobody is hit by the human, either
                hit.append((speed, headway, share, relative, takes))
    assert avoidable > len(some) / 4
    assert hit == []


@pytest.mark.parametrize("seeds", [range(6), pytest.param(range(100), marks=pytest.mark.slow)], ids=["6", "100"])
def test_a_pedestrian_before_whom_a_leader_can_brake_is_not_hit(seeds):
    could = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        speed, walks, side = rng.uniform(4, 22), rng.uniform(0.8, 3.5), rng.choice([-1.0, 1.0])
        members = leader(speed)
        enters = 2.0 + (4.0 - CAR.width / 2 - 0.15) / walks
        before = stopping_distance(speed, members[0]) + rng.exponential(2.0)
        x = speed * enters + CAR.length / 2 + 0.25 + before + 0.1 * speed
        played = play(members, walk(x, walks, 2.0, side), 12.0, seed)
        could += sum(met.avoidable for met in played.met)
        assert played.clearance > 0 or not played.met[0].avoidable, f"{speed:.2f} m/s, pedestrian {walks:.2f} m/s"
    assert could >= 0.95 * len(seeds)


@pytest.mark.parametrize("seeds", [range(6), pytest.param(range(100), marks=pytest.mark.slow)], ids=["6", "100"])
def test_a_pedestrian_between_members_before_whom_a_follower_can_brake_is_not_hit(seeds):
    could = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        speed, headway = rng.uniform(3, 14), rng.uniform(1.5, 3.0)
        walks, side = rng.uniform(0.8, 3.0), rng.choice([-1.0, 1.0])
        members = followers(speed, headway)
        gap = TrackingFollower(time_headway=headway).desired_distance(speed) - 0.03
        room = gap - stopping_distance(speed, members[1]) - 0.1 * speed - 0.5
        behind_leader = rng.uniform(0.2 * room, room)
        enters = 2.0 + (4.0 - CAR.width / 2 - 0.15) / walks
        x = speed * enters - CAR.length / 2 - 0.25 - behind_leader
        played = play(members, walk(x, walks, 2.0, side), 12.0, seed)
        assert played.met[0].vehicle == "robot.1"
        could += played.met[0].avoidable
        assert played.clearance > 0 or not played.met[0].avoidable, f"{speed:.2f} m/s, pedestrian {walks:.2f} m/s"
    assert could >= 0.9 * len(seeds)


RADIUS = 30.0
ARC = [(RADIUS * math.sin(a), RADIUS * (1 - math.cos(a))) for a in np.linspace(0, math.pi / 2, 60)]
BEND = np.array([(-300.0, 0.0), *ARC, (RADIUS, 300.0)])
HEDGE = Scene.from_shapely(solids=[shapely.box(-80.0, 4.0, RADIUS - 4.0, 84.0)])  # all that is inside of the bend


@pytest.mark.parametrize("behind", [5.0, 15.0, 25.0, 40.0])  # the begin of the bend [m]
def test_a_car_that_stands_behind_a_bend_is_stopped_for_by_a_leader(behind):
    route = Route.along(["e"], BEND, np.full(len(BEND), 20.0))
    way = Way(route)
    x, y, heading = way.pose(300.0 + behind, 0.0, 4.74)
    stands = Lying("c", "car", 4.74, 1.76, 0.0, NEVER, (), x, y, heading)
    members = leader(13.0, route, at=(-150.0, 0.0, 0.0))
    played = play(members, stands, 40.0, scene=HEDGE)
    assert of(played.seen, "robot.0")[-1, 4] < 0.05
    assert played.clearance > 0.5


@pytest.mark.parametrize("behind", [10.0, 20.0, 30.0])
def test_a_car_that_stands_behind_a_bend_is_stopped_for_by_a_follower(behind):
    """It has come to stand there when the predecessor was past."""
    route = Route.along(["e"], BEND, np.full(len(BEND), 20.0))
    x, y, heading = Way(route).pose(300.0 + behind, 0.0, 4.74)
    speed, law = 7.0, TrackingFollower(time_headway=3.0)
    turn = Prescribed(lambda time: Drive(0.0, 1 / RADIUS if 0 <= 7 * time - 51.27 < RADIUS * math.pi / 2 else 0.0))
    members = platoon(
        turn, law, 1, distance=law.desired_distance(speed), model=CAR, eye=TRACKER, speed=speed,
        leader_eye=replace(BLIND, rate=10.0), odometry=ODOMETRY["car"], at=(-50.0, 0.0, 0.0),
    )  # fmt: skip
    members = [replace(m, route=route) for m in members]
    passed = (50.0 + behind + 5.0) / speed + 0.2
    stands = Lying("c", "car", 4.74, 1.76, passed, NEVER, (), x, y, heading)
    played = play(members, stands, 25.0, scene=HEDGE)
    assert of(played.seen, "robot.1")[-1, 4] < 0.05
    assert played.clearance > 0.5
