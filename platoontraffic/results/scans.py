"""scans.npz: what the members' lasers measured, bit for bit. A NumPy archive of columns, two tables and the ranges.

A row a scan, by time, then by platoon and place:

time_s               (s,)      the instant of the world that was scanned; a mirror that turns ends its sweep then
vehicle              (s,)      row of `vehicle_id` and the columns beside it
x_m, y_m, heading_rad (s,)     the vehicle's centre at that time; counter-clockwise from east
offset               (s + 1,)  ranges of scan i are offset[i] to offset[i + 1] - 1 of `ranges_m`
ranges_m             (all,)    +inf nothing within range_max, -inf nearer than range_min, NaN lost

And where laws have a `remembered_path`, what they remembered when the scan had been decided on:

path_offset          (s + 1,)  points of scan i are path_offset[i] to path_offset[i + 1] - 1 of `path_m`
path_m               (p, 2)    in the world, by the vehicle's true pose: the law knows it in its odometry's frame only

A row a member that has scanned, in the order of its first scan:

vehicle_id           (v,)
angle_min_rad, angle_max_rad, samples, range_min_m, range_max_m, rate_hz   (v,)  of its laser
mount_x_m, mount_y_m, mount_yaw_rad                                       (v,)  where that sits, from the centre
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.world.fleet import Fleet, Group
from platoontraffic.world.traffic import TrafficSnapshot

NAME = "scans.npz"
_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the date of every part: the same scans are the same bytes

FIELDS = {
    "time_s": ("s", "instant that was scanned, since the platoons were placed"),
    "vehicle": ("", "row of vehicle_id and of the laser's columns"),
    "x_m": ("m", "centre of the footprint then, east"),
    "y_m": ("m", "centre of the footprint then, north"),
    "heading_rad": ("rad", "counter-clockwise from east"),
    "offset": ("", "ranges of scan i are offset[i] to offset[i + 1] - 1 of ranges_m"),
    "ranges_m": ("m", "from the first beam to the last; inf: nothing, -inf: too near, NaN: lost"),
    "path_offset": ("", "where laws remember a path: points of scan i are path_offset[i] to path_offset[i + 1] - 1"),
    "path_m": ("m", "points of remembered paths: east, north"),
    "vehicle_id": ("", "members that scanned"),
    "angle_min_rad": ("rad", "first beam, from the laser's forward direction, counter-clockwise"),
    "angle_max_rad": ("rad", "last beam"),
    "samples": ("", "beams"),
    "range_min_m": ("m", "nearest distance that the laser can tell"),
    "range_max_m": ("m", "farthest"),
    "rate_hz": ("1/s", "scans made; not all are recorded"),
    "mount_x_m": ("m", "laser ahead of the centre"),
    "mount_y_m": ("m", "laser to the left of the centre"),
    "mount_yaw_rad": ("rad", "its forward direction, from the vehicle's"),
}


class ScanRecorder:
    """Collects scans on disk as they come; `close` makes the archive of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._raw = (folder / "scans.raw").open("w+b")
        self._path = (folder / "paths.raw").open("w+b")
        self._points: list[int] = []  # of the path of each scan
        self._remembering = False
        self._number: dict[str, int] = {}  # of each vehicle, by its first scan
        self._lasers: list[LidarModel] = []
        self._rows: list[tuple[float, int, float, float, float, int]] = []

    def record(
        self, step: int, every: int, traffic: TrafficSnapshot, fleet: Fleet, scans: Sequence[ScanBatch | None]
    ) -> None:
        """To be called in every step; takes each laser's first scan in or after every `every`-th."""
        rows = []
        for group, batch in zip(fleet.groups, scans, strict=True):
            if batch is not None and step % every < group.every:
                paths = self._remembered(group)
                rows += [(fleet.members[i], i, batch.ranges[k], paths[k]) for k, i in enumerate(group.rows.tolist())]
        for member, i, ranges, path in sorted(rows, key=lambda row: (row[0].platoon, row[0].place, row[0].id)):
            if member.id not in self._number:
                self._number[member.id] = len(self._lasers)
                self._lasers.append(member.lidar)
            pose = float(traffic.x[i]), float(traffic.y[i]), float(traffic.heading[i])
            self._rows.append((traffic.time, self._number[member.id], *pose, len(ranges)))
            self._raw.write(np.ascontiguousarray(ranges, dtype="<f4").tobytes())
            points = _in_world(path[np.isfinite(path).all(axis=1)], *pose, member.model.axle)
            self._points.append(len(points))
            self._path.write(np.ascontiguousarray(points.round(3), dtype="<f8").tobytes())

    def _remembered(self, group: Group) -> np.ndarray:
        """Paths (n, k, 2) as seen from the driven axles."""
        path = group.law.remembered_path(group.memory)
        if path is None:
            return np.empty((len(group.rows), 0, 2))
        self._remembering = True
        return path

    def flush(self) -> None:
        self._raw.flush()
        self._path.flush()

    def close(self) -> None:
        if self._raw.closed:
            return
        time, vehicle, x, y, heading, samples = np.array(self._rows, dtype=float).reshape(-1, 6).T
        lasers = self._lasers
        columns = {
            "time_s": time,
            "vehicle": vehicle.astype("<i4"),
            "x_m": x,
            "y_m": y,
            "heading_rad": heading,
            "offset": np.concatenate([[0], np.cumsum(samples)]).astype("<i8"),
            "vehicle_id": np.array(list(self._number), dtype="<U"),
            "angle_min_rad": np.array([m.angle_min for m in lasers]),
            "angle_max_rad": np.array([m.angle_max for m in lasers]),
            "samples": np.array([m.samples for m in lasers], dtype="<i4"),
            "range_min_m": np.array([m.range_min for m in lasers]),
            "range_max_m": np.array([m.range_max for m in lasers]),
            "rate_hz": np.array([m.rate for m in lasers]),
            "mount_x_m": np.array([m.mount.x for m in lasers]),
            "mount_y_m": np.array([m.mount.y for m in lasers]),
            "mount_yaw_rad": np.array([m.mount.yaw for m in lasers]),
        }
        raw = [("ranges_m", self._raw, "<f4", (int(samples.sum()),))]
        if self._remembering:
            columns["path_offset"] = np.concatenate([[0], np.cumsum(self._points)]).astype("<i8")
            raw.append(("path_m", self._path, "<f8", (sum(self._points), 2)))
        with self._raw, self._path, zipfile.ZipFile(self._folder / NAME, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, column in columns.items():
                with archive.open(_part(name), "w") as part:
                    np.lib.format.write_array(part, np.ascontiguousarray(column), allow_pickle=False)
            for name, file, kind, shape in raw:
                file.seek(0)
                with archive.open(_part(name), "w", force_zip64=True) as part:
                    header = {"descr": kind, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(part, header)
                    shutil.copyfileobj(file, part, 1 << 20)  # more than fits into memory, perhaps
        (self._folder / "scans.raw").unlink()
        (self._folder / "paths.raw").unlink()


def resource() -> dict:
    """The archive as a resource of a data package."""
    fields = [{"name": name, "unit": unit, "description": meaning} for name, (unit, meaning) in FIELDS.items()]
    return {"name": "scans", "path": NAME, "description": "a NumPy archive of arrays", "arrays": fields}


def _part(name: str) -> zipfile.ZipInfo:
    part = zipfile.ZipInfo(f"{name}.npy", _LONG_AGO)
    part.compress_type = zipfile.ZIP_DEFLATED
    return part


def _in_world(points: np.ndarray, x: float, y: float, heading: float, axle: float) -> np.ndarray:
    """Points (k, 2) as seen from the driven axle of a vehicle, x forward, y to the left."""
    cos, sin = np.cos(heading), np.sin(heading)
    return (points + np.array([axle, 0.0])) @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
