"""Made-up folders of finished runs: a ring road, a platoon, background traffic, and scans by the real lidar."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd

from platoontraffic.lidar import PRESETS, Boxes, Carriers, Mount, Occasion, Scene, scan

RADIUS, LENGTH, WIDTH, SPEED = 120.0, 4.74, 1.80, 10.0
LASER = LENGTH / 2 - 0.4  # behind the front bumper
GAP = 12.0
REMEMBERED = 32  # points in a follower's remembered path to its predecessor
SPACING = (GAP + LENGTH) / RADIUS  # of members on the ring [rad]
EVIL = "<script>alert(1)</script>"


def angle(place: np.ndarray | float, time: np.ndarray | float):
    """Polar angle of a member on the ring [rad]."""
    return 0.5 - place * SPACING + time * SPEED / RADIUS


def pose(angle, radius=RADIUS):
    heading = angle + math.pi / 2
    return radius * np.cos(angle), radius * np.sin(angle), np.mod(heading + np.pi, 2 * np.pi) - np.pi


def made_run(
    folder: Path,
    *,
    members: int = 3,
    others: int = 20,
    seconds: float = 20.0,
    every: float = 0.1,
    traffic_every: float | None = 0.5,
    scans_every: float | None = 0.5,
    platoon: str = "platoon",
    other: str = EVIL,
) -> Path:
    """A run on one lane of the ring, with background traffic on the lanes beside.

    platoon : its id
    other   : id of the first background vehicle; the target of the second member from 10 s to 12 s, instead of its
              predecessor
    """
    folder.mkdir(parents=True)
    ids = [f"{platoon}.{place}" for place in range(members)]
    strangers = [other, *(f"car.{i}" for i in range(1, others))][:others]
    _trajectories(folder, platoon, ids, other, seconds, every)
    _events(folder, ids, other, seconds)
    _metrics(folder, platoon, ids)
    _vehicles(folder, platoon, ids, strangers if traffic_every else [])
    if traffic_every:
        _traffic(folder, strangers, seconds, traffic_every)
    if scans_every:
        _scans(folder, ids, others, seconds, scans_every)
    _scene(folder)
    kinds = {"lock_lost": "the law no longer takes its true predecessor for it"}
    resources = [{"name": "events", "path": "events.csv", "kinds": kinds}]
    package = {"title": f"A ring & {EVIL}", "resources": resources}
    (folder / "datapackage.json").write_text(json.dumps(package))
    (folder / "provenance.json").write_text(json.dumps({"seed": 1, "version": "0"}))
    (folder / "DONE").touch()
    return folder


def _times(seconds: float, every: float) -> np.ndarray:
    return np.round(np.arange(round(seconds / every) + 1) * every, 6)


def _trajectories(folder: Path, platoon: str, ids: list[str], other: str, seconds: float, every: float) -> None:
    times = _times(seconds, every)
    time, place = (grid.ravel() for grid in np.meshgrid(times, np.arange(len(ids)), indexing="ij"))
    x, y, heading = pose(angle(place, time))
    follows = place > 0
    lost = (place == 1) & (time >= 10) & (time < 12)
    names = np.array(ids, dtype=object)
    pd.DataFrame(
        {
            "time_s": time,
            "platoon_id": platoon,
            "vehicle_id": names[place],
            "place": place,
            "x_m": x,
            "y_m": y,
            "heading_rad": heading,
            "speed_mps": SPEED + 0.5 * np.sin(time + place),
            "accel_mps2": 0.5 * np.cos(time + place),
            "yaw_rate_radps": SPEED / RADIUS,
            "lateral_accel_mps2": SPEED**2 / RADIUS,
            "gap_m": np.where(follows, GAP + 0.2 * np.sin(time / 3 + place), np.nan),
            "gap_error_m": np.where(follows, 0.2 * np.sin(time / 3 + place), np.nan),
            "seen_gap_m": np.where(follows, GAP, np.nan),
            "seen_bearing_rad": np.where(follows, SPACING / 2, np.nan),
            "target_id": np.where(lost, other, np.where(follows, names[np.maximum(place - 1, 0)], "")),
        }
    ).to_csv(folder / "trajectories.csv", index=False, float_format="%.6f")


def _events(folder: Path, ids: list[str], other: str, seconds: float) -> None:
    rows = [(0.0, "departed", name, "", np.nan, "") for name in ids]
    if seconds > 12 and len(ids) > 1:
        rows += [
            (10.0, "lock_lost", ids[1], "", np.nan, "out of sight"),
            (10.0, "wrong_target", ids[1], other, np.nan, ""),
            (12.0, "lock_regained", ids[1], ids[0], 2.0, ""),
            (13.5, "collision", ids[-1], "wall", np.nan, ""),
        ]
    rows.append((seconds, "end", "", "", np.nan, "duration"))
    table = pd.DataFrame(rows, columns=["time_s", "kind", "vehicle_id", "other_id", "duration_s", "detail"])
    place = [ids.index(v) if v in ids else np.nan for v in table.vehicle_id]
    table["x_m"], table["y_m"], _ = pose(angle(np.array(place), table.time_s.to_numpy()))
    table.to_csv(folder / "events.csv", index=False)


def _metrics(folder: Path, platoon: str, ids: list[str]) -> None:
    rows = [("vehicle", platoon, name, "gap_mean", GAP, "m") for name in ids[1:]]
    rows += [("run", "", "", "collisions", 1.0, ""), ("run", "", "", "duration", 20.0, "s")]
    columns = ["scope", "platoon_id", "vehicle_id", "metric", "value", "unit"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "metrics.csv", index=False)


def _vehicles(folder: Path, platoon: str, ids: list[str], strangers: list[str]) -> None:
    n, m = len(ids), len(strangers)
    pd.DataFrame(
        {
            "vehicle_id": [*ids, *strangers],
            "platoon_id": [platoon] * n + [""] * m,
            "place": [*range(n), *[None] * m],
            "length_m": LENGTH,
            "width_m": WIDTH,
            "laser_x_m": [LASER] * n + [None] * m,
            "laser_y_m": [0.0] * n + [None] * m,
            "laser_yaw_rad": [0.0] * n + [None] * m,
        }
    ).to_csv(folder / "vehicles.csv", index=False)


def other_pose(i, time, others: int):
    """Pose of the i-th background vehicle: on four lanes beside the platoon's, faster or slower."""
    lane = np.asarray(i) % 4
    radius = RADIUS + 3.6 * (lane + 1)
    return pose(2 * np.pi * np.asarray(i) / others + time * (8 + lane) / radius, radius)


def _traffic(folder: Path, strangers: list[str], seconds: float, every: float) -> None:
    n = len(strangers)
    time, i = (g.ravel() for g in np.meshgrid(_times(seconds, every), np.arange(n), indexing="ij"))
    x, y, heading = other_pose(i, time, n)
    names = np.array(strangers, dtype=object)
    columns = {"time_s": time, "vehicle_id": names[i], "x_m": x, "y_m": y, "heading_rad": heading}
    table = pd.DataFrame({**columns, "speed_mps": 8.0 + i % 4})
    table.to_csv(folder / "traffic.csv", index=False, float_format="%.6f")


def _scans(folder: Path, ids: list[str], others: int, seconds: float, every: float) -> None:
    n = len(ids)
    laser = PRESETS["car-follower"]
    mount = Mount(LASER)
    model = type(laser)(720, -0.14, 0.14, 0.3, 30.0, 10.0, mount, laser.noise)
    rows, ranges, paths = [], [], []
    for number, time in enumerate(_times(seconds, every)):
        own, strange = pose(angle(np.arange(n), time)), other_pose(np.arange(others), time, max(others, 1))
        x, y, heading = (np.concatenate(both) for both in zip(own, strange, strict=True))
        sizes = np.full(n + others, LENGTH), np.full(n + others, WIDTH)
        batch = scan(
            model, Scene.from_shapely(), Boxes(x, y, heading, *sizes, np.arange(n + others)),
            Carriers(*own, np.arange(n), ids), Occasion(number=number),
        )  # fmt: skip
        rows += [(time, v, own[0][v], own[1][v], own[2][v]) for v in range(n)]
        ranges.append(batch.ranges)
        for v in range(1, n):
            along = angle(v, time) + np.linspace(0, SPACING, REMEMBERED)
            paths.append(np.column_stack(pose(along)[:2]))
    time, vehicle, x, y, heading = np.array(rows).T
    np.savez_compressed(
        folder / "scans.npz",
        time_s=time, vehicle=vehicle.astype(int), x_m=x, y_m=y, heading_rad=heading,
        offset=np.arange(len(rows) + 1) * model.samples,
        ranges_m=np.concatenate([batch.ravel() for batch in ranges]),
        path_offset=np.concatenate([[0], np.cumsum(np.where(vehicle > 0, REMEMBERED, 0))]),
        path_m=np.concatenate([*paths, np.empty((0, 2))]),
        vehicle_id=np.array(ids),
        angle_min_rad=np.full(n, model.angle_min), angle_max_rad=np.full(n, model.angle_max),
        samples=np.full(n, model.samples), range_min_m=np.full(n, model.range_min),
        range_max_m=np.full(n, model.range_max), rate_hz=np.full(n, model.rate),
        mount_x_m=np.full(n, mount.x), mount_y_m=np.full(n, mount.y), mount_yaw_rad=np.full(n, mount.yaw),
    )  # fmt: skip


def _scene(folder: Path) -> None:
    def ring(radius: float) -> list[list[float]]:
        turns = np.linspace(0, 2 * np.pi, 181)
        return np.round(np.column_stack([radius * np.cos(turns), radius * np.sin(turns)]), 3).tolist()

    shapes = {
        "road": ("Polygon", [ring(RADIUS + 17), ring(RADIUS - 2)]),
        "junctions": ("MultiPolygon", []),
        "lanes": ("MultiLineString", [ring(RADIUS + 1.8 + 3.6 * i) for i in range(4)]),
        "middle": ("MultiLineString", []),
        "walls": ("MultiLineString", []),
        "buildings": ("Polygon", [[[-30, -30], [30, -30], [30, 30], [-30, 30], [-30, -30]]]),
    }
    features = [
        {"type": "Feature", "properties": {"kind": kind}, "geometry": {"type": t, "coordinates": coordinates}}
        for kind, (t, coordinates) in shapes.items()
    ]
    (folder / "scene.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def made_batch(folder: Path, varied: dict[str, list], *, seeds: int = 3, failed: int = 1, waiting: int = 1) -> Path:
    """A batch whose first runs failed because of EVIL, and whose last ones are not done.

    gap_mean_m is ten times the number of the point, plus the seed; collisions are the same in all.
    """
    folder.mkdir(parents=True)
    points = list(itertools.product(*varied.values()))
    rows = [(f"run{i}-s{seed}", seed, *point) for i, point in enumerate(points) for seed in range(1, seeds + 1)]
    states = ["failed"] * failed + ["done"] * (len(rows) - failed - waiting) + ["waiting"] * waiting
    runs = pd.DataFrame(rows, columns=["id", "seed", *varied])
    runs.insert(1, "status", states)
    runs["error"] = [f"{EVIL} is not a number" if state == "failed" else "" for state in states]
    runs["wall_s"] = 1.0
    runs.to_csv(folder / "runs.csv", index=False)
    done = pd.DataFrame(rows, columns=["id", "seed", *varied])
    done["collisions"] = 0
    done["gap_mean_m"] = [10.0 * points.index(tuple(point)) + seed for _, seed, *point in rows]
    done[[state == "done" for state in states]].to_csv(folder / "summary.csv", index=False)
    fields = [{"name": "gap_mean_m", "unit": "m"}, {"name": "collisions", "unit": ""}]
    resources = [{"name": n, "format": "csv", "schema": {"fields": fields}} for n in ("runs", "summary")]
    (folder / "datapackage.json").write_text(json.dumps({"title": f"A study of {EVIL}", "resources": resources}))
    (folder / "study.toml").write_text('base = "paper_loop"\n')
    return folder
