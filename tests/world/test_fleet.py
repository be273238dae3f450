"""Members that come and go, and commands of both kinds in one fleet."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from platoontraffic.controllers import Decision, Law, Sensed, per_vehicle
from platoontraffic.errors import InputError
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.records import take
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.sensing import Sensing
from tests.support.bench import BLIND, DT, NO_WALLS, ROBOT, drive, platoon, snapshot

CAR = CARS["car"]


# ---- commands


@dataclass(frozen=True)
class Driver(Law):
    """A constant drive."""

    acceleration: float
    curvature: float = 0.0

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        n = len(sensed.speed)
        return Decision(Drive(np.full(n, self.acceleration), np.full(n, self.curvature)))


@dataclass(frozen=True)
class Turner(Law):
    """A constant twist."""

    speed: float
    yaw_rate: float = 0.0

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        n = len(sensed.speed)
        return Decision(Twist(np.full(n, self.speed), np.full(n, self.yaw_rate)))


def of(fleet: Fleet, *platoons: str) -> set[str]:
    return {m.id for m in fleet.members if m.platoon in platoons}


def one(law, name="robot", model=ROBOT, at=(0.0, 0.0, 0.0), speed=0.0, **changes) -> Member:
    (member,) = platoon(law, at=at, model=model)
    return replace(member, id=f"{name}.0", platoon=name, speed=speed, **changes)


def test_a_robot_goes_faster_by_the_acceleration_times_the_step():
    log = drive([one(Driver(0.2))], NO_WALLS, 3.0)
    np.testing.assert_allclose(log.speed[:, 0], 0.2 * log.time, atol=1e-9)
    # A robot has the speed at the end of a step, v + a dt, at once, as with a twist.
    np.testing.assert_allclose(log.x[:, 0], 0.1 * log.time * (log.time + DT), atol=1e-9)


def test_a_robot_drives_the_curvature_whatever_its_speed_does():
    log = drive([one(Driver(0.2, curvature=2.0))], NO_WALLS, 4.0)
    distance = 0.1 * log.time * (log.time + DT)
    np.testing.assert_allclose(log.turned[:, 0], 2.0 * distance, atol=1e-9)


def test_a_car_lags_behind_the_acceleration_by_its_drive_line():
    """v = a (t - lag (1 - exp(-t / lag))): the demand as through one first-order lag."""
    model = replace(CAR, max_jerk=1e6)
    log = drive([one(Driver(1.5), model=model, speed=5.0)], NO_WALLS, 4.0, dt=0.1)
    lag = model.lag
    wanted = 5.0 + 1.5 * (log.time - lag * -np.expm1(-log.time / lag))
    np.testing.assert_allclose(log.speed[:, 0], wanted, atol=1e-6)


def test_a_car_brakes_by_the_lag_of_its_brakes_and_then_stands():
    model = replace(CAR, max_jerk=1e6)
    log = drive([one(Driver(-3.0), model=model, speed=6.0)], NO_WALLS, 4.0, dt=0.1)
    lag = model.brake_lag
    wanted = 6.0 - 3.0 * (log.time - lag * -np.expm1(-log.time / lag))
    moves = wanted > 0.01
    np.testing.assert_allclose(log.speed[moves, 0], wanted[moves], atol=1e-6)
    np.testing.assert_array_equal(log.speed[-10:, 0], 0.0)


def test_drives_and_twists_go_side_by_side_as_each_does_alone():
    members = [
        one(Driver(0.1, 0.5), "a"),
        one(Turner(0.3, 0.2), "b", at=(0, 50, 0)),
        one(Driver(1.0, 0.01), "c", model=CAR, at=(0, 100, 0), speed=3.0),
        one(Turner(8.0, 0.1), "d", model=CAR, at=(0, 200, 0), speed=3.0),
    ]
    together = drive(members, NO_WALLS, 5.0, dt=0.1)
    for i, member in enumerate(members):
        alone = drive([member], NO_WALLS, 5.0, dt=0.1)
        for name in ("x", "y", "heading", "turned", "speed"):
            np.testing.assert_array_equal(getattr(together, name)[:, i], getattr(alone, name)[:, 0])


@dataclass(frozen=True)
class Hesitant(Law):
    """A twist; a drive after the first second."""

    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        if sensed.scan.stamp < 1.0 - 1e-9:
            return Decision(Twist(0.2, 0.0))
        return Decision(Drive(0.1, 0.0))


def test_a_law_may_go_from_one_kind_of_command_to_the_other():
    log = drive([one(Hesitant())], NO_WALLS, 2.0)
    np.testing.assert_allclose(log.speed[log.time <= 1.0, 0][1:], 0.2)
    np.testing.assert_allclose(log.speed[-1, 0], 0.2 + 0.1 * 1.0, atol=1e-9)


@pytest.mark.parametrize("acceleration", [np.nan, np.inf])
def test_a_drive_that_is_not_a_number_is_reported_as_a_fault_of_the_law(acceleration):
    said = rf"Driver gave acceleration {acceleration}, curvature 0.0, target nan, nan for robot.0 at 0.000 s"
    with pytest.raises(InputError, match=said):
        drive([one(Driver(acceleration))], NO_WALLS, 1.0)


# ---- members that leave, and the memories of laws


class Arrays(NamedTuple):
    count: np.ndarray
    seen: np.ndarray  # (n, 2)


@dataclass(frozen=True)
class Record:
    count: np.ndarray
    inner: Arrays


@dataclass(frozen=True)
class Counting(Law):
    """Counts its calls for every row, from a number of its own; the speed that it commands shows the count."""

    kind: str

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        n = len(sensed.speed)
        if memory is None:  # each begins with a number of its own
            number = np.array([float(name.removeprefix("p").removesuffix(".0")) for name in sensed.scan.ids])
            memory = self.packed(number)
        number = self.unpacked(memory)
        assert len(number) == n
        return Decision(Twist(number / 100, np.zeros(n)), self.packed(number + 10))

    def packed(self, number: np.ndarray) -> Any:
        arrays = Arrays(number, np.column_stack([number, number]))
        kinds = {"array": number, "list": number.tolist(), "namedtuple": arrays, "dataclass": Record(number, arrays)}
        return kinds[self.kind]

    def unpacked(self, memory: Any) -> np.ndarray:
        if is_dataclass(memory):
            np.testing.assert_array_equal(memory.count, memory.inner.seen[:, 1])
            return memory.inner.count
        return np.asarray(memory.seen[:, 0] if isinstance(memory, Arrays) else memory)


def three(law) -> Fleet:
    """Platoons p1, p2, p3 of one robot each that share a law and a lidar."""
    return Fleet.deployed([one(law, f"p{k}", at=(0.0, 5.0 * k, 0.0)) for k in (1, 2, 3)], DT)


def decided(fleet: Fleet, step: int) -> Fleet:
    return fleet.decided(Sensing(NO_WALLS).scan(snapshot(fleet, step * DT), fleet, step), DT)


@pytest.mark.parametrize("kind", ["array", "list", "namedtuple", "dataclass"])
def test_members_that_stay_keep_their_own_memories(kind):
    fleet = decided(three(Counting(kind)), 0)
    assert len(fleet.groups) == 1
    fleet = decided(fleet.without(of(fleet, "p2")), 1)
    assert [m.id for m in fleet.members] == ["p1.0", "p3.0"]
    np.testing.assert_allclose(fleet.command.twist.speed, [0.11, 0.13])
    fleet = decided(fleet.without(of(fleet, "p1")), 2)
    np.testing.assert_allclose(fleet.command.twist.speed, [0.23])


@dataclass(frozen=True)
class OneByOne(Law):
    """As Counting, written for one vehicle."""

    @per_vehicle
    def __call__(self, sensed: Sensed, memory: dict | None, dt: float) -> Decision:
        memory = memory or {"number": float(sensed.scan.frame_id[1:-2])}
        return Decision(Twist(memory["number"] / 100, 0.0), {"number": memory["number"] + 10})


def test_a_law_for_one_vehicle_may_remember_what_it_likes():
    fleet = decided(three(OneByOne()), 0)
    fleet = decided(fleet.without(of(fleet, "p1")), 1)
    np.testing.assert_allclose(fleet.command.twist.speed, [0.12, 0.13])


@dataclass(frozen=True)
class Mixed(Law):
    """Commands the first one by its speed, and the others by their acceleration."""

    @per_vehicle
    def __call__(self, sensed: Sensed, memory: None, dt: float) -> Decision:
        return Decision(Twist(1.0, 0.0) if sensed.scan.frame_id.startswith("p1") else Drive(-3.0, 0.0))


def test_one_kind_of_command_is_given_to_all_vehicles_of_a_law():
    """The deceleration of a `Drive` was taken for a speed, or the other way round, by the order of the members."""
    with pytest.raises(InputError, match=r"law Mixed failed .*gives Drive and Twist to vehicles at once; must be one"):
        decided(three(Mixed()), 0)


@dataclass(frozen=True)
class Remembering(Law):
    what: str

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        n = len(sensed.speed)
        whats = {"dict": {"a": np.zeros(n)}, "number": 3.0, "tuple": (np.zeros(n),), "words": "abc"}
        return Decision(Twist(np.zeros(n), np.zeros(n)), whats[self.what])


@pytest.mark.parametrize(
    ("what", "named"), [("dict", "dict"), ("number", "float"), ("tuple", "tuple"), ("words", "str")]
)
def test_a_memory_without_rows_is_reported_in_one_line(what, named):
    fleet = decided(three(Remembering(what)), 0)
    with pytest.raises(InputError, match=rf"test_fleet.py:\d+: law Remembering remembers a {named}; must be") as error:
        fleet.without(of(fleet, "p2"))
    assert len(error.value.faults) == 1
    assert len(str(error.value).splitlines()) == 1


@dataclass(frozen=True)
class Misshapen(Law):
    rows: int | None

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        n = len(sensed.speed)
        return Decision(Twist(np.zeros(n), np.zeros(n)), np.zeros(self.rows if self.rows is not None else ()))


@pytest.mark.parametrize("rows", [7, None])
def test_a_memory_without_one_row_a_vehicle_is_reported(rows):
    fleet = decided(three(Misshapen(rows)), 0)
    with pytest.raises(InputError, match="law Misshapen remembers"):
        fleet.without(of(fleet, "p2"))


def test_a_memory_needs_no_rows_while_all_of_a_group_stay_or_go():
    fleet = decided(three(Remembering("dict")), 0)
    assert fleet.without(set()) is fleet
    assert fleet.without({"p9.0"}).groups[0].memory is fleet.groups[0].memory
    assert fleet.without(of(fleet, "p1", "p2", "p3")).groups == ()


# ---- rows and numbers


def mixed() -> list[Member]:
    """Two platoons of three and one of one, robots and cars."""
    a = platoon(Turner(0.3), Turner(0.2), 2, at=(0, 0, 0))
    b = [
        replace(m, id=f"b.{m.place}", platoon="b", speed=2.0)
        for m in platoon(Driver(1.0), Turner(4.0), 2, at=(0, 50, 0), distance=8.0, model=CAR)
    ]
    return [*a, *b, one(Turner(0.1), "c", at=(0, 90, 0))]


def same(one: Any, other: Any) -> None:
    for f in fields(one):
        np.testing.assert_array_equal(getattr(one, f.name), getattr(other, f.name))


@pytest.mark.parametrize("gone", ["robot", "b", "c"])
def test_members_that_stay_drive_on_unchanged(gone):
    members = mixed()
    fleet = Fleet.deployed(members, 0.1)
    for step in range(5):
        fleet = decided(fleet, step).moved(0.1)
    rows = [i for i, m in enumerate(members) if m.platoon != gone]
    left = fleet.without(of(fleet, gone))
    same(left.motion, take(fleet.motion, np.array(rows)))
    np.testing.assert_array_equal(left.number, rows)
    assert [m.id for m in left.members] == [members[i].id for i in rows]
    expected = [rows.index(fleet.predecessor[i]) if fleet.predecessor[i] >= 0 else -1 for i in rows]
    np.testing.assert_array_equal(left.predecessor, expected)
    both = decided(fleet, 5).moved(0.1), decided(left, 5).moved(0.1)
    same(both[1].motion, take(both[0].motion, np.array(rows)))


def test_members_that_join_drive_as_if_deployed_with_the_rest():
    members = mixed()
    together = Fleet.deployed(members, 0.1)
    joined = Fleet.deployed(members[:3], 0.1)
    for part, first in ((members[3:6], 3), (members[6:], 6)):
        joined = joined.joined(Fleet.deployed(part, 0.1, np.arange(first, first + len(part))))
    np.testing.assert_array_equal(joined.number, together.number)
    np.testing.assert_array_equal(joined.predecessor, together.predecessor)
    for step in range(8):
        together, joined = (decided(fleet, step).moved(0.1) for fleet in (together, joined))
    same(joined.motion, together.motion)


def test_an_empty_fleet_can_be_joined_and_left():
    empty, members = Fleet.deployed([], 0.1), mixed()
    assert len(empty) == 0
    assert empty.arrived() == set()
    some = empty.joined(Fleet.deployed(members, 0.1))
    assert [m.id for m in some.members] == [m.id for m in members]
    same(decided(some, 0).moved(0.1).motion, decided(Fleet.deployed(members, 0.1), 0).moved(0.1).motion)
    assert len(some.without(of(some, "robot", "b", "c"))) == 0


def test_a_slow_lidar_of_a_member_that_joins_scans_in_the_same_steps_as_the_rest():
    slow = replace(BLIND, rate=1 / (4 * DT))
    here, later = (Fleet.deployed([one(Turner(0.1), name, lidar=slow)], DT) for name in "ab")
    fleet = here.joined(later)
    due = [[s is not None for s in Sensing(NO_WALLS).scan(snapshot(fleet, k * DT), fleet, k)] for k in range(8)]
    assert due == [[k % 4 == 0] * 2 for k in range(8)]


# ---- groups


class Clock(NamedTuple):
    since: np.ndarray
    last: np.ndarray | None


@dataclass(frozen=True)
class Ageing(Law):
    """Its speed tells for how many decisions it has driven; `memory` says as what it remembers that."""

    memory: str

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        n = len(sensed.speed)
        age = np.zeros(n) if memory is None else self.age(memory, n) + 1
        kept = {
            "array": lambda: age,
            "list": lambda: list(age),
            "namedtuple": lambda: Clock(age, None),
            "sometimes None": lambda: Clock(age, None if np.all(age < 2) else np.zeros(n)),
            "no rows": lambda: np.full(5, age[0]),
            "dict": lambda: {"age": age},
        }[self.memory]()
        return Decision(Twist(0.01 * age, np.zeros(n)), kept)

    def age(self, memory: Any, n: int) -> np.ndarray:
        if self.memory == "no rows":
            assert len(memory) == 5
            return np.full(n, memory[0])
        if self.memory == "dict":
            return memory["age"]
        return memory.since if isinstance(memory, Clock) else np.array(memory)


def after(fleet: Fleet, steps: range) -> Fleet:
    """Decisions in these steps, with as few groups as there can be."""
    for step in steps:
        fleet = decided(fleet.regrouped(), step)
    return fleet


@pytest.mark.parametrize(
    ("memory", "groups"),
    [("array", 1), ("list", 1), ("namedtuple", 1), ("sometimes None", 1), ("no rows", 2), ("dict", 2)],
)
def test_platoons_that_depart_later_decide_as_alone_in_as_few_calls_as_their_memories_allow(memory, groups):
    law = Ageing(memory)
    early, late = (
        Fleet.deployed([one(law, f"{name}{k}", at=(0.0, 5.0 * k + y, 0.0)) for k in (1, 2)], DT)
        for name, y in (("a", 0.0), ("b", 50.0))
    )
    early = after(early, range(4))
    both = after(early.joined(late), range(4, 9))
    alone = [after(fleet, range(4, 9)).command.twist.speed for fleet in (early, late)]
    np.testing.assert_array_equal(both.command.twist.speed, np.concatenate(alone))
    assert len(both.groups) == groups
    if groups == 1:
        left = after(both.without({"a1.0"}), range(9, 10))
        np.testing.assert_allclose(left.command.twist.speed, both.command.twist.speed[1:] + 0.01)
