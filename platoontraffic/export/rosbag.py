"""A run as ROS 2 messages: a folder for `ros2 bag play` with one .mcap file, which Foxglove opens.

Topics are named as in the paper; i numbers the members by platoon and place:

/scan{i}               sensor_msgs/msg/LaserScan   the ranges of scans.npz, bit for bit, by REP 117
/rbt_isr_{i}/odom      nav_msgs/msg/Odometry       true pose and motion: covariances are 0
/rbt_isr_{i}/cmd_vel   geometry_msgs/msg/Twist     the actual twist; commands are not recorded
/tf                    tf2_msgs/msg/TFMessage      map -> VEHICLE/base_link
/tf_static             tf2_msgs/msg/TFMessage      VEHICLE/base_link -> VEHICLE/laser

map is the network's frame, x east and y north; base_link is the centre of the footprint, x forward and y left. Times
are those of the run.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from platoontraffic.analysis.results import Results, ResultsError, Scans, load_run

NAME = "rosbag"  # folder of the bag in that of the run
STORE = get_typestore(Stores.ROS2_HUMBLE)
FOREVER = QosTime(9223372036, 854775807)
LATCHED = Qos(  # late subscribers get the last message too
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    FOREVER,
    FOREVER,
    QosLiveliness.AUTOMATIC,
    FOREVER,
    False,
)


class Stamped(NamedTuple):
    time: int  # time since the start of the run [ns]
    topic: str
    message: Any


def export(folder: Path) -> list[Path]:
    """Write the bag of a finished run; returns its files.

    raises: ResultsError, OSError (it cannot be written)
    """
    results = load_run(Path(folder))
    if results.scans is None:
        raise ResultsError(f"{folder}: has no scans; record them with: platoontraffic run … record.scans_every_s=0.1")
    bag, new = results.folder / NAME, results.folder / f".{secrets.token_hex(8)}"
    try:
        _write(new / NAME, sorted(_messages(results), key=lambda one: one[:2]))
        if bag.is_symlink() or bag.is_file():
            bag.unlink()
        shutil.rmtree(bag, ignore_errors=True)
        (new / NAME).rename(bag)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return sorted(bag.iterdir())


def _write(folder: Path, messages: list[Stamped]) -> None:
    folder.parent.mkdir()
    writer = Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for time, topic, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                qos = [LATCHED] if topic == "/tf_static" else []
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE, offered_qos_profiles=qos)
            writer.write(connections[topic], time, STORE.serialize_cdr(message, kind))


def _messages(results: Results) -> Iterator[Stamped]:
    rows = results.trajectories
    if unknown := set(results.scans.vehicle_id.tolist()) - set(rows.vehicle_id):
        name = min(map(str, unknown))
        raise ResultsError(f"{results.folder}: scans.npz has scans of '{name}', which trajectories.csv does not have")
    members = rows.drop_duplicates("vehicle_id").sort_values(["platoon_id", "place"], kind="stable").vehicle_id.tolist()
    number = {vehicle: i for i, vehicle in enumerate(members)}
    yield from _motions(rows, number)
    yield from _scans(results.scans, number)
    yield Stamped(0, "/tf_static", _mounts(results.scans))


def _motions(rows: pd.DataFrame, number: dict[str, int]) -> Iterator[Stamped]:
    for time_s, together in rows.groupby("time_s", sort=False):
        time = _nanoseconds(time_s)
        transforms = []
        for row in together.itertuples():
            i, frame = number[row.vehicle_id], f"{row.vehicle_id}/base_link"
            position, orientation = (row.x_m, row.y_m), _orientation(row.heading_rad)
            # The speed forward is that of all on the vehicle's middle line; base_link's to the side is not recorded.
            twist = _new(
                "geometry_msgs/msg/Twist", linear=_vector(row.speed_mps), angular=_vector(z=row.yaw_rate_radps)
            )
            transforms.append(_transform(time, "map", frame, position, orientation))
            point = _new("geometry_msgs/msg/Point", x=position[0], y=position[1], z=0.0)
            pose = _new("geometry_msgs/msg/Pose", position=point, orientation=orientation)
            odometry = _new(
                "nav_msgs/msg/Odometry",
                header=_header(time, "map"),
                child_frame_id=frame,
                pose=_new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
                twist=_new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
            )
            yield Stamped(time, f"/rbt_isr_{i}/odom", odometry)
            yield Stamped(time, f"/rbt_isr_{i}/cmd_vel", twist)
        yield Stamped(time, "/tf", _new("tf2_msgs/msg/TFMessage", transforms=transforms))


def _scans(scans: Scans, number: dict[str, int]) -> Iterator[Stamped]:
    increment = (scans.angle_max_rad - scans.angle_min_rad) / np.maximum(scans.samples - 1, 1)
    for i, (time_s, v) in enumerate(zip(scans.time_s.tolist(), scans.vehicle.tolist(), strict=True)):
        time, vehicle, (frame, topic) = _nanoseconds(time_s), str(scans.vehicle_id[v]), _names(scans, v)
        scan = _new(
            "sensor_msgs/msg/LaserScan",
            header=_header(time, frame),
            angle_min=float(scans.angle_min_rad[v]),
            angle_max=float(scans.angle_max_rad[v]),
            angle_increment=float(increment[v]),
            time_increment=0.0,
            scan_time=1 / float(scans.rate_hz[v]),
            range_min=float(scans.range_min_m[v]),
            range_max=float(scans.range_max_m[v]),
            ranges=scans.ranges(i),
            intensities=np.empty(0, dtype=np.float32),
        )
        yield Stamped(time, f"/scan{number[vehicle]}{topic}", scan)


def _names(scans: Scans, v: int) -> tuple[str, str]:
    """Frame of a laser, and what its topic has beyond that of the vehicle's scan; further lasers go by their names."""
    name = "" if scans.following[v] else str(scans.laser[v])
    return f"{scans.vehicle_id[v]}/{name or 'laser'}", name and f"/{name}"


def _mounts(scans: Scans) -> Any:
    mounts = zip(scans.vehicle_id, scans.mount_x_m, scans.mount_y_m, scans.mount_yaw_rad, strict=True)
    transforms = [
        _transform(0, f"{vehicle}/base_link", _names(scans, v)[0], (x, y), _orientation(yaw))
        for v, (vehicle, x, y, yaw) in enumerate(mounts)
    ]
    return _new("tf2_msgs/msg/TFMessage", transforms=transforms)


def _transform(time: int, frame: str, child: str, place: tuple[float, float], rotation: Any) -> Any:
    transform = _new("geometry_msgs/msg/Transform", translation=_vector(*place), rotation=rotation)
    header = _header(time, frame)
    return _new("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=transform)


def _header(time: int, frame: str) -> Any:
    seconds, nanoseconds = divmod(time, 10**9)
    stamp = _new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return _new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _orientation(yaw: float) -> Any:
    return _new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))


def _twist(speed: float, yaw_rate: float) -> Any:
    return _new("geometry_msgs/msg/Twist", linear=_vector(x=speed), angular=_vector(z=yaw_rate))


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return _new("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def _new(kind: str, **values: Any) -> Any:
    return STORE.types[kind](**values)


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)
