"""Data of a run for the replay page: a header of names and offsets, and columns of numbers.

Lengths are in steps of 1 mm for robots and 1 cm for cars, from the lower left corner of the road; ranges in steps of
1/2000 of the laser's greatest range. A track is a stretch of a vehicle's rows at successive instants.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from platoontraffic.analysis.following import stretches
from platoontraffic.analysis.reading import ResultsError, inside, read_table
from platoontraffic.analysis.results import Results, Scans
from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.lidar.segments import find_segments
from platoontraffic.replay.columns import Columns
from platoontraffic.replay.instants import config_of, end_of, instants

SMALL = 2.0  # shorter vehicles are robots [m]
ANGLE, TIME, SPEED = 1e-3, 1e-3, 1e-3  # steps [rad, s, m/s]
PATH_STEPS = 5  # step of remembered paths, in steps of other lengths
RANGE_STEPS = 2000  # steps in a laser's greatest range
NOTHING, TOO_NEAR, LOST, FIRST = 0, 1, 2, 3  # codes of ranges; FIRST is 0 m
SIZES = {True: (4.74, 1.80), False: (0.20, 0.15)}  # length and width where a run has no vehicles.csv: car, robot [m]

# Columns of trajectories that the page shows: name in the page, column, step.
MEASURED = (
    ("speed", "speed_mps", SPEED),
    ("acceleration", "accel_mps2", SPEED),
    ("gap", "gap_m", 0.001),
    ("error", "gap_error_m", 0.001),
    ("seenGap", "seen_gap_m", 0.001),
    ("seenBearing", "seen_bearing_rad", 1e-4),
)

# Key figures: metric, heading.
KEY_METRICS = {
    "speed_mean": "mean speed",
    "gap_mean": "mean gap",
    "gap_min": "least gap",
    "gap_error_rms": "spacing error, RMS",
    "time_gap_mean": "time gap",
    "ttc_min": "least TTC",
    "lock_on_ratio": "locked on",
    "lock_losses": "losses",
    "accel_rms": "acceleration, RMS",
    "accel_gain_l2": "acceleration gain",
    "near_misses": "near misses",
    "collisions": "contacts",
}


class NoMembersError(ResultsError):
    """The run has no member to show."""


def packed(results: Results, chosen: str | None = None) -> bytes:
    """All data of the page, compressed.

    chosen: the member that is selected at first; default: the first follower

    raises: ResultsError, NoMembersError, InputError if there is no such member
    """
    columns = Columns()
    members = results.trajectories.drop_duplicates("vehicle_id").sort_values(["platoon_id", "place"], kind="stable")
    if members.empty:
        raise NoMembersError(f"{results.folder}: no member was ever on the road")
    ids = members.vehicle_id.tolist()
    if chosen is not None and chosen not in ids:
        raise InputError(f"--vehicle: no member {chosen!r} in this run{did_you_mean(chosen, ids)}")
    town = _sizes(results, ids)[0].max() >= SMALL
    points = [point for lines in results.scene.values() for line in lines for point in line]
    low = np.floor(np.min(points, axis=0)) if points else np.zeros(2)
    step = 0.01 if town else 0.001
    header = {
        **_facts(results),
        "until": end_of(results),
        "origin": low.tolist(),
        "town": bool(town),
        "scene": {kind: _shape(columns, lines, low, step) for kind, lines in results.scene.items()},
        "members": _members(columns, results, members, low, step),
        "traffic": _traffic(columns, results, low, step),
        "scans": _scans(columns, results, ids, low, step),
        "chosen": chosen or _first_to_look_at(members),
        "events": _events(results),
        "obstacles": _obstacles(results),
        "signals": _signals(results),
        "metrics": _metrics(results),
    }
    return columns.packed(header)


def _facts(results: Results) -> dict[str, Any]:
    """Title and origin of the run; the page does without them if their files cannot be read."""
    package, provenance = (_json(results, name) for name in ("datapackage.json", "provenance.json"))
    resources = {r.get("name"): r for r in package.get("resources", [])}
    return {
        "title": package.get("title") or results.folder.parent.name,
        "run": f"{results.folder.resolve().parent.name}/{results.folder.resolve().name}",
        "seed": provenance.get("seed"),
        "version": provenance.get("version"),
        "kinds": resources.get("events", {}).get("kinds", {}),
        "replayRecordsScans": _replay_records_scans(results),
    }


def _replay_records_scans(results: Results) -> bool:
    """Whether `run --replay` records scans of this scenario; it does not where all members are from the traffic."""
    config = config_of(results)
    return "platoon" in config or "equip" not in config


def _json(results: Results, name: str) -> dict[str, Any]:
    try:
        return json.loads(inside(results.folder, name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _shape(columns: Columns, lines: Sequence[Sequence], low: np.ndarray, step: float) -> dict[str, Any]:
    points = np.array([point[:2] for line in lines for point in line], dtype=float).reshape(-1, 2) - low
    return {
        "lengths": columns.add([len(line) for line in lines]),
        "x": columns.add(points[:, 0], step),
        "y": columns.add(points[:, 1], step),
    }


def _sizes(results: Results, ids: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Length and width of each vehicle [m]."""
    if results.vehicles is None:
        points = np.array([p for ring in results.scene.get("road", []) for p in ring] or [(0, 0)])
        usual = SIZES[bool(np.ptp(points, axis=0).max() > 100)]
        return np.full(len(ids), usual[0]), np.full(len(ids), usual[1])
    known = results.vehicles.drop_duplicates("vehicle_id").set_index("vehicle_id").reindex(ids)
    return known.length_m.fillna(SIZES[True][0]).to_numpy(), known.width_m.fillna(SIZES[True][1]).to_numpy()


def _tracks(columns: Columns, rows: pd.DataFrame, ids: Sequence[str], low: np.ndarray, step: float, times: np.ndarray):
    """The rows sorted by vehicle and time, and the columns of their poses.

    times  : the instants of the rows, and some without rows [s]
    returns: rows, columns by name
    """
    rows = rows.assign(
        vehicle=pd.Index(ids).get_indexer(rows.vehicle_id), instant=np.searchsorted(times, rows.time_s)
    ).sort_values(["vehicle", "instant"], kind="stable")
    vehicle, instant = rows.vehicle.to_numpy(), rows.instant.to_numpy()
    begins = np.flatnonzero((np.diff(vehicle, prepend=-1) != 0) | (np.diff(instant, prepend=-9) != 1))
    heading = rows.heading_rad.to_numpy()
    turn = np.diff(heading, prepend=0.0)
    turn -= 2 * np.pi * np.rint(turn / (2 * np.pi))
    turn[begins] = heading[begins]
    along = np.cumsum(turn)  # not wrapped within a track, because the page interpolates
    base = along[begins] - heading[begins]
    heading = along - np.repeat(base, np.diff(np.append(begins, len(rows))))
    return rows, {
        "times": columns.add(times, TIME),
        "vehicle": columns.add(vehicle[begins]),
        "first": columns.add(instant[begins]),
        "begin": columns.add(np.append(begins, len(rows))),
        "x": columns.add(rows.x_m.to_numpy() - low[0], step),
        "y": columns.add(rows.y_m.to_numpy() - low[1], step),
        "heading": columns.add(heading, ANGLE),
    }


def _members(columns: Columns, results: Results, members: pd.DataFrame, low: np.ndarray, step: float) -> dict:
    ids = members.vehicle_id.tolist()
    times = instants(results, results.trajectories, "every_s")
    rows, written = _tracks(columns, results.trajectories, ids, low, step, times)
    length, width = _sizes(results, ids)
    laser_x, laser_y, laser_yaw = _lasers(results, ids, length)
    target = rows.target_id.fillna("") if "target_id" in rows else pd.Series("", index=rows.index)
    targets = [t for t in target.unique() if t]
    return {
        "ids": ids,
        "platoons": members.platoon_id.tolist(),
        "places": members.place.tolist(),
        "predecessors": _predecessors(results, members),
        "length": columns.add(length, 0.001),
        "width": columns.add(width, 0.001),
        "laserX": columns.add(laser_x, 1e-4),
        "laserY": columns.add(laser_y, 1e-4),
        "laserYaw": columns.add(laser_yaw, 1e-4),
        **written,
        **{name: columns.add(rows[c].to_numpy(dtype=float), step) for name, c, step in MEASURED if c in rows},
        "targets": targets,
        "target": columns.add(pd.Index(targets).get_indexer(target) if targets else np.full(len(rows), -1.0)),
    }


def _predecessors(results: Results, members: pd.DataFrame) -> list[list[tuple[float, float | None, int]]]:
    """Begin, end and number of each predecessor of each member, by time; an end of None is that of the run [s]."""
    places = {m.vehicle_id: (m.platoon_id, m.place) for m in members.itertuples()}
    number, start, end = {v: i for i, v in enumerate(places)}, results.trajectories.time_s.min(), end_of(results)
    return [
        [
            (max(one.begin, start), None if one.end >= end else one.end, number[one.ahead])
            for one in own
            if one.ahead in number
        ]
        for own in stretches(places, results.events, end).values()
    ]


def _lasers(results: Results, ids: Sequence[str], length: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position of each laser from the centre, ahead and to the left [m], and yaw [rad]; by default at the bumper."""
    lasers = np.full((len(ids), 3), np.nan)
    if results.vehicles is not None:
        known = results.vehicles.drop_duplicates("vehicle_id").set_index("vehicle_id").reindex(ids)
        lasers = known[["laser_x_m", "laser_y_m", "laser_yaw_rad"]].to_numpy(dtype=float)
    x = np.where(np.isnan(lasers[:, 0]), length / 2, lasers[:, 0])
    return x, np.nan_to_num(lasers[:, 1]), np.nan_to_num(lasers[:, 2])


def _traffic(columns: Columns, results: Results, low: np.ndarray, step: float) -> dict[str, Any] | None:
    if results.traffic is None:
        return None
    ids = results.traffic.vehicle_id.drop_duplicates().tolist()
    times = instants(results, results.traffic, "traffic_every_s")
    rows, written = _tracks(columns, results.traffic, ids, low, step, times)
    length, width = _sizes(results, ids)
    return {
        "ids": ids,
        "length": columns.add(length, 0.001),
        "width": columns.add(width, 0.001),
        **written,
        "speed": columns.add(rows.speed_mps.to_numpy(), 0.05),
    }


def _scans(columns: Columns, results: Results, ids: Sequence[str], low: np.ndarray, step: float) -> dict | None:
    scans = results.scans
    if scans is None:
        return None
    order = np.lexsort((scans.time_s, scans.vehicle))  # compresses well; the page reads by vehicle
    order = order[scans.following[scans.vehicle[order]]]
    written = [_range_steps(scans.ranges(i), scans.range_max_m[scans.vehicle[i]] / RANGE_STEPS) for i in order]
    member = pd.Index(ids).get_indexer(scans.vehicle_id)
    increment = (scans.angle_max_rad - scans.angle_min_rad) / np.maximum(scans.samples - 1, 1)
    return {
        "path": _paths(columns, scans, order, low, step),
        "member": columns.add(member),
        "samples": columns.add(scans.samples),
        "angleMin": scans.angle_min_rad.tolist(),
        "increment": increment.tolist(),
        "rangeMin": scans.range_min_m.tolist(),
        "rangeMax": scans.range_max_m.tolist(),
        "mountX": scans.mount_x_m.tolist(),
        "mountY": scans.mount_y_m.tolist(),
        "mountYaw": scans.mount_yaw_rad.tolist(),
        "rangeSteps": RANGE_STEPS,
        "laser": columns.add(scans.vehicle[order]),
        "time": columns.add(scans.time_s[order], TIME),
        "x": columns.add(scans.x_m[order] - low[0], step),
        "y": columns.add(scans.y_m[order] - low[1], step),
        "heading": columns.add(scans.heading_rad[order], ANGLE),
        "ranges": columns.add(np.concatenate([*written, np.empty(0)])),
        **_segment_columns(columns, scans, order),
    }


def _segment_columns(columns: Columns, scans: Scans, order: np.ndarray) -> dict[str, Any]:
    """The groups of returns of each scan, in the order of the scans."""
    groups = _segments(scans)
    first, last = ([groups[i][end] for i in order] for end in (0, 1))
    return {
        "segments": columns.add(np.concatenate([[0], np.cumsum([len(beams) for beams in first])])),
        "segmentFirst": columns.add(np.concatenate([*first, np.empty(0)])),
        "segmentLast": columns.add(np.concatenate([*last, np.empty(0)])),
    }


def _paths(columns: Columns, scans: Scans, order: np.ndarray, low: np.ndarray, step: float) -> dict | None:
    """The paths that laws remembered at their scans, in the order of the scans."""
    if scans.path_offset is None:
        return None
    begins, ends = scans.path_offset[order], scans.path_offset[order + 1]
    rows = np.concatenate([*map(np.arange, begins, ends), np.empty(0, dtype=int)])
    return {
        "offset": columns.add(np.concatenate([[0], np.cumsum(ends - begins)])),
        "x": columns.add(scans.path_m[rows, 0] - low[0], PATH_STEPS * step),
        "y": columns.add(scans.path_m[rows, 1] - low[1], PATH_STEPS * step),
    }


def _range_steps(ranges: np.ndarray, step: float) -> np.ndarray:
    finite = np.isfinite(ranges)
    steps = FIRST + np.rint(np.where(finite, ranges, 0.0) / step)
    return np.select([finite, ranges == np.inf, ranges == -np.inf], [steps, NOTHING, TOO_NEAR], LOST)


def _segments(scans: Scans) -> list[tuple[np.ndarray, np.ndarray]]:
    """First and last beam of every group of returns, by scan."""
    groups: list[tuple[np.ndarray, np.ndarray]] = [(np.empty(0), np.empty(0))] * len(scans)
    kinds: dict[tuple, list[int]] = {}
    names = ("samples", "angle_min_rad", "angle_max_rad", "range_min_m", "range_max_m")
    for v in range(len(scans.vehicle_id)):
        kinds.setdefault(tuple(getattr(scans, name)[v].item() for name in names), []).append(v)
    for kind, vehicles in kinds.items():
        rows = np.flatnonzero(np.isin(scans.vehicle, vehicles))
        model = LidarModel(*kind)
        ranges = scans.ranges_m[(scans.offset[rows][:, None] + np.arange(model.samples))]
        batch = ScanBatch(model, 0.0, tuple(map(str, rows)), ranges, None, np.zeros(len(rows), dtype=bool))
        try:
            found = find_segments(batch)
        except ValueError:  # too few beams to bridge lost ones or to form a group
            continue
        for row, i in enumerate(rows):
            own = found.of(row)
            groups[i] = found.first[own], found.last[own]
    return groups


def _first_to_look_at(members: pd.DataFrame) -> str:
    """The first follower of the largest platoon, or the leader if that has no follower."""
    followers = members[members.place > 0]  # those in no platoon have place 0
    largest = (members if followers.empty else followers).groupby("platoon_id", sort=False).size().idxmax()
    platoon = members[members.platoon_id == largest]
    return platoon.vehicle_id.iloc[min(1, len(platoon) - 1)]


def _events(results: Results) -> list[list]:
    """Rows: time, kind, vehicle, other, x, y, duration, detail."""
    table = results.events.reindex(
        columns=["time_s", "kind", "vehicle_id", "other_id", "x_m", "y_m", "duration_s", "detail"]
    )
    texts = ["kind", "vehicle_id", "other_id", "detail"]
    table[texts] = table[texts].fillna("").astype(str)
    numbers = ["x_m", "y_m", "duration_s"]
    table[numbers] = table[numbers].astype(float)
    return [[None if v != v else v for v in row] for row in table.to_numpy(dtype=object).tolist()]


def _signals(results: Results) -> dict[str, Any] | None:
    """Light and link of each stop line of the scene, and for each light the times and states; None: not recorded."""
    file = inside(results.folder, "sumo_signals.csv")
    if not results.scene.get("signals") or not file.is_file():
        return None
    table = read_table(file, ("time_s", "signal_id", "state"), ("signal_id", "state"))
    features = _json(results, "scene.geojson")["features"]
    links = next(f["properties"]["links"] for f in features if f["properties"]["kind"] == "signals")
    states = {light: [own.time_s.tolist(), own.state.tolist()] for light, own in table.groupby("signal_id")}
    return {"links": links, "states": states}


def _obstacles(results: Results) -> list[tuple[str, str]]:
    """Id and kind of each obstacle."""
    rows = results.events[results.events.kind == "obstacle"]
    kinds = rows.what.fillna("obstacle") if "what" in rows else ["obstacle"] * len(rows)
    return list(zip(rows.vehicle_id, kinds, strict=True))


def _metrics(results: Results) -> dict[str, Any]:
    """Key figures: headings, units, and a row a member."""
    table = results.metrics[(results.metrics.scope == "vehicle") & results.metrics.metric.isin(KEY_METRICS)]
    table = table[np.isfinite(table.value)]
    units = table.drop_duplicates("metric").set_index("metric").reindex(columns=["unit"]).unit.fillna("").to_dict()
    names = [name for name in KEY_METRICS if name in units]
    rows: dict[str, list] = {v: [None] * len(names) for v in table.vehicle_id.unique()}
    for vehicle, name, value in table[["vehicle_id", "metric", "value"]].itertuples(index=False):
        rows[vehicle][names.index(name)] = float(f"{value:.4g}")
    return {"headings": [[KEY_METRICS[name], units[name], name] for name in names], "rows": rows}
