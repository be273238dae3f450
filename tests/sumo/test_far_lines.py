"""Stop lines that need not be judged: far ones, and all of them between two looks."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.road.lane_routes import Line
from platoontraffic.simulation import Simulation
from platoontraffic.sumo import stoplines
from platoontraffic.sumo.ego import Ego
from platoontraffic.sumo.far_lines import FarLines, LastLook, LineState
from platoontraffic.sumo.stoplines import RIGHT_OF_WAY, StopLines


def driven(scenario: str = "corridor_two_platoons", duration: int = 40, *changes: str) -> np.ndarray:
    """Where members come to; those of two platoons on a street with lights, junctions and lane changes."""
    with Simulation.load(scenario, f"run.duration_s={duration}", *changes) as simulation:
        return np.array([(*now.fleet.motion.x, *now.fleet.motion.y) for now in simulation])


@pytest.mark.sumo
def test_members_drive_as_if_each_line_were_looked_at_in_every_step(monkeypatch):
    expected, still, times = driven(), FarLines.still, []

    def never(*given):
        is_far, lines = still(*given)
        times.append(is_far.sum())
        return np.zeros_like(is_far), lines

    monkeypatch.setattr(FarLines, "still", never)
    assert (driven() == expected).all()
    assert sum(times) > 100


@pytest.mark.parametrize(
    ("station", "speed", "lane", "minor", "expected"),
    [
        (30.0, 10.0, "a_0", False, True),
        (30.0, 17.0, "a_0", False, False),  # it has to know from 72 m + 5 m on
        (30.0, 17.0, "a_0", True, True),  # cross traffic is not looked at from there
        (87.0, 17.0, "a_0", True, True),
        (88.0, 17.0, "a_0", True, False),
        (30.0, 10.0, "a_1", False, False),
        (9.0, 10.0, "a_0", False, False),  # it is not beyond the line before
    ],
)
def test_a_line_is_looked_at_again_where_something_has_changed(station, speed, lane, minor, expected):
    state = LineState(75.0, not minor, minor, False, RIGHT_OF_WAY)
    line, ego = Line(100.0, "m", "", 0, "a_0", "b_0", (":x_0",), 10.0), Ego("m", "a_0", 5.0, 5.0)
    far = FarLines([ego._replace(id="another"), ego])
    far.note(1, ego, 10.0, line, state, gives_way=minor)
    is_far, lines = far.still(np.array([0.0, station]), np.array([0.0, speed]), ["a_0", lane])
    assert (is_far == [False, expected]).all()
    assert LineState(*(values[1] for values in lines)) == state._replace(distance=100.0 - station)
    others = FarLines([ego, ego, ego])
    others.take_over(far, [(2, 1)])
    assert others.lines == [None, None, line]
    assert (others.still(np.full(3, station), np.full(3, speed), [lane] * 3)[0] == [False, False, expected]).all()


def test_a_near_line_is_looked_at_in_every_step():
    ego = Ego("m", "a_0", 10.0, 5.0)
    far, line = FarLines([ego]), Line(100.0, "m", "", 0, "a_0", "b_0", (), 10.0)
    for gives_way, distance in ((False, 29.9), (True, 12.5)):
        far.note(0, ego, 10.0, line, LineState(distance, True, False, False, 0), gives_way)
        assert not far.still(np.array([50.0]), np.array([0.0]), ["a_0"])[0].any()


# ---- between two looks

LINES = LineState(
    np.array([20.0, 0.5, np.inf, 0.0]), np.array([True, True, True, False]), *np.zeros((2, 4), bool), np.arange(4)
)


def test_between_two_looks_lines_come_nearer_by_what_has_been_driven():
    last = LastLook(4)
    last.note(np.array([100.0, 50.0, 30.0, 10.0]), LINES)
    anew, lines = last.now(np.array([101.5, 50.25, 32.0, 10.5]))
    assert not anew.any()
    assert lines.distance.tolist() == [18.5, 0.25, np.inf, -0.5]
    assert [values.tolist() for values in lines[1:]] == [values.tolist() for values in LINES[1:]]


@pytest.mark.parametrize(
    ("front", "expected"),
    [
        ([120.0, 50.0, 30.0, 10.0], [True, False, False, False]),  # its front is on the line
        ([100.0, 51.0, 30.0, 10.0], [False, True, False, False]),  # beyond it
        ([100.0, 50.0, 999.0, 12.0], [False, False, False, False]),  # there is none; it had stopped beyond it
        ([2.0, 49.5, 30.0, 10.0], [True, False, False, False]),  # in the next lap; a little back
    ],
)
def test_between_two_looks_the_next_line_is_judged_of_one_that_has_passed_its_own(front, expected):
    last = LastLook(4)
    last.note(np.array([100.0, 50.0, 30.0, 10.0]), LINES)
    assert last.now(np.array(front))[0].tolist() == expected


def test_a_new_member_is_looked_at_at_once():
    old, new = LastLook(4), LastLook(3)
    assert old.now(np.zeros(4))[0].all()
    old.note(np.array([100.0, 50.0, 30.0, 10.0]), LINES)
    new.take_over(old, [(2, 0), (0, 1)])
    anew, lines = new.now(np.array([50.0, 3.0, 101.0]))
    assert anew.tolist() == [False, True, False]
    assert lines.distance[[0, 2]].tolist() == [0.5, 19.0]


@pytest.mark.sumo
@pytest.mark.parametrize(("step", "every"), [(0.025, 8), (0.05, 4), (0.1, 2)])
def test_lines_are_judged_five_times_a_second(monkeypatch, step, every):
    times, look = [], StopLines._begin_look
    monkeypatch.setattr(StopLines, "_begin_look", lambda lines: (times.append(1), look(lines))[1])
    steps = len(driven("corridor_tracking", 10, f"run.step_s={step}"))
    assert len(times) in (steps // every, steps // every + 1)


@pytest.mark.sumo
def test_members_that_nobody_hinders_drive_as_if_they_looked_in_every_step(monkeypatch):
    expected = driven("corridor_tracking", 60)
    monkeypatch.setattr(stoplines, "LOOKS_EVERY", 0.01)
    assert (driven("corridor_tracking", 60) == expected).all()
