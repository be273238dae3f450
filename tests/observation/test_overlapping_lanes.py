"""Contacts where lanes of two directions overlap: straight lanes, so that every distance is a sum."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.observation.collisions import Collisions
from platoontraffic.observation.overlapping_lanes import KEEPS, OnLane
from platoontraffic.observation.swings import Outline
from platoontraffic.vehicles.bicycle import CARS
from tests.support.bench import constant, platoon
from tests.support.observed import ROAD, Observed

CAR = CARS["car"]
LENGTH, WIDTH = CAR.length, CAR.width
LITTLE, MUCH = KEEPS * WIDTH - 0.05, KEEPS * WIDTH + 0.05


def met(
    apart: float, off: float = 0.0, its_off: float = 0.0, heading: float = 0.0, middle: float = math.nan,
    left_hand: bool = False, its_heading: float = math.pi, no_middle_below: float = -math.inf, edge: float = -5.0,
) -> str:  # fmt: skip
    """What is said of the contact of a member that drives east and a car that drives west.

    apart : middles of their lanes [m]
    off   : distance of the member from the middle of its lane, towards the other one [m]; its_off: of that one
    middle: of the road, along y [m]; NaN: it has none; nor has it below `no_middle_below`
    edge  : of the road, along y [m]
    """
    lanes = shapely.LineString([(-200, 0), (200, 0)]), shapely.LineString([(200, apart), (-200, apart)])
    headed = lambda x, y, heading: lanes[0 if math.cos(heading) > 0 else 1]  # noqa: E731
    right = lambda x, y, heading: np.where(y < no_middle_below, np.nan, (y - middle) * -np.sign(np.cos(heading)))  # noqa: E731
    changes = {"lane_headed": headed, "right_of_middle": right, "left_hand": left_hand}
    changes["drivable"] = shapely.box(-100, edge, 1000, 5)
    observed = Observed(platoon(constant(0.0), model=CAR), SimpleNamespace(**{**vars(ROAD), **changes}))
    for k in range(60):
        other = 20.0 - 0.4 * k, apart - its_off, its_heading
        found = observed.at(k / 10, x=0.3 * k, y=off, heading=heading, speed=3.0, others=[other]).events
        if what := [event.what for event in found if event.kind == "collision"]:
            return what[0]
    return ""


@pytest.mark.parametrize(("apart", "what"), [(WIDTH - 0.05, "lanes_overlap"), (WIDTH + 0.05, "")])
def test_in_the_middles_of_lanes_two_touch_where_these_are_less_than_a_width_apart(apart, what):
    """Cars of SUMO's do so on roads with kinks, and members that keep to their lanes cannot help it."""
    assert met(apart) == what


@pytest.mark.parametrize(("off", "what"), [(LITTLE, "lanes_overlap"), (MUCH, "beside"), (-MUCH, "lanes_overlap")])
def test_a_member_that_has_left_the_middle_of_its_lane_towards_the_other_one_is_the_cause(off, what):
    assert met(1.2, off) == what


def test_so_it_is_if_one_that_stands_askew_reaches_over():
    """Its front corner is off by half of its length times the sine."""
    askew = math.asin(2 * MUCH / LENGTH)
    assert met(1.6, heading=askew) == "beside"
    assert met(1.6, heading=0.5 * askew) == "lanes_overlap"


def test_where_the_lanes_do_not_overlap_the_road_is_not_the_cause():
    assert met(WIDTH + 0.1, off=0.2) == "beside"


def test_the_other_one_must_keep_to_its_lane_too():
    assert met(1.2, its_off=MUCH) == "beside"
    assert met(1.2, its_off=LITTLE) == "lanes_overlap"


@pytest.mark.parametrize(
    ("off", "its_off", "left_hand", "what"),
    [
        (0.0, 1.6, False, "other_crossed_middle"),  # it reaches to 0.7 m, and the member to 0.9 m
        (1.0, 1.6, False, "beside"),  # both are beyond the middle
        (1.5, 0.0, False, "beside"),  # the member is
        (0.0, 1.6, True, "beside"),  # each is on the other's side
    ],
)
def test_one_that_comes_over_the_middle_of_the_road_is_the_cause_if_the_member_keeps_to_its_side(
    off, its_off, left_hand, what
):
    """The lanes are 3.2 m wide. In Bologna buses that cut a bend touched members which braked on their own lane."""
    assert met(3.2, off, its_off, middle=1.6, left_hand=left_hand) == what


def test_over_the_middle_every_corner_counts_and_both_directions():
    askew = math.asin(2 * 0.6 / LENGTH)
    assert met(3.2, 0.6, its_off=0.75, middle=1.6, its_heading=math.pi + askew) == "other_crossed_middle"
    assert met(3.2, 0.6, its_off=0.75, heading=askew, middle=1.6) == "beside"


@pytest.mark.parametrize(("edge", "what"), [(-0.8, "other_crossed_middle"), (-5.0, "beside")])
def test_a_corner_beside_the_road_is_on_its_own_side_and_one_in_a_junction_on_none(edge, what):
    """There is no middle to the right of a place; the road ends there, or is that of a junction."""
    assert met(3.2, its_off=1.6, middle=1.6, no_middle_below=-0.5, edge=edge) == what


@pytest.mark.parametrize(("aside", "over"), [(1.6, True), (3.4, False)])
def test_a_bus_whose_bumpers_are_on_its_lane_is_over_the_middle_inside_of_a_bend(aside, over):
    """The road bends by 39 degrees at x = 0: its middle is 2.1 m from there to the side of the member at x = 6 m."""
    right = lambda x, y, heading: (y + 0.35 * abs(x)) * -np.sign(np.cos(heading))  # noqa: E731
    network = SimpleNamespace(right_of_middle=right, left_hand=False, drivable=shapely.box(-50, -50, 50, 50))
    poses = [
        (np.array([0.0]), np.array([y]), np.array([heading])) for y, heading in ((-2.7, 0.0), (aside - 2.1, np.pi))
    ]
    both = SimpleNamespace(poses=poses, length=(LENGTH, 12.0), width=(WIDTH, 2.5))
    collisions = Collisions(None, SimpleNamespace(drivable=network.drivable))
    collisions._network = network
    assert collisions._crossed_the_middle(both) is over


def test_on_a_bend_its_place_is_along_the_bend():
    """Bumpers of a car across a right angle are 2 m from its corner; the middle of the car is 1.41 m inside of it."""
    bend = shapely.LineString([(-10, 0), (0, 0), (0, 10)])
    on = OnLane(bend, Outline(0.0, 2.0, math.radians(45), 2 * math.sqrt(2), WIDTH))
    expected = shapely.LineString([(-2, 0), (0, 0), (0, 2)]).buffer(WIDTH / 2, cap_style="flat")
    assert on.in_the_middle().symmetric_difference(expected).area == pytest.approx(0.0, abs=1e-6)
