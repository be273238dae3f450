"""Post-encroachment times: closed forms, symmetries, and a slow second implementation on a junction."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from platoontraffic.observation import encroachments
from platoontraffic.observation.encroachments import Encroachments
from platoontraffic.observation.encroachments_kernel import STEPS, STILL, Trails, _newest, _overlap, _pose, extend
from platoontraffic.observation.step import Step
from platoontraffic.world.events import Event
from platoontraffic.world.traffic import TrafficSnapshot
from tests.observation.test_second_opinion import agree

DT = 0.1
LENGTH, WIDTH = 4.74, 1.8


class Fleet(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.number)


def line(x, y, heading, speed):
    """Pose over time of a body that drives straight on."""
    return lambda t: (x + speed * t * math.cos(heading), y + speed * t * math.sin(heading), heading)


def met(member, other, seconds=20.0, *, dt=DT, turn=0.0, both=False, appears=0.0, lengths=(LENGTH, LENGTH)):
    """(what, post-encroachment time) of each event, of a member and another body whose poses are functions of time.

    turn    : the whole scene is turned by that, and moved
    both    : the other is a member of another platoon
    appears : from then on the other is there
    """
    members = [SimpleNamespace(equip="", platoon=name) for name in "ab"][: 1 + both]
    observer, found = Encroachments(members), []
    for step in range(round(seconds / dt) + 1):
        t = step * dt
        there = 2 if t >= appears else 1
        x, y, heading = np.array([member(t), other(t)][:there]).T
        x, y = x * np.cos(turn) - y * np.sin(turn) + 500 * turn, x * np.sin(turn) + y * np.cos(turn)
        sizes = np.array(lengths)[:there], np.full(there, WIDTH)
        traffic = TrafficSnapshot(t, ("m", "o")[:there], x, y, heading + turn, 0 * x, *sizes)
        n = 1 + both

        fleet = Fleet(number=np.arange(n))
        seen = observer.observe(Step(traffic, fleet, [("", "")] * n, None, x, y, []))
        found += [(event.what, event.duration) for event in seen]
    return found


def crossing(first_speed, second_speed, late):
    """The member drives east over the origin, the other north; it is there at 6 s, the other `late` s later."""
    south = -(6.0 + late) * second_speed
    return line(-6.0 * first_speed, 0.0, 0.0, first_speed), line(0.0, south, math.pi / 2, second_speed)


@pytest.mark.parametrize("late", [1.0, 2.0, 4.0])
def test_who_crosses_behind_a_long_slow_vehicle_encroaches(late):
    """At 2.5 m/s a body of 12 m overlaps for 6 s with where it was: the other one was taken for a follower."""
    length, speed = 12.0, 2.5
    bus = line(WIDTH / 2 + length / 2 - 12.0 * speed, 0.0, 0.0, speed)  # its rear leaves the other's strip at 12 s
    other = line(0.0, -WIDTH / 2 - LENGTH / 2 - 10.0 * (12.0 + late), math.pi / 2, 10.0)
    (found,) = met(other, bus, 20.0, lengths=(LENGTH, length))
    assert found == ("second", pytest.approx(late, abs=1e-2))


@pytest.mark.parametrize(("v", "w", "late"), [(10.0, 8.0, 2.0), (5.0, 12.0, 3.1), (13.0, 13.0, 1.03)])
def test_two_that_cross_at_right_angles(v, w, late):
    """The rear of the first leaves the other's strip half of a length and of a width behind the origin, and the front
    of the second comes to its strip as far before it."""
    (what, time), = met(*crossing(v, w, late))  # fmt: skip
    assert what == "first"
    assert time == pytest.approx(late - (LENGTH + WIDTH) / 2 * (1 / v + 1 / w), abs=2e-3)


def test_who_is_first_is_said_and_does_not_matter():
    member, other = crossing(10.0, 8.0, 2.0)
    (_, time), = met(member, other)  # fmt: skip
    assert met(other, member) == [("second", pytest.approx(time))]


@pytest.mark.parametrize("turn", [0.3, 2.0, -1.2])
def test_a_turned_scene_has_the_same_times(turn):
    member, other = crossing(10.0, 8.0, 2.0)
    (_, time), = met(member, other)  # fmt: skip
    assert met(member, other, turn=turn) == [("first", pytest.approx(time, abs=2e-3))]


def test_the_step_does_not_matter():
    member, other = crossing(10.0, 8.0, 2.0)
    assert met(member, other, dt=0.025) == [("first", pytest.approx(met(member, other)[0][1], abs=2e-3))]


def test_two_members_of_two_platoons_have_one_event():
    member, other = crossing(10.0, 8.0, 2.0)
    assert met(member, other, both=True) == met(other, member, both=True) == met(member, other)


def test_a_long_time_apart_is_no_encroachment():
    member, other = crossing(10.0, 8.0, 6.5)
    assert met(member, other, seconds=30) == []


@pytest.mark.parametrize("headway", [0.8, 2.0, 4.5, 7.0])
def test_one_that_follows_does_not_encroach(headway):
    ahead, behind = line(10.0 * headway, 0.0, 0.0, 10.0), line(0.0, 0.0, 0.0, 10.0)
    assert met(behind, ahead) == met(ahead, behind) == []


def test_one_that_catches_up_does_not_encroach():
    ahead, behind = line(100.0, 0.0, 0.0, 5.0), line(0.0, 0.0, 0.0, 10.0)
    assert met(behind, ahead, 18.0) == met(ahead, behind, 18.0) == []


def test_a_body_that_appears_ahead_is_followed():
    """As one that SUMO inserts on the lane, or that comes within sight."""
    ahead, behind = line(30.0, 0.0, 0.0, 10.0), line(0.0, 0.0, 0.0, 10.0)
    assert met(behind, ahead, appears=5.0) == []


def round_a_circle(radius, speed, late=0.0):
    def pose(t):
        angle = speed * (t - late) / radius
        return radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2

    return pose


def test_one_that_follows_in_a_tight_bend_does_not_encroach():
    ahead, behind = round_a_circle(8.0, 4.0), round_a_circle(8.0, 4.0, 2.5)
    assert met(behind, ahead, 9.0) == met(ahead, behind, 9.0) == []  # less than a lap


def test_they_meet_head_on_in_two_lanes():
    assert met(line(-50.0, 0.0, 0.0, 10.0), line(50.0, 2.5, math.pi, 10.0)) == []


def merging(radius, speed, late):
    """The member drives east along y = 0; the other comes from the south on an arc to the left ... into that line."""
    bend = math.pi / 2 * radius

    def other(t):
        way = speed * (t - late) + bend - 60.0
        if way < 0:
            return 0.0, -radius + way, math.pi / 2
        if way < bend:
            angle = way / radius
            return radius * (1 - math.cos(angle)), -radius + radius * math.sin(angle), math.pi / 2 - angle
        return radius + way - bend, 0.0, 0.0

    return line(radius - 60.0, 0.0, 0.0, speed), other


def test_paths_that_merge():
    """At equal speeds, both come to the end of the arc at 6 s and `late` s after: the second enters the strip of the
    first before that, with its left front corner, and the least time over the first 1.8 m is near the time gap."""
    late = 2.5
    (what, time), = met(*merging(12.0, 10.0, late))  # fmt: skip
    assert what == "first"
    headway = late - LENGTH / 10.0
    assert headway - 0.35 < time < headway + 0.2
    member, other = merging(12.0, 10.0, -late)  # the other comes first
    assert [what for what, _ in met(member, other)] == ["second"]


def test_bodies_that_touch_do_not_encroach():
    assert met(*crossing(10.0, 8.0, 0.1)) == []


def somewhere(rng):
    """A straight line or an arc of random curvature through a square of 60 m, driven at constant speed."""
    x, y = rng.uniform(-30, 30, 2)
    heading, speed, bend = rng.choice([0.0, 0.5, 1.0, 1.5]) * np.pi, rng.uniform(2, 12), rng.choice([0.0, 0.0, 0.06])
    when = rng.uniform(3, 12)  # at which it is at (x, y)

    def pose(t):
        way = speed * (t - when)
        turned = bend * way
        chord = way * np.sinc(turned / 2 / np.pi)
        along = heading + turned / 2
        return x + chord * np.cos(along), y + chord * np.sin(along), heading + turned

    return pose


def random_tables(rng):
    """Members, poses and events of twelve bodies in a small square, four of them in two platoons."""
    poses, since = [somewhere(rng) for _ in range(12)], [0, 0, 0, 0, *rng.integers(0, 60, 8)]
    ids = np.array([f"{p}.{i}" for p in "ab" for i in range(2)] + [f"car{i}" for i in range(8)])
    platoons = ["a", "a", "b", "b"]
    observer, rows, events = Encroachments([SimpleNamespace(equip="", platoon=p) for p in platoons]), [], []
    for step in range(150):
        here = [i for i in range(12) if step >= since[i]]
        x, y, heading = np.ascontiguousarray(np.array([poses[i](step * DT) for i in here]).T)  # or numba compiles anew
        sizes = np.full(len(here), LENGTH), np.full(len(here), WIDTH)
        traffic = TrafficSnapshot(step * DT, tuple(ids[here]), x, y, heading, 0 * x, *sizes)
        events += observer.observe(Step(traffic, Fleet(number=np.arange(4)), [("", "")] * 4, None, x, y, []))
        rows += zip([step * DT] * len(here), ids[here], x, y, heading, *sizes, strict=True)
    columns = ["time_s", "vehicle_id", "x_m", "y_m", "heading_rad", "length_m", "width_m"]
    members = pd.DataFrame({"vehicle_id": ids[:4], "platoon_id": platoons})
    named = pd.DataFrame(events, columns=Event._fields).rename(
        columns={"vehicle": "vehicle_id", "other": "other_id", "duration": "duration_s"}
    )
    return members, pd.DataFrame(rows, columns=columns), named


def test_a_slow_second_implementation_agrees_on_random_scenes():
    rng = np.random.default_rng(1)
    assert sum(agree(*random_tables(rng)) for _ in range(5)) > 10


def test_a_member_may_meet_more_bodies_than_there_was_room_for(monkeypatch):
    *_, events = random_tables(np.random.default_rng(1))
    monkeypatch.setattr(encroachments, "MEETS", 1)
    pd.testing.assert_frame_equal(random_tables(np.random.default_rng(1))[2], events)


def driven(rng, steps):
    """x, y and heading of a body that drives straight on, bends, is shaken, stands, turns round and drives back."""
    x, y, heading, poses = 0.0, 0.0, rng.uniform(-3, 3), []
    while len(poses) < steps:
        way, bend, error = rng.choice([0.0, 0.3, 1.4, -0.7]), rng.choice([0.0, 0.0, 0.004, 0.2]), rng.choice([0.0, 0.1])
        heading += math.pi * (rng.random() < 0.05)
        for _ in range(rng.integers(1, 40)):
            heading += bend * way
            x, y = x + way * math.cos(heading), y + way * math.sin(heading)
            poses.append((x + error * rng.normal(), y + error * rng.normal(), heading + 0.3 * error * rng.normal()))
    return poses[:steps]


@pytest.mark.parametrize("seed", range(20))
def test_the_newest_pose_that_a_body_is_over_is_found_as_by_looking_at_all(seed):
    rng, rows, one = np.random.default_rng(seed), 31, np.zeros(1, np.intp)
    trails = Trails(np.zeros((1, rows, STILL + 1)), np.zeros((1, STEPS + 1)), np.zeros(1, np.intp), *np.zeros((3, 1)))
    trails.half_length[:], trails.half_width[:] = LENGTH / 2, WIDTH / 2
    found = 0
    for step, (x, y, heading) in enumerate(driven(rng, 200), 1):
        head = step % rows
        extend(trails, head, one, *(np.array([value]) for value in (x, y, math.cos(heading), math.sin(heading))))
        ages = range(min(step, rows))
        for _ in range(20):
            (there_x, there_y), course = rng.normal((x, y), 12.0), rng.uniform(-3, 3)
            body = there_x, there_y, math.cos(course), math.sin(course), LENGTH / 2, WIDTH / 2
            over = (age for age in ages if _overlap(body, _pose(trails, (head - age) % rows, 0)))
            newest = next(over, -1)
            assert _newest(trails, head, body, 0) == newest
            found += newest >= 0
    assert found > 200
