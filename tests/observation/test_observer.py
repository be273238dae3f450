"""Gaps, time measures and events of vehicles that are placed step by step; without SUMO and without laws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers import Law
from platoontraffic.observation.lane_entries import LaneEntries
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import ROBOT, constant, platoon
from tests.support.observed import CAR, LENGTH, ROAD, Observed, cars


def test_gap_is_bumper_to_bumper_along_the_predecessors_path():
    """The leader has driven 10 m east of its follower and then, round a corner, 6 m north."""
    observed, axle = Observed(cars()), CAR.axle
    observed.at(0.0, x=[0.0, -9.0])
    for k in range(1, 101):
        observed.at(0.1 * k, x=[0.1 * k, -9.0], speed=[1.0, 0.0])
    corner = 10.0 + axle  # of the axle's path
    for k in range(1, 61):
        seen = observed.at(10 + 0.1 * k, x=[corner, -9.0], y=[0.1 * k - axle, 0.0], heading=[np.pi / 2, 0.0])
    assert seen.measures.gap[1] == pytest.approx(10 + 9 + 6 - LENGTH, abs=1e-6)
    assert seen.measures.cross_track[1] == pytest.approx(0, abs=1e-9)
    assert np.isnan(seen.measures.gap[0])


def test_members_depart_and_arrive_by_themselves_or_with_their_leader():
    observed = Observed(cars(2))
    assert observed.at(0.0, []).kinds == []
    assert observed.at(0.1, [0, 1], x=[0.0, -9.0]).kinds == [("departed", "robot.0"), ("departed", "robot.1")]
    assert observed.at(0.2, [0, 1, 2], x=[1.0, -8.0, -19.0]).kinds == [("departed", "robot.2")]
    seen = observed.at(0.3, [2], x=[-18.0])
    assert seen.kinds == [("arrived", "robot.0"), ("arrived", "robot.1")]
    assert [(e.time, e.x, e.edge, e.what) for e in seen.events] == [
        (0.3, 1.0, "edge0", "own_route"),
        (0.3, -8.0, "edge1", "with_leader"),
    ]
    assert np.isnan(seen.measures.gap[0])
    assert observed.at(0.4, []).kinds == [("arrived", "robot.2")]


@pytest.mark.parametrize(("behind", "kinds"), [(16.0, ["arrived"] * 3), (80.0, ["arrived", "stranded", "stranded"])])
def test_members_far_behind_an_arriving_leader_and_those_behind_them_are_stranded(behind, kinds):
    """None sees its predecessor. The car's law wants no gap, so 15 m are a platoon's longest."""
    observed = Observed(cars(2))
    x = np.array([100.0, 100.0 - behind, 88.0 - behind])
    for k in range(30):
        observed.at(0.1 * k, x=x)
    seen = observed.at(3.0, [])
    assert seen.kinds == [(kind, f"robot.{i}") for i, kind in enumerate(kinds)]
    stranded = [event for event in seen.events if event.kind == "stranded"]
    assert all((event.other, event.what) == ("robot.0", "") for event in stranded)
    assert [event.detail for event in stranded] == [
        "80 m from where its leader arrived",
        "92 m from where its leader arrived",
    ][: len(stranded)]


def test_a_member_that_has_only_just_fallen_behind_is_not_stranded():
    observed = Observed(cars(1))
    for k in range(12):
        observed.at(0.1 * k, x=[100.0, 20.0])
    assert observed.at(1.2, []).kinds == [("arrived", "robot.0"), ("arrived", "robot.1")]


def test_gap_of_a_member_that_departs_later_is_along_the_path_driven_before():
    observed = Observed(cars())
    for k in range(50):
        observed.at(0.1 * k, [0], x=[k], speed=10.0)
    seen = observed.at(5.0, x=[50.0, 30.0], speed=10.0)
    assert seen.measures.gap[1] == pytest.approx(20 - LENGTH)


def test_memory_of_a_member_survives_a_change_of_its_row():
    observed = Observed(cars(2))
    x = np.array([0.0, -20.0, -40.0])
    for k in range(101):
        observed.at(0.1 * k, [0, 1, 2] if k < 50 else [2], x=x if k < 50 else x[2:], speed=[3, 2, 0] if k < 50 else 0.0)
    assert observed.at(10.1, [2], x=x[2:]).kinds == [("standstill", "robot.2")]


def test_a_standstill_is_put_down_to_a_vehicle_within_a_cars_length_or_to_a_lost_predecessor():
    observed = Observed(cars(3))
    x = -np.array([0.0, LENGTH + 3.0, 2 * LENGTH + 20.0, 3 * LENGTH + 23.0])
    for k in range(101):
        observed.at(0.1 * k, x=x, speed=0.0)
    events = observed.at(10.1, x=x, speed=0.0).events
    assert [(e.vehicle, e.what, e.detail) for e in events] == [
        ("robot.0", "", "since 0.000 s"),
        ("robot.1", "behind", "since 0.000 s, behind robot.0"),
        ("robot.2", "lost", "since 0.000 s, has lost robot.1"),
        ("robot.3", "behind", "since 0.000 s, behind robot.2"),
    ]


def test_time_to_collision_and_needed_braking_are_those_of_constant_speeds():
    members = cars(3)
    x = -np.arange(4) * (LENGTH + 10.0)
    measures = Observed(members).at(0.0, x=x, speed=[10.0, 15.0, 10.0, 10.0]).measures
    assert np.isnan([measures.closing[0], measures.time_to_collision[0], measures.needed_braking[0]]).all()
    np.testing.assert_allclose(measures.closing[1:], [5, -5, 0])
    np.testing.assert_allclose(measures.time_to_collision, [np.nan, 2, np.nan, np.nan])
    np.testing.assert_allclose(measures.needed_braking, [np.nan, 25 / 20, 0, 0])


@dataclass(frozen=True)
class OneAtATime(Law):
    """The law's `desired_distance` takes one speed, not an array."""

    def desired_distance(self, speed: float) -> float:
        return 5.0 + speed if speed > 2 else 5.0


@dataclass(frozen=True)
class AllAtOnce(Law):
    def desired_distance(self, speed: np.ndarray) -> np.ndarray:
        return np.where(speed > 2, 5.0 + speed, 5.0)


@pytest.mark.parametrize("law", [OneAtATime(), AllAtOnce()])
def test_gap_error_is_against_the_gap_that_the_law_wants_at_that_speed(law):
    leader, *followers = cars(3)
    members = [leader, *(replace(m, law=law) for m in followers)]
    seen = Observed(members).at(0.0, x=-np.arange(4) * (LENGTH + 12.0), speed=[0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(seen.measures.gap_error, [np.nan, 7, 7, 4])


def test_jerk_is_the_change_of_acceleration_over_the_step_and_0_at_departure():
    observed = Observed(cars(1))
    assert observed.at(0.0, [0], x=0.0, acceleration=2.0).measures.jerk == 0
    seen = observed.at(0.1, x=[0.0, -9.0], acceleration=[1.0, 3.0])
    np.testing.assert_allclose(seen.measures.jerk, [-10, 0])


@pytest.mark.parametrize(("model", "limit"), [(CAR, 0.5), (ROBOT, 0.5 * ROBOT.length / 4.74)])
def test_a_near_miss_is_noted_once_per_episode_and_not_during_contact(model, limit):
    observed = Observed(platoon(constant(0.0), constant(1.0), 1, model=model))

    def gap(time: float, gap: float) -> list[str]:
        seen = observed.at(time, x=[0.0, -model.length - gap])
        assert seen.measures.gap[1] == pytest.approx(gap)
        return [kind for kind, _ in seen.kinds if kind not in ("departed", "arrived")]

    gaps = [2.0, 1.01, 0.99, 0.5, 0.8, 1.2, 0.7, 2.0, -0.01, 0.5, 2.0]
    noted = [gap(0.1 * k, g * limit) for k, g in enumerate(gaps)]
    assert noted == [[], [], ["near_miss"], [], [], [], ["near_miss"], [], ["collision"], [], []]


def test_an_emergency_brake_is_noted_once_per_episode_and_not_for_robots():
    for model, kinds in ((CAR, [[], [], ["emergency_brake"], [], [], ["emergency_brake"]]), (ROBOT, [[]] * 6)):
        observed = Observed(platoon(constant(0.0), model=model))
        observed.at(0.0, x=0.0)
        accelerations = [-1.0, -4.4, -4.6, -8.0, 0.0, -5.0]
        found = [observed.at(k + 1.0, x=0.0, acceleration=a).kinds for k, a in enumerate(accelerations)]
        assert [[kind for kind, _ in step] for step in found] == kinds


@pytest.mark.parametrize(("model", "limit"), [(CAR, 0.3), (ROBOT, 0.3 * ROBOT.length / 4.74)])
def test_off_road_begins_and_ends_at_a_distance_that_scales_with_the_vehicle(model, limit):
    observed = Observed(platoon(constant(0.0), model=model))
    outside = [0.0, 0.9, 1.1, 3.0, 1.2, 0.5, 0.0]
    seen = [observed.at(float(k), x=0.0, y=5 + o * limit) for k, o in enumerate(outside)]
    kinds = [[kind for kind, _ in s.kinds if kind != "departed"] for s in seen]
    assert kinds == [[], [], ["off_road"], [], [], ["on_road"], []]
    assert seen[2].events[0].detail == f"{1.1 * limit:.3f} m outside"
    assert seen[5].events[0].duration == 3
    np.testing.assert_allclose([s.measures.off_road[0] for s in seen], np.array(outside) * limit, atol=1e-12)


@pytest.mark.parametrize(
    ("x", "what"), [(4.0, "struck_other_from_behind"), (-4.0, "struck_from_behind"), (0.5, "beside")]
)
def test_a_collision_says_which_vehicle_struck_which(x, what):
    y = 1.7 if what == "beside" else 0.0
    (departed, collision) = Observed(platoon(constant(0.0), model=CAR)).at(0.0, x=0.0, others=[(x, y)]).events
    assert (departed.kind, collision.kind, collision.other, collision.what) == (
        "departed",
        "collision",
        "other.0",
        what,
    )


@pytest.mark.parametrize(("wait", "what"), [(1.9, "other_changed_lanes"), (2.1, "struck_other_from_behind")])
def test_a_collision_soon_after_the_others_lane_change_is_put_down_to_that(wait, what):
    observed = Observed(platoon(constant(0.0), model=CAR))
    observed.at(0.0, x=0.0, others=[(10.0, 3.2)])
    observed.at(1.0, x=0.0, others=[(10.0, 0.0)])
    (collision,) = observed.at(1.0 + wait, x=6.0, others=[(10.0, 0.0)]).events
    assert (collision.kind, collision.what) == ("collision", what)


@pytest.mark.parametrize(("wait", "what"), [(0.0, "other_appeared"), (0.9, "other_appeared"), (1.1, "beside")])
def test_a_collision_soon_after_the_other_was_inserted_is_put_down_to_that(wait, what):
    observed = Observed(platoon(constant(0.0), model=CAR))
    observed.at(0.0, x=0.0)
    observed.at(0.95, x=0.0)
    beside = [(0.5, 1.9 if wait else 1.7)]
    found = observed.at(1.0, x=0.0, others=beside).events
    if wait:
        assert not any(event.kind == "collision" for event in found)
        found = observed.at(1.0 + wait, x=0.0, others=[(0.5, 1.7)]).events
    (collision,) = found
    assert (collision.kind, collision.what) == ("collision", what)


def met_while_standing(stands: float, on_lanes: bool = True, creeps: float = 0.0, turns: float = 0.0,
                       seen: float = 4.0) -> str:  # fmt: skip
    """What is said of a contact with an oncoming car that is too close, after a member has stood for a time [s].

    turns: turning rate of the member [rad/s], seen: time for which the other one is there [s]
    """
    road = SimpleNamespace(**{**vars(ROAD), "is_on_lanes": lambda edge, body: on_lanes})
    observed = Observed(platoon(constant(0.0), model=CAR), road)
    for k in range(41):
        t = k / 10
        x, its = 5.0 * min(t - (4.0 - stands), 0.0) + creeps * t, LENGTH - 0.3 + 8.0 * (4.0 - t)
        others = [(its, 1.7, np.pi)] if t > 4.0 - seen - 1e-6 else []
        found = observed.at(t, x=x, heading=turns * (t - 4.0), others=others).events
        if collision := [event.what for event in found if event.kind == "collision"]:
            return collision[0]
    return ""


def test_a_member_that_stands_anywhere_is_not_the_cause_where_a_pedestrian_walks_into_it(monkeypatch):
    """On a crossing, inside a junction, SUMO's pedestrians walk through what stands."""
    monkeypatch.setattr("platoontraffic.observation.collisions.PERSON", "other.")
    assert met_while_standing(2.1, on_lanes=False) == "stood"
    assert met_while_standing(1.9, on_lanes=False) == "beside"


def test_a_member_that_has_just_been_inserted_beside_another_vehicle_is_not_the_cause():
    entries, there = LaneEntries(shapely.box(0, 0, 1, 1)), [np.zeros(2)] * 6
    entries.observe(TrafficSnapshot(0.0, ("b",), *(values[:1] for values in there)))
    assert not entries.is_new("b")
    entries.observe(TrafficSnapshot(0.1, ("a", "b"), *there))
    assert entries.is_new("a")
    assert not entries.is_new("b")


def test_a_member_that_stands_on_its_lanes_is_not_the_cause_where_one_from_another_direction_strikes_it():
    assert met_while_standing(2.1) == "stood"
    assert met_while_standing(2.5, seen=1.3) == "stood"
    assert met_while_standing(1.9) == "beside"
    assert met_while_standing(3.0, creeps=0.03) == "beside"
    assert met_while_standing(3.0, turns=0.02) == "beside"
    assert met_while_standing(3.0, on_lanes=False) == "beside"


def cut_in(goes: str) -> str:
    """What is said of a contact of a member with the car ahead, one of which has just changed lanes in 2 s."""
    observed, what = Observed(platoon(constant(0.0), model=CAR)), ""
    for k in range(40):
        share = min(max((k - 10) / 20, 0.0), 1.0)
        own, its = (-1.6, 1.6 - 3.2 * share) if goes == "other" else (1.6 - 3.2 * share, -1.6)
        gap = 8.0 - max(k - 20, 0) * 0.3
        seen = observed.at(k / 10, x=2.0 * k, y=own, speed=20.0, others=[(2.0 * k + gap, its)])
        what = next((event.what for event in seen.events if event.kind == "collision"), what)
    return what


def test_whoever_has_just_changed_lanes_is_named():
    assert cut_in("other") == "other_changed_lanes"
    assert cut_in("own") == "changed_lanes"


def test_a_car_that_is_put_onto_the_next_lane_and_turns_at_once_has_changed_lanes():
    """Its front goes 2.2 m aside in a step in which its centre, across its new heading, goes less than 2 m: as SUMO
    moves a car that changes lanes where it leaves a bend.
    """
    turn, half = np.radians(21.0), LENGTH / 2
    observed = Observed(platoon(constant(0.0), model=CAR))
    front, mean = np.array([8.0, 2.6]), -turn / 2
    after = front + np.array([[np.cos(mean), np.sin(mean)], [-np.sin(mean), np.cos(mean)]]).T @ (0.7, -2.2)
    for k in range(5):
        x, y = front - (half + 0.7 * (4 - k), 0.0)
        observed.at(0.1 * k, x=0.1 * k - 2.0, others=[(x, y, 0.0)])
    x, y = after - half * np.array([np.cos(turn), -np.sin(turn)])
    assert abs((y - front[1]) * np.cos(turn) + (x - (front[0] - half)) * np.sin(turn)) < 2.0
    (collision,) = observed.at(0.5, x=x - 2.5, others=[(x, y, -turn)]).events
    assert (collision.kind, collision.what) == ("collision", "other_changed_lanes")


@pytest.mark.parametrize(("its", "what"), [((-5.1, -5.1, -1.9), "other_changed_lanes"), ((-2.5, -2.2, -1.9), "beside")])
def test_a_car_that_is_put_against_the_corner_of_a_member_has_changed_lanes(its, what):
    """The member is askew, as in a lane change away from there; across the road the two are no wider than apart."""
    observed = Observed(platoon(constant(0.0), model=CAR))
    for k, y in enumerate(its):
        events = observed.at(k / 10, x=0.0, heading=0.1, others=[(0.0, y)]).events
    assert [(event.kind, event.what) for event in events] == [("collision", what)]


@pytest.mark.parametrize("first", range(6))
def test_members_that_come_later_have_the_same_rows(first):
    """As if all had been known from the beginning, however many come at a time."""
    members = [replace(m, platoon=f"p{i // 2}") for i, m in enumerate(cars(5))]
    whole, grown = Observed(members).observer, Observed(members[:first]).observer
    for i in range(first, len(members), 2):
        grown.extend(members[i : i + 2])
    for name, part in vars(whole).items():
        theirs = getattr(grown, name)
        for key, value in vars(part).items() if hasattr(part, "__dict__") else ():
            if isinstance(value, np.ndarray | list):
                np.testing.assert_array_equal(getattr(theirs, key), value, f"{name}.{key}")
    np.testing.assert_array_equal(grown._gaps._paths.spacing, whole._gaps._paths.spacing)
    assert list(grown._presence.members) == members
