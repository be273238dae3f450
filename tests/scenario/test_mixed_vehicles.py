"""Platoons of several kinds of vehicles: `vehicles`, one for each member."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
import tomli_w

from platoontraffic import scenario, simulation
from platoontraffic.errors import InputError
from platoontraffic.vehicles.catalogue import VEHICLES

TEXT = """
[sumo]
net = "corridor"
[scene]
walls = "none"
[run]
duration_s = 5.0
[[platoon]]
id = "mixed"
gap_m = 3.0
start = {{ edge = "light_prio", position_m = 90.0 }}
to = "b2_east"
{}
"""
KINDS = "truck", "car", "van"


def loaded(tmp_path: Path, keys: str) -> scenario.Scenario:
    file = tmp_path / "mine.toml"
    file.write_text(TEXT.format(keys))
    return scenario.load(file)


@pytest.mark.sumo
def test_each_member_is_its_vehicle_with_a_laser_at_its_own_bumper(tmp_path):
    members = simulation.prepare(loaded(tmp_path, f"vehicles = {list(KINDS)}")).members
    assert [m.model for m in members] == [VEHICLES[kind] for kind in KINDS]
    for ahead, member in pairwise(members):
        assert ahead.position - member.position == pytest.approx(ahead.model.length + 3.0)
        assert member.lidar.mount.x == pytest.approx(member.model.length / 2 - 0.03)
    assert len({id(m.route) for m in members}) == 3  # each as its own vehicle can drive it


def test_the_size_is_the_number_of_vehicles_and_a_vehicle_may_be_a_table(tmp_path):
    checked = loaded(tmp_path, 'vehicles = ["car", { type = "truck", lag_s = 0.9 }]')
    platoon = checked.spec.platoon[0]
    assert (platoon.size, platoon.model(1).lag, platoon.model(1).length) == (2, 0.9, VEHICLES["truck"].length)
    again = tmp_path / "again.toml"
    again.write_text(tomli_w.dumps(checked.resolved(tmp_path)))
    assert scenario.load(again).spec.platoon[0].model(1) == platoon.model(1)


def test_equal_vehicles_are_placed_as_by_one_key(tmp_path):
    one, each = (
        loaded(tmp_path, keys).spec.platoon[0]
        for keys in ('size = 3\nvehicle = "van"', 'vehicles = ["van", "van", "van"]')
    )
    assert [each.behind_leader(k) for k in range(3)] == pytest.approx([one.behind_leader(k) for k in range(3)])
    assert (one.leader, one.follower) == (each.leader, each.follower)


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ('vehicles = ["car", "truck"]\nsize = 3', "has 2 `vehicles` for a size of 3"),
        ('vehicles = ["car"]\nvehicle = "car"', "has `vehicle` beside `vehicles`"),
        ('vehicles = ["car", "paper-robot"]', "must have vehicles of one class"),
        ('vehicles = ["car", "lorry"]', r"platoon\.0\.vehicles\.1\.type: 'lorry': not known"),
        ('vehicles = []\nleader = "path"', r"platoon\.0\.vehicles"),
    ],
)
def test_faults_are_one_line(tmp_path, keys, fault):
    with pytest.raises(InputError, match=fault) as error:
        loaded(tmp_path, keys)
    assert len(error.value.faults) == 1
