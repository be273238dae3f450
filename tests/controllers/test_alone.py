"""The law `tracking` without a predecessor, and at stop lines; without SUMO."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pytest
import shapely
import tomli_w

from platoontraffic import scenario
from platoontraffic.controllers import Law
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.errors import InputError
from platoontraffic.lidar import PRESETS, Mount, Noise
from platoontraffic.observation.instant import Instant
from platoontraffic.road.route import Route
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.fleet import Fleet
from tests.support.bench import BLIND, NO_WALLS, Prescribed, StopLine, Unseeing, platoon, targets

DT, SPEED = 0.1, 10.0
CAR = VEHICLES["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise())
STRAIGHT = Route.along(("road",), np.array([[-200.0, 0.0], [2000.0, 0.0]]), np.full(2, 12.0))


def corner(radius: float = 12.0) -> Route:
    """A bend to the left after 50 m."""
    angle = np.linspace(0, np.pi / 2, 30)
    arc = np.column_stack([50 + radius * np.sin(angle), radius * (1 - np.cos(angle))])
    points = np.vstack([[-200.0, 0.0], [0.0, 0.0], arc, [50 + radius, 400.0]])
    return Route.along(("road",), points, np.full(len(points), 12.0))


@dataclass(frozen=True)
class CalledTwice(TrackingFollower):
    """The law `tracking`, called twice in each step with the same memory."""

    def __call__(self, sensed, memory, dt):
        before = copy.deepcopy(memory)
        first, second = (TrackingFollower.__call__(self, sensed, memory, dt) for _ in range(2))
        np.testing.assert_equal(first, second)
        np.testing.assert_equal(memory, before)
        return first


class Street(StopLine):
    """Bare ground with a stop line; the leader disappears at some time [s]."""

    def __init__(self, leader_leaves: float = np.inf, **line) -> None:
        super().__init__(DT, **line)
        self._leader_leaves = leader_leaves

    def advance(self, fleet: Fleet) -> Fleet:
        fleet = super().advance(fleet)
        return fleet.without({"robot.0"}) if self.time >= self._leader_leaves else fleet


class Course(NamedTuple):
    """A follower, instant by instant, (k,)."""

    time: np.ndarray
    x: np.ndarray  # of its driven axle
    y: np.ndarray
    speed: np.ndarray
    front: np.ndarray  # x of its front bumper
    locked: np.ndarray
    leader_x: np.ndarray  # of its centre; NaN once it has left


def driven(leader, seconds: float, law: Law | None = None, route: Route = STRAIGHT, **street) -> Course:
    """A follower with a route behind a leader that drives by the clock; or by the law `path`, if that is None."""
    law = law or TrackingFollower(on_loss="drive")
    leads = Prescribed(lambda time: Drive(*leader(time))) if leader else PathLeader(speed=SPEED)
    members = platoon(
        leads, law, 1, distance=TrackingFollower().desired_distance(SPEED),
        model=CAR, leader_eye=replace(BLIND, rate=1 / DT), eye=EYE, speed=SPEED,
    )  # fmt: skip
    members = [replace(m, route=route) for m in members]
    setting = Setting(members, NO_WALLS, DT, steps=round(seconds / DT), ground=lambda: Street(**street))
    with Simulation(setting) as simulation:
        return Course(*np.array([row_of(now) for now in simulation]).T)


def row_of(now: Instant) -> tuple[float, ...]:
    fleet, motion = now.fleet, now.fleet.motion
    locked = targets(now)[-1] == fleet.predecessor[-1] >= 0
    x, y = (axle[-1] for axle in fleet.model.axle_position(motion))
    leader_x = motion.x[0] if len(fleet) == 2 else np.nan
    return now.time, x, y, motion.speed[-1], motion.x[-1] + CAR.length / 2, locked, leader_x


def steady(time: float) -> tuple[float, float]:
    return 0.0, 0.0


@pytest.mark.slow
def test_a_follower_without_leader_drives_on_along_its_route_and_round_the_corner_at_the_limit():
    course = driven(steady, 26.0, route=corner(), leader_leaves=1.0)
    away = shapely.distance(shapely.LineString(corner().line.points), shapely.points(course.x, course.y))
    assert away.max() < 0.4
    assert course.y[-1] > 60
    assert course.speed[-1] == pytest.approx(12.0, abs=0.1)
    bend = course.speed[(course.y > 1) & (course.y < 11)]
    assert len(bend)
    assert (bend**2 / 12.0 < 1.1 * TrackingFollower().alone.lateral_acceleration).all()


def test_with_on_loss_stop_a_follower_without_leader_stops():
    course = driven(steady, 21.0, TrackingFollower(on_loss="stop"), leader_leaves=1.0)
    assert course.speed[-1] == pytest.approx(0, abs=0.01)


def test_a_follower_without_leader_stops_at_a_red_light_and_drives_on_at_green():
    course = driven(steady, 31.0, leader_leaves=1.0, x=100.0, is_open=lambda time: time > 25)
    before = course.time < 25
    assert 97.0 < course.front[before].max() <= 100.0
    assert course.front[-1] > 110


@pytest.mark.parametrize(("policy", "passes"), [("convoy", True), ("obey", False)])
def test_a_follower_behind_its_leader_stops_at_a_closed_line_only_with_policy_obey(policy, passes):
    law = TrackingFollower(on_loss="drive", policy=policy)
    course = driven(steady, 15.0, law, x=80.0, is_open=lambda time: time < 8.2)  # the leader is across by then
    assert (course.front[-1] > 80) == passes
    if not passes:
        assert course.front[-1] > 77
        assert course.speed[-1] == pytest.approx(0, abs=0.05)


def test_a_follower_takes_a_tight_turn_no_faster_than_its_leader():
    """The leader accelerates as soon as it is through the turn, the follower has not yet begun it."""
    route = corner(6.0).drivable_by(CAR)
    course = driven(None, 19.0, route=route)
    bend = route.line.project(50.0 + 6.0 * np.sqrt(0.5), 6.0 - 6.0 * np.sqrt(0.5), 0.0, np.inf)[0]
    away = shapely.distance(shapely.LineString(route.line.points), shapely.points(course.x, course.y))
    assert course.y[-1] > 15
    assert away.max() < 0.3
    station = np.array([route.line.project(x, y, 0.0, np.inf)[0] for x, y in zip(course.x, course.y, strict=True)])
    middle = np.abs(station - bend) < 2.0
    assert middle.any()
    before, here, after = route.line.at(bend + np.array([-2.0, 0.0, 2.0]))
    turn = np.arctan2(*(after - here)[::-1]) - np.arctan2(*(here - before)[::-1])
    assert (course.speed[middle] ** 2 * turn / 2.0 < 1.1 * TrackingFollower().alone.lateral_acceleration).all()


@pytest.mark.parametrize("held", [False, True])
def test_a_follower_that_a_line_has_held_drives_on_along_its_route_and_not_in_the_trail(held):
    """The leader swerves by 1.6 m beyond the line, and waits in sight."""

    def leader(time: float) -> tuple[float, float]:
        acceleration = -4.0 if 10.4 < time < 12.4 else 1.0 if time > 14 else 0.0
        return acceleration, 0.016 * ((8.4 < time < 9.4) - (9.4 < time < 10.4))

    law = TrackingFollower(on_loss="drive", policy="obey")
    course = driven(leader, 20.0, law, x=80.0, is_open=lambda time: not held or not 8.2 < time < 11)
    there = course.front > 105
    assert course.locked[there].all()
    assert np.median(course.y[there]) == pytest.approx(0.0 if held else 1.6, abs=0.3)


@pytest.mark.slow
def test_a_predecessor_that_left_the_route_is_not_followed():
    """The leader goes straight on where the route turns, unseen by the follower."""
    law = Unseeing(TrackingFollower(on_loss="drive"), 1.0, 5.0)
    course = driven(steady, 8.0, law, corner())
    assert not course.locked[-20:].any()
    assert course.speed[-1] > 3


def test_a_vehicle_met_on_the_route_is_followed_at_the_desired_distance():
    """The follower loses its leader, which brakes to a stand."""
    law = Unseeing(TrackingFollower(on_loss="drive"), 1.0, 2.9)
    course = driven(lambda time: (-2.0 if time > 1 else 0.0, 0.0), 14.9, law)
    assert course.locked[-20:].all()
    assert course.leader_x[-1] - CAR.length / 2 - course.front[-1] == pytest.approx(3.0, abs=0.3)


def test_needs_follow_from_policy_and_on_loss():
    assert TrackingFollower().needs == frozenset()
    assert TrackingFollower(policy="obey").needs == {"signals"}
    assert TrackingFollower(on_loss="drive").needs == {"route", "signals", "leads"}
    assert not TrackingFollower(policy="obey").drives_alone


@pytest.mark.parametrize("on_loss", ["stop", "drive"])
def test_the_law_called_twice_decides_the_same_and_keeps_its_memory_unchanged(on_loss):
    course = driven(steady, 7.0, CalledTwice(on_loss=on_loss), corner(), leader_leaves=3.0)
    assert len(course.time) == round(7 / DT) + 1


# ---- the path law of a lost follower, in a scenario

DRIVES = """
[sumo]
net = "highway"
[run]
duration_s = 10.0
[[platoon]]
size = 2
vehicle = "car"
start = { edge = "e0_e1", position_m = 300.0 }
to = "e4_e5"
leader = { law = "sumo" }
[platoon.follower]
law = "tracking"
on_loss = "drive"
[platoon.follower.alone]
time_headway_s = 2.5
"""


@pytest.fixture
def drives(tmp_path):
    file = tmp_path / "drives.toml"
    file.write_text(DRIVES)
    return file


def test_a_scenario_says_how_a_lost_follower_drives(drives, tmp_path):
    loaded = scenario.load(drives, ["platoon.follower.alone.braking_mps2=3"])
    assert loaded.laws[0, "follower"].alone == PathLeader(time_headway=2.5, braking=3.0)
    resolved = loaded.resolved(tmp_path)
    alone = resolved["platoon"][0]["follower"]["alone"]
    assert (alone["time_headway_s"], alone["braking_mps2"], alone["speed_mps"]) == (2.5, 3.0, "road")
    again = tmp_path / "again.toml"
    again.write_text(tomli_w.dumps(resolved))
    assert scenario.load(again).resolved(tmp_path) == resolved


def test_a_follower_without_predecessor_drives_by_the_path_law_by_default():
    assert TrackingFollower().alone == PathLeader()


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("alone.time_headwy_s=2", "platoon.0.follower.alone.time_headwy_s: unknown key; did you mean 'time_headway_s'"),
        ("alone.braking_mps2=-1", "platoon.0.follower.alone.braking_mps2: -1: should be greater than 0"),
        ("alone.speed_mps=0", "platoon.0.follower.alone.speed_mps: 0: should be greater than 0"),
        ("alone=2", "platoon.0.follower.alone: 2: should be a table"),
        ("alone.profile=brake", "alone: profile and trace are for leaders"),
    ],
)
def test_a_fault_in_the_table_alone_is_named(drives, override, said):
    with pytest.raises(InputError) as error:
        scenario.load(drives, [f"platoon.follower.{override}"])
    assert any(said in fault for fault in error.value.faults), error.value.faults


def test_a_fault_in_the_table_alone_is_named_with_its_line(drives):
    drives.write_text(DRIVES.replace("time_headway_s", "time_headwy_s"))
    with pytest.raises(InputError, match=r"drives.toml:16: platoon.0.follower.alone.time_headwy_s: unknown key"):
        scenario.load(drives)


@pytest.mark.parametrize(("keeps_to", "aside"), [("trail", 3.2), ("route", 0.0)])
def test_it_leaves_its_lane_behind_its_predecessor_only_in_a_platoon(keeps_to, aside):
    """The vehicle ahead changes lanes. One that merely happens to be ahead is not followed there."""
    bend = 3.2 * 4 / 40.0**2  # curvature of two arcs of 20 m that lead 3.2 m aside, 2 d / (L / 2)^2 [1/m]

    def leader(time: float) -> tuple[float, float]:
        driven = SPEED * (time - 1.0)
        return 0.0, bend if 0.0 <= driven < 20.0 else -bend if 20.0 <= driven < 40.0 else 0.0

    course = driven(leader, 10.0, TrackingFollower(on_loss="drive", keeps_to=keeps_to))
    assert course.y[-1] == pytest.approx(aside, abs=0.7)


def test_a_follower_that_keeps_to_its_route_must_be_able_to_drive_alone():
    with pytest.raises(ValueError, match="on_loss"):
        TrackingFollower(keeps_to="route")
