"""Several lasers on a member, and sensors of a scenario's own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario
from platoontraffic.analysis import load
from platoontraffic.controllers import Decision, Law
from platoontraffic.errors import InputError
from platoontraffic.lidar import LidarModel, Mount, Noise, scan
from platoontraffic.recording import run
from platoontraffic.simulation import Setting, Simulation, prepare
from platoontraffic.vehicles.motion import Twist
from platoontraffic.vehicles.sensor import NamedSensor, Sensor
from platoontraffic.world import sensing
from tests.support import ROOT
from tests.support.bench import NO_WALLS, platoon

DT = 0.1
EXAMPLE = ROOT / "docs/examples/radar.toml"
NOISY = Noise(sigma=0.05)
FRONT = LidarModel(61, -0.5, 0.5, 0.01, 20.0, rate=10.0, mount=Mount(0.05), noise=NOISY)
REAR = replace(FRONT, mount=Mount(-0.1, yaw=np.pi), rate=5.0, name="rear")


class Clock(NamedTuple):
    step: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True)
class Counter(Sensor):
    rate: float = 10.0

    def __call__(self, surroundings, rows):
        return Clock(np.full(len(rows), float(surroundings.step)), surroundings.normal(rows)[:, 0])


@dataclass(frozen=True)
class Keeping(Law):
    """Drives straight on; its memory is what it was given."""

    needs = frozenset({"clock"})

    def __call__(self, sensed, memory, dt):
        n = len(sensed.speed)
        given = [(sensed.scan is not None, sorted(sensed.scans), sensed.readings.get("clock"), dt)] * n
        return Decision(Twist(np.full(n, 0.2), np.zeros(n)), given)


class KeepingAlso(Keeping):
    """Another law."""


def members(lidar=FRONT, further=(REAR,), sensor=Counter()):
    sensors = (NamedSensor("clock", sensor),)
    one = platoon(Keeping(), Keeping(), 2, leader_eye=lidar, eye=lidar, distance=1.0)
    return [replace(m, further_lidars=further, sensors=sensors) for m in one]


def instants(some, steps=4, seed=0):
    with Simulation(Setting(some, NO_WALLS, DT, steps, seed)) as simulation:
        return list(simulation)


def test_each_laser_scans_at_its_own_rate_and_looks_its_own_way():
    seen = instants(members())
    assert [sorted(one.readings[0].scans) for one in seen] == [["rear"], [], ["rear"], [], ["rear"]]
    first = seen[0]
    assert np.isfinite(first.scans[0].ranges).any(axis=1).tolist() == [False, True, True]  # ahead of it
    assert np.isfinite(first.readings[0].scans["rear"].ranges).any(axis=1).tolist() == [True, True, False]  # behind it
    assert first.readings[0].scans["rear"].name == "rear"


def test_members_with_one_laser_are_scanned_at_once_whatever_their_laws(monkeypatch):
    scanned = []
    monkeypatch.setattr(sensing, "scan", lambda *given, **more: scanned.append(given[3].ids) or scan(*given, **more))
    alike = members(further=(), sensor=Counter())
    first, second, third = alike
    mixed = instants([replace(first, law=KeepingAlso()), second, replace(third, law=KeepingAlso())], steps=0)[0]
    assert scanned == [("robot.0", "robot.2", "robot.1")]
    (one, other), (whole,) = mixed.scans, instants(alike, steps=0)[0].scans
    assert one.ids == ("robot.0", "robot.2")
    np.testing.assert_array_equal(one.ranges, whole.ranges[[0, 2]])
    np.testing.assert_array_equal(other.hits, whole.hits[[1]])


def test_lasers_of_one_member_err_independently():
    same_place = replace(FRONT, name="second")
    first = instants(members(further=(same_place,)))[0]
    one, other = first.scans[0].ranges, first.readings[0].scans["second"].ranges
    hit = np.isfinite(one) & np.isfinite(other)
    assert hit.sum() > 5
    assert (one[hit] != other[hit]).all()


def test_a_law_gets_all_lasers_without_the_surfaces_that_their_beams_met():
    seen = instants(members())
    (_, names, _, _) = seen[0].fleet.groups[0].memory[0]
    assert names == ["rear"]


def test_a_law_decides_when_its_fastest_sensor_is_due():
    slow = replace(FRONT, rate=5.0)
    given = [one.fleet.groups[0].memory[0] for one in instants(members(slow, ()))]
    assert [has_scan for has_scan, *_ in given] == [True, False, True, False, True]
    assert [reading.step[0] for _, _, reading, _ in given] == [0, 1, 2, 3, 4]
    assert {dt for *_, dt in given} == {DT}


def test_errors_of_a_sensor_depend_on_seed_vehicle_and_step_only():
    def noise(some, seed=0):
        return [one.readings[0].sensors["clock"].noise for one in instants(some, seed=seed)]

    some = members()
    assert not np.array_equal(noise(some), noise(some, seed=1))
    np.testing.assert_array_equal(noise(some), np.array(noise(some[::-1]))[:, ::-1])
    assert len(np.unique(noise(some))) == 5 * 3


@dataclass(frozen=True)
class Failing(Sensor):
    gives: object = None

    def __call__(self, surroundings, rows):
        return 1 / 0 if self.gives is None else self.gives


@pytest.mark.parametrize(("gives", "what"), [(None, "ZeroDivisionError"), (3.0, "one row for each vehicle")])
def test_a_failing_sensor_is_reported_with_its_file_and_line(gives, what):
    with pytest.raises(InputError, match=rf"test_sensing.py:\d+: sensor Failing failed at 0.000 s: .*{what}"):
        instants(members(sensor=Failing(gives)))


# ---- in a scenario


@pytest.mark.sumo
def test_the_example_follows_by_radar_and_records_both_lasers(tmp_path):
    checked = scenario.load(EXAMPLE, ["run.duration_s=4", "record.scans_every_s=1.0"])
    folder = run(prepare(checked), tmp_path / "run")
    scans = load(folder).scans
    assert set(zip(scans.vehicle_id, scans.laser, strict=True)) == {
        ("platoon.0", "lidar"), ("platoon.1", "lidar"), ("platoon.1", "rear"),
        ("platoon.2", "lidar"), ("platoon.2", "rear"),
    }  # fmt: skip
    last = pd.read_csv(folder / "trajectories.csv").query("time_s == 4.0 and place > 0")
    assert last.gap_m.between(8, 30).all()
    assert (last.target_id == ["platoon.0", "platoon.1"]).all()
    assert not load(folder).events.kind.isin(["split", "lock_lost"]).any()
    again = run(prepare(scenario.load(folder / "config.toml")), tmp_path / "again")
    for name in ("trajectories.csv", "events.csv", "metrics.csv", "scans.npz"):
        assert (again / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("platoon.follower.sensors.radar.sensor=radar.py:Rodar", "no sensor 'Rodar'"),
        ("platoon.follower.sensors.radar.rate_hz=7.0", "its interval must be a multiple of run.step_s"),
        ("platoon.follower.sensors.radar.rnge_m=7.0", "sensors.radar.rnge_m: unknown key"),
        ("platoon.follower.sensors.sonar.sensor=radar.py:Radar", "does not declare 'sonar' in its needs"),
        ("platoon.follower.sensors.radar.sensor=radar.py:Echo", "the class Echo has no __call__"),
        ("platoon.follower.lidars.rear.rate_hz=40.0", "must be a multiple of that of lidar"),
        ("platoon.follower.lidars.lidar.preset=car-leader", "must be another"),
        ("platoon.follower.lidars.rear.preset=car-leder", "did you mean"),
    ],
)
def test_what_is_wrong_with_lasers_and_sensors_is_a_fault(change, what):
    with pytest.raises(InputError) as error:
        scenario.load(EXAMPLE, [change])
    assert what in str(error.value)
    assert len(error.value.faults) == 1


def test_a_law_without_its_sensor_is_a_fault(tmp_path):
    text = EXAMPLE.read_text().partition("[platoon.follower.sensors")[0]
    (tmp_path / "mine.toml").write_text(text)
    Path(tmp_path / "radar.py").write_text((EXAMPLE.parent / "radar.py").read_text())
    with pytest.raises(
        InputError, match="RadarCruise needs radar; there is: leader, leads, members, messages, route, signals, truth"
    ):
        scenario.load(tmp_path / "mine.toml")
