"""What is exported says what was recorded."""

from __future__ import annotations

import json
import re
import shutil
import sys
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic.analysis import load
from platoontraffic.cli.main import app
from tests.support.made_runs import EVIL, LASER, LENGTH, made_run

MEMBERS = 3


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return made_run(tmp_path_factory.mktemp("results") / "ring" / "made", members=MEMBERS, seconds=5.0)


def export(folder: Path, to: str) -> list[Path]:
    done = CliRunner().invoke(app, ["export", str(folder), "--to", to])
    assert (done.exit_code, done.stderr) == (0, "")
    return [Path(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def bag(run) -> dict[str, list[tuple[int, object]]]:
    """Topic -> times [ns] and messages, as another reader has them."""
    pytest.importorskip("rosbags", reason="needs rosbags: pip install platoontraffic[ros]")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    files = export(run, "mcap")
    assert [file.name for file in files] == ["foxglove_layout.json", "metadata.yaml", "rosbag.mcap", "view.rviz"]
    store, messages = get_typestore(Stores.ROS2_HUMBLE), {}
    with Reader(files[0].parent) as reader:
        for connection, time, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            messages.setdefault(connection.topic, []).append((time, message))
    return messages


def seconds(message) -> float:
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec * 1e-9


def test_every_range_comes_back_bit_for_bit(run, bag):
    scans = load(run).scans
    members = load(run).trajectories.vehicle_id.unique().tolist()
    for number, vehicle in enumerate(members):
        rows = np.flatnonzero(scans.vehicle_id[scans.vehicle] == vehicle)
        messages = bag[f"/scan{number}"]
        assert len(messages) == len(rows) > 0
        for row, (time, message) in zip(rows, messages, strict=True):
            assert message.ranges.dtype == np.float32
            assert message.ranges.tobytes() == scans.ranges(row).astype("<f4").tobytes()
            assert time * 1e-9 == pytest.approx(scans.time_s[row], abs=1e-9)
            assert seconds(message) == pytest.approx(scans.time_s[row], abs=1e-9)
            assert message.header.frame_id == f"{vehicle}/laser"
            last = message.angle_min + message.angle_increment * (len(message.ranges) - 1)
            assert last == pytest.approx(message.angle_max, abs=1e-5)


def test_lost_near_and_absent_returns_are_those_of_rep_117(tmp_path):
    pytest.importorskip("rosbags")
    from platoontraffic.export import rosbag

    folder = made_run(tmp_path / "run", seconds=1.0)
    with np.load(folder / "scans.npz") as archive:
        columns = dict(archive)
    columns["ranges_m"][:3] = np.inf, -np.inf, np.nan
    np.savez(folder / "scans.npz", **columns)
    first = next(m.message for m in rosbag._messages(load(folder)) if m.topic.startswith("/scan"))
    raw = rosbag.STORE.serialize_cdr(first, first.__msgtype__)
    again = rosbag.STORE.deserialize_cdr(raw, first.__msgtype__).ranges[:3]
    assert again[0] == np.inf
    assert again[1] == -np.inf
    assert np.isnan(again[2])


def test_a_scan_of_a_turning_mirror_has_the_time_of_its_first_beam(tmp_path):
    """A consumer that corrects it for its own motion was wrong by the way of a whole sweep, 3 m at 30 m/s."""
    pytest.importorskip("rosbags")
    from platoontraffic.export import rosbag

    folder = made_run(tmp_path / "run", seconds=1.0)
    with np.load(folder / "scans.npz") as archive:
        columns = dict(archive)
    columns["sweep_time_s"] = np.full(len(columns["vehicle_id"]), 0.02)
    np.savez(folder / "scans.npz", **columns)
    scans = [one for one in rosbag._messages(load(folder)) if one.topic.startswith("/scan")]
    later = columns["time_s"] >= 0.02  # no message has a time below 0
    assert 0 < later.sum() < len(later)
    assert [seconds(one.message) for one in scans] == pytest.approx(columns["time_s"][later] - 0.02)
    assert [one.time * 1e-9 for one in scans] == pytest.approx(columns["time_s"][later])
    samples = columns["samples"][columns["vehicle"][later]]
    assert [one.message.time_increment for one in scans] == pytest.approx(0.02 / (samples - 1))


def test_poses_and_twists_are_those_of_the_table(run, bag):
    rows = load(run).trajectories
    for number, (vehicle, own) in enumerate(rows.groupby("vehicle_id")):
        odometry, twists = bag[f"/rbt_isr_{number}/odom"], bag[f"/rbt_isr_{number}/cmd_vel"]
        assert len(odometry) == len(twists) == len(own)
        assert [seconds(m) for _, m in odometry] == pytest.approx(own.time_s.tolist(), abs=1e-9)
        assert {(m.header.frame_id, m.child_frame_id) for _, m in odometry} == {
            (f"{vehicle}/odom", f"{vehicle}/base_link")
        }
        ((_, static),) = bag["/tf_static"]
        (start,) = [t.transform for t in static.transforms if t.child_frame_id == f"{vehicle}/odom"]
        turned = 2 * np.arctan2(start.rotation.z, start.rotation.w)
        c, s = np.cos(turned), np.sin(turned)
        poses = [m.pose.pose for _, m in odometry]
        found = [[start.translation.x + c * p.position.x - s * p.position.y,
                  start.translation.y + s * p.position.x + c * p.position.y] for p in poses]  # fmt: skip
        np.testing.assert_allclose(found, own[["x_m", "y_m"]].to_numpy(), atol=1e-9)
        headings = [turned + 2 * np.arctan2(p.orientation.z, p.orientation.w) for p in poses]
        assert np.cos(headings - own.heading_rad).min() == pytest.approx(1.0, abs=1e-12)
        assert [[m.linear.x, m.angular.z] for _, m in twists] == own[
            ["speed_mps", "yaw_rate_radps"]
        ].to_numpy().tolist()


def test_frames_lead_from_the_map_to_the_laser(run, bag):
    times = load(run).trajectories.time_s.unique()
    assert [time for time, _ in bag["/tf"]] == [round(time * 1e9) for time in times]
    members = load(run).trajectories.vehicle_id.unique()
    for _, message in bag["/tf"]:
        frames = [(t.header.frame_id, t.child_frame_id) for t in message.transforms]
        assert frames == [(f"{vehicle}/odom", f"{vehicle}/base_link") for vehicle in members]
    ((_, mounts),) = bag["/tf_static"]
    frames = {(t.header.frame_id, t.child_frame_id, t.transform.translation.x) for t in mounts.transforms}
    assert {(parent, child) for parent, child, _ in frames if parent == "map"} == {
        ("map", f"{vehicle}/odom") for vehicle in members
    }
    assert {one for one in frames if one[0] != "map"} == {
        (f"{vehicle}/base_link", f"{vehicle}/laser", LASER) for vehicle in members
    }


def test_bodies_and_traffic_are_boxes_where_the_tables_have_them(run, bag):
    results = load(run)
    for topic, table in (("/vehicles", results.trajectories), ("/traffic", results.traffic)):
        assert len(bag[topic]) == table.time_s.nunique()
        time, last = bag[topic][-1]
        rows = table[table.time_s == table.time_s.max()].sort_values("x_m")
        assert time == round(rows.time_s.iloc[0] * 1e9)
        first, *boxes = last.markers
        assert first.action == first.DELETEALL
        boxes = sorted(boxes, key=lambda one: one.pose.position.x)
        assert [(b.pose.position.x, b.pose.position.y) for b in boxes] == list(zip(rows.x_m, rows.y_m, strict=True))
        assert {(b.header.frame_id, b.type, b.scale.x) for b in boxes} == {("map", 1, LENGTH)}


def test_targets_are_where_the_laws_see_them(run, bag):
    rows = load(run).trajectories
    _, message = bag["/targets"][10]
    at = rows[(rows.time_s == rows.time_s.unique()[10]) & rows.seen_gap_m.notna()]
    marks = message.markers[1:]
    assert len(marks) == len(at) == MEMBERS - 1
    for row, mark in zip(at.itertuples(), marks, strict=True):
        assert mark.header.frame_id == f"{row.vehicle_id}/base_link"
        x, y = mark.pose.position.x - LASER, mark.pose.position.y
        assert np.hypot(x, y) == pytest.approx(row.seen_gap_m + LENGTH / 2 - LASER)
        assert np.arctan2(y, x) == pytest.approx(row.seen_bearing_rad)


def test_the_clock_and_the_road_are_there(run, bag):
    assert [time for time, _ in bag["/clock"]] == [time for time, _ in bag["/tf"]]
    ((_, road),) = bag["/road"]
    lines = {marker.ns: len(marker.points) for marker in road.markers}
    rings = load(run).scene["road"]
    assert lines["road"] == 2 * sum(len(ring) - 1 for ring in rings)


def test_an_occupancy_grid_is_occupied_at_walls_free_on_the_road_and_unknown_beside_it():
    pytest.importorskip("rosbags")
    from platoontraffic.export.markers import FREE, OCCUPIED, UNKNOWN, occupancy

    def square(low: float, high: float) -> list[list[float]]:
        return [[low, low], [high, low], [high, high], [low, high], [low, low]]

    scene = {"road": [square(0, 10), square(4, 6)], "walls": [[[2.0, 2.0], [8.0, 2.0]]], "buildings": [square(20, 22)]}
    cells, size, (left, low) = occupancy(SimpleNamespace(scene=scene))

    def at(x: float, y: float) -> int:
        return cells[int((y - low) / size), int((x - left) / size)]

    assert [at(1, 1), at(5, 5), at(15, 5)] == [FREE, UNKNOWN, UNKNOWN]
    assert [at(2, 2), at(5, 2), at(21, 21), at(20, 21)] == [OCCUPIED] * 4
    assert occupancy(SimpleNamespace(scene=scene | {"walls": [], "buildings": []})) is None


def test_covariances_of_dead_reckoning_have_their_closed_forms():
    """Straight ahead at v for T: the heading's variance is (b T)^2 + w^2 dt T, and that along the road (s v T)^2 + n^2
    dt T; across it, b acts as v b T^2 / 2."""
    from platoontraffic.export.dead_reckoning import covariances
    from platoontraffic.vehicles.odometry import OdometryErrors

    time = np.linspace(0.0, 20.0, 2001)
    rows = pd.DataFrame({"time_s": time, "speed_mps": 10.0, "heading_rad": 0.7})
    last = covariances(rows, OdometryErrors(0.005, 0.02, 0.002, 0.003), 0.1)[-1]
    assert last[0, 0] == pytest.approx((0.005 * 10 * 20) ** 2 + 0.02**2 * 0.1 * 20)
    assert last[2, 2] == pytest.approx((0.002 * 20) ** 2 + 0.003**2 * 0.1 * 20)
    across = (10 * 0.002 * 20**2 / 2) ** 2 + 10**2 * 0.003**2 * 0.1 * 20**3 / 3
    assert last[1, 1] == pytest.approx(across, rel=2e-3)
    coarse = covariances(rows.iloc[::100], OdometryErrors(0.005, 0.02, 0.002, 0.003), 0.1)[-1]  # a row a second
    np.testing.assert_allclose(coarse, last, rtol=5e-3)
    bend = rows.assign(heading_rad=0.1 * time)
    errors = OdometryErrors(0.005, 0.02, 0.002, 0.003)
    fine, coarse = (np.sqrt(np.diag(covariances(bend.iloc[::n], errors, 0.1)[-1])) for n in (1, 100))
    np.testing.assert_allclose(coarse, fine, rtol=0.02)
    standing = rows.assign(speed_mps=0.0)
    assert (covariances(standing, OdometryErrors(0.005, 0.02, 0.002, 0.003), 0.1) == 0).all()


def test_settings_of_viewers_name_topics_of_the_bag(run, bag):
    layout = json.loads((run / "rosbag" / "foxglove_layout.json").read_text())
    assert set(layout["configById"]["3D!scene"]["topics"]) <= set(bag) | {"/map"}
    named = re.findall(r"Value: (/\S+)", (run / "rosbag" / "view.rviz").read_text())
    assert {"/road", "/vehicles", "/scan0"} <= set(named) <= set(bag) | {"/map"}


def test_a_bag_is_written_again_in_the_place_of_the_old_one(run, bag):
    before = (run / "rosbag" / "rosbag.mcap").read_bytes()
    (run / "rosbag" / "old").touch()
    export(run, "mcap")
    assert (run / "rosbag" / "rosbag.mcap").read_bytes() == before
    assert not (run / "rosbag" / "old").exists()


def test_without_rosbags_it_says_what_to_install(run, monkeypatch):
    monkeypatch.delitem(sys.modules, "platoontraffic.export.rosbag", raising=False)
    monkeypatch.setitem(sys.modules, "rosbags.interfaces", None)
    done = CliRunner().invoke(app, ["export", str(run), "--to", "mcap"])
    assert (done.exit_code, done.stderr.count("\n")) == (3, 1)
    assert 'pip install "platoontraffic[ros]"' in done.stderr


def vehicles(file: Path) -> pd.DataFrame:
    """Of an FCD file, poses of centres in the project's own frame."""
    rows = []
    for step in ET.parse(file).getroot():
        for vehicle in step:
            heading = np.radians(90 - float(vehicle.get("angle")))
            front = float(vehicle.get("x")), float(vehicle.get("y"))
            x, y = front[0] - LENGTH / 2 * np.cos(heading), front[1] - LENGTH / 2 * np.sin(heading)
            rows.append((float(step.get("time")), vehicle.get("id"), x, y, heading, float(vehicle.get("speed"))))
    columns = ["time_s", "vehicle_id", "x_m", "y_m", "heading_rad", "speed_mps"]
    return pd.DataFrame(rows, columns=columns).sort_values(["time_s", "vehicle_id"]).reset_index(drop=True)


def test_floating_car_data_and_tables_have_the_same_poses(run):
    (file,) = export(run, "fcd")
    results = load(run)
    own = results.trajectories[results.trajectories.time_s.isin(results.traffic.time_s)]
    rows = pd.concat([own, results.traffic]).sort_values(["time_s", "vehicle_id"])
    read = vehicles(file)
    assert EVIL in set(read.vehicle_id)
    assert read[["time_s", "vehicle_id"]].to_numpy().tolist() == rows[["time_s", "vehicle_id"]].to_numpy().tolist()
    for name in ("x_m", "y_m", "speed_mps"):
        assert np.abs(read[name].to_numpy() - rows[name].to_numpy()).max() < 1e-6
    assert np.cos(read.heading_rad.to_numpy() - rows.heading_rad.to_numpy()).min() > 1 - 1e-14


def test_floating_car_data_are_what_sumo_says_they_are(run):
    xmlschema = pytest.importorskip("xmlschema", reason="needs xmlschema, and the schemas of eclipse-sumo")
    sumo = pytest.importorskip("sumo")
    (file,) = export(run, "fcd")
    xmlschema.XMLSchema(Path(sumo.SUMO_HOME, "data", "xsd", "fcd_file.xsd")).validate(file)


def test_sumos_own_reader_takes_floating_car_data(run):
    import sumolib

    (file,) = export(run, "fcd")
    steps = list(sumolib.xml.parse(str(file), "timestep"))
    assert len(steps) == load(run).traffic.time_s.nunique()
    assert all(float(a.time) < float(b.time) for a, b in pairwise(steps))
    assert len(steps[0].vehicle) == MEMBERS + 20


@pytest.mark.sumo
def test_sumo_and_floating_car_data_agree_on_where_a_vehicle_is(one_corner, tmp_path):
    """The leader starts with its front bumper at the position that the scenario gives to SUMO."""
    shutil.copytree(one_corner, tmp_path / "run")
    (file,) = export(tmp_path / "run", "fcd")
    first = ET.parse(file).getroot()[0][0]
    row = load(one_corner).trajectories.iloc[0]
    length = load(one_corner).vehicles.length_m.iloc[0]
    assert float(first.get("x")) == pytest.approx(row.x_m + length / 2 * np.cos(row.heading_rad), abs=1e-5)
    assert first.get("lane") == row.lane_id


@pytest.mark.parametrize("to", ["mcap", "fcd", "parquet"])
@pytest.mark.parametrize("what", ["nothing", "unfinished"])
def test_what_is_not_a_finished_run_is_one_line(to, what, tmp_path):
    pytest.importorskip("rosbags" if to == "mcap" else "pyarrow" if to == "parquet" else "pandas")
    folder = tmp_path / what
    if what == "unfinished":
        (made_run(folder, seconds=1.0) / "DONE").unlink()
    done = CliRunner().invoke(app, ["export", str(folder), "--to", to])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)


def test_a_run_without_scans_says_how_to_record_them(tmp_path):
    pytest.importorskip("rosbags")
    folder = made_run(tmp_path / "run", seconds=1.0, scans_every=None)
    done = CliRunner().invoke(app, ["export", str(folder), "--to", "mcap"])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "record.scans_every_s" in done.stderr


def test_a_run_without_any_member_on_the_road_is_one_line(run, tmp_path):
    pytest.importorskip("rosbags", reason="needs rosbags: pip install platoontraffic[ros]")
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    head = (folder / "trajectories.csv").read_text().splitlines()[0]
    (folder / "trajectories.csv").write_text(head + "\n")
    done = CliRunner().invoke(app, ["export", str(folder), "--to", "mcap"])
    assert done.exit_code == 2
    assert "no member was ever on the road" in done.stderr


def test_scans_of_another_run_are_one_line(run, tmp_path):
    pytest.importorskip("rosbags", reason="needs rosbags: pip install platoontraffic[ros]")
    folder = shutil.copytree(run, tmp_path / "run")
    with np.load(folder / "scans.npz") as scans:
        arrays = dict(scans)
    arrays["vehicle_id"] = np.array([f"x{name}" for name in arrays["vehicle_id"]])
    np.savez(folder / "scans.npz", **arrays)
    done = CliRunner().invoke(app, ["export", str(folder), "--to", "mcap"])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "which trajectories.csv does not have" in done.stderr


def test_an_unknown_format_is_one_line(run):
    done = CliRunner().invoke(app, ["export", str(run), "--to", "mcpa"])
    assert (done.exit_code, done.stderr) == (2, "--to: 'mcpa': no such format; did you mean 'mcap'?\n")
