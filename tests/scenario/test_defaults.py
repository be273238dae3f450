"""Defaults that depend on the vehicle: what a platoon of cars, or of robots, is that names no more than it must."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import tomli_w

from platoontraffic import scenario, simulation
from platoontraffic.errors import InputError
from platoontraffic.observation.sight import warnings
from platoontraffic.scenario import Scenario

CARS = ("car", "van", "truck")
ROAD = '[sumo]\nnet = "corridor"\n[run]\nduration_s = 5.0\n'
PLATOON = '[[platoon]]\nsize = 2\nstart = {{ edge = "light_prio", position_m = 90.0 }}\nto = "b2_east"\n{}\n'


def loaded(tmp_path: Path, *platoons: str, changes: tuple[str, ...] = ()) -> Scenario:
    file = tmp_path / "mine.toml"
    file.write_text(ROAD + "".join(PLATOON.format(platoon) for platoon in platoons))
    return scenario.load(file, changes)


def lidar(checked: Scenario, role: str) -> str:
    return checked.resolved()["platoon"][0][role]["lidar"]["preset"]


@pytest.mark.parametrize("vehicle", CARS)
def test_cars_lead_by_path_and_follow_by_tracking(tmp_path, vehicle):
    checked = loaded(tmp_path, f'vehicle = "{vehicle}"')
    table = checked.resolved()["platoon"][0]
    assert checked.spec.run.step_s == 0.1
    assert (table["leader"]["law"], table["leader"]["lidar"]["preset"]) == ("path", "car-leader")
    follower = table["follower"]
    assert (follower["law"], follower["policy"], follower["on_loss"]) == ("tracking", "obey", "drive")
    assert follower["lidar"]["preset"] == "car-tracker"
    assert {role: table[role]["odometry"]["preset"] for role in ("leader", "follower")} == {
        "leader": "car",
        "follower": "car",
    }


def test_robots_must_name_their_laws_and_keep_the_papers_lasers(tmp_path):
    with pytest.raises(InputError, match=r"platoon\.0\.leader: missing: a paper-robot has no default leader"):
        loaded(tmp_path, "")
    with pytest.raises(InputError, match=r"must have a \[platoon\.follower\]"):
        loaded(tmp_path, 'leader = "path"')
    with pytest.raises(InputError, match=r"platoon\.0\.leader\.law: missing"):
        loaded(tmp_path, 'leader = { speed_mps = 0.1 }\nfollower = "repaired"')
    checked = loaded(tmp_path, 'leader = "path"\nfollower = "repaired"')
    assert (lidar(checked, "leader"), lidar(checked, "follower")) == ("paper-leader", "paper-follower")
    assert checked.spec.run.step_s == 0.025


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ('vehicle = "kar"', "vehicle.type: 'kar': not known; did you mean 'car'?"),
        ('vehicle = { type = "kar" }', "vehicle.type: 'kar': not known; did you mean 'car'?"),
        ('vehicle = "kar"\nleader = { odometry = "car" }', "vehicle.type: 'kar': not known; did you mean 'car'?"),
        ("vehicle = 3", "vehicle: 3: should be a table, or a name"),
        ('vehicles = ["kar", "car"]', "vehicles.0.type: 'kar': not known; did you mean 'car'?"),
        ("vehicles = []", "vehicles: []: List should have at least 1 item after validation, not 0"),
    ],
)
def test_a_vehicle_that_is_not_known_is_the_only_fault(tmp_path, keys, fault):
    with pytest.raises(InputError) as error:
        loaded(tmp_path, keys)
    assert [one.partition(": platoon.0.")[2] for one in error.value.faults] == [fault]


def test_a_law_that_is_named_has_its_own_gains_and_the_laser_of_its_vehicle(tmp_path):
    checked = loaded(tmp_path, 'vehicle = "car"\nleader = "path"\nfollower = "tracking"')
    follower = checked.resolved()["platoon"][0]["follower"]
    assert (follower["policy"], follower["on_loss"], follower["odometry"]["preset"]) == ("convoy", "stop", "none")
    assert (lidar(checked, "leader"), lidar(checked, "follower")) == ("car-leader", "car-tracker")
    checked = loaded(tmp_path, 'vehicle = "car"\nfollower = "repaired"')
    assert (lidar(checked, "leader"), lidar(checked, "follower")) == ("car-leader", "car-follower")


def test_what_is_given_is_kept(tmp_path):
    given = 'vehicle = "van"\n[platoon.leader]\nlidar = { preset = "utm30lx", rate_hz = 10.0 }\nspeed_mps = 9.0\n'
    given += '[platoon.follower]\npolicy = "convoy"\nodometry = "none"'
    table = loaded(tmp_path, given, changes=("run.step_s=0.05",)).resolved()
    leader, follower = (table["platoon"][0][role] for role in ("leader", "follower"))
    assert (leader["law"], leader["speed_mps"], leader["lidar"]["preset"]) == ("path", 9.0, "utm30lx")
    assert (follower["policy"], follower["on_loss"], follower["odometry"]["preset"]) == ("convoy", "drive", "none")
    assert table["run"]["step_s"] == 0.05
    changed = loaded(tmp_path, 'vehicle = "car"', changes=("platoon.follower.time_headway_s=1.5",))
    follower = changed.resolved()["platoon"][0]["follower"]
    assert (follower["law"], follower["policy"], follower["time_headway_s"]) == ("tracking", "obey", 1.5)


def test_one_car_has_no_follower(tmp_path):
    assert loaded(tmp_path, 'vehicle = "car"', changes=("platoon.size=1",)).spec.platoon[0].follower is None


def test_the_step_is_that_of_the_finest_laser_or_robot(tmp_path):
    robots = 'id = "r"\nleader = "path"\nfollower = "repaired"'
    assert loaded(tmp_path, 'vehicle = "car"', robots).spec.run.step_s == 0.025
    for laser in ('"paper-leader"', "{ rate_hz = 40.0 }"):
        assert loaded(tmp_path, f'vehicle = "car"\nleader = {{ lidar = {laser} }}').spec.run.step_s == 0.025
    assert loaded(tmp_path, 'vehicle = "car"\nleader = { lidar = { rate_hz = 5.0 } }').spec.run.step_s == 0.1


def test_walls_stand_where_a_robot_drives(tmp_path):
    def walls(*platoons: str, changes: tuple[str, ...] = ()) -> str:
        return loaded(tmp_path, *platoons, changes=changes).spec.scene.walls

    robots = 'id = "r"\nleader = "path"\nfollower = "repaired"'
    assert [walls(f'vehicle = "{car}"') for car in CARS] == ["none"] * 3
    assert walls('vehicle = "car"', 'id = "v"\nvehicle = "van"') == "none"
    assert walls(robots) == walls('vehicle = "car"', robots) == "outline"
    assert walls('vehicle = "car"', changes=("scene.walls=outline",)) == "outline"
    assert walls('vehicle = "car"', changes=("scene.lidar_engine=numpy",)) == "none"


def test_a_run_states_the_defaults_so_that_it_can_be_repeated(tmp_path):
    checked = loaded(tmp_path, 'vehicle = "car"')
    again = tmp_path / "config.toml"
    again.write_text(tomli_w.dumps(checked.resolved(tmp_path)))
    assert scenario.load(again).resolved(tmp_path) == checked.resolved(tmp_path)


@pytest.mark.parametrize(
    ("leader", "range_max", "warned"),
    [
        ("speed_mps = 25.0", 60.0, False),  # 25 m/s 0.51 s + (25 m/s)^2 / 2 / 8 m/s2 = 52 m
        ("speed_mps = 30.0", 60.0, True),  # 71 m
        ("speed_mps = 30.0", 80.0, False),
        ("", 60.0, False),  # by the limits of the corridor
        ('law = "sumo"', 10.0, False),
    ],
)
def test_a_leader_that_cannot_stop_within_its_sight_is_warned_of(tmp_path, leader, range_max, warned):
    table = f'vehicle = "car"\n[platoon.leader]\n{leader}\n[platoon.leader.lidar]\nrange_max_m = {range_max}\n'
    said = warnings(simulation.prepare(loaded(tmp_path, table)))
    assert len(said) == warned
    if warned:
        assert re.search(
            r"mine\.toml:\d+: platoon\.0\.leader: at [\d.]+ m/s it stops within \d+ m, and its laser reaches", said[0]
        )


def test_a_speed_above_the_top_speed_of_the_vehicle_is_warned_of(tmp_path):
    """130 was meant as km/h: the leader drove 55.6 m/s without a word."""
    table = 'vehicle = "car"\n[platoon.leader]\nspeed_mps = 130.0\n[platoon.leader.lidar]\nrange_max_m = 300.0\n'
    (said,) = warnings(simulation.prepare(loaded(tmp_path, table)))
    assert re.search(r"mine\.toml:\d+: platoon\.0\.leader\.speed_mps: 130: its vehicle drives 55.6 m/s at most", said)
    assert not warnings(simulation.prepare(loaded(tmp_path, table.replace("130.0", "50.0"))))


def test_a_leader_that_is_slow_since_it_sees_little_is_warned_of(tmp_path):
    """v (0.3 s + 0.2 s) + v^2 / 2 / 8 m/s2 = 10 m - half a length, 2.4 m."""
    table = 'vehicle = "car"\n[platoon.leader]\n[platoon.leader.lidar]\nrange_max_m = 10.0\n'
    (said,) = warnings(simulation.prepare(loaded(tmp_path, table)))
    assert "its laser reaches 10 m, so it drives up to 7.73 m/s" in said
    assert said.endswith("m/s in place of 13.9 m/s")


@pytest.mark.parametrize(
    ("law", "range_max", "warned"), [("tracking", 80.0, 1), ("tracking", 130.0, 0), ("sumo", 80.0, 0)]
)
def test_a_share_whose_fast_cars_see_too_little_for_their_speed_is_warned_of(tmp_path, law, range_max, warned):
    """On `highway` some drive 1.2 times 33.3 m/s: 40 m/s 0.5 s + (40 m/s)^2 / 2 / 8 m/s2 = 120 m."""
    file = tmp_path / "share.toml"
    lidar = f", lidar = {{ preset = 'car-tracker', range_max_m = {range_max} }}" if law != "sumo" else ""
    drives = ', policy = "obey", on_loss = "drive"' if law != "sumo" else ""
    file.write_text(f"""[sumo]
net = "highway"
[run]
duration_s = 1.0
[[equip]]
share = 0.5
follower = {{ law = "{law}"{lidar}{drives} }}
""")
    said = warnings(simulation.prepare(scenario.load(file)))
    assert len(said) == warned
    assert not warnings(simulation.prepare(scenario.load(file, ["equip.share=0"])))
    assert all(
        "equip.0: a fast driver's car: its laser reaches 80 m, so it drives up to 31.5 m/s in place of 40" in one
        for one in said
    )
