"""Metrics of a run, computed from the tables that it recorded and nothing else.

vehicle scope (followers only where a predecessor is needed):

gap_mean, gap_min, gap_max    of gap_m over the recorded instants
gap_error_rms                 root mean square of gap_error_m
time_gap_median               of time_gap_s; a mean would be that of the slowest instants
cross_track_rms, _max         of |cross_track_m|
right_lane_share              share of the recorded instants with a defined right_of_middle_m at which it is positive
lock_on_ratio                 share of the time from the first lock to the end in which the law's target was its true
                              predecessor, by the events, that is of all steps; 0 if it was never locked
lock_losses, lock_loss_longest  number and longest duration of the losses, the last one up to the end
lost_for_good                 time of the loss that lasted to the end; none if there was no such loss
standstill_share              share of the run spent in standstills of more than 10 s
collisions                    episodes of contact with a vehicle or a wall
laps                          |turned_rad| / 2 pi at the end; corners are its quarters, the last counted from 80 deg
distance                      length of the driven path of the centre
speed_mean                    of speed_mps

platoon and run scope: the worst, the mean or the sum over the members, as the name says.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.observation import STANDSTILL_AFTER


class Metric(NamedTuple):
    scope: str
    platoon: str
    vehicle: str
    name: str
    value: float
    unit: str


def compute(trajectories: pd.DataFrame, events: pd.DataFrame) -> list[Metric]:
    """All metrics of a run.

    trajectories, events: the tables of the files of those names
    """
    end = float(events.loc[events.kind == "end", "time_s"].iloc[0])
    start = float(trajectories.time_s.min())
    metrics: list[Metric] = []
    for (platoon, place, vehicle), rows in trajectories.groupby(["platoon_id", "place", "vehicle_id"]):
        own = events[events.vehicle_id == vehicle]
        collisions = events[
            (events.kind == "collision") & ((events.vehicle_id == vehicle) | (events.other_id == vehicle))
        ]
        values = {**_motion(rows), **_standing(own, start, end), ("collisions", ""): float(len(collisions))}
        if place > 0:
            values |= _following(rows) | _locking(own, end)
        metrics += [Metric("vehicle", platoon, vehicle, name, value, unit) for (name, unit), value in values.items()]
    for platoon in trajectories.platoon_id.unique():
        mine = [m for m in metrics if m.scope == "vehicle" and m.platoon == platoon]
        metrics += [Metric("platoon", platoon, "", *m) for m in _together(mine, trajectories, events, platoon)]
    members = [m for m in metrics if m.scope == "vehicle"]
    metrics += [Metric("run", "", "", *m) for m in _together(members, trajectories, events, None)]
    metrics.append(Metric("run", "", "", "duration", end - start, "s"))
    return metrics


def _motion(rows: pd.DataFrame) -> dict[tuple[str, str], float]:
    laps = abs(rows.turned_rad.iloc[-1]) / (2 * math.pi)
    right = rows.right_of_middle_m.dropna()
    return {
        ("laps", ""): laps,
        ("corners", ""): float(math.floor(4 * laps + 10 / 90)),
        ("distance", "m"): float(np.hypot(rows.x_m.diff(), rows.y_m.diff()).sum()),
        ("speed_mean", "m/s"): rows.speed_mps.mean(),
        ("right_lane_share", ""): (right > 0).mean() if len(right) else math.nan,
    }


def _standing(own: pd.DataFrame, start: float, end: float) -> dict[tuple[str, str], float]:
    began = own.loc[own.kind == "standstill", "time_s"]
    ended = own.loc[own.kind == "standstill_end", "duration_s"]
    last = end - began.iloc[-1] + STANDSTILL_AFTER if len(began) > len(ended) else 0.0
    share = (ended.sum() + last) / (end - start)
    return {("standstills", ""): float(len(began)), ("standstill_share", ""): share}


def _collisions(events: pd.DataFrame, vehicles: Collection[str]) -> float:
    involved = events.vehicle_id.isin(vehicles) | events.other_id.isin(vehicles)
    return float((involved & (events.kind == "collision")).sum())


def _following(rows: pd.DataFrame) -> dict[tuple[str, str], float]:
    return {
        ("gap_mean", "m"): rows.gap_m.mean(),
        ("gap_min", "m"): rows.gap_m.min(),
        ("gap_max", "m"): rows.gap_m.max(),
        ("gap_error_rms", "m"): _rms(rows.gap_error_m),
        ("time_gap_median", "s"): rows.time_gap_s.median(),
        ("cross_track_rms", "m"): _rms(rows.cross_track_m),
        ("cross_track_max", "m"): rows.cross_track_m.abs().max(),
    }


def _locking(own: pd.DataFrame, end: float) -> dict[tuple[str, str], float]:
    first = own.loc[own.kind == "locked", "time_s"]
    lost = own.loc[own.kind == "lock_lost", "time_s"].to_list()
    regained = own.loc[own.kind == "lock_regained", "time_s"].to_list()
    losses = [b - a for a, b in zip(lost, [*regained, end][: len(lost)], strict=True)]
    for_good = lost[-1] if len(lost) > len(regained) else math.nan
    since = end - first.iloc[0] if len(first) else 0.0
    return {
        ("lock_on_ratio", ""): 1 - sum(losses) / since if since else 0.0,
        ("lock_losses", ""): float(len(losses)),
        ("lock_loss_longest", "s"): max(losses, default=0.0),
        ("lost_for_good", "s"): for_good,
    }


def _together(members: list[Metric], trajectories: pd.DataFrame, events: pd.DataFrame, platoon: str | None):
    """Metrics of several members: (name, value, unit)."""

    def over(name: str, how) -> float:
        values = [m.value for m in members if m.name == name and not math.isnan(m.value)]
        return float(how(values)) if values else math.nan

    ids = {m.vehicle for m in members}
    rows = trajectories if platoon is None else trajectories[trajectories.platoon_id == platoon]
    leader = rows[rows.place == 0].right_of_middle_m.dropna()
    yield "members", float(len(ids)), ""
    yield "collisions", _collisions(events, ids), ""
    yield "laps_min", over("laps", min), ""
    yield "corners_min", over("corners", min), ""
    yield "gap_min", over("gap_min", min), "m"
    yield "gap_max", over("gap_max", max), "m"
    yield "gap_mean", over("gap_mean", np.mean), "m"
    yield "gap_error_rms_max", over("gap_error_rms", max), "m"
    yield "cross_track_max", over("cross_track_max", max), "m"
    yield "lock_on_ratio_min", over("lock_on_ratio", min), ""
    yield "lock_losses", over("lock_losses", sum), ""
    yield "lost_for_good_first", over("lost_for_good", min), "s"
    yield "standstill_share_mean", over("standstill_share", np.mean), ""
    yield "leader_right_lane_share", (leader > 0).mean() if len(leader) else math.nan, ""
    yield "right_lane_share_min", over("right_lane_share", min), ""


def _rms(values: pd.Series) -> float:
    values = values.dropna()
    return float(np.sqrt((values**2).mean())) if len(values) else math.nan


def summary(name: str, seed: int, varied: dict[str, Any], metrics: list[Metric]) -> str:
    """summary.csv: one row with the run, what its arguments varied, and every metric of scope 'run'."""
    row: dict[str, Any] = {"scenario": name, "seed": seed, **varied}
    for metric in metrics:
        if metric.scope == "run":
            unit = metric.unit.replace("/", "p")
            row[f"{metric.name}_{unit}" if unit else metric.name] = metric.value
    return pd.DataFrame([row]).to_csv(index=False, float_format="%.9g", lineterminator="\n")
