"""A run as ROS 2 messages: a folder for `ros2 bag play` with one .mcap file, which Foxglove opens.

Topics are named as in the paper; i numbers the members by platoon and place:

/scan{i}               sensor_msgs/msg/LaserScan   the ranges of scans.npz, bit for bit, by REP 117
/rbt_isr_{i}/odom      nav_msgs/msg/Odometry       true pose and motion; covariances by the errors of its odometry
/rbt_isr_{i}/cmd_vel   geometry_msgs/msg/Twist     the actual twist; commands are not recorded
/tf                    tf2_msgs/msg/TFMessage      VEHICLE/odom -> VEHICLE/base_link
/tf_static             tf2_msgs/msg/TFMessage      map -> VEHICLE/odom, VEHICLE/base_link -> VEHICLE/laser
/road, /vehicles, /traffic, /targets               visualization_msgs/msg/MarkerArray
/map                   nav_msgs/msg/OccupancyGrid  where there are walls or buildings
/clock                 rosgraph_msgs/msg/Clock     at the recorded instants

map is the network's frame, x east and y north; VEHICLE/odom is where the vehicle started, after REP 105; base_link is
the centre of the footprint, x forward and y left. Times are those of the run. Beside the bag are a layout for Foxglove
and a configuration for RViz.
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
from platoontraffic.export import viewers
from platoontraffic.export.dead_reckoning import covariances, errors_of
from platoontraffic.export.markers import COLOURS, GREY, ORANGE, RIGHT, SPHERE, WRONG, Markers, occupancy
from platoontraffic.vehicles.odometry import OdometryErrors

NAME = "rosbag"  # folder of the bag in that of the run
STORE = get_typestore(Stores.ROS2_HUMBLE)
MARKERS = Markers(STORE.types)
ONCE = ("/tf_static", *viewers.LATCHED)  # topics with one message
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
    if results.trajectories.empty:
        raise ResultsError(f"{folder}: no member was ever on the road")
    bag, new = results.folder / NAME, results.folder / f".{secrets.token_hex(8)}"
    try:
        messages = sorted(_messages(results), key=lambda one: one[:2])
        _write(new / NAME, messages)
        _write_views(new / NAME, results, grid=any(one.topic == "/map" for one in messages))
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
                qos = [LATCHED] if topic in ONCE else []
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE, offered_qos_profiles=qos)
            writer.write(connections[topic], time, STORE.serialize_cdr(message, kind))


def _write_views(folder: Path, results: Results, grid: bool) -> None:
    members = _numbered(results)
    of_view = len(members), grid, f"{next(iter(members))}/base_link"
    (folder / "foxglove_layout.json").write_text(viewers.foxglove(*of_view), encoding="utf-8")
    (folder / "view.rviz").write_text(viewers.rviz(*of_view), encoding="utf-8")


def _numbered(results: Results) -> dict[str, int]:
    """Members by platoon and place, with their numbers."""
    rows = results.trajectories
    members = rows.drop_duplicates("vehicle_id").sort_values(["platoon_id", "place"], kind="stable").vehicle_id
    return {vehicle: i for i, vehicle in enumerate(members)}


def _messages(results: Results) -> Iterator[Stamped]:
    rows = results.trajectories
    if unknown := set(results.scans.vehicle_id.tolist()) - set(rows.vehicle_id):
        name = min(map(str, unknown))
        raise ResultsError(f"{results.folder}: scans.npz has scans of '{name}', which trajectories.csv does not have")
    number = _numbered(results)
    starts = rows.drop_duplicates("vehicle_id").set_index("vehicle_id")
    yield from _odometry(results, number, starts)
    yield from _scans(results.scans, number)
    yield from _seen(results, number)
    yield Stamped(0, "/tf_static", _mounts(results.scans, starts))
    yield Stamped(0, "/road", MARKERS.scene(results))
    if grid := occupancy(results):
        yield Stamped(0, "/map", _map(*grid))


def _odometry(results: Results, number: dict[str, int], starts: pd.DataFrame) -> Iterator[Stamped]:
    """Poses in the frames in which the members started, their twists, transforms, and the clock."""
    errors, dt = errors_of(results)
    transforms: dict[int, list[Any]] = {}
    for vehicle, own in results.trajectories.groupby("vehicle_id", sort=False):
        i, frame, base, start = number[vehicle], f"{vehicle}/odom", f"{vehicle}/base_link", starts.loc[vehicle]
        of_vehicle = errors.get((start.platoon_id.partition(".")[0], start.place == 0), OdometryErrors())
        cos, sin = np.cos(start.heading_rad), np.sin(start.heading_rad)
        for row, spread in zip(own.itertuples(), covariances(own, of_vehicle, dt), strict=True):
            time, x, y = _nanoseconds(row.time_s), row.x_m - start.x_m, row.y_m - start.y_m
            position = cos * x + sin * y, cos * y - sin * x
            orientation = _orientation(row.heading_rad - start.heading_rad)
            # The speed forward is that of all on the vehicle's middle line; base_link's to the side is not recorded.
            twist = _twist(row.speed_mps, row.yaw_rate_radps)
            transforms.setdefault(time, []).append(_transform(time, frame, base, position, orientation))
            point = _new("geometry_msgs/msg/Point", x=float(position[0]), y=float(position[1]), z=0.0)
            pose = _new("geometry_msgs/msg/Pose", position=point, orientation=orientation)
            of_pose, of_twist = np.zeros((6, 6)), np.zeros((6, 6))
            of_pose[np.ix_([0, 1, 5], [0, 1, 5])] = spread
            if row.speed_mps:
                of_twist[0, 0] = (of_vehicle.speed_scale * row.speed_mps) ** 2 + of_vehicle.speed_noise**2
                of_twist[5, 5] = of_vehicle.yaw_rate_bias**2 + of_vehicle.yaw_rate_noise**2
            odometry = _new(
                "nav_msgs/msg/Odometry",
                header=_header(time, frame),
                child_frame_id=base,
                pose=_new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=of_pose.ravel()),
                twist=_new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=of_twist.ravel()),
            )
            yield Stamped(time, f"/rbt_isr_{i}/odom", odometry)
            yield Stamped(time, f"/rbt_isr_{i}/cmd_vel", twist)
    for time, together in transforms.items():
        order = sorted(together, key=lambda one: number[one.child_frame_id.removesuffix("/base_link")])
        yield Stamped(time, "/tf", _new("tf2_msgs/msg/TFMessage", transforms=order))
        yield Stamped(time, "/clock", _new("rosgraph_msgs/msg/Clock", clock=_header(time, "").stamp))


def _seen(results: Results, number: dict[str, int]) -> Iterator[Stamped]:
    """Bodies of members and of other vehicles, and the targets of the members' laws."""
    known = None if results.vehicles is None else results.vehicles.drop_duplicates("vehicle_id")
    sizes = pd.DataFrame() if known is None else known.set_index("vehicle_id")
    usual = (4.74, 1.80)

    def size(vehicle: str) -> tuple[float, float]:
        return tuple(sizes.loc[vehicle, ["length_m", "width_m"]]) if vehicle in sizes.index else usual

    rows = results.trajectories
    for time_s, together in rows.groupby("time_s", sort=False):
        time = _nanoseconds(time_s)
        bodies, targets = [MARKERS.cleared(time, "vehicles")], [MARKERS.cleared(time, "targets")]
        for row in together.itertuples():
            pose, colour = (row.x_m, row.y_m, row.heading_rad), COLOURS[row.place % len(COLOURS)]
            bodies.append(MARKERS.box(time, "vehicles", number[row.vehicle_id], pose, size(row.vehicle_id), colour))
            if pd.notna(getattr(row, "seen_gap_m", np.nan)) and pd.notna(row.seen_bearing_rad):
                targets.append(_target(time, row, number[row.vehicle_id], size(row.vehicle_id)[0], sizes))
        yield Stamped(time, "/vehicles", MARKERS.array(bodies))
        yield Stamped(time, "/targets", MARKERS.array(targets))
    if results.traffic is None:
        return
    came = results.events[results.events.kind == "obstacle"].vehicle_id.tolist()
    numbers = {vehicle: i for i, vehicle in enumerate(results.traffic.vehicle_id.unique())}
    for time_s, together in results.traffic.groupby("time_s", sort=False):
        time = _nanoseconds(time_s)
        bodies = [MARKERS.cleared(time, "traffic")]
        for row in together.itertuples():
            colour = ORANGE if row.vehicle_id in came else GREY
            pose = row.x_m, row.y_m, row.heading_rad
            bodies.append(MARKERS.box(time, "traffic", numbers[row.vehicle_id], pose, size(row.vehicle_id), colour))
        yield Stamped(time, "/traffic", MARKERS.array(bodies))


def _target(time: int, row: Any, number: int, length: float, sizes: pd.DataFrame) -> Any:
    """What a law takes for its predecessor, green if it is that. The gap is measured from the front bumper, the bearing
    from the laser."""
    mount = sizes.loc[row.vehicle_id, ["laser_x_m", "laser_y_m", "laser_yaw_rad"]] if len(sizes) else (length / 2, 0, 0)
    ahead, left, yaw = (0.0 if pd.isna(value) else float(value) for value in mount)
    distance, angle = row.seen_gap_m + length / 2 - ahead, yaw + row.seen_bearing_rad
    place = ahead + distance * np.cos(angle), left + distance * np.sin(angle), 0.0
    right = row.target_id == f"{row.platoon_id}.{row.place - 1}"
    wide = 0.12 * length
    return MARKERS.marker(
        f"{row.vehicle_id}/base_link", time, "targets", number, SPHERE, place, scale=(wide, wide, wide),
        colour=RIGHT if right else WRONG,
    )  # fmt: skip


def _map(cells: np.ndarray, size: float, corner: tuple[float, float]) -> Any:
    header = _header(0, "map")
    origin = _new(
        "geometry_msgs/msg/Pose",
        position=_new("geometry_msgs/msg/Point", x=corner[0], y=corner[1], z=0.0),
        orientation=_orientation(0.0),
    )
    height, width = cells.shape
    info = _new(
        "nav_msgs/msg/MapMetaData",
        map_load_time=header.stamp,
        resolution=size,
        width=width,
        height=height,
        origin=origin,
    )
    return _new("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=cells.ravel())


def _scans(scans: Scans, number: dict[str, int]) -> Iterator[Stamped]:
    increment = (scans.angle_max_rad - scans.angle_min_rad) / np.maximum(scans.samples - 1, 1)
    sweep = np.zeros(len(increment)) if scans.sweep_time_s is None else scans.sweep_time_s
    for i, (time_s, v) in enumerate(zip(scans.time_s.tolist(), scans.vehicle.tolist(), strict=True)):
        time, vehicle, (frame, topic) = _nanoseconds(time_s), str(scans.vehicle_id[v]), _names(scans, v)
        begins = _nanoseconds(time_s - float(sweep[v]))
        if begins < 0:  # ROS has no such times, and the vehicle was nowhere then
            continue
        scan = _new(
            "sensor_msgs/msg/LaserScan",
            header=_header(begins, frame),
            angle_min=float(scans.angle_min_rad[v]),
            angle_max=float(scans.angle_max_rad[v]),
            angle_increment=float(increment[v]),
            time_increment=float(sweep[v]) / max(int(scans.samples[v]) - 1, 1),
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


def _mounts(scans: Scans, starts: pd.DataFrame) -> Any:
    """Frames that do not move: where members started, and their lasers."""
    mounts = zip(scans.vehicle_id, scans.mount_x_m, scans.mount_y_m, scans.mount_yaw_rad, strict=True)
    transforms = [
        _transform(0, f"{vehicle}/base_link", _names(scans, v)[0], (x, y), _orientation(yaw))
        for v, (vehicle, x, y, yaw) in enumerate(mounts)
    ]
    transforms += [
        _transform(0, "map", f"{row.Index}/odom", (row.x_m, row.y_m), _orientation(row.heading_rad))
        for row in starts.itertuples()
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
