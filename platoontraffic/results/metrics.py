"""Metrics of a run, computed from the tables that it recorded and nothing else.

A member's time is that from its event `departed` to `arrived`, or to the end. A recorded instant stands for the time up
to the member's next one where a duration is asked for.

Platoon and run scope: the worst, the mean or the sum over the members, as the name says; of tet and tit the sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.results.following import Stretch, lengths, split_off, stretches, within
from platoontraffic.world.events import STANDSTILL_AFTER, WALL

EXPOSED = 3.0  # a shorter time to collision is dangerous [s]
ENOUGH_BEAMS = 5  # on a predecessor, for a law to make something of it
STEADY = 0.05  # a speed that deviates less tells nothing of a string's stability, RMS [m/s]
MOVING = 0.1  # of the mean speed: slower is hardly moving

OBSTACLES = {
    "car": "obstacles that are cars",
    "cut_in": "who has cut in",
    "pedestrian": "obstacles that are pedestrians",
    "box": "boxes",
    "robot": "obstacles that are robots",
    "person": "SUMO's own pedestrians",
}

MEANINGS = {
    "laps": "|turned_rad| / 2 pi at the end",
    "corners": "quarters of laps, the last counted from 80 deg",
    "distance": "length of the driven path of the centre",
    "speed_mean": "of speed_mps",
    "accel_rms": "root mean square of accel_mps2",
    "jerk_rms": "root mean square of jerk_mps3",
    "jerk_max": "of |jerk_mps3|",
    "right_lane_share": "share of the recorded instants with a defined right_of_middle_m at which it is positive",
    "standstills": "events standstill",
    "standstill_share": "share of its time spent in standstills of more than 10 s",
    "off_road_share": "share of its time off the road, by the events, that is of all steps",
    "collisions": "episodes of contact with a vehicle or a wall",
    "collisions_caused": "those of them in which it was not struck from behind, nor another changed lanes into its way",
    "red_lights": "events red_light",
    "failures_to_yield": "events failed_to_yield",
    "held_share": "share of its time spent held before closed lines, by the events",
    "hard_brakings": "events emergency_brake",
    # of followers only
    "gap_mean": "of gap_m over the recorded instants",
    "gap_min": "of gap_m over the recorded instants",
    "gap_max": "of gap_m over the recorded instants",
    "gap_error_rms": "root mean square of gap_error_m",
    "time_gap_median": "of time_gap_s; its mean over all instants would be that of the slowest",
    "time_gap_mean": "of time_gap_s where it drives faster than a tenth of its speed_mean",
    "time_gap_min": "of time_gap_s where it drives faster than a tenth of its speed_mean",
    "cross_track_rms": "root mean square of cross_track_m",
    "cross_track_max": "of |cross_track_m|",
    "lock_on_ratio": "share of the time from the first lock to the end in which the law's target was its true "
    "predecessor, by the events, that is of all steps; 0 if it was never locked",
    "lock_losses": "number of losses of lock",
    "lock_loss_longest": "longest loss of lock, the last one up to the end",
    "lost_for_good": "time of the loss that lasted to the end; none if there was no such loss",
    "splits": "events split",
    "rejoin_time_mean": "of the splits after which it rejoined, from their begin",
    "rejoin_time_longest": "the longest of these",
    "in_platoon_share": "share of its time as a follower, while its predecessor is on the road, in which it was not "
    "split off; told to split off it is that, and after it has left it follows nobody",
    "in_platoon_distance": "driven in that time",
    "steal_share": "share of the recorded instants at which the law's target was a vehicle of no platoon of the run",
    "lock_on_seen": "share of the recorded instants, with 5 beams or more on the predecessor and not split off, at "
    "which that was the law's target",
    "ttc_min": "of ttc_s",
    "tet": "time exposed to a ttc_s below 3 s",
    "tit": "integral of 3 s - ttc_s over that time",
    "drac_max": "of drac_mps2",
    "near_misses": "events near_miss",
    "occluded_share_mean": "of occluded_share",
    "beams_share5": "share of the recorded instants with a beams_on_predecessor at which it is 5 or more",
    "speed_gain_l2": "root mean square of its speed's deviation from its mean, over that of the member ahead; over the "
    "instants of both; none where the member ahead deviates by less than 0.05 m/s (root mean square). Above 1, the "
    "string of vehicles amplifies",
    "speed_gain_linf": "the same of the largest deviations",
    # of platoons and runs only
    "members": "how many they are",
    "head_to_tail_l2": "of a platoon: speed_gain_l2 of the last member over the first; of a run: the largest",
    "leader_right_lane_share": "right_lane_share of the leaders, all instants together",
    # of runs with obstacles only
    "cut_ins": "events cut_in",
    "cut_in_gap_min": "least gap to who has cut in, in the 10 s after",
    "cut_in_ttc_min": "least time to collision with who has cut in, in the 10 s after",
    "steps_out": "events steps_out",
    "step_out_gap_min": "least distance to a pedestrian who has stepped out, in the 10 s after",
    "unavoidable": "cut-ins and steps out for which no braking is enough",
    "avoidable_contacts": "contacts in the 10 s after one that could be avoided",
    **{f"collisions_{kind}": f"episodes of contact with {what}" for kind, what in OBSTACLES.items()},
    "duration": "from the first recorded instant to the end",
}
_OVER_MEMBERS = {"_max": "largest", "_min": "least", "_mean": "mean", "_first": "earliest"}


def meaning(name: str) -> str:
    """Of a metric, over members too; empty if it is none of this module."""
    for suffix, word in _OVER_MEMBERS.items():
        if name not in MEANINGS and (base := name.removesuffix(suffix)) in MEANINGS:
            return f"the members' {word} {base}: {MEANINGS[base]}"
    return MEANINGS.get(name, "")


class Metric(NamedTuple):
    scope: str
    platoon: str
    vehicle: str
    name: str
    value: float
    unit: str


def of_obstacles(encounters: pd.DataFrame, events: pd.DataFrame) -> list[Metric]:
    """Metrics of a run with obstacles; encounters, events: the tables of the files of those names."""
    came = events[events.kind == "obstacle"]
    kinds = {obstacle.vehicle_id: obstacle.what for obstacle in came.itertuples()}
    hit = events.loc[events.kind == "collision", "other_id"].astype(str)
    hit = hit.map(kinds).where(~hit.str.startswith("person."), "person")
    cut_ins, steps = (encounters[encounters.kind == kind] for kind in ("cut_in", "pedestrian"))
    values = [
        ("cut_ins", float(len(cut_ins)), ""),
        ("cut_in_gap_min", cut_ins.gap_min_m.min(), "m"),
        ("cut_in_ttc_min", cut_ins.ttc_min_s.min(), "s"),
        ("steps_out", float(len(steps)), ""),
        ("step_out_gap_min", steps.gap_min_m.min(), "m"),
        ("unavoidable", float((encounters.avoidable == 0).sum()), ""),
        ("avoidable_contacts", float(((encounters.avoidable == 1) & (encounters.contact == 1)).sum()), ""),
        *((f"collisions_{kind}", float((hit == kind).sum()), "") for kind in OBSTACLES),
    ]
    return [Metric("run", "", "", *value) for value in values]


Values = dict[tuple[str, str], float]  # by name and unit


def compute(trajectories: pd.DataFrame, events: pd.DataFrame) -> list[Metric]:
    """All metrics of a run.

    trajectories, events: the tables of the files of those names
    """
    end = float(events.loc[events.kind == "end", "time_s"].iloc[0])
    start = float(trajectories.time_s.min())
    events_of = dict(tuple(events.groupby("vehicle_id")))
    collisions = events[events.kind == "collision"]
    places = trajectories.drop_duplicates("vehicle_id").set_index("vehicle_id")
    places = dict(zip(places.index, zip(places.platoon_id, places.place, strict=True), strict=True))
    follows = stretches(places, events, end)
    members: list[Metric] = []
    platoons: list[Metric] = []
    for platoon, of_platoon in trajectories.groupby("platoon_id"):
        mine: list[Metric] = []
        speeds: dict[int, pd.Series] = {}  # by place
        vehicles: dict[int, str] = {}
        for (place, vehicle), rows in of_platoon.groupby(["place", "vehicle_id"]):
            own = events_of.get(vehicle, events[:0])
            since, until = _first(own, "departed", start), _first(own, "arrived", end)
            speeds[place], vehicles[place] = rows.set_index("time_s").speed_mps, vehicle
            values = _motion(rows, own) | _standing(own, since, until) | _leaving_road(own, since, until)
            values |= _lines(own, since, until)
            values["collisions", ""] = _collisions(collisions, [vehicle])
            values["collisions_caused", ""] = _caused(collisions, vehicle)
            if place > 0 or follows[vehicle]:
                values |= _staying(rows, own, follows[vehicle], places)
                values |= _following(rows) | _locking(own, until) | _nearing(rows, own) | _seeing(rows)
            if place > 0:
                gains = _speed_gains(speeds[place], speeds.get(place - 1))
                values["speed_gain_l2", ""], values["speed_gain_linf", ""] = gains
            mine += [Metric("vehicle", platoon, vehicle, name, value, unit) for (name, unit), value in values.items()]
        members += mine
        head_to_tail, _ = _speed_gains(speeds[max(speeds)], speeds.get(0) if max(speeds) else None)
        platoons += [Metric("platoon", platoon, "", *m) for m in _together(mine, of_platoon, collisions)]
        platoons.append(Metric("platoon", platoon, "", "head_to_tail_l2", head_to_tail, ""))
    head_to_tail = _over(platoons, "head_to_tail_l2", max)
    run = [*_together(members, trajectories, collisions), ("head_to_tail_l2", head_to_tail, "")]
    return [*members, *platoons, *(Metric("run", "", "", *m) for m in (*run, ("duration", end - start, "s")))]


def _motion(rows: pd.DataFrame, own: pd.DataFrame) -> Values:
    laps = abs(rows.turned_rad.iloc[-1]) / (2 * math.pi)
    right = rows.right_of_middle_m.dropna()
    return {
        ("laps", ""): laps,
        ("corners", ""): float(math.floor(4 * laps + 10 / 90)),
        ("distance", "m"): float(np.hypot(rows.x_m.diff(), rows.y_m.diff()).sum()),
        ("speed_mean", "m/s"): rows.speed_mps.mean(),
        ("accel_rms", "m/s2"): _rms(rows.accel_mps2),
        ("jerk_rms", "m/s3"): _rms(rows.jerk_mps3),
        ("jerk_max", "m/s3"): rows.jerk_mps3.abs().max(),
        ("hard_brakings", ""): float((own.kind == "emergency_brake").sum()),
        ("right_lane_share", ""): (right > 0).mean() if len(right) else math.nan,
    }


def _standing(own: pd.DataFrame, since: float, until: float) -> Values:
    began = own.loc[own.kind == "standstill", "time_s"]
    ended = own.loc[own.kind == "standstill_end", "duration_s"]
    last = until - began.iloc[-1] + STANDSTILL_AFTER if len(began) > len(ended) else 0.0
    share = _share(ended.sum() + last, until - since)
    return {("standstills", ""): float(len(began)), ("standstill_share", ""): share}


def _leaving_road(own: pd.DataFrame, since: float, until: float) -> Values:
    left = own.loc[own.kind == "off_road", "time_s"]
    back = own.loc[own.kind == "on_road", "duration_s"]
    last = until - left.iloc[-1] if len(left) > len(back) else 0.0
    return {("off_road_share", ""): _share(back.sum() + last, until - since)}


def _collisions(collisions: pd.DataFrame, vehicles: Collection[str]) -> float:
    return float((collisions.vehicle_id.isin(vehicles) | collisions.other_id.isin(vehicles)).sum())


def _caused(collisions: pd.DataFrame, vehicle: str) -> float:
    own = collisions[collisions.vehicle_id == vehicle]
    struck = collisions[(collisions.other_id == vehicle) & (collisions.what == "struck_from_behind")]
    return float((~own.what.isin(["struck_from_behind", "other_changed_lanes"])).sum() + len(struck))


def _lines(own: pd.DataFrame, since: float, until: float) -> Values:
    held, released = own.loc[own.kind == "held", "time_s"], own.loc[own.kind == "released", "duration_s"]
    last = until - held.iloc[-1] if len(held) > len(released) else 0.0
    return {
        ("red_lights", ""): float((own.kind == "red_light").sum()),
        ("failures_to_yield", ""): float((own.kind == "failed_to_yield").sum()),
        ("held_share", ""): _share(released.sum() + last, until - since),
    }


def _staying(rows: pd.DataFrame, own: pd.DataFrame, follows: list[Stretch], members: Collection[str]) -> Values:
    """In its platoon."""
    counted, off = [(one.begin, one.end) for one in follows], split_off(own, follows)
    whole, lost = lengths(counted, off)
    rows = rows[within(rows.time_s, counted)]
    split = within(rows.time_s, off)
    ahead = pd.Series("", index=rows.index)
    for one in follows:
        ahead[within(rows.time_s, [(one.begin, one.end)])] = one.ahead
    back = own.loc[own.kind == "rejoined"]
    steps = np.hypot(rows.x_m.diff(), rows.y_m.diff())
    seen = (rows.beams_on_predecessor >= ENOUGH_BEAMS) & ~split
    stolen = rows.target_id.notna() & ~rows.target_id.isin({"", WALL, *members})
    return {
        ("splits", ""): float((own.kind == "split").sum()),
        ("rejoin_time_mean", "s"): back.duration_s.mean() if len(back) else math.nan,
        ("rejoin_time_longest", "s"): back.duration_s.max() if len(back) else math.nan,
        ("in_platoon_share", ""): 1 - _share(lost, whole),
        ("in_platoon_distance", "m"): float(steps[~split].sum()),
        ("steal_share", ""): stolen.mean() if len(rows) else math.nan,
        ("lock_on_seen", ""): (rows.target_id[seen] == ahead[seen]).mean() if seen.any() else math.nan,
    }


def _following(rows: pd.DataFrame) -> Values:
    moving = rows.time_gap_s[rows.speed_mps > MOVING * rows.speed_mps.mean()]
    return {
        ("gap_mean", "m"): rows.gap_m.mean(),
        ("gap_min", "m"): rows.gap_m.min(),
        ("gap_max", "m"): rows.gap_m.max(),
        ("gap_error_rms", "m"): _rms(rows.gap_error_m),
        ("time_gap_median", "s"): rows.time_gap_s.median(),
        ("time_gap_mean", "s"): moving.mean(),
        ("time_gap_min", "s"): moving.min(),
        ("cross_track_rms", "m"): _rms(rows.cross_track_m),
        ("cross_track_max", "m"): rows.cross_track_m.abs().max(),
    }


def _locking(own: pd.DataFrame, until: float) -> Values:
    first = own.loc[own.kind == "locked", "time_s"]
    lost = own.loc[own.kind == "lock_lost", "time_s"].to_list()
    ends = own.loc[own.kind.isin(["lock_regained", "locked", "told"]), "time_s"].to_list()
    regained = [min((t for t in ends if t > a), default=math.nan) for a in lost]
    losses = [(until if math.isnan(b) else b) - a for a, b in zip(lost, regained, strict=True)]
    for_good = lost[-1] if lost and math.isnan(regained[-1]) else math.nan
    since = until - first.iloc[0] if len(first) else 0.0
    return {
        ("lock_on_ratio", ""): 1 - sum(losses) / since if since else 0.0,
        ("lock_losses", ""): float(len(losses)),
        ("lock_loss_longest", "s"): max(losses, default=0.0),
        ("lost_for_good", "s"): for_good,
    }


def _nearing(rows: pd.DataFrame, own: pd.DataFrame) -> Values:
    exposed = rows.ttc_s < EXPOSED
    lasts = -rows.time_s.diff(-1)[exposed]
    return {
        ("ttc_min", "s"): rows.ttc_s.min(),
        ("tet", "s"): lasts.sum(),
        ("tit", "s2"): ((EXPOSED - rows.ttc_s[exposed]) * lasts).sum(),
        ("drac_max", "m/s2"): rows.drac_mps2.max(),
        ("near_misses", ""): float((own.kind == "near_miss").sum()),
    }


def _seeing(rows: pd.DataFrame) -> Values:
    beams = rows.beams_on_predecessor.dropna()
    return {
        ("occluded_share_mean", ""): rows.occluded_share.mean(),
        ("beams_share5", ""): (beams >= ENOUGH_BEAMS).mean() if len(beams) else math.nan,
    }


def _speed_gains(speed: pd.Series, ahead: pd.Series | None) -> tuple[float, float]:
    """L2 and L-infinity norm of a speed's deviation from its mean, over those of another; both indexed by time."""
    if ahead is None:
        return math.nan, math.nan
    _, here, there = np.intersect1d(speed.index, ahead.index, assume_unique=True, return_indices=True)
    own, other = (v.to_numpy()[at] - v.iloc[at].mean() for v, at in ((speed, here), (ahead, there)))
    if not len(other) or _root_mean_square(other) < STEADY:
        return math.nan, math.nan
    return _root_mean_square(own) / _root_mean_square(other), np.abs(own).max() / np.abs(other).max()


def _together(members: list[Metric], rows: pd.DataFrame, collisions: pd.DataFrame) -> Iterator[tuple[str, float, str]]:
    """Metrics of several members: (name, value, unit); rows: of these members."""

    def over(name: str, how: Callable) -> float:
        return _over(members, name, how)

    ids = {m.vehicle for m in members}
    leader = rows.loc[rows.place == 0, "right_of_middle_m"].dropna()
    yield "members", float(len(ids)), ""
    yield "collisions", _collisions(collisions, ids), ""
    yield "collisions_caused", over("collisions_caused", sum), ""
    yield "red_lights", over("red_lights", sum), ""
    yield "failures_to_yield", over("failures_to_yield", sum), ""
    yield "held_share_mean", over("held_share", np.mean), ""
    yield "splits", over("splits", sum), ""
    yield "rejoin_time_mean", over("rejoin_time_mean", np.mean), "s"
    yield "rejoin_time_longest_max", over("rejoin_time_longest", max), "s"
    yield "in_platoon_share_mean", over("in_platoon_share", np.mean), ""
    yield "in_platoon_distance_mean", over("in_platoon_distance", np.mean), "m"
    yield "steal_share_mean", over("steal_share", np.mean), ""
    yield "lock_on_seen_min", over("lock_on_seen", min), ""
    yield "laps_min", over("laps", min), ""
    yield "corners_min", over("corners", min), ""
    yield "gap_min", over("gap_min", min), "m"
    yield "gap_max", over("gap_max", max), "m"
    yield "gap_mean", over("gap_mean", np.mean), "m"
    yield "gap_error_rms_max", over("gap_error_rms", max), "m"
    yield "time_gap_mean", over("time_gap_mean", np.mean), "s"
    yield "time_gap_min", over("time_gap_min", min), "s"
    yield "cross_track_max", over("cross_track_max", max), "m"
    yield "lock_on_ratio_min", over("lock_on_ratio", min), ""
    yield "lock_losses", over("lock_losses", sum), ""
    yield "lost_for_good_first", over("lost_for_good", min), "s"
    yield "occluded_share_mean", over("occluded_share_mean", np.mean), ""
    yield "beams_share5_min", over("beams_share5", min), ""
    yield "ttc_min", over("ttc_min", min), "s"
    yield "tet", over("tet", sum), "s"
    yield "tit", over("tit", sum), "s2"
    yield "drac_max", over("drac_max", max), "m/s2"
    yield "near_misses", over("near_misses", sum), ""
    yield "hard_brakings", over("hard_brakings", sum), ""
    yield "accel_rms_max", over("accel_rms", max), "m/s2"
    yield "jerk_rms_max", over("jerk_rms", max), "m/s3"
    yield "jerk_max", over("jerk_max", max), "m/s3"
    yield "speed_gain_l2_max", over("speed_gain_l2", max), ""
    yield "speed_gain_linf_max", over("speed_gain_linf", max), ""
    yield "standstill_share_mean", over("standstill_share", np.mean), ""
    yield "off_road_share_max", over("off_road_share", max), ""
    yield "leader_right_lane_share", (leader > 0).mean() if len(leader) else math.nan, ""
    yield "right_lane_share_min", over("right_lane_share", min), ""


def _over(metrics: list[Metric], name: str, how: Callable) -> float:
    values = [m.value for m in metrics if m.name == name and not math.isnan(m.value)]
    return float(how(values)) if values else math.nan


def _first(own: pd.DataFrame, kind: str, otherwise: float) -> float:
    """Time of the first event of a kind."""
    times = own.loc[own.kind == kind, "time_s"]
    return float(times.iloc[0]) if len(times) else otherwise


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def _root_mean_square(values: pd.Series | np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def _rms(values: pd.Series) -> float:
    values = values.dropna()
    return _root_mean_square(values) if len(values) else math.nan


def summary(name: str, seed: int, varied: dict[str, Any], metrics: list[Metric]) -> str:
    """summary.csv: one row with the run, what its arguments varied, and every metric of the run and of the traffic."""
    row: dict[str, Any] = {"scenario": name, "seed": seed, **varied}
    for metric in metrics:
        if metric.scope in ("run", "traffic"):
            row[column(metric.scope, metric.name, metric.unit)] = metric.value
    return pd.DataFrame([row]).to_csv(index=False, float_format="%.9g", lineterminator="\n")


def column(scope: str, name: str, unit: str) -> str:
    """The column of summary.csv that a metric has: `gap_mean_m`, or of the traffic `traffic_delay_mean_s`."""
    parts = ["traffic" if scope == "traffic" else "", name, unit.replace("/", "p")]
    return "_".join(filter(None, parts))
