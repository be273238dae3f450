"""The laser-only follower that has lost its predecessor, and what it does about lights; without SUMO."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from platoontraffic.lidar import PRESETS, Mount, Noise

from platoontraffic.controllers import Signals
from platoontraffic.controllers.tracking import TrackingFollower
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


class Street:
    """A leader that drives by the clock, and a follower with a route."""

    def __init__(self, leader, route: Route = STRAIGHT, **options) -> None:
        law = TrackingFollower(**{"on_loss": "drive"} | options)
        members = platoon(
            Prescribed(lambda time: Drive(*leader(time))), law, 1, distance=law.desired_distance(SPEED), model=CAR,
            leader_eye=replace(BLIND, rate=1 / DT), eye=EYE, speed=SPEED,
        )  # fmt: skip
        self.fleet = Fleet.deployed([replace(m, route=route) for m in members], DT)
        self.sensing, self.step, self.rows = Sensing(NO_WALLS), 0, []

    def drive(self, seconds: float, line: float = np.inf, is_open=lambda time: True) -> None:
        """line: x of one before which to stop"""
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


def test_it_stops_if_it_is_to():
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
def test_behind_its_leader_it_stops_for_a_light_if_it_obeys(policy, passes):
    street = Street(steady, policy=policy)
    street.drive(15, line=80.0, is_open=lambda time: time < 8.2)  # the leader is across by then
    assert (street.front[-1] > 80) == passes
    if not passes:
        assert street.front[-1] > 77
        assert street.speed[-1] == pytest.approx(0, abs=0.05)


def test_it_finds_its_predecessor_again_and_keeps_its_distance():
    """That stands round the corner, and drives on later."""
    street = Street(lambda time: (0.0, 0.0), corner())
    street.drive(1)
    blind = street.sensing
    street.sensing = type("Nothing", (), {"scan": lambda self, *given: _blind(blind.scan(*given))})()
    street.drive(4)  # the leader goes straight on meanwhile: it does not know the corner
    street.sensing = blind
    street.drive(3)
    assert not street.locked[-20:].any()  # who has left the route is not followed
    assert street.speed[-1] > 3


def _blind(scans):
    return [scan and replace(scan, ranges=np.full(scan.ranges.shape, np.inf)) for scan in scans]


def test_who_is_met_on_the_route_is_followed_at_the_law_s_distance():
    street = Street(lambda time: (-2.0 if time > 1 else 0.0, 0.0))
    street.drive(1)
    seeing = street.sensing
    street.sensing = type("Nothing", (), {"scan": lambda self, *given: _blind(seeing.scan(*given))})()
    street.drive(1.9)  # it forgets it, while that brakes to a stand
    street.sensing = seeing
    street.drive(12)
    gap = street.fleet.motion.x[0] - street.fleet.motion.x[1] - CAR.length
    assert street.locked[-20:].all()
    assert gap == pytest.approx(3.0, abs=0.3)


def test_what_it_needs_follows_from_what_it_is_to_do():
    assert TrackingFollower().needs == frozenset()
    assert TrackingFollower(policy="obey").needs == {"signals"}
    assert TrackingFollower(on_loss="drive").needs == {"route", "signals"}
