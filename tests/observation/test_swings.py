"""Vehicles that swing their rear into another one, as SUMO's do at kinks: against closed forms, and both ways round."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.observation.collisions import _were_abreast
from platoontraffic.observation.lane_entries import Poses, Together
from platoontraffic.observation.swings import AXLE, Course, sideways, swung, trailing
from platoontraffic.vehicles.bicycle import CARS
from tests.support.bench import constant, platoon
from tests.support.observed import Observed

CAR = CARS["car"]
LENGTH, WIDTH = CAR.length, CAR.width
KINK = math.radians(-133.0)
STEP = 0.1  # [s]


def test_a_trailing_axle_draws_the_tractrix():
    """Drawn from the origin along x, from square to it: x = s - a tanh(s / a), y = a / cosh(s / a) (Huygens)."""
    a, s = 3.0, np.linspace(0.0, 6.0, 7)
    heading = trailing(s, np.zeros(7), -math.pi / 2, a)
    rear = s[-1] - a * math.cos(heading), -a * math.sin(heading)
    assert rear == (pytest.approx(6.0 - a * math.tanh(2.0)), pytest.approx(a / math.cosh(2.0)))


def test_on_a_circle_a_trailing_axle_drives_one_of_radius_sqrt_of_r_squared_minus_a_squared():
    radius, a, turn = 10.0, 3.0, np.linspace(0.0, 20.0, 40001)
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    heading = trailing(x, y, math.pi / 2, a)
    rear = math.hypot(x[-1] - a * math.cos(heading), y[-1] - a * math.sin(heading))
    assert rear == pytest.approx(math.sqrt(radius**2 - a**2), abs=1e-3)


def test_on_an_arc_nobody_moves_sideways_and_a_jump_aside_is_its_size():
    turn = np.linspace(0.0, 3.0, 31)
    assert sideways(10 * np.cos(turn), 10 * np.sin(turn), turn + math.pi / 2) == pytest.approx(0.0, abs=1e-9)
    assert sideways(np.array([0.0, 1.0]), np.array([0.0, 3.2]), np.zeros(2)) == pytest.approx(3.2)


def hairpin(about: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and headings of a car that drives north, and at (0, -1) turns back: "front" like SUMO's, or "axle"."""
    driven = np.arange(0.0, 8.6, 0.2)
    before = np.minimum(driven, 7.0)
    onward = driven - before
    x, y = onward * math.cos(math.pi / 2 + KINK), before - 8.0 + onward * math.sin(math.pi / 2 + KINK)
    if about == "front":
        turned = np.minimum(onward / 1.0, 1.0)
        heading = math.pi / 2 + KINK * turned
    else:
        heading = np.array([trailing(x[: k + 1], y[: k + 1], math.pi / 2, AXLE * LENGTH) for k in range(len(x))])
    return x - LENGTH / 2 * np.cos(heading), y - LENGTH / 2 * np.sin(heading), heading


def west(x: float, y: float, count: int, speed: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A car that drives west and ends at (x, y)."""
    along = x + speed * STEP * np.arange(count)[::-1]
    return along, np.full(count, y), np.full(count, math.pi)


def cause(swings, keeps, own_side: bool = True) -> int | None:
    """Which has swung into the other: 0, the first, or 1; the same with the two exchanged is asserted."""
    time = STEP * np.arange(len(swings[0]))
    courses = [Course.of(*poses, LENGTH, WIDTH) for poses in (swings, keeps)]
    found = swung(time, courses, lambda n: own_side)
    assert swung(time, courses[::-1], lambda n: own_side) == (None if found is None else 1 - found)
    return found


def test_a_vehicle_that_turns_about_its_front_has_swung_into_one_that_keeps_its_side():
    front = hairpin("front")
    assert cause(front, west(-3.0, 1.6, len(front[0]), 8.0)) == 0


def test_a_vehicle_whose_rear_follows_its_front_has_not():
    axle = hairpin("axle")
    assert cause(axle, west(-3.0, 1.6, len(axle[0]), 8.0)) is None


def test_into_a_vehicle_on_the_wrong_side_of_the_road_nobody_has_swung():
    front = hairpin("front")
    assert cause(front, west(-3.0, 1.6, len(front[0]), 8.0), own_side=False) is None


def test_two_that_would_meet_soon_in_any_case_have_not_swung():
    """The other one comes towards the front of the one that turns."""
    front = hairpin("front")
    assert cause(front, west(6.0, -4.5, len(front[0]), 8.0)) is None


def test_a_vehicle_that_is_put_onto_another_lane_has_not_swung():
    x, y, heading = hairpin("front")
    x[-1] -= 3.2 * math.sin(heading[-1])
    y[-1] += 3.2 * math.cos(heading[-1])
    assert cause((x, y, heading), west(-3.0, 3.0, len(x), 8.0)) is None


def contact(right_of_middle: float, left_hand: bool = False, swings: str = "other", keeps_lane: bool = False) -> str:
    """What is said of the contact of a member with a car, of which one swings and the other drives west."""
    road = SimpleNamespace(
        drivable=shapely.box(-100, -50, 100, 50),
        right_of_middle=lambda x, y, heading: np.full(len(x), right_of_middle),
        left_hand=left_hand,
        lane_headed=lambda x, y, heading: None,
        keeps_to_a_lane=lambda x, y, heading, body: keeps_lane,
    )
    observed, front = Observed(platoon(constant(0.0), model=CAR), road), hairpin("front")
    keeps = west(-3.0, 1.6, len(front[0]), 8.0)
    own, its = (keeps, front) if swings == "other" else (front, keeps)
    for k, (mine, other) in enumerate(zip(zip(*own, strict=True), zip(*its, strict=True), strict=True)):
        x, y, heading = mine
        for event in observed.at(STEP * k, x=x, y=y, heading=heading, others=[other]).events:
            if event.kind == "collision":
                return event.what
    return ""


def test_the_observer_names_the_one_that_has_swung():
    assert contact(1.6) == "other_swung_out"
    assert contact(1.6, swings="own") == "swung_out"


@pytest.mark.parametrize(
    ("right", "left_hand", "what"),
    [(-1.6, False, "beside"), (math.nan, False, "beside"), (0.5, False, "beside"), (-1.6, True, "other_swung_out")],
)
def test_the_one_that_is_swung_into_must_be_on_its_own_side(right, left_hand, what):
    assert contact(right, left_hand) == what


def test_inside_a_junction_the_one_that_is_swung_into_must_be_on_the_path_of_a_connection():
    """A bus that turned right swung its rear over the next lane, into a member that waited in the junction."""
    assert contact(math.nan, keeps_lane=True) == "other_swung_out"
    assert contact(math.nan, keeps_lane=True, swings="own") == "swung_out"
    assert contact(-1.6, keeps_lane=True) == "beside"


@pytest.mark.parametrize(
    ("ahead", "aside", "abreast"),
    [(7.0, 2.0, True), (-7.0, 2.0, True), (8.5, 0.0, False), (-8.5, 0.0, False)],  # lengths 12 m and 4.74 m
)
def test_a_vehicle_beside_any_part_of_another_one_is_not_behind_it(ahead, aside, abreast):
    """A bus swung its rear into a car beside it, 7 m behind its middle: the car had struck it from behind."""
    x, y, nothing = np.array([0.0, 0.0]), np.array([0.0, 0.0]), np.zeros(2)
    both = Together(
        np.array([0.0, STEP]),
        [Poses(x, y, nothing), Poses(x + ahead, y + aside, nothing)],
        np.array([4.74, 12.0]),
        np.array([1.76, 2.5]),
    )
    assert _were_abreast(both) == abreast
