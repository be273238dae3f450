"""What an observer makes of vehicles that are put here and there by hand: no SUMO, no laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from platoontraffic.lidar import PRESETS, Boxes, Carriers, LidarModel, Mount, ScanBatch, scan

from platoontraffic.controllers import Law, Target
from platoontraffic.observation import observer
from platoontraffic.observation.observer import Event, Measures, Observer
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.catalogue import FleetModel
from platoontraffic.vehicles.motion import Motion
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import Group, Member
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import NO_WALLS, ROBOT, batch_of, constant, platoon

CAR = CARS["car"]
ROAD = SimpleNamespace(drivable=shapely.box(-100, -5, 1000, 5), right_of_middle=lambda x, y, heading: np.nan * x)
LENGTH = CAR.length


def cars(followers: int = 1) -> list[Member]:
    eye = replace(PRESETS["car-follower"], mount=Mount(LENGTH / 2))
    return platoon(constant(0.0), constant(1.0), followers, model=CAR, eye=eye)


class Watched:
    """Members whose motion is given step by step; of those that are not given, none is there."""

    def __init__(self, members: Sequence[Member]) -> None:
        self.members = members
        self.observer = Observer(members, ROAD, Contacts(NO_WALLS, {m.id for m in members}))

    def at(
        self,
        time: float,
        number: Sequence[int] | None = None,
        hits=None,
        others=(),
        bearing=0.0,
        signals=None,
        **motion,
    ):
        """Events as (kind, vehicle), whole events, measures.

        hits: of the scan of the last row, (k,); others: x of further cars
        """
        number = np.arange(len(self.members)) if number is None else np.array(number, dtype=int)
        n = len(number)
        members = tuple(self.members[i] for i in number)
        values = {name: np.zeros(n) for name in Motion.__dataclass_fields__}
        values |= {name: np.broadcast_to(np.asarray(value, dtype=float), n).copy() for name, value in motion.items()}
        row_of = {(m.platoon, m.place): i for i, m in enumerate(members)}
        model = FleetModel.of([m.model for m in members])
        groups, scans = (), ()
        if hits is not None:
            hits = np.array([hits])
            lidar = replace(members[-1].lidar, samples=hits.shape[1])
            scans = (replace(batch_of(np.where(hits == -2, np.inf, 1.0), lidar), hits=hits),)
            groups = (Group(members[-1].law, lidar, np.array([n - 1]), 1),)
        fleet = Here(
            members=members,
            number=number,
            groups=groups,
            model=model,
            predecessor=np.array([row_of.get((m.platoon, m.place - 1), -1) for m in members], dtype=int),
            motion=Motion(**values),
            target=Target(np.full(n, np.nan), np.full(n, bearing)),
        )
        x = np.concatenate([fleet.motion.x, others])
        speed, rest = np.concatenate([fleet.motion.speed, 0 * np.array(others)]), np.ones(len(others))
        traffic = TrafficSnapshot(
            time,
            (*(m.id for m in members), *(f"other.{i}" for i in range(len(others)))),
            x,
            np.concatenate([fleet.motion.y, 0 * rest]),
            np.concatenate([fleet.motion.heading, 0 * rest]),
            speed,
            np.concatenate([model.length, LENGTH * rest]),
            np.concatenate([model.width, 1.8 * rest]),
        )
        events = self.observer.watch(traffic, fleet, scans, [(f"edge{i}", f"edge{i}_0") for i in number], signals)
        return Seen([(e.kind, e.vehicle) for e in events], events, self.observer.measure(fleet))


class Here(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.members)


class Seen(SimpleNamespace):
    kinds: list[tuple[str, str]]
    events: list[Event]
    measures: Measures

    def __init__(self, kinds, events, measures) -> None:
        super().__init__(kinds=kinds, events=events, measures=measures)


def test_the_gap_is_bumper_to_bumper_along_the_path_that_was_driven():
    """Round a corner: the leader has driven 10 m to the east and 6 m to the north of where its follower is."""
    watched, axle = Watched(cars()), CAR.axle
    watched.at(0.0, x=[0.0, -9.0])
    for k in range(1, 101):
        watched.at(0.1 * k, x=[0.1 * k, -9.0], speed=[1.0, 0.0])
    corner = 10.0 + axle  # of the axle's path
    for k in range(1, 61):
        seen = watched.at(10 + 0.1 * k, x=[corner, -9.0], y=[0.1 * k - axle, 0.0], heading=[np.pi / 2, 0.0])
    assert seen.measures.gap[1] == pytest.approx(10 + 9 + 6 - LENGTH, abs=1e-6)
    assert seen.measures.cross_track[1] == pytest.approx(0, abs=1e-9)
    assert np.isnan(seen.measures.gap[0])


def test_members_depart_and_arrive():
    watched = Watched(cars(2))
    assert watched.at(0.0, []).kinds == []
    assert watched.at(0.1, [0, 1], x=[0.0, -9.0]).kinds == [("departed", "robot.0"), ("departed", "robot.1")]
    assert watched.at(0.2, [0, 1, 2], x=[1.0, -8.0, -19.0]).kinds == [("departed", "robot.2")]
    seen = watched.at(0.3, [2], x=[-18.0])
    assert seen.kinds == [("arrived", "robot.0"), ("arrived", "robot.1")]
    assert [(e.time, e.x, e.edge, e.detail) for e in seen.events] == [
        (0.3, 1.0, "edge0", ""),
        (0.3, -8.0, "edge1", "with its leader"),
    ]
    assert np.isnan(seen.measures.gap[0])
    assert watched.at(0.4, []).kinds == [("arrived", "robot.2")]


def test_a_member_that_departs_later_finds_its_place_on_the_path():
    watched = Watched(cars())
    for k in range(50):
        watched.at(0.1 * k, [0], x=[k], speed=10.0)
    seen = watched.at(5.0, x=[50.0, 30.0], speed=10.0)
    assert seen.measures.gap[1] == pytest.approx(20 - LENGTH)


def test_what_is_remembered_belongs_to_the_member_and_not_to_its_row():
    watched = Watched(cars(2))
    x = np.array([0.0, -20.0, -40.0])
    for k in range(101):
        watched.at(0.1 * k, [0, 1, 2] if k < 50 else [2], x=x if k < 50 else x[2:], speed=[3, 2, 0] if k < 50 else 0.0)
    assert watched.at(10.1, [2], x=x[2:]).kinds == [("standstill", "robot.2")]


def test_a_standstill_says_behind_whom_if_one_stands_within_a_cars_length_ahead():
    watched = Watched(cars(3))
    x = -np.array([0.0, LENGTH + 3.0, 2 * LENGTH + 20.0, 3 * LENGTH + 23.0])
    for k in range(101):
        watched.at(0.1 * k, x=x, speed=0.0)
    events = watched.at(10.1, x=x, speed=0.0).events
    assert [(e.vehicle, e.detail) for e in events] == [
        ("robot.0", "since 0.000 s"),
        ("robot.1", "since 0.000 s, behind robot.0"),
        ("robot.2", "since 0.000 s, has lost robot.1"),
        ("robot.3", "since 0.000 s, behind robot.2"),
    ]


def test_time_to_collision_and_needed_braking():
    members = cars(3)
    x = -np.arange(4) * (LENGTH + 10.0)
    measures = Watched(members).at(0.0, x=x, speed=[10.0, 15.0, 10.0, 10.0]).measures
    assert np.isnan([measures.closing[0], measures.time_to_collision[0], measures.needed_braking[0]]).all()
    np.testing.assert_allclose(measures.closing[1:], [5, -5, 0])
    np.testing.assert_allclose(measures.time_to_collision, [np.nan, 2, np.nan, np.nan])
    np.testing.assert_allclose(measures.needed_braking, [np.nan, 25 / 20, 0, 0])


@dataclass(frozen=True)
class OneAtATime(Law):
    """Its distance wanted is for one speed, not for an array of them."""

    def desired_distance(self, speed: float) -> float:
        return 5.0 + speed if speed > 2 else 5.0


@dataclass(frozen=True)
class AllAtOnce(Law):
    def desired_distance(self, speed: np.ndarray) -> np.ndarray:
        return np.where(speed > 2, 5.0 + speed, 5.0)


@pytest.mark.parametrize("law", [OneAtATime(), AllAtOnce()])
def test_the_gap_is_held_against_what_the_law_wants_at_that_speed(law):
    leader, *followers = cars(3)
    members = [leader, *(replace(m, law=law) for m in followers)]
    seen = Watched(members).at(0.0, x=-np.arange(4) * (LENGTH + 12.0), speed=[0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(seen.measures.gap_error, [np.nan, 7, 7, 4])


def test_jerk_is_the_change_of_acceleration_over_the_step():
    watched = Watched(cars(1))
    assert watched.at(0.0, [0], x=0.0, acceleration=2.0).measures.jerk == 0
    seen = watched.at(0.1, x=[0.0, -9.0], acceleration=[1.0, 3.0])
    np.testing.assert_allclose(seen.measures.jerk, [-10, 0])


@pytest.mark.parametrize(("model", "limit"), [(CAR, 0.5), (ROBOT, 0.5 * ROBOT.length / 4.74)])
def test_a_near_miss_is_noted_once_and_not_where_there_is_contact(model, limit):
    watched = Watched(platoon(constant(0.0), constant(1.0), 1, model=model))

    def gap(time: float, gap: float) -> list[str]:
        seen = watched.at(time, x=[0.0, -model.length - gap])
        assert seen.measures.gap[1] == pytest.approx(gap)
        return [kind for kind, _ in seen.kinds if kind not in ("departed", "arrived")]

    gaps = [2.0, 1.01, 0.99, 0.5, 0.8, 1.2, 0.7, 2.0, -0.01, 0.5, 2.0]
    noted = [gap(0.1 * k, g * limit) for k, g in enumerate(gaps)]
    assert noted == [[], [], ["near_miss"], [], [], [], ["near_miss"], [], ["collision"], [], []]


def test_an_emergency_brake_is_noted_once_and_not_of_robots():
    for model, kinds in ((CAR, [[], [], ["emergency_brake"], [], [], ["emergency_brake"]]), (ROBOT, [[]] * 6)):
        watched = Watched(platoon(constant(0.0), model=model))
        watched.at(0.0, x=0.0)
        accelerations = [-1.0, -4.4, -4.6, -8.0, 0.0, -5.0]
        found = [watched.at(k + 1.0, x=0.0, acceleration=a).kinds for k, a in enumerate(accelerations)]
        assert [[kind for kind, _ in step] for step in found] == kinds


@pytest.mark.parametrize(("model", "limit"), [(CAR, 0.3), (ROBOT, 0.3 * ROBOT.length / 4.74)])
def test_off_the_road_is_more_than_a_little_outside(model, limit):
    watched = Watched(platoon(constant(0.0), model=model))
    outside = [0.0, 0.9, 1.1, 3.0, 1.2, 0.5, 0.0]
    seen = [watched.at(float(k), x=0.0, y=5 + o * limit) for k, o in enumerate(outside)]
    kinds = [[kind for kind, _ in s.kinds if kind != "departed"] for s in seen]
    assert kinds == [[], [], ["off_road"], [], [], ["on_road"], []]
    assert seen[2].events[0].detail == f"{1.1 * limit:.3f} m outside"
    assert seen[5].events[0].duration == 3
    np.testing.assert_allclose([s.measures.off_road[0] for s in seen], np.array(outside) * limit, atol=1e-12)


def test_locks_follow_what_the_target_lies_on():
    """Rows: 0 the leader, 1 the follower, 2 another vehicle; −1 a wall, −2 nothing."""
    watched = Watched(cars())
    ahead, other, wall, nothing = [0] * 20, [2] * 20, [-1] * 20, [-2] * 20
    expected = [
        (nothing, []),
        (wall, [("wrong_target", "wall", "")]),
        (ahead, [("locked", "robot.0", "")]),
        (ahead, []),
        (other, [("wrong_target", "other.0", ""), ("lock_lost", "other.0", "took another for it")]),
        (other, []),
        (nothing, []),
        (ahead, [("lock_regained", "robot.0", "")]),
        (nothing, [("lock_lost", "", "out of sight")]),
    ]
    for k, (hits, noted) in enumerate(expected):
        seen = watched.at(float(k), x=[0.0, -20.0], others=[40.0], hits=hits)
        others = ("departed", "split", "rejoined")
        assert [(e.kind, e.other, e.detail) for e in seen.events if e.kind not in others] == noted, k
        assert seen.measures.beams[1] == (20 if hits is ahead else 0)
        if k == 7:
            (regained,) = (e for e in seen.events if e.kind == "lock_regained")
            assert regained.duration == 3
    seen = watched.at(9.0, x=[0.0, -20.0], hits=ahead, bearing=np.nan)
    assert seen.measures.target[1] == ""


def test_a_target_keeps_its_name_when_rows_change():
    watched = Watched(cars())
    watched.at(0.0, x=[0.0, -20.0], others=[40.0, 60.0], hits=[3] * 20)
    assert watched.at(0.1, x=[0.0, -20.0], others=[]).measures.target[1] == "other.1"


def seen(batch: ScanBatch, row: int, ahead: int, bearing: float, *boxes: np.ndarray) -> list[int]:
    """What the only scan of a batch shows: of the target, of the predecessor, of the predecessor if it were alone."""
    n = len(boxes[0])
    traffic = TrafficSnapshot(0.0, tuple(map(str, range(n))), *boxes[:3], np.zeros(n), *boxes[3:])
    fleet = SimpleNamespace(predecessor=np.full(n, ahead), target=Target(np.full(n, 1.0), np.full(n, bearing)))
    found = np.full((3, n), -9)
    observer._see(batch, traffic, np.array([row]), fleet, found)
    assert (np.delete(found, row, axis=1) == -9).all()
    return found[:, row].tolist()


def test_most_about_a_bearing_is_what_a_slow_count_says():
    rng = np.random.default_rng(2)
    model = LidarModel(40, -0.4, 0.4, 0.0, 9.0)
    hits = rng.integers(-2, 3, (300, 40)).astype(np.int32)
    ranges = np.where(rng.random(hits.shape) < 0.2, np.nan, np.where(hits == -2, np.inf, 1.0))
    bearing = np.where(rng.random(300) < 0.1, np.nan, rng.uniform(-0.6, 0.6, 300))
    for row in range(300):
        batch = replace(batch_of(ranges[[row]], model), hits=hits[[row]])
        found, *_ = seen(batch, 0, -1, bearing[row], *np.zeros((5, 1)))
        votes: dict[int, int] = {}
        if not np.isnan(bearing[row]):
            beam = round((bearing[row] - model.angle_min) / model.angle_increment)
            for k in range(max(beam - 3, 0), min(beam + 4, 40)):
                if np.isfinite(ranges[row, k]):
                    votes[hits[row, k]] = votes.get(hits[row, k], 0) + 1
        most = max(votes.values(), default=0)
        assert found == min((on for on, count in votes.items() if count == most), default=-2)


@pytest.mark.parametrize("model", [LidarModel(400, -0.8, 0.8, 0.1, 12.0, mount=Mount(1.0, 0.2, 0.1)),
                                   LidarModel(721, -np.pi, np.pi, 0.0, 30.0)])  # fmt: skip
def test_beams_across_a_lone_vehicle_are_those_that_a_scan_has_on_it(model):
    rng = np.random.default_rng(3)
    met = 0
    for _ in range(60):
        pose = np.array([rng.uniform(-8, 8, 2), rng.uniform(-8, 8, 2), rng.uniform(-np.pi, np.pi, 2)])
        size = np.full(2, 4.0), np.full(2, 1.8)
        batch = scan(model, NO_WALLS, Boxes(*pose, *size, np.arange(2)), Carriers(*pose[:, [0]], owner=[0]))
        _, on, alone = seen(batch, 0, 1, 0.0, *pose, *size)
        assert on == np.count_nonzero(batch.hits == 1)
        assert abs(alone - on) <= 1  # a beam through a corner, or at the end of the range
        met += alone
    assert met > 1000


def test_a_vehicle_between_hides_what_is_behind_it():
    """A follower 20 m behind, and a car of full width whose one half stands in the way."""
    eye = LidarModel(2001, -0.2, 0.2, 0.0, 60.0)
    leader, between = np.array([20.0, 0.0, 0.0]), np.array([10.0, 1.5, 0.0])
    poses = np.array([leader, np.zeros(3), between]).T
    size = np.full(3, 4.0), np.array([2.0, 2.0, 3.0])
    batch = scan(eye, NO_WALLS, Boxes(*poses, *size, np.arange(3)), Carriers(*poses[:, [1]], owner=[1]))
    _, on, alone = seen(batch, 1, 0, 0.0, *poses, *size)
    assert on / alone == pytest.approx(0.5, abs=0.01)
