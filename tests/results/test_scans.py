"""Recorded scans are what the lasers measured, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic import scenario
from platoontraffic.analysis import load
from platoontraffic.cli.main import app
from platoontraffic.controllers import Decision, Law
from platoontraffic.errors import InputError
from platoontraffic.lidar import Mount, ScanBatch
from platoontraffic.observation.instant import Instant
from platoontraffic.results.recorder import Clocks, Recorder
from platoontraffic.results.scans import ScanRecorder
from platoontraffic.vehicles.motion import Twist
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.sensing import Sensing
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen
from tests.support.bench import LOOP, constant, platoon, snapshot
from tests.support.runs import run

DT = 0.025


def fleet(order=lambda members: members) -> Fleet:
    members = platoon(constant(0.1), constant(0.1), 2, at=(3.0, 1.0, 0.0))
    slow = replace(members[2].lidar, rate=1 / (3 * DT), samples=91, mount=Mount(0.05, 0.01, 0.2))
    return Fleet.deployed(order([*members[:2], replace(members[2], lidar=slow)]), DT)


def instant(step: int, traffic: TrafficSnapshot, fleet: Fleet, scans: list[ScanBatch | None]) -> Instant:
    """At which these scans were taken and used."""
    return Instant(step, traffic, fleet, scans, seen=[Seen(traffic, group.rows) for group in fleet.groups])


def record(folder: Path, fleet: Fleet, steps: int = 12, every: int = 5) -> list:
    """Records the scans of some steps; returns all that were made, as (step, batch)."""
    folder.mkdir()
    recorder, sensing, made = ScanRecorder(folder), Sensing(LOOP), []
    for step in range(steps):
        traffic = snapshot(fleet, step * DT)
        scans = sensing.scan(traffic, fleet, step)
        made += [(step, batch) for batch in scans if batch is not None]
        recorder.record(instant(step, traffic, fleet, scans), every)
    recorder.close()
    assert [file.name for file in folder.iterdir()] == ["scans.npz"]
    return made


def read(folder: Path) -> dict[str, np.ndarray]:
    with np.load(folder / "scans.npz", allow_pickle=False) as archive:
        return dict(archive)


def test_each_laser_records_its_first_scan_at_or_after_each_tick(tmp_path):
    record(tmp_path / "run", fleet())
    scans = read(tmp_path / "run")
    steps = {
        str(name): np.rint(scans["time_s"][scans["vehicle"] == v] / DT).tolist()
        for v, name in enumerate(scans["vehicle_id"])
    }
    assert steps == {"robot.0": [0, 5, 10], "robot.1": [0, 5, 10], "robot.2": [0, 6]}  # scans in every third step


def test_recorded_ranges_are_bit_for_bit_those_of_the_laser(tmp_path):
    made = {(step, name): batch[name].ranges for step, batch in record(tmp_path / "run", fleet()) for name in batch.ids}
    scans = read(tmp_path / "run")
    assert len(scans["time_s"]) == 8
    for i, (time, v) in enumerate(zip(scans["time_s"], scans["vehicle"], strict=True)):
        ranges = scans["ranges_m"][scans["offset"][i] : scans["offset"][i + 1]]
        given = made[round(time / DT), scans["vehicle_id"][v]]
        assert ranges.tobytes() == given.astype("<f4").tobytes()
        assert len(ranges) == scans["samples"][v]
    assert np.isinf(scans["ranges_m"]).any()
    assert scans["offset"][-1] == len(scans["ranges_m"])


def test_a_recorded_scan_and_its_pose_reconstruct_the_walls(tmp_path):
    record(tmp_path / "run", fleet())
    scans = read(tmp_path / "run")
    i, v = 2, 2
    assert scans["vehicle"][i] == v
    ranges = scans["ranges_m"][scans["offset"][i] : scans["offset"][i + 1]]
    angles = np.linspace(scans["angle_min_rad"][v], scans["angle_max_rad"][v], scans["samples"][v])
    cos, sin = np.cos(scans["heading_rad"][i]), np.sin(scans["heading_rad"][i])
    mount = scans["mount_x_m"][v], scans["mount_y_m"][v], scans["mount_yaw_rad"][v]
    x = scans["x_m"][i] + mount[0] * cos - mount[1] * sin
    y = scans["y_m"][i] + mount[0] * sin + mount[1] * cos
    met = np.isfinite(ranges)
    angles = scans["heading_rad"][i] + mount[2] + angles[met]
    points = np.column_stack([x + ranges[met] * np.cos(angles), y + ranges[met] * np.sin(angles)])
    predecessor = fleet().members[1]
    rear = predecessor.pose[0] - predecessor.model.length / 2
    on_rear = np.abs(points[:, 0] - rear) < 1e-5
    on_walls = np.abs(np.abs(points - [3.0, 2.5]) - [3.0, 2.5]).min(axis=1) < 1e-5
    on_obstacle = np.abs(points[:, 1] - 2.0) < 1e-5
    assert met.any()
    assert (on_rear | on_walls | on_obstacle).all()


def test_the_order_of_members_does_not_matter_and_the_bytes_are_the_same(tmp_path):
    record(tmp_path / "one", fleet())
    record(tmp_path / "other", fleet(lambda members: members[::-1]))
    assert (tmp_path / "one" / "scans.npz").read_bytes() == (tmp_path / "other" / "scans.npz").read_bytes()


def test_an_interrupted_run_keeps_its_scans(tmp_path):
    recorder = Recorder(tmp_path / "run", Clocks(trajectories=2, scans=1))
    some = fleet()
    traffic = snapshot(some, 0.0)
    recorder.record(instant(1, traffic, some, Sensing(LOOP).scan(traffic, some, 0)))
    kept = recorder.keep_unfinished()
    assert len(read(kept)["time_s"]) == 3
    assert not (kept / "scans.raw").exists()


@pytest.mark.parametrize("key", ["traffic_every_s", "scans_every_s"])
def test_for_replay_keeps_the_intervals_that_a_scenario_gives(key):
    given = scenario.load("ring_platoon", [f"record.{key}=3.0"])
    record = given.for_replay().spec.record
    assert getattr(record, key) == 3.0
    assert (record.traffic_every_s, record.scans_every_s).count(3.0) == 1
    assert given.spec.record.scans_every_s in (None, 3.0)  # that of the scenario itself is as it was


@pytest.mark.parametrize(("name", "most"), [("paper_loop", 1.0), ("ring_platoon", 0.3), ("grid_platoons", 5.0)])
def test_many_lasers_are_recorded_less_often(name, most):
    checked = scenario.load(name).for_replay()
    every, run = checked.spec.record.scans_every_s, checked.spec.run
    beams = 720 * sum(platoon.size for platoon in checked.spec.platoon)
    assert abs(every / run.step_s - round(every / run.step_s)) < 1e-9
    assert 0.25 <= every <= most
    assert run.duration_s / every * beams <= 1e7


def test_scans_are_recorded_in_whole_steps():
    with pytest.raises(InputError, match=r"record.scans_every_s: 0.15: must be a multiple"):
        scenario.load("ring_platoon", ["record.scans_every_s=0.15"])


@pytest.mark.sumo
def test_run_with_replay_leaves_scans_and_a_page_and_drives_the_same(tmp_path):
    def run(out: str, *options: str) -> Path:
        arguments = ["run", "paper_loop", "run.duration_s=3", "platoon.size=3", "--out", str(tmp_path / out), *options]
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, done.stderr
        return Path(done.stdout.splitlines()[-1])

    plain, one, other = run("plain", "-q"), run("one", "--replay"), run("other", "--replay", "-q")
    assert not (plain / "scans.npz").exists()
    assert one.name == other.name != plain.name
    for name in ("scans.npz", "vehicles.csv", "traffic.csv", "trajectories.csv", "replay.html"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    assert (one / "trajectories.csv").read_bytes() == (plain / "trajectories.csv").read_bytes()

    results = load(one)
    assert len(results.scans) == 3 * (1 + round(3 / 0.25))
    rows = results.trajectories.set_index(["time_s", "vehicle_id"])
    for i in range(0, len(results.scans), 2):  # every second is at a recorded instant, 0.1 s apart
        time = round(float(results.scans.time_s[i]), 3)
        vehicle = results.scans.vehicle_id[results.scans.vehicle[i]]
        if (time, vehicle) in rows.index:
            row = rows.loc[(time, vehicle)]
            np.testing.assert_allclose([results.scans.x_m[i], results.scans.y_m[i]], [row.x_m, row.y_m], atol=1e-6)
    assert results.vehicles.length_m.tolist() == [0.2] * 3
    package = pd.read_json(one / "datapackage.json", typ="series")
    assert {"scans", "traffic", "vehicles"} <= {resource["name"] for resource in package["resources"]}


@dataclass(frozen=True)
class Remembering(Law):
    """Drives straight on and remembers two points ahead of its axle; robot.1 has no second one."""

    def __call__(self, sensed, memory, dt):
        n = len(sensed.speed)
        ahead = np.tile([[1.0, 0.0], [2.0, 0.5]], (n, 1, 1))
        ahead[0, 1] = np.nan
        return Decision(Twist(np.full(n, 0.1), np.zeros(n)), ahead)

    def remembered_path(self, memory):
        return memory


def test_remembered_paths_are_recorded_in_world_coordinates(tmp_path):
    members = platoon(constant(0.1), Remembering(), 2, at=(3.0, 1.0, np.pi / 2))
    fleet, sensing = Fleet.deployed(members, DT), Sensing(LOOP)
    tmp_path.joinpath("run").mkdir()
    recorder = ScanRecorder(tmp_path / "run")
    traffic = snapshot(fleet, 0.0)
    scans = sensing.scan(traffic, fleet, 0)
    recorder.record(instant(0, traffic, fleet.decided(scans, DT, None, None), scans), 1)
    recorder.close()
    read_back = read(tmp_path / "run")
    counts = dict(zip(read_back["vehicle_id"], np.diff(read_back["path_offset"]), strict=True))
    assert counts == {"robot.0": 0, "robot.1": 1, "robot.2": 2}
    row = [m.id for m in members].index("robot.2")
    x, y, axle = fleet.motion.x[row], fleet.motion.y[row], members[row].model.axle
    ahead = np.array([(x, y + axle + 1.0), (x - 0.5, y + axle + 2.0)])
    assert read_back["path_m"][1:] == pytest.approx(ahead, abs=1e-3)


def test_without_a_law_that_remembers_a_path_there_is_none(tmp_path):
    record(tmp_path / "run", fleet())
    assert "path_m" not in read(tmp_path / "run")


@pytest.mark.sumo
def test_the_tracking_follower_remembers_where_its_predecessor_drove(tmp_path):
    import shapely

    changes = ("run.duration_s=12", "record.scans_every_s=1")
    results = load(run(tmp_path / "run", "corridor_tracking", *changes))
    scans, rows = results.scans, results.trajectories
    paths = {vehicle: shapely.LineString(own[["x_m", "y_m"]]) for vehicle, own in rows.groupby("vehicle_id")}
    for place in range(1, 5):
        (v,) = np.flatnonzero(scans.vehicle_id == f"platoon.{place}")
        last = np.flatnonzero(scans.vehicle == v)[-1]
        points = scans.path_m[scans.path_offset[last] : scans.path_offset[last + 1]]
        assert len(points) == 32
        ahead = points[points[:, 0] > scans.x_m[last]]
        assert len(ahead) >= 3
        assert paths[f"platoon.{place - 1}"].distance(shapely.points(ahead)).max() < 0.3
