"""Metrics of a run, computed from the tables that it recorded and nothing else.

A metric is one row of a table in this file: its name, unit and meaning, the function that computes it, and how platoons
and the run aggregate it over their members. A member's time is that from its event `departed` to `arrived` or
`stranded`, or to the end of the run.

Metrics of measured values are over all steps, whatever `record.every_s` is: they follow from statistics.csv. The
meaning of those that need trajectories.csv says "over the recorded instants".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.results import strings
from platoontraffic.results.excerpts import MOVING, Group, Own, all_of, platoons, span
from platoontraffic.results.statistics import from_trajectories
from platoontraffic.vehicles.bicycle import VALID_LATERAL
from platoontraffic.world.events import ENOUGH_BEAMS, EXPOSED, SHORT_ENCROACHMENT, STANDSTILL_AFTER, WALL

# Kinds of contact of which the other is the cause.
CAUSED_BY_OTHER = (
    "struck_from_behind", "other_changed_lanes", "other_swung_out", "other_crossed_middle", "other_appeared", "stood",
)  # fmt: skip
CAUSED_BY_ROAD = ("lanes_overlap", "appeared")  # by neither of the two
LAST_CORNER = 10.0  # a quarter turn counts when this much of it is missing [deg]


class Metric(NamedTuple):
    """One metric of a scope."""

    name: str
    unit: str
    meaning: str
    value: Callable[[Any], float]  # of what the table below it says
    over: str = ""  # key of AGGREGATES, for platoons and the run; "": they do not have it


class Value(NamedTuple):
    """One row of metrics.csv."""

    scope: str
    platoon: str
    vehicle: str
    name: str
    value: float
    unit: str


AGGREGATES: Mapping[str, tuple[Callable, str]] = {
    "sum": (sum, "sum"),
    "mean": (np.mean, "mean (each member has the same weight, whatever its time on the road)"),
    "max": (max, "largest value"),
    "min": (min, "least value"),
    "first": (min, "earliest time"),
}

# ---- of every member: functions of its `Own`

OF_MEMBERS = (
    Metric(
        "laps",
        "",
        "|turned_rad| / 2 pi at the end; empty unless the run counts laps, or its route is a loop, or it has none",
        lambda m: _laps(m),
        "min",
    ),
    Metric(
        "corners",
        "",
        f"quarter turns, the last one counted from {90 - LAST_CORNER:g} deg; empty where laps is empty",
        lambda m: float(np.floor(4 * _laps(m) + LAST_CORNER / 90)),
        "min",
    ),
    Metric(
        "distance",
        "m",
        "length of the path of the centre, over all steps",
        lambda m: m.steps("centre_speed_mps").integral,
    ),
    Metric("speed_mean", "m/s", "mean of speed_mps over all steps", lambda m: m.steps("speed_mps").mean),
    Metric(
        "accel_rms", "m/s2", "root mean square of accel_mps2 over all steps", lambda m: m.steps("accel_mps2").rms, "max"
    ),
    Metric(
        "jerk_rms", "m/s3", "root mean square of jerk_mps3 over all steps", lambda m: m.steps("jerk_mps3").rms, "max"
    ),
    Metric("jerk_max", "m/s3", "maximum of |jerk_mps3| over all steps", lambda m: m.steps("jerk_mps3").largest, "max"),
    Metric(
        "lateral_accel_max",
        "m/s2",
        "maximum of |lateral_accel_mps2| over all steps",
        lambda m: m.steps("lateral_accel_mps2").largest,
        "max",
    ),
    Metric(
        "lateral_accel_beyond_share",
        "",
        f"share of all steps with |lateral_accel_mps2| above {VALID_LATERAL:g} m/s2, to which the model of a car is "
        "valid",
        lambda m: m.steps("lateral_accel_beyond").mean,
        "max",
    ),
    Metric("hard_brakings", "", "number of events emergency_brake", lambda m: m.count("emergency_brake"), "sum"),
    Metric(
        "right_lane_share",
        "",
        "share of the recorded instants with a value of right_of_middle_m at which that is positive",
        lambda m: _right_lane_share(m.rows.right_of_middle_m),
        "min",
    ),
    Metric("arrived", "", "1 if it has arrived, else 0", lambda m: m.count("arrived"), "sum"),
    Metric("stranded", "", "1 if it was taken off the road as stranded, else 0", lambda m: m.count("stranded"), "sum"),
    Metric("standstills", "", "number of events standstill", lambda m: m.count("standstill")),
    Metric(
        "standstill_share",
        "",
        f"share of its time spent in standstills of more than {STANDSTILL_AFTER:g} s",
        lambda m: m.share_between("standstill", "standstill_end", already=STANDSTILL_AFTER),
        "mean",
    ),
    Metric(
        "off_road_share",
        "",
        "share of its time spent off the road, by the events, which see every step",
        lambda m: m.share_between("off_road", "on_road"),
        "max",
    ),
    Metric("red_lights", "", "number of events red_light", lambda m: m.count("red_light"), "sum"),
    Metric("failures_to_yield", "", "number of events failed_to_yield", lambda m: m.count("failed_to_yield"), "sum"),
    Metric(
        "held_share",
        "",
        "share of its time spent before closed stop lines, by the events",
        lambda m: m.share_between("held", "released"),
        "mean",
    ),
    # A contact between two members is one of each, and one of their platoon: see OF_GROUPS.
    Metric(
        "collisions", "", "episodes of contact with a vehicle or a wall", lambda m: _contacts(m.collisions, {m.vehicle})
    ),
    Metric(
        "collisions_caused",
        "",
        "episodes of contact of which it is the cause: it changed lanes into the other's path just before, or else "
        "struck the other from behind, a wall, or the other side by side or head on; not those in which the other "
        "changed lanes, struck it from behind, swung its rear into it, was inserted just before, or came from another "
        "direction and struck it where it had stood on its own lanes; nor those of two in the middles of lanes that "
        "overlap",
        lambda m: _caused(m.collisions, m.vehicle),
        "sum",
    ),
    Metric("clearance_min", "m", "minimum of clearance_m over all steps", lambda m: m.steps("clearance_m").min, "min"),
    Metric(
        "contact_in_min", "s", "minimum of contact_in_s over all steps", lambda m: m.steps("contact_in_s").min, "min"
    ),
    Metric(
        "near_misses_other",
        "",
        "number of events near_miss_other of which it is one of the two",
        lambda m: _contacts(m.near_misses, {m.vehicle}),
    ),
    Metric(
        "pet_min",
        "s",
        "least post-encroachment time, of the events encroachment of which it is one of the two",
        lambda m: _of_pairs(m.encroachments, {m.vehicle}).duration_s.min(),
        "min",
    ),
    Metric(
        "short_encroachments",
        "",
        f"number of those events with less than {SHORT_ENCROACHMENT:g} s",
        lambda m: _short(m.encroachments, {m.vehicle}),
    ),
)

# ---- of members that have followed at some time


def _in_platoon(name: str, unit: str, statistic: str, quantity: str, field: str, over: str) -> tuple[Metric, Metric]:
    """A statistic of a quantity while a follower is in its platoon, and NAME_all: whether or not it is.

    field: of a row of statistics.csv
    """
    while_in = (
        f"{statistic} of {quantity} while it is in its platoon: over all steps if it was never split off, else over "
        "the recorded instants at which it follows and is not split off"
    )
    over_all = f"{statistic} of {quantity} over all steps, whether or not it was split off"
    return (
        Metric(name, unit, while_in, lambda m: getattr(m.in_platoon(quantity), field), over),
        Metric(f"{name}_all", unit, over_all, lambda m: getattr(m.steps(quantity), field), over),
    )


OF_FOLLOWERS = (
    Metric("splits", "", "number of events split", lambda m: m.count("split"), "sum"),
    Metric(
        "rejoin_time_mean",
        "s",
        "mean time from the begin of a split, 2 s before its event, to its end, of the splits that ended; orders are "
        "none",
        lambda m: float(np.mean(m.rejoin_times)) if m.rejoin_times else math.nan,
        "mean",
    ),
    Metric(
        "rejoin_time_longest",
        "s",
        "longest time from the begin of a split to its end, of the splits that ended",
        lambda m: max(m.rejoin_times, default=math.nan),
        "max",
    ),
    Metric(
        "in_platoon_share",
        "",
        "share of its time as a follower with its predecessor on the road in which it was not split off; after an "
        "order to split off it counts as split off, after an order to leave it is no follower",
        lambda m: m.following.share,
        "mean",
    ),
    Metric(
        "in_platoon_distance",
        "m",
        "distance driven in that time, from one recorded instant to the next",
        lambda m: m.following.distance,
        "mean",
    ),
    Metric(
        "steal_share",
        "",
        "share of the recorded instants at which it follows and its predecessor is on the road, at which the law's "
        "target was a vehicle that is no member",
        lambda m: _steal_share(m),
        "mean",
    ),
    Metric(
        "lock_on_seen",
        "",
        f"share of the recorded instants with {ENOUGH_BEAMS} beams or more on the predecessor, and not split off, at "
        "which the predecessor was the law's target",
        lambda m: _lock_on_seen(m),
        "min",
    ),
    *_in_platoon("gap_mean", "m", "mean", "gap_m", "mean", "mean"),
    *_in_platoon("gap_min", "m", "minimum", "gap_m", "min", "min"),
    *_in_platoon("gap_max", "m", "maximum", "gap_m", "max", "max"),
    *_in_platoon("gap_error_rms", "m", "root mean square", "gap_error_m", "rms", "max"),
    Metric(
        "time_gap_median",
        "s",
        "median of time_gap_s over the recorded instants at which it follows and is not split off; the slowest "
        "instants would dominate a mean over all of them",
        lambda m: m.following.in_platoon.time_gap_s.median(),
    ),
    Metric(
        "time_gap_mean",
        "s",
        f"mean of time_gap_s over those of these instants at which its speed is above {MOVING:g} of the mean "
        "of speed_mps over all its recorded instants",
        lambda m: m.moving_time_gaps(m.following.in_platoon).mean(),
        "mean",
    ),
    Metric(
        "time_gap_mean_all",
        "s",
        "the same, whether or not it was split off",
        lambda m: m.moving_time_gaps(m.rows).mean(),
        "mean",
    ),
    *_in_platoon("time_gap_min", "s", "minimum", "time_gap_s", "min", "min"),
    *_in_platoon("cross_track_rms", "m", "root mean square", "cross_track_m", "rms", ""),
    *_in_platoon("cross_track_max", "m", "maximum of the absolute value", "cross_track_m", "largest", "max"),
    Metric(
        "lock_on_ratio",
        "",
        "share of the time from the first lock to the end, as far as it has a predecessor, in which the law's target "
        "was that predecessor, by the events, which see every step; behind a new one it is not locked until `locked`; "
        "0 if there was no lock",
        lambda m: m.lock_on_ratio,
        "min",
    ),
    Metric("lock_losses", "", "number of lock losses", lambda m: float(len(m.lock_losses[0])), "sum"),
    Metric(
        "lock_loss_longest",
        "s",
        "longest lock loss, the last one up to the end",
        lambda m: max(m.lock_losses[0], default=0.0),
    ),
    Metric(
        "lost_for_good",
        "s",
        "time of the lock loss that lasted to the end; empty if there was none",
        lambda m: m.lock_losses[1],
        "first",
    ),
    Metric(
        "message_loss",
        "",
        "share of the messages of its predecessor that are lost; empty without a channel",
        lambda m: m.steps("message_lost").mean,
        "mean",
    ),
    Metric(
        "message_age_mean",
        "s",
        "mean over all steps of the age of the newest message of its predecessor that has arrived",
        lambda m: m.steps("message_age_s").mean,
        "mean",
    ),
    Metric("message_age_max", "s", "maximum of the same", lambda m: m.steps("message_age_s").max, "max"),
    Metric("radio_losses", "", "number of events radio_lost", lambda m: m.count("radio_lost"), "sum"),
    Metric("ttc_min", "s", "minimum of ttc_s over all steps", lambda m: m.steps("ttc_s").min, "min"),
    Metric(
        "tet",
        "s",
        f"time exposed: number of steps with a ttc_s below {EXPOSED:g} s, times the step (Minderhoud and Bovy 2001)",
        lambda m: m.steps("ttc_shortfall_s").time_s,
        "sum",
    ),
    Metric(
        "tit",
        "s2",
        f"integral of {EXPOSED:g} s - ttc_s over that time",
        lambda m: m.steps("ttc_shortfall_s").integral,
        "sum",
    ),
    Metric("drac_max", "m/s2", "maximum of drac_mps2 over all steps", lambda m: m.steps("drac_mps2").max, "max"),
    Metric("near_misses", "", "number of events near_miss", lambda m: m.count("near_miss"), "sum"),
    Metric(
        "occluded_share_mean",
        "",
        "mean of occluded_share over all steps",
        lambda m: m.steps("occluded_share").mean,
        "mean",
    ),
    Metric(
        "beams_share5",
        "",
        f"share of all steps with a value of beams_on_predecessor at which that is {ENOUGH_BEAMS} or more",
        lambda m: m.steps("beams_enough").mean,
        "min",
    ),
    Metric("accel_gain_l2", "", strings.MEANING, lambda m: m.accel_gains.l2, "max"),
    Metric(
        "accel_gain_linf",
        "",
        "the same with the largest absolute values in place of the root of the sum of squares",
        lambda m: m.accel_gains.linf,
        "max",
    ),
)

# Those of them that a follower without a laser, which SUMO drives, does not have.
BY_LASER = frozenset({
    "splits", "rejoin_time_mean", "rejoin_time_longest", "in_platoon_share", "in_platoon_distance", "steal_share",
    "lock_on_seen", "gap_error_rms", "gap_error_rms_all", "lock_on_ratio", "lock_losses", "lock_loss_longest",
    "lost_for_good", "occluded_share_mean", "beams_share5",
})  # fmt: skip

# ---- of a platoon and of all members of the run: functions of its `Group`

OF_GROUPS = (
    Metric("members", "", "number of members", lambda group: float(len(group.members))),
    Metric(
        "collisions",
        "",
        "episodes of contact between a member and a vehicle or a wall",
        lambda group: _contacts(group.collisions, {m.vehicle for m in group.members}),
    ),
    Metric(
        "near_misses_other",
        "",
        "number of events near_miss_other of which a member is one of the two",
        lambda group: _contacts(group.near_misses, {m.vehicle for m in group.members}),
    ),
    Metric(
        "short_encroachments",
        "",
        f"number of events encroachment with less than {SHORT_ENCROACHMENT:g} s of which a member is one of the two",
        lambda group: _short(group.encroachments, {m.vehicle for m in group.members}),
    ),
    Metric(
        "leader_right_lane_share",
        "",
        "right_lane_share of the leaders, all recorded instants together",
        lambda group: _right_lane_share(group.rows.loc[group.rows.place == 0, "right_of_middle_m"]),
    ),
)
OF_STRINGS = (  # the run has the largest value over the platoons
    Metric("head_to_tail_accel_gain_l2", "", strings.MEANING_HEAD_TO_TAIL, lambda group: group.head_to_tail.l2, "max"),
    Metric(
        "head_to_tail_accel_gain_linf",
        "",
        "the same with the largest absolute values in place of the root of the sum of squares",
        lambda group: group.head_to_tail.linf,
        "max",
    ),
)
DURATION = "duration", "from the first departure to the end"

# Order of the rows of a platoon and of the run. A metric that is not named here comes behind these.
ORDER = (
    "members", "arrived", "stranded", "collisions", "collisions_caused", "red_lights", "failures_to_yield",
    "held_share_mean", "splits",
    "rejoin_time_mean", "rejoin_time_longest_max", "in_platoon_share_mean", "in_platoon_distance_mean",
    "steal_share_mean", "lock_on_seen_min", "laps_min", "corners_min", "gap_min", "gap_max", "gap_mean",
    "gap_error_rms_max", "time_gap_mean", "time_gap_min", "cross_track_max", "lock_on_ratio_min", "lock_losses",
    "lost_for_good_first", "occluded_share_mean", "beams_share5_min", "ttc_min", "tet", "tit", "drac_max",
    "near_misses", "hard_brakings", "accel_rms_max", "jerk_rms_max", "jerk_max", "lateral_accel_max",
    "lateral_accel_beyond_share_max", "accel_gain_l2_max",
    "accel_gain_linf_max", "standstill_share_mean", "off_road_share_max", "leader_right_lane_share",
    "right_lane_share_min", "clearance_min", "contact_in_min", "near_misses_other",
    "pet_min", "short_encroachments", "gap_mean_all", "gap_min_all", "gap_max_all", "gap_error_rms_max_all",
    "time_gap_mean_all", "time_gap_min_all", "cross_track_max_all",
    "message_loss_mean", "message_age_mean", "message_age_max", "radio_losses",
)  # fmt: skip

# ---- of a run with obstacles: functions of its `Meetings`


class Meetings(NamedTuple):
    """Encounters with obstacles, and what members touched."""

    cut_ins: pd.DataFrame  # of encounters.csv
    crossings: pd.DataFrame  # of encounters.csv
    all: pd.DataFrame
    struck: pd.Series  # kind of obstacle, by collision


OBSTACLES = {
    "car": "obstacles that are cars",
    "cut_in": "cars that cut in",
    "pedestrian": "obstacles that are pedestrians",
    "box": "boxes",
    "robot": "obstacles that are robots",
    "person": "SUMO's own pedestrians",
}
OF_OBSTACLES = (
    Metric("cut_ins", "", "number of events cut_in", lambda met: float(len(met.cut_ins))),
    Metric(
        "cut_in_gap_min",
        "m",
        "least gap to a cut-in vehicle in the 10 s after",
        lambda met: met.cut_ins.gap_min_m.min(),
    ),
    Metric(
        "cut_in_ttc_min",
        "s",
        "least time to collision with a cut-in vehicle in the 10 s after",
        lambda met: met.cut_ins.ttc_min_s.min(),
    ),
    Metric("steps_out", "", "number of events steps_out", lambda met: float(len(met.crossings))),
    Metric(
        "step_out_gap_min",
        "m",
        "least distance to a pedestrian that stepped out, in the 10 s after",
        lambda met: met.crossings.gap_min_m.min(),
    ),
    Metric(
        "unavoidable",
        "",
        "cut-ins and crossings for which no braking avoids contact",
        lambda met: float((met.all.avoidable == 0).sum()),
    ),
    Metric(
        "avoidable_contacts",
        "",
        "contacts in the 10 s after a cut-in or crossing that was avoidable",
        lambda met: float(((met.all.avoidable == 1) & (met.all.contact == 1)).sum()),
    ),
    *(
        Metric(
            f"collisions_{kind}",
            "",
            f"episodes of contact with {what}",
            lambda met, kind=kind: float((met.struck == kind).sum()),
        )
        for kind, what in OBSTACLES.items()
    ),
)

# ---- of the background traffic while the platoons are on the road: functions of its `Trips`


class Trips(NamedTuple):
    """Rows of sumo_trips.csv or trips.csv."""

    all: pd.DataFrame
    finished: pd.DataFrame

    def count(self, status: str) -> float:
        return float((self.all.status == status).sum())

    @property
    def kilometres(self) -> float:
        return self.all.route_length_m.sum() / 1000

    def per_kilometre(self, column: str) -> float:
        return self.all[column].sum() / self.kilometres if self.kilometres > 0 else math.nan


OF_TRIPS = ("traffic", "everybody", "equipped")  # scopes of the following: trips of no member, all, those of members

OF_TRAFFIC = (
    Metric("trips_finished", "", "trips that arrived", lambda trips: trips.count("arrived")),
    Metric("trips_running", "", "trips on the road at the end", lambda trips: trips.count("running")),
    Metric(
        "trips_removed",
        "",
        "trips of vehicles that were removed: members that were stuck, and vehicles where an obstacle appears",
        lambda trips: trips.count("removed"),
    ),
    Metric(
        "trips_waiting", "", "trips that waited for room to depart until the end", lambda trips: trips.count("waiting")
    ),
    Metric(
        "travel_time_mean_finished",
        "s",
        "mean time on the road, finished trips",
        lambda trips: trips.finished.duration_s.mean(),
    ),
    Metric(
        "waiting_mean_finished",
        "s",
        "mean time at a standstill, finished trips",
        lambda trips: trips.finished.waiting_s.mean(),
    ),
    Metric(
        "delay_mean_finished",
        "s",
        "mean time lost by driving slower than possible, finished trips",
        lambda trips: trips.finished.time_loss_s.mean(),
    ),
    Metric(
        "depart_delay_mean_finished",
        "s",
        "mean delay of departure, finished trips",
        lambda trips: trips.finished.depart_delay_s.mean(),
    ),
    Metric("distance", "km", "distance driven, all trips", lambda trips: trips.kilometres),
    Metric(
        "co2_per_distance", "kg/km", "CO2 of all trips over their distance", lambda trips: trips.per_kilometre("co2_kg")
    ),
    Metric(
        "fuel_per_distance",
        "kg/km",
        "fuel of all trips over their distance",
        lambda trips: trips.per_kilometre("fuel_kg"),
    ),
)

# Columns of summary.csv that count events: rare ones are distributed as Poisson's law says, so their means have exact
# limits. Numbers of trips or members are none.
COUNTS = frozenset(
    (
        *(m.name for m in (*OF_MEMBERS, *OF_FOLLOWERS) if m.over == "sum" and not m.unit and m.name != "arrived"),
        *(m.name for m in OF_OBSTACLES if not m.unit),
        "collisions",
        "near_misses_other",
        "short_encroachments",
    )
)

# Columns of summary.csv whose values are integers.
INTEGERS = COUNTS | {
    "seed", "members", "arrived", "stranded", "corners_min",
    *(f"{scope}_{m.name}" for scope in OF_TRIPS for m in OF_TRAFFIC if not m.unit),
}  # fmt: skip


# ---- computing


def compute(
    trajectories: pd.DataFrame,
    events: pd.DataFrame,
    statistics: pd.DataFrame | None = None,
    on_loops: Collection[str] | None = None,
) -> list[Value]:
    """Metrics of members, platoons and the run.

    trajectories, events, statistics: the tables of the files of those names; without statistics, metrics over all steps
    are over the recorded instants

    on_loops: platoons whose laps count; None: all
    """
    statistics = from_trajectories(trajectories) if statistics is None else statistics
    start, end = span(trajectories, events)
    members: list[Value] = []
    of_platoons: list[Value] = []
    everybody: list[Own] = []
    for platoon, group in platoons(trajectories, events, statistics, on_loops):
        mine = [Value("vehicle", platoon, m.vehicle, *value) for m in group.members for value in _of_member(m)]
        of_platoons += [Value("platoon", platoon, "", *value) for value in _of_group(group, mine)]
        of_platoons += [Value("platoon", platoon, "", one.name, one.value(group), one.unit) for one in OF_STRINGS]
        members += mine
        everybody += group.members
    run = [*_of_group(all_of(everybody, trajectories, events), members)]
    run += [(one.name, aggregate(of_platoons, one.name, one.over), one.unit) for one in OF_STRINGS]
    run.append((DURATION[0], end - start, "s"))
    return [*members, *of_platoons, *(Value("run", "", "", *value) for value in run)]


def of_obstacles(encounters: pd.DataFrame, events: pd.DataFrame) -> list[Value]:
    """Metrics of a run with obstacles; encounters, events: the tables of the files of those names."""
    came = events[events.kind == "obstacle"]
    kinds = dict(zip(came.vehicle_id, came.what, strict=True))
    struck = events.loc[events.kind == "collision", "other_id"].astype(str)
    struck = struck.map(kinds).where(~struck.str.startswith("person."), "person")
    cut_ins, crossings = (encounters[encounters.kind == kind] for kind in ("cut_in", "pedestrian"))
    met = Meetings(cut_ins, crossings, encounters, struck)
    return [Value("run", "", "", metric.name, metric.value(met), metric.unit) for metric in OF_OBSTACLES]


def of_trips(scope: str, trips: pd.DataFrame) -> list[Value]:
    """Metrics of some rows of sumo_trips.csv or trips.csv; scope: a name in `OF_TRIPS`"""
    found = Trips(trips, trips[trips.status == "arrived"])
    return [Value(scope, "", "", metric.name, metric.value(found), metric.unit) for metric in OF_TRAFFIC]


def aggregate(values: Sequence[Value], name: str, over: str) -> float:
    """A metric over those that have a value of it; NaN if none has, but 0 for the number of events of no members."""
    there = [one.value for one in values if one.name == name and not math.isnan(one.value)]
    nothing = 0.0 if over == "sum" and not values else math.nan
    return float(AGGREGATES[over][0](there)) if there else nothing


def name_over(name: str, over: str) -> str:
    """Name of a member's metric for platoons and the run: gap_error_rms is gap_error_rms_max, gap_max stays gap_max.

    gap_error_rms_all is gap_error_rms_max_all
    """
    plain = name.removesuffix("_all")
    return name if over == "sum" or plain.endswith(f"_{over}") else f"{plain}_{over}{name[len(plain) :]}"


def meanings() -> dict[str, dict[str, str]]:
    """Scope -> metric -> meaning."""
    of_members = {m.name: m.meaning for m in (*OF_MEMBERS, *OF_FOLLOWERS)}
    group = {name: f"{AGGREGATES[m.over][1]} over the members of {m.name}: {m.meaning}" for name, m in _aggregated()}
    group |= {m.name: m.meaning for m in (*OF_GROUPS, *OF_STRINGS)}
    run = group | {m.name: m.meaning for m in OF_OBSTACLES} | {DURATION[0]: DURATION[1]}
    return {"vehicle": of_members, "platoon": group, "run": run} | {
        scope: {m.name: m.meaning for m in OF_TRAFFIC} for scope in OF_TRIPS
    }


def summary(name: str, seed: int, varied: dict[str, Any], values: Sequence[Value]) -> str:
    """summary.csv: one row with the run, the keys that arguments varied, and every metric of run and trips."""
    row: dict[str, Any] = {"scenario": name, "seed": seed, **varied}
    for one in values:
        if one.scope in ("run", *OF_TRIPS):
            of = column(one.scope, one.name, one.unit)
            row[of] = _number(one.value, of in INTEGERS)
    return pd.DataFrame([row]).to_csv(index=False, float_format="%.9g", lineterminator="\n")


def _number(value: float, integer: bool) -> str:
    """A count without a decimal point; any other value with one, so that a share of 1 is no integer to its readers."""
    if math.isnan(value):
        return ""
    written = f"{value:.9g}"
    return written if integer or not written.lstrip("-").isdecimal() else f"{written}.0"


def column(scope: str, name: str, unit: str) -> str:
    """Column of summary.csv for a metric: `gap_mean_m`, or `traffic_delay_mean_finished_s` for one of the traffic."""
    parts = [scope if scope in OF_TRIPS else "", name, unit.replace("/", "p")]
    return "_".join(filter(None, parts))


def _of_member(member: Own) -> Iterator[tuple[str, float, str]]:
    """(name, value, unit) of each metric that a member has."""
    rows = OF_MEMBERS
    rows += tuple(m for m in OF_FOLLOWERS if member.has_laser or m.name not in BY_LASER) if member.is_follower else ()
    return ((metric.name, metric.value(member), metric.unit) for metric in rows)


def _of_group(group: Group, values: Sequence[Value]) -> list[tuple[str, float, str]]:
    """(name, value, unit) of each metric of several members; values: theirs."""
    rows = [(name, aggregate(values, metric.name, metric.over), metric.unit) for name, metric in _aggregated()]
    rows += [(metric.name, metric.value(group), metric.unit) for metric in OF_GROUPS]
    return sorted(rows, key=lambda row: ORDER.index(row[0]) if row[0] in ORDER else len(ORDER))


def _aggregated() -> Iterator[tuple[str, Metric]]:
    """The metrics of members that platoons and the run have too, by the name that they have there."""
    for metric in (*OF_MEMBERS, *OF_FOLLOWERS):
        if metric.over:
            yield name_over(metric.name, metric.over), metric


# ---- functions of some metrics


def _laps(member: Own) -> float:
    return abs(member.steps("turning_radps").integral) / (2 * math.pi) if member.laps_count else math.nan


def _right_lane_share(right_of_middle: pd.Series) -> float:
    there = right_of_middle.dropna()
    return (there > 0).mean() if len(there) else math.nan


def _of_pairs(events: pd.DataFrame, vehicles: Collection[str]) -> pd.DataFrame:
    """The events of which a vehicle is one of the two."""
    if events.empty:
        return events
    return events[events.vehicle_id.isin(vehicles) | events.other_id.isin(vehicles)]


def _contacts(collisions: pd.DataFrame, vehicles: Collection[str]) -> float:
    return float(len(_of_pairs(collisions, vehicles)))


def _short(encroachments: pd.DataFrame, vehicles: Collection[str]) -> float:
    return float((_of_pairs(encroachments, vehicles).duration_s < SHORT_ENCROACHMENT).sum())


def _caused(collisions: pd.DataFrame, vehicle: str) -> float:
    if collisions.empty:
        return 0.0
    own = collisions[collisions.vehicle_id == vehicle]
    by_other = collisions[(collisions.other_id == vehicle) & collisions.what.isin(CAUSED_BY_OTHER)]
    return float((~own.what.isin(CAUSED_BY_OTHER + CAUSED_BY_ROAD)).sum() + len(by_other))


def _steal_share(member: Own) -> float:
    target = member.following.rows.target_id
    stolen = target.notna() & ~target.isin({"", WALL, *member.motions})
    return stolen.mean() if len(stolen) else math.nan


def _lock_on_seen(member: Own) -> float:
    rows, split, ahead, *_ = member.following
    seen = (rows.beams_on_predecessor >= ENOUGH_BEAMS) & ~split
    return (rows.target_id[seen] == ahead[seen.to_numpy()]).mean() if seen.any() else math.nan
