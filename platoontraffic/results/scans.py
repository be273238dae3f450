"""scans.npz: what the members' lasers measured, bit for bit. A NumPy archive of columns, two tables and the ranges.

A row a scan, by time, then by platoon and place; a scan is recorded when the law is given it, after its laser's delay:

time_s               (s,)      the instant of the world that was scanned; a rotating mirror ends its sweep then
vehicle              (s,)      row of `vehicle_id`, `laser` and the columns beside them
x_m, y_m, heading_rad (s,)     the vehicle's centre at that time; counter-clockwise from east
offset               (s + 1,)  ranges of scan i are offset[i] to offset[i + 1] - 1 of `ranges_m`
ranges_m             (all,)    +inf nothing within range_max, -inf nearer than range_min, NaN lost

Where laws have a `remembered_path`, also that path after the decision on each scan:

path_offset          (s + 1,)  points of scan i are path_offset[i] to path_offset[i + 1] - 1 of `path_m`
path_m               (p, 2)    in the world, by the vehicle's true pose; the law has it in its odometry's frame only

A row a laser that has scanned, in the order of the first scans:

vehicle_id           (v,)      the member that carries it
laser                (v,)      its name on that member; "lidar" is the one by which the member follows
angle_min_rad, angle_max_rad, samples, range_min_m, range_max_m, rate_hz, sweep_time_s, delay_s   (v,)  of its laser
mount_x_m, mount_y_m, mount_yaw_rad                                       (v,)  position of the laser, from the centre
"""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.calls import ask
from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.lidar.noise import DEFAULT_NAME
from platoontraffic.observation.instant import Instant
from platoontraffic.world.fleet import NOTHING, Group, Member
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen

NAME = "scans.npz"
_DATE = (1980, 1, 1, 0, 0, 0)  # of every part of the archive, so that the same scans give the same bytes

FIELDS = {  # array: unit, meaning
    "time_s": ("s", "instant that was scanned, since the platoons were placed"),
    "vehicle": ("", "row of vehicle_id, laser and the laser's columns"),
    "x_m": ("m", "centre of the footprint at that time, east"),
    "y_m": ("m", "centre of the footprint at that time, north"),
    "heading_rad": ("rad", "counter-clockwise from east"),
    "offset": ("", "ranges of scan i are offset[i] to offset[i + 1] - 1 of ranges_m"),
    "ranges_m": ("m", "from the first beam to the last; inf: nothing in range, -inf: too near, NaN: lost"),
    "path_offset": ("", "where laws remember a path: points of scan i are path_offset[i] to path_offset[i + 1] - 1"),
    "path_m": ("m", "points of remembered paths: east, north"),
    "vehicle_id": ("", "member that carries the laser; a row a laser that has scanned"),
    "laser": ("", "name of the laser on that member; `lidar` is the one by which it follows"),
    "angle_min_rad": ("rad", "angle of the first beam from the laser's forward direction, counter-clockwise"),
    "angle_max_rad": ("rad", "angle of the last beam"),
    "samples": ("", "number of beams"),
    "range_min_m": ("m", "least distance that the laser can measure"),
    "range_max_m": ("m", "greatest distance that the laser can measure"),
    "rate_hz": ("1/s", "scans made per second; not all of them are recorded"),
    "sweep_time_s": ("s", "from the first beam to the last, which is at time_s; 0: all are measured at once"),
    "delay_s": ("s", "time from the end of a scan to its use by the law, at the first step after it"),
    "mount_x_m": ("m", "position of the laser, ahead of the centre"),
    "mount_y_m": ("m", "position of the laser, to the left of the centre"),
    "mount_yaw_rad": ("rad", "forward direction of the laser, from that of the vehicle"),
}


class _Scan(NamedTuple):
    """A scan that is recorded."""

    step: int  # in which it was taken
    time: float  # then [s]
    member: Member
    then: tuple[float, float, float]  # x, y, heading of the member at that time
    now: tuple[float, float, float]  # the same when its law used it
    laser: LidarModel
    ranges: np.ndarray  # (samples,) [m]
    path: np.ndarray  # remembered, in the frame of the driven axle, (k, 2) [m]


def _scans(now: Instant, step: int, rows: np.ndarray, batch: ScanBatch, seen: Seen, paths: np.ndarray) -> list[_Scan]:
    members, world = now.fleet.members, seen.traffic
    return [
        _Scan(step, world.time, members[i], _pose(world, row), _pose(now.traffic, i), batch.model, ranges, path)
        for i, row, ranges, path in zip(rows.tolist(), seen.rows.tolist(), batch.ranges, paths, strict=True)
    ]


def _pose(traffic: TrafficSnapshot, row: int) -> tuple[float, float, float]:
    return float(traffic.x[row]), float(traffic.y[row]), float(traffic.heading[row])


def _order(one: _Scan) -> tuple[int, str, int, str, bool, str]:
    """By time, platoon and place; of a member, the laser by which it follows comes first."""
    member, name = one.member, one.laser.name
    return one.step, member.platoon, member.place, member.id, name != DEFAULT_NAME, name


class ScanRecorder:
    """Collects scans on disk as they come; `close` makes the archive of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._ranges = (folder / "scans.raw").open("w+b")
        self._paths = (folder / "paths.raw").open("w+b")
        self._points: list[int] = []  # in the remembered path of each scan
        self._any_paths = False
        self._lasers: dict[tuple[str, LidarModel], int] = {}  # by member: number by first scan
        self._rows: list[tuple[float, int, float, float, float, int]] = []  # time, vehicle, x, y, heading, samples
        self._taken: list[_Scan] = []  # not yet written: another laser's scan of an earlier instant may come later
        self._longest = 0  # delay of all lasers [steps]

    def record(self, now: Instant, every: int) -> None:
        """Take each laser's first scan at or after every `every`-th step; to be called in every step."""
        nothing = [NOTHING] * len(now.scans)
        for group, batch, seen, more in zip(
            now.fleet.groups, now.scans, now.seen, now.readings or nothing, strict=True
        ):
            rows, step, self._longest = group.rows, now.step - group.delay, max(self._longest, group.delay)
            if batch is not None and step % every < group.every:
                self._taken += _scans(now, step, rows, batch, seen, self._remembered(group))
            for model, period, delay in group.further_lidars:
                step, self._longest = now.step - delay, max(self._longest, delay)
                if model.name in more.scans and step % every < period:
                    no_paths = np.empty((len(rows), 0, 2))
                    self._taken += _scans(now, step, rows, more.scans[model.name], more.seen[model.name], no_paths)
        self._write_until(now.step - self._longest)

    def _write_until(self, step: float) -> None:
        """Write scans of steps up to one before which none comes any more."""
        early = [one for one in self._taken if one.step <= step]
        self._taken = [one for one in self._taken if one.step > step]
        for one in sorted(early, key=_order):
            self._write(one)

    def _write(self, one: _Scan) -> None:
        member = one.member
        number = self._lasers.setdefault((member.id, one.laser), len(self._lasers))
        self._rows.append((one.time, number, *one.then, len(one.ranges)))
        self._ranges.write(np.ascontiguousarray(one.ranges, dtype="<f4").tobytes())
        points = _in_world(one.path[np.isfinite(one.path).all(axis=1)], *one.now, member.model.axle)
        self._points.append(len(points))
        self._paths.write(np.ascontiguousarray(points.round(3), dtype="<f8").tobytes())

    def _remembered(self, group: Group) -> np.ndarray:
        """Remembered paths in the frames of the driven axles, (n, k, 2) [m]; k = 0 for laws that remember none."""
        path = ask(group.law, group.law.remembered_path, group.memory)
        if path is None:
            return np.empty((len(group.rows), 0, 2))
        self._any_paths = True
        return path

    def flush(self) -> None:
        self._ranges.flush()
        self._paths.flush()

    def close(self) -> None:
        """Make the archive; a second call does nothing."""
        if self._ranges.closed:
            return
        self._write_until(np.inf)
        columns = self._columns()
        streamed = [("ranges_m", self._ranges, "<f4", (int(columns["offset"][-1]),))]
        if self._any_paths:
            columns["path_offset"] = np.concatenate([[0], np.cumsum(self._points)]).astype("<i8")
            streamed.append(("path_m", self._paths, "<f8", (sum(self._points), 2)))
        with self._ranges, self._paths, zipfile.ZipFile(self.folder / NAME, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, column in columns.items():
                with archive.open(_part(name), "w") as part:
                    np.lib.format.write_array(part, np.ascontiguousarray(column), allow_pickle=False)
            for name, file, kind, shape in streamed:
                file.seek(0)
                with archive.open(_part(name), "w", force_zip64=True) as part:
                    header = {"descr": kind, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(part, header)
                    shutil.copyfileobj(file, part, 1 << 20)  # in pieces: all ranges may not fit into memory
        (self.folder / "scans.raw").unlink()
        (self.folder / "paths.raw").unlink()

    def _columns(self) -> dict[str, np.ndarray]:
        """The arrays that fit into memory, by name."""
        time, vehicle, x, y, heading, samples = np.array(self._rows, dtype=float).reshape(-1, 6).T
        lasers = [laser for _, laser in self._lasers]
        return {
            "time_s": time,
            "vehicle": vehicle.astype("<i4"),
            "x_m": x,
            "y_m": y,
            "heading_rad": heading,
            "offset": np.concatenate([[0], np.cumsum(samples)]).astype("<i8"),
            "vehicle_id": np.array([vehicle for vehicle, _ in self._lasers], dtype="<U"),
            "laser": np.array([laser.name for laser in lasers], dtype="<U"),
            "angle_min_rad": np.array([m.angle_min for m in lasers]),
            "angle_max_rad": np.array([m.angle_max for m in lasers]),
            "samples": np.array([m.samples for m in lasers], dtype="<i4"),
            "range_min_m": np.array([m.range_min for m in lasers]),
            "range_max_m": np.array([m.range_max for m in lasers]),
            "rate_hz": np.array([m.rate for m in lasers]),
            "sweep_time_s": np.array([m.sweep_time for m in lasers]),
            "delay_s": np.array([m.delay for m in lasers]),
            "mount_x_m": np.array([m.mount.x for m in lasers]),
            "mount_y_m": np.array([m.mount.y for m in lasers]),
            "mount_yaw_rad": np.array([m.mount.yaw for m in lasers]),
        }


def _part(name: str) -> zipfile.ZipInfo:
    part = zipfile.ZipInfo(f"{name}.npy", _DATE)
    part.compress_type = zipfile.ZIP_DEFLATED
    return part


def _in_world(points: np.ndarray, x: float, y: float, heading: float, axle: float) -> np.ndarray:
    """World coordinates of points (k, 2) that are given in the frame of a vehicle's driven axle, x forward, y left."""
    cos, sin = np.cos(heading), np.sin(heading)
    return (points + np.array([axle, 0.0])) @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
