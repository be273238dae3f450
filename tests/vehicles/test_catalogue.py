"""Robots and cars in one fleet, and a platoon of cars on a ring."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely

from platoontraffic import shipped
from platoontraffic.controllers.printed import SPEED_GAIN
from platoontraffic.road.network import Network
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.catalogue import FleetModel
from platoontraffic.vehicles.motion import Motion, Twist
from platoontraffic.vehicles.records import take
from platoontraffic.world.fleet import Member
from tests.support.bench import NO_WALLS, ROBOT, Prescribed, drive, platoon
from tests.support.runs import run

MODELS = (ROBOT, CARS["car"], replace(ROBOT, lag=0.3, width=0.2), CARS["truck"])


def members(order: list[int]) -> list[Member]:
    """Platoons of one; each drives its own curve."""
    alone = []
    for i in order:
        wave = Prescribed(lambda time, i=i: Twist(2 + 2 * np.sin(time + i), 0.3 * np.cos(2 * time - i)))
        (member,) = platoon(wave, at=(20.0 * i, -3.0 * i, 0.5 + i), model=MODELS[i])
        alone.append(replace(member, id=f"m{i}.0", platoon=f"m{i}"))
    return alone


def state(motion: Motion) -> np.ndarray:
    return np.array([getattr(motion, f.name) for f in fields(Motion)])


def driven(order: list[int], seconds: float = 6.0) -> np.ndarray:
    """Every field of the motion at every step, (steps, fields, n)."""
    states = []
    drive(members(order), NO_WALLS, seconds, observe=lambda now: states.append(state(now.fleet.motion)))
    return np.array(states)


def test_robots_and_cars_in_one_fleet_move_as_each_alone():
    together = driven([0, 1, 2, 3])
    assert (np.ptp(together[:, 0], axis=0) > 1).all()
    for i in range(4):
        np.testing.assert_array_equal(together[..., [i]], driven([i]))


def test_the_order_of_robots_and_cars_changes_nothing():
    np.testing.assert_array_equal(driven([0, 1, 2, 3])[..., ::-1], driven([3, 2, 1, 0]))


def test_only_cars_steer_and_brake():
    steering, braking = np.abs(driven([0, 1, 2, 3])[:, -2:]).max(axis=0)
    assert (steering > 0).tolist() == (braking > 0).tolist() == [False, True, False, True]


def test_axles_of_a_fleet_are_those_of_its_members():
    model = FleetModel.of(MODELS)
    motion = Motion.at_rest([0, 1, 2, 3], [5, 6, 7, 8], [0.1, 0.2, 0.3, -3.0])
    for i, alone in enumerate(MODELS):
        axle = alone.axle_position(take(motion, np.array([i])))
        np.testing.assert_array_equal(np.array(model.axle_position(motion))[:, [i]], axle)
        assert (model.length[i], model.width[i]) == (alone.length, alone.width)


def test_members_that_share_a_model_are_as_those_with_one_of_their_own():
    order = [1, 0, 3, 1, 2, 0, 1]
    shared, own = (FleetModel.of([one(MODELS[i]) for i in order]) for one in (lambda model: model, replace))
    for field in fields(FleetModel)[:-1]:
        np.testing.assert_array_equal(getattr(shared, field.name), getattr(own, field.name))
    assert [kind.rows.tolist() for kind in shared.kinds] == [[0, 2, 3, 6], [1, 4, 5]]
    for kind, other in zip(shared.kinds, own.kinds, strict=True):
        assert kind.rows.tolist() == other.rows.tolist()
        for field in fields(kind.model):
            np.testing.assert_array_equal(getattr(kind.model, field.name), getattr(other.model, field.name))


RING = """
[sumo]
net = "ring"
traffic = false
[scene]
walls = "none"  # a kerb is lower than the beams
[run]
duration_s = 45.0
[[platoon]]
size = 2
vehicle = "car"
start = { edge = "south_east", position_m = 40.0 }
gap_m = 4.0
route = ["south_east", "east_north", "north_west", "west_south"]
loop = true
[platoon.leader]
law = "path"
speed_mps = 10.0
lidar = "car-leader"
[platoon.follower]
law = "repaired"
stand_off_m = 4.0
group_step_m = 1.0
lidar = "car-follower"
"""


@pytest.mark.sumo
def test_a_car_follows_another_round_a_ring(tmp_path: Path):
    file = tmp_path / "ring.toml"
    file.write_text(RING)
    folder = run(tmp_path / "ring", file)
    rows, events = (pd.read_csv(folder / f"{name}.csv") for name in ("trajectories", "events"))
    # No contact, and no lock loss.
    assert events.kind.tolist() == ["departed", "departed", "locked", "end"]

    leader, follower = (rows[rows.place == place] for place in (0, 1))
    assert leader[leader.time_s > 20].speed_mps.to_numpy() == pytest.approx(10.0, abs=0.01)
    lane = shapely.LineString(Network.read(shipped.networks()["ring"]).route_line(
        ["south_east", "east_north", "north_west", "west_south"], 0, closed=True))  # fmt: skip
    assert shapely.distance(lane, shapely.points(leader.x_m, leader.y_m)).max() < 0.3

    steady = follower[follower.time_s > 25]
    car = CARS["car"]
    to_bumper = 0.03  # the laser is 0.03 m behind the front bumper
    assert steady.gap_m.mean() + to_bumper == pytest.approx(4.0 + 10.0 / SPEED_GAIN, rel=0.02)
    assert steady.speed_mps.mean() == pytest.approx(10.0, rel=0.01)
    assert follower.cross_track_m.abs().max() < car.width / 2
