"""Standstills have the true reason: what the law brakes for, and the body that its beam met; without SUMO's traffic."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount, Scene
from platoontraffic.observation.observer import Observer
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import Event
from platoontraffic.world.fleet import Member
from tests.controllers.test_path_leader import line
from tests.support.bench import NO_WALLS, StopLine, constant, drive, platoon

CAR = CARS["car"]
EYE = replace(PRESETS["car-leader"], mount=Mount(CAR.length / 2))
STRAIGHT = line((0, 0), (400, 0))
ROAD = SimpleNamespace(drivable=shapely.box(-100, -50, 1000, 50), right_of_middle=lambda x, y, heading: np.nan * x)


def standing(name: str, x: float, y: float, heading: float) -> Member:
    (member,) = platoon(constant(0.0), at=(x, y, heading), model=CAR)
    return replace(member, id=name, platoon=name)


def driving(followers: int = 0) -> list[Member]:
    follower = TrackingFollower(on_loss="drive", policy="obey")
    members = platoon(
        PathLeader(speed=10.0), follower, followers, model=CAR, leader_eye=EYE, eye=EYE, distance=9.0, speed=10.0
    )
    return [replace(member, route=STRAIGHT) for member in members]


def events(members: list[Member], seconds: float = 60.0, scene: Scene = NO_WALLS, **setting) -> list[Event]:
    noted: list[Event] = []

    def observer() -> Observer:
        return Observer(members, ROAD, Contacts(scene, {m.id for m in members}))

    drive(members, scene, seconds, 0.1, lambda now: noted.extend(now.events), observer=observer, **setting)
    return noted


def standstills(noted: list[Event]) -> list[tuple[str, str, str]]:
    return [(e.vehicle, e.what, e.detail.partition(", ")[2]) for e in noted if e.kind == "standstill"]


@pytest.mark.parametrize(
    ("y", "heading", "reason"),
    [
        (0.0, 0.0, ("behind", "behind other")),
        (0.0, np.pi / 2, ("blocked", "blocked by other")),
        (2.4, np.radians(150), ("blocked", "blocked by other")),  # only its nose is in the strip
    ],
)
def test_a_leader_names_the_body_in_its_strip_at_whatever_angle(y, heading, reason):
    noted = events([*driving(), standing("other", 60.0, y, heading)])
    assert ("robot.0", *reason) in standstills(noted)


def test_a_leader_before_a_wall_is_blocked_by_a_wall():
    noted = events(driving(), scene=Scene.from_shapely(solids=[shapely.box(60, -1, 62, 1)]))
    assert standstills(noted) == [("robot.0", "blocked", "blocked by a wall")]


def test_followers_stand_behind_their_predecessors_and_the_first_is_blocked():
    noted = events([*driving(2), standing("other", 90.0, 0.0, np.pi / 2)])
    assert sorted(reason for reason in standstills(noted) if reason[0] != "other") == [
        ("robot.0", "blocked", "blocked by other"),
        ("robot.1", "behind", "behind robot.0"),
        ("robot.2", "behind", "behind robot.1"),
    ]


def test_a_closed_line_is_a_reason_before_the_body_behind_it():
    noted = events(
        [*driving(), standing("other", 75.0, 0.0, np.pi / 2)], ground=lambda: StopLine(0.1, 70.0, lambda time: False)
    )
    assert ("robot.0", "held", "held by light") in standstills(noted)


def test_a_body_is_a_reason_before_the_closed_line_behind_it():
    noted = events(
        [*driving(), standing("other", 60.0, 0.0, np.pi / 2)], ground=lambda: StopLine(0.1, 64.0, lambda time: False)
    )
    assert ("robot.0", "blocked", "blocked by other") in standstills(noted)


def test_a_vehicle_that_drives_past_is_no_reason_of_who_stands_at_a_closed_line():
    """An oblique body before the line, met by a beam just when the standstill was noted, was named for 66 s at red."""

    def ground() -> StopLine:
        return StopLine(0.1, 70.0, lambda time: False)

    (alone,) = (e for e in events(driving(), ground=ground) if e.kind == "standstill")
    speed = 2.0
    (crosses,) = platoon(constant(speed), at=(70.6, -speed * alone.time, np.pi / 2), model=CAR)
    noted = events([*driving(), replace(crosses, id="other", platoon="other")], ground=ground)
    assert ("robot.0", "held", "held by light") in standstills(noted)


def test_who_creeps_past_a_nose_says_so_once():
    noted = events([*driving(), standing("other", 60.0, 2.95, np.radians(150))])
    creeps = [(e.vehicle, e.other, e.detail) for e in noted if e.kind == "creeps"]
    assert creeps == [("robot.0", "other", "past other")]
    assert not [e for e in noted if e.kind == "collision"]


def test_one_that_is_released_just_before_a_standstill_is_long_enough_was_held():
    def noted(opens: float) -> list[Event]:
        return events(driving(), ground=lambda: StopLine(0.1, 70.0, lambda time: time >= opens))

    (held,) = (e for e in noted(np.inf) if e.kind == "standstill")
    since = float(held.detail.partition(" s")[0].removeprefix("since "))
    (reason,) = standstills(noted(since + 9.95))
    assert reason == ("robot.0", "held", f"held by light until {since + 9.9:.1f} s")
