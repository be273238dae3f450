"""The laser-only follower without a predecessor, and at stop lines; without SUMO."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely
import tomli_w

from platoontraffic import scenario
from platoontraffic.controllers import Signals
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.errors import InputError
from platoontraffic.lidar import PRESETS, Mount, Noise
from platoontraffic.road.route import Route
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.sensing import Sensing
from tests.support.bench import BLIND, NO_WALLS, Prescribed, platoon, snapshot, targets

DT, SPEED = 0.1, 10.0
CAR = VEHICLES["car"]
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise())
STRAIGHT = Route.along(("road",), np.array([[-200.0, 0.0], [2000.0, 0.0]]), np.full(2, 12.0))


def corner(radius: float = 12.0) -> Route:
    """Fifty metres on, to the left."""
    angle = np.linspace(0, np.pi / 2, 30)
    arc = np.column_stack([50 + radius * np.sin(angle), radius * (1 - np.cos(angle))])
    points = np.vstack([[-200.0, 0.0], [0.0, 0.0], arc, [50 + radius, 400.0]])
    return Route.along(("road",), points, np.full(len(points), 12.0))


@dataclass(frozen=True)
class CalledTwice(TrackingFollower):
    """The law, called twice in each step with the same memory."""

    def __call__(self, sensed, memory, dt):
        before = copy.deepcopy(memory)
        first, second = (TrackingFollower.__call__(self, sensed, memory, dt) for _ in range(2))
        np.testing.assert_equal(first, second)
        np.testing.assert_equal(memory, before)
        return first


class Street:
    """A leader that drives by the clock, and a follower with a route."""

    def __init__(self, leader, route: Route = STRAIGHT, kind: type = TrackingFollower, **options) -> None:
        law = kind(**{"on_loss": "drive"} | options)
        members = platoon(
            Prescribed(lambda time: Drive(*leader(time))), law, 1, distance=law.desired_distance(SPEED), model=CAR,
            leader_eye=replace(BLIND, rate=1 / DT), eye=EYE, speed=SPEED,
        )  # fmt: skip
        self.fleet = Fleet.deployed([replace(m, route=route) for m in members], DT)
        self.sensing, self.step, self.rows = Sensing(NO_WALLS), 0, []

    def drive(self, seconds: float, line: float = np.inf, is_open=lambda time: True) -> None:
        """line: x of a stop line"""
        for _ in range(round(seconds / DT)):
            time, fleet = self.step * DT, self.fleet
            front = fleet.motion.x + CAR.length / 2
            ahead = np.where(front > line, np.inf, line - front)
            n = len(fleet)
            closed = np.full(n, not is_open(time)) & (ahead < np.inf)
            signals = Signals(ahead, ~closed, *np.zeros((2, n), bool), np.ones(n, int))
            scans = self.sensing.scan(snapshot(fleet, time), fleet, self.step)
            fleet = fleet.decided(scans, DT, signals)
            locked = bool(targets(fleet, scans)[-1] == fleet.predecessor[-1] >= 0)
            axle = np.column_stack(fleet.model.axle_position(fleet.motion))[-1]
            self.rows.append((time, *axle, fleet.motion.speed[-1], front[-1], locked))
            self.fleet, self.step = fleet.moved(DT), self.step + 1

    def leader_leaves(self) -> None:
        self.fleet = self.fleet.without({"robot.0"})

    def __getattr__(self, name: str) -> np.ndarray:
        names = ("time", "x", "y", "speed", "front", "locked")
        if name not in names:
            raise AttributeError(name)
        return np.array(self.rows)[:, names.index(name)]


def steady(time: float) -> tuple[float, float]:
    return 0.0, 0.0


def test_it_drives_on_along_its_route_at_the_limit_and_round_the_corner():
    street = Street(steady, corner())
    street.drive(1)
    street.leader_leaves()
    street.drive(25)
    away = shapely.distance(shapely.LineString(corner().line.points), shapely.points(street.x, street.y))
    assert away.max() < 0.4
    assert street.y[-1] > 60
    assert street.speed[-1] == pytest.approx(12.0, abs=0.1)
    bend = away[(street.y > 1) & (street.y < 11)]
    assert (street.speed[(street.y > 1) & (street.y < 11)] ** 2 / 12.0 < 2.5).all()  # comfortable sideways
    assert len(bend)


def test_with_on_loss_stop_it_stops():
    street = Street(steady, on_loss="stop")
    street.drive(1)
    street.leader_leaves()
    street.drive(20)
    assert street.speed[-1] == pytest.approx(0, abs=0.01)


def test_alone_it_stops_at_a_red_light_and_goes_on_when_it_changes():
    street = Street(steady)
    street.drive(1)
    street.leader_leaves()
    street.drive(30, line=100.0, is_open=lambda time: time > 25)
    before = street.time < 25
    assert 97.0 < street.front[before].max() <= 100.0
    assert street.front[-1] > 110


@pytest.mark.parametrize(("policy", "passes"), [("convoy", True), ("obey", False)])
def test_behind_its_leader_it_stops_at_a_closed_line_only_with_policy_obey(policy, passes):
    street = Street(steady, policy=policy)
    street.drive(15, line=80.0, is_open=lambda time: time < 8.2)  # the leader is across by then
    assert (street.front[-1] > 80) == passes
    if not passes:
        assert street.front[-1] > 77
        assert street.speed[-1] == pytest.approx(0, abs=0.05)


def test_a_predecessor_that_left_the_route_is_not_followed():
    street = Street(lambda time: (0.0, 0.0), corner())
    street.drive(1)
    blind = street.sensing
    street.sensing = type("Nothing", (), {"scan": lambda self, *given: _blind(blind.scan(*given))})()
    street.drive(4)  # the leader goes straight on where the route turns
    street.sensing = blind
    street.drive(3)
    assert not street.locked[-20:].any()
    assert street.speed[-1] > 3


def _blind(scans):
    return [scan and replace(scan, ranges=np.full(scan.ranges.shape, np.inf)) for scan in scans]


def test_a_vehicle_met_on_the_route_is_followed_at_the_desired_distance():
    street = Street(lambda time: (-2.0 if time > 1 else 0.0, 0.0))
    street.drive(1)
    seeing = street.sensing
    street.sensing = type("Nothing", (), {"scan": lambda self, *given: _blind(seeing.scan(*given))})()
    street.drive(1.9)  # the follower drops the leader, which brakes to a stand
    street.sensing = seeing
    street.drive(12)
    gap = street.fleet.motion.x[0] - street.fleet.motion.x[1] - CAR.length
    assert street.locked[-20:].all()
    assert gap == pytest.approx(3.0, abs=0.3)


def test_needs_follow_from_policy_and_on_loss():
    assert TrackingFollower().needs == frozenset()
    assert TrackingFollower(policy="obey").needs == {"signals"}
    assert TrackingFollower(on_loss="drive").needs == {"route", "signals"}
    assert not TrackingFollower(policy="obey").drives_alone


@pytest.mark.parametrize("on_loss", ["stop", "drive"])
def test_the_law_is_a_function_of_what_it_is_given(on_loss):
    street = Street(steady, corner(), kind=CalledTwice, on_loss=on_loss)
    street.drive(3)
    street.leader_leaves()
    street.drive(4)
    assert len(street.rows) == round(7 / DT)


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


def test_alone_is_the_path_law_by_default():
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
def test_a_fault_in_its_keys_is_named(drives, override, said):
    with pytest.raises(InputError) as error:
        scenario.load(drives, [f"platoon.follower.{override}"])
    assert any(said in fault for fault in error.value.faults), error.value.faults


def test_a_fault_in_its_keys_is_named_with_its_line(drives):
    drives.write_text(DRIVES.replace("time_headway_s", "time_headwy_s"))
    with pytest.raises(InputError, match=r"drives.toml:16: platoon.0.follower.alone.time_headwy_s: unknown key"):
        scenario.load(drives)
