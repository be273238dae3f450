"""Splits and rejoins of followers, and the causes of splits; without SUMO."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from platoontraffic.controllers import CLOSED_BY, Signals
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.observation.hindrances import HELD_BY
from tests.support.observed import CAR, Observed, cars

AHEAD, OTHER, NOTHING = [0] * 20, [2] * 20, [-2] * 20


class Road(Observed):
    """A follower 20 m behind its leader, centre to centre, in steps of 0.1 s; its law wants a gap of 3 m at rest."""

    def __init__(self, number: int = 2) -> None:
        leader, *followers = cars(number - 1)
        super().__init__([leader, *(replace(m, law=TrackingFollower()) for m in followers)])
        self.time, self.noted = 0.0, []

    def drive(self, seconds: float, hits=AHEAD, gap: float = 20.0, signals: Signals | None = None, **here) -> None:
        for _ in range(round(seconds / 0.1)):
            here.setdefault("others", [(-60.0, 0.0)])
            seen = self.at(self.time, x=[0.0, -gap], hits=hits, signals=signals, **here)
            self.noted += [e for e in seen.events if e.kind in ("split", "rejoined", "held", "released")]
            self.time = round(self.time + 0.1, 6)

    @property
    def kinds(self) -> list[str]:
        return [e.kind for e in self.noted]


def lines(is_open: bool, reason: int, distance: float = 3.0) -> Signals:
    far = np.array([np.inf, distance])
    return Signals(far, np.array([True, is_open]), *np.zeros((2, 2), bool), np.array([0, reason]))


def test_a_lock_lost_for_two_seconds_is_a_split_that_ends_with_the_next_lock():
    road = Road()
    road.drive(3)
    road.drive(1.9, NOTHING)
    road.drive(2)
    assert road.noted == []
    road.drive(5, NOTHING)
    road.drive(1)
    assert road.kinds == ["split", "rejoined"]
    split, rejoined = road.noted
    assert (split.vehicle, split.other, split.what) == ("robot.1", "robot.0", "out_of_sight")
    assert split.time == pytest.approx(6.9 + 2.0, abs=0.11)
    assert rejoined.duration == pytest.approx(5.0, abs=0.11)


def test_a_follower_that_takes_another_vehicle_is_split_off():
    road = Road()
    road.drive(1)
    road.drive(3, OTHER)
    assert [(e.what, e.detail) for e in road.noted] == [("taken", "took other.0 for its predecessor")]


def test_a_vehicle_between_is_the_cause_of_a_split():
    road = Road()
    road.drive(1)
    road.drive(3, OTHER, others=[(-9.0, 0.0)])
    assert [(e.what, e.detail) for e in road.noted] == [("between", "other.0 between")]


@pytest.mark.parametrize(("more", "noted"), [(-0.1, []), (0.1, ["fell_behind"])])
def test_a_gap_much_longer_than_wanted_is_a_split_despite_the_lock(more, noted):
    road = Road()
    farthest = 3.0 + 15.0 + CAR.length  # from centre to centre: 15 m more than the gap wanted at rest
    road.drive(3, gap=farthest + more)
    assert [e.what for e in road.noted] == noted


def test_a_closed_stop_line_is_the_cause_of_the_split_after_it():
    road = Road()
    road.drive(1)
    road.drive(4, signals=lines(False, 1), speed=[10.0, 0.0])
    road.drive(1, signals=lines(True, 1), speed=[10.0, 0.0])
    road.drive(3, NOTHING, signals=lines(True, 2, np.inf))
    assert [(e.kind, e.what, e.detail) for e in road.noted] == [
        ("held", "light", "light"),
        ("released", "", ""),
        ("split", "held", "held by light 7.0 s ago"),
    ]
    assert road.noted[1].duration == pytest.approx(4.0, abs=0.11)


def test_a_member_that_passes_a_closed_line_at_speed_is_not_held():
    road = Road()
    road.drive(2, signals=lines(False, 1), speed=[10.0, 8.0])
    assert road.noted == []


def test_a_leader_is_never_split_off():
    road = Road(1)
    for k in range(50):
        assert [e for e in road.at(0.1 * k, x=[0.0]).kinds if e[0] != "departed"] == []


def test_a_member_can_be_held_by_everything_that_closes_a_stop_line():
    assert [by.split("_")[0] for by in HELD_BY] == [by.split(" ")[0] for by in CLOSED_BY]
