"""Gap acceptance by cases, monotonicity, and a simulation in small steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from platoontraffic.road.gap_acceptance import (
    BEHIND_MARGIN,
    FIRST_MARGIN,
    LEAST_MARGIN,
    TIME_TO_IMPATIENCE,
    Foe,
    Pace,
    margin_after,
    may_cross,
)

LENGTH = 4.74
OWN = Pace(0.0, 2.5, 6.0, 0.4)

distances = st.floats(0.1, 200)
speeds = st.floats(0, 30)
paces = st.builds(Pace, st.floats(0, 20), st.floats(0.5, 4), st.floats(1, 20), st.floats(0, 1))


# ---- the time that a distance takes


def by_small_steps(distance: float, pace: Pace, h: float = 1e-3) -> float:
    speed, driven, time = pace.speed, 0.0, 0.0
    while driven < distance:
        rate = pace.acceleration if time >= pace.delay and speed < pace.top else 0.0
        driven, time, speed = driven + speed * h + rate * h**2 / 2, time + h, speed + rate * h
    return time


@pytest.mark.parametrize("speed", [0.0, 3.0, 6.0, 14.0])
@pytest.mark.parametrize("distance", [0.5, 7.0, 12.0, 60.0])
def test_time_for_a_distance_is_that_of_small_steps(distance, speed):
    pace = OWN._replace(speed=speed)
    time = pace.time_for(distance)
    assert time == pytest.approx(by_small_steps(distance, pace), abs=3e-3)


def test_time_is_the_closed_form_from_rest_and_at_full_speed():
    assert OWN.time_for(3.0) == pytest.approx(0.4 + np.sqrt(2 * 3.0 / 2.5))
    assert Pace(10.0, 2.5, 6.0).time_for(50.0) == pytest.approx(5.0)
    assert Pace(0.0).time_for(1.0) == np.inf
    assert OWN.time_for(0.0) == OWN.time_for(-3.0) == 0.0


@given(distances, distances, paces, speeds)
def test_a_longer_distance_never_takes_less_time_and_a_higher_speed_never_more(one, other, pace, faster):
    near, far = sorted((one, other))
    assert pace.time_for(near) <= pace.time_for(far) + 1e-9
    assert pace._replace(speed=pace.speed + faster).time_for(near) <= pace.time_for(near) + 1e-9


@given(distances, paces)
def test_the_speed_after_a_time_is_the_derivative_of_the_distance(distance, pace):
    time, h = pace.time_for(distance), 1e-4
    later = pace.time_for(distance + h)
    if pace.speed_after(time) > 0.1:
        assert h / (later - time) == pytest.approx(pace.speed_after((time + later) / 2), rel=1e-2)


# ---- whether there is a gap


def coming(seconds: float, speed: float = 10.0, **changes: float) -> Foe:
    """A foe that reaches the conflict in `seconds`; the own vehicle is 5 m before it."""
    foe = Foe(5.0, 5.0, 9.0, seconds * speed, seconds * speed + 4.0, Pace(speed), 5.0, np.inf)
    return foe._replace(**changes)


def test_a_vehicle_crosses_before_a_foe_that_comes_a_margin_after_it_is_gone():
    gone = OWN.time_for(9.0 + LENGTH)
    assert not may_cross(coming(gone + FIRST_MARGIN - 0.01), OWN, LENGTH)
    assert may_cross(coming(gone + FIRST_MARGIN + 0.01), OWN, LENGTH)


def test_a_vehicle_crosses_behind_a_foe_that_is_gone_before_it_comes():
    own = Pace(10.0)
    foe = Foe(40.0, 40.0, 44.0, 5.0, 9.0, Pace(10.0), 5.0, np.inf)
    assert may_cross(foe, own, LENGTH)
    still_there = 10 * (4.0 - BEHIND_MARGIN) + 0.1
    assert not may_cross(foe._replace(foe_to_exit=still_there - 5.0), own, LENGTH)


def test_a_vehicle_enters_behind_a_foe_that_entered_earlier_and_is_gone_by_a_margin_when_it_comes():
    """Where paths merge 50 m beyond the line, a stream with a car every few seconds leaves no other gap."""
    own, there = Pace(0.0, 1.5, 14.0, 0.4), 50.0
    comes = own.at_once.time_for(1.0 + there)
    gone = Foe(1.0, 1.0 + there, 80.0, 0.0, 30.0, Pace(12.0), 5.0, np.inf, merges=True)
    far = 12.0 * (comes - FIRST_MARGIN) - 5.0  # from where it is gone that margin before the own vehicle comes

    def at(to_merge: float) -> Foe:
        return gone._replace(foe_to_conflict=to_merge, foe_to_exit=to_merge + 30.0, foe_to_enter=to_merge - there)

    assert at(there).foe_to_enter == 0.0
    assert may_cross(at(there), own, LENGTH)
    assert not may_cross(at(there)._replace(foe_to_enter=np.inf), own, LENGTH)
    assert may_cross(at(far - 0.1)._replace(foe_to_enter=0.0), own, LENGTH)
    assert not may_cross(at(far + 0.1)._replace(foe_to_enter=0.0), own, LENGTH)
    enters = 12.0 * (own.time_for(1.0) - BEHIND_MARGIN)  # one that is outside when the own vehicle enters would brake
    assert may_cross(at(there)._replace(foe_to_enter=enters - 0.1), own, LENGTH)
    assert not may_cross(at(there)._replace(foe_to_enter=enters + 0.1), own, LENGTH)
    creeps = at(20.0)._replace(pace=Pace(3.9), foe_to_enter=-30.0)  # it may come to a stand behind a queue
    assert not may_cross(creeps, own, LENGTH)


def test_a_foe_that_turns_slowly_clears_later():
    own, foe = Pace(10.0), Foe(40.0, 40.0, 44.0, 5.0, 15.0, Pace(10.0), 5.0, 10.0)
    assert may_cross(foe, own, LENGTH)
    assert not may_cross(foe._replace(clearing_speed=4.0), own, LENGTH)  # 0.5 s and 15 m at 4 m/s


def test_a_foe_that_hurries_is_expected_as_soon_as_it_can_come():
    still = Foe(5.0, 5.0, 9.0, 13.74, 17.74, Pace(0.0), 5.0, np.inf)
    assert may_cross(still, OWN, LENGTH)
    hurries = still._replace(pace=Pace(0.0, 2.6, 13.9))
    assert not may_cross(hurries, OWN, LENGTH)
    needed = OWN.time_for(9.0 + LENGTH) + FIRST_MARGIN
    far = next(m / 10 for m in range(10_000) if hurries.pace.time_for(m / 10) > needed)
    assert may_cross(hurries._replace(foe_to_conflict=far, foe_to_exit=far + 4), OWN, LENGTH)
    assert not may_cross(hurries._replace(foe_to_conflict=far - 0.2, foe_to_exit=far + 4), OWN, LENGTH)


@pytest.mark.parametrize(
    ("foe", "free"),
    [
        (coming(2.0, foe_to_conflict=-30.0, foe_to_exit=-5.1), True),  # its rear is past
        (coming(2.0, foe_to_conflict=-30.0, foe_to_exit=-4.9, to_enter=0.5), True),  # 0.1 m more at 10 m/s
        (coming(2.0, foe_to_conflict=-1.0, foe_to_exit=9.0, to_enter=0.5), False),
        (coming(2.0, to_conflict=-20.0, to_exit=-4.8), True),  # the own rear is
        (coming(2.0, pace=Pace(0.0)), True),  # it waits
        (coming(2.0, pace=Pace(0.0), foe_to_conflict=0.0), False),  # it stands on the conflict
    ],
)
def test_a_vehicle_that_is_past_or_waits_is_no_foe(foe, free):
    assert may_cross(foe, OWN, LENGTH) is free


def test_who_merges_first_must_not_make_the_other_brake_hard():
    """Standing, it enters a lane before a car at 14 m/s, and accelerates: that one keeps a length by 2 m/s2."""
    own, length, h = Pace(0.0, 2.5, 14.0), 5.0, 1e-3
    merge = Foe(1.0, 2.0, 12.0, 0.0, 10.0, Pace(14.0), 5.0, np.inf, merges=True)
    closed = [m for m in range(300) if not may_cross(merge._replace(foe_to_conflict=float(m)), own, length)]
    past = own.time_for(2.0 + length)
    time = np.arange(past, past + 10.0, h)
    speed = np.array([own.speed_after(t) for t in time])
    rear = h * np.cumsum(speed)
    its = np.maximum(14.0 - 2.0 * np.maximum(time - past - FIRST_MARGIN, 0.0), 0.0)
    gap = closed[-1] + 1 - 14.0 * past + rear - h * np.cumsum(its)
    assert gap.min() == pytest.approx(length, rel=0.3)


def test_waiting_makes_impatient_down_to_the_least_margin():
    waits = [0.0, 30.0, 100.0, TIME_TO_IMPATIENCE, 1e4]
    margins = [margin_after(waited) for waited in waits]
    assert margins == sorted(margins, reverse=True)
    assert (margins[0], margins[-1]) == (FIRST_MARGIN, LEAST_MARGIN)
    assert LEAST_MARGIN > 0


foes = st.builds(
    lambda own, across, off, beyond, speed, length, inside: Foe(
        own, own, own + across, off, off + beyond, Pace(speed), length, np.inf, False, off - inside
    ),
    st.floats(0, 60), st.floats(1, 30), st.floats(0, 200), st.floats(0, 30), st.floats(0.2, 30), st.floats(2, 18),
    st.floats(0, 50),
)  # fmt: skip


@given(foes, paces, st.floats(0, 100))
def test_a_gap_before_a_foe_stays_one_if_the_foe_comes_later(foe, own, later):
    """Only a gap before the foe: one behind it closes when the foe comes later."""
    before = foe.foe_to_conflict / foe.pace.speed > own.time_for(foe.to_exit + 5.0) + FIRST_MARGIN
    moved = foe._replace(foe_to_conflict=foe.foe_to_conflict + later, foe_to_exit=foe.foe_to_exit + later)
    assert may_cross(moved, own, 5.0) or not before


@given(foes, paces, st.floats(0, 20))
def test_a_longer_foe_or_own_vehicle_never_opens_a_gap(foe, own, more):
    if not may_cross(foe, own, 5.0):
        assert not may_cross(foe._replace(length=foe.length + more), own, 5.0)
        assert not may_cross(foe, own, 5.0 + more)


@given(foes, paces, st.floats(0, TIME_TO_IMPATIENCE))
def test_vehicles_that_may_cross_are_never_in_conflict_together(foe, own, waited):
    """Both drive on: the foe at its speed, the own vehicle as `Pace` says, however long it has waited."""
    if may_cross(foe, own, 5.0, margin_after(waited)):
        mine = own.time_for(foe.to_conflict), own.time_for(foe.to_exit + 5.0)
        its = foe.foe_to_conflict / foe.pace.speed, (foe.foe_to_exit + foe.length) / foe.pace.speed
        assert mine[1] < its[0] or its[1] < mine[0]
