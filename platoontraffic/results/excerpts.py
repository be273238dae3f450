"""The tables of a run, cut to one member or to a group of members: what metrics are functions of."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.analysis.following import NOBODY, Stretch, lengths, split_off, stretches, within
from platoontraffic.results.statistics import NOTHING, Row, by_vehicle, of_values
from platoontraffic.results.strings import Gains, Motion, gains_behind, head_to_tail, overlaps, together, without
from platoontraffic.world.events import GONE

MOVING = 0.1  # slower than this share of its mean speed a member hardly moves [1]


@dataclass(frozen=True, eq=False)
class Own:
    """One member's part of the tables of a run."""

    vehicle: str
    place: int
    rows: pd.DataFrame  # of trajectories.csv; none if it came and went between two recorded instants
    statistics: Mapping[str, Row]  # of statistics.csv, by quantity
    events: pd.DataFrame  # that happen to it
    since: float  # time on the road: from its event `departed` [s] ...
    until: float  # ... to `arrived` or `stranded`, or to the end of the run [s]
    follows: Sequence[Stretch]
    collisions: pd.DataFrame  # events of the whole run
    near_misses: pd.DataFrame  # the same of near misses with others than the predecessor
    encroachments: pd.DataFrame  # the same of encroachments
    motions: Mapping[str, Motion]  # of all members of the run
    laps_count: bool  # whether the path that it drives is a loop

    @property
    def is_follower(self) -> bool:
        """Whether the member has followed at some time."""
        return self.place > 0 or bool(self.follows)

    def steps(self, quantity: str) -> Row:
        """Statistics of a quantity over all steps."""
        return self.statistics.get(quantity, NOTHING)

    def count(self, kind: str) -> float:
        """Number of its events of a kind."""
        return float(self._kinds[kind])

    @cached_property
    def _kinds(self) -> Counter[str]:
        return Counter(self._kind)

    @cached_property
    def split_off(self) -> list[tuple[float, float]]:
        """Periods in which it is split off [s]."""
        return split_off(self.events, self.follows)

    def share_between(self, begins: str, ends: str, already: float = 0.0) -> float:
        """Share of its time between events of two kinds, the last period up to the end.

        already: time for which the state has lasted when the event that begins it is noted [s]
        """
        if not self._kinds[begins] and not self._kinds[ends]:
            return share(0.0, self.until - self.since)
        began, ended = self._times(begins), self._durations(ends)
        last = self.until - began[-1] + already if len(began) > len(ended) else 0.0
        return share(np.nansum(ended) + last, self.until - self.since)

    def in_platoon(self, quantity: str) -> Row:
        """Statistics of a quantity while it follows and is not split off: of the recorded instants if it ever was."""
        if not self.split_off:
            return self.steps(quantity)
        return of_values(self._in_platoon[quantity])

    @cached_property
    def _in_platoon(self) -> pd.DataFrame:
        return self.following.in_platoon

    def moving_time_gaps(self, rows: pd.DataFrame) -> pd.Series:
        """Time gaps at those of its rows at which it moves [s]."""
        return rows.time_gap_s[rows.speed_mps > MOVING * self.rows.speed_mps.mean()]

    @cached_property
    def lock_losses(self) -> tuple[list[float], float]:
        """Durations of its lock losses, the last one up to the end, and the time of the final one; NaN: none [s]."""
        final = self._lost[-1] if self._lost else (math.nan, 0.0)
        return [min(b, self.until) - a for a, b in self._lost], final[0] if math.isinf(final[1]) else math.nan

    @cached_property
    def _lost(self) -> list[tuple[float, float]]:
        """Periods without a lock; the last one may have no end [s]."""
        ends = self._times("lock_regained", "locked", "told").tolist()
        return [(a, min((t for t in ends if t > a), default=math.inf)) for a in self._times("lock_lost").tolist()]

    @property
    def lock_on_ratio(self) -> float:
        """Share of the time since its first lock, as far as it has a predecessor, in which it is locked on."""
        first = min(self._times("locked"), default=math.inf)
        follows = [one for one in self.follows if one.ahead != NOBODY]
        behind = [(max(one.begin, first), min(one.end, self.until)) for one in follows]
        not_yet = [(one.begin, self._first_lock(one)) for one in follows]
        whole, lost = lengths([(begin, end) for begin, end in behind if begin < end], [*self._lost, *not_yet])
        return 1 - lost / whole if whole else 0.0

    def _first_lock(self, stretch: Stretch) -> float:
        """Time at which it is first locked on its predecessor of a stretch [s]; inf: it is not in that stretch."""
        others = zip(self._kind, self.events.other_id.tolist(), self.events.time_s.tolist(), strict=True)
        locks = (time for kind, other, time in others if kind in ("locked", "lock_regained") and other == stretch.ahead)
        return next((time for time in locks if stretch.begin <= time < stretch.end), math.inf)

    @cached_property
    def rejoin_times(self) -> list[float]:
        """Durations of the splits that ended [s]. A join by an order ends none, unless there was one."""
        found, is_split = [], False
        for kind, duration in zip(self._kind, self.events.duration_s.tolist(), strict=True):
            if kind == "rejoined" and is_split:
                found.append(duration)
            is_split = kind == "split" or (is_split and kind != "rejoined")
        return found

    def _times(self, *kinds: str) -> np.ndarray:
        """Times of its events of some kinds, in the order of the table [s]."""
        return self.events.time_s.to_numpy()[[kind in kinds for kind in self._kind]]

    def _durations(self, *kinds: str) -> np.ndarray:
        """Durations of the same [s]."""
        return self.events.duration_s.to_numpy()[[kind in kinds for kind in self._kind]]

    @cached_property
    def _kind(self) -> list[str]:
        """That of each of its events."""
        return self.events.kind.tolist()

    @cached_property
    def following(self) -> Following:
        counted = [(one.begin, one.end) for one in self.follows]
        off, nobody = self.split_off, [(one.begin, one.end) for one in self.follows if one.ahead == NOBODY]
        whole, lost = lengths(counted, off)
        here = self._within(self.rows.time_s, counted)
        driven = np.hypot(self.rows.x_m.diff(), self.rows.y_m.diff()).to_numpy()[1:]
        is_off = within(self.rows.time_s, off) | self._within(self.rows.time_s, nobody)
        distance = driven[(here & ~is_off)[:-1]].sum()  # each step is of where it begins
        rows = self.rows[here]
        time = rows.time_s.to_numpy()
        ahead = np.full(len(rows), "", dtype=object)
        for one in self.follows:
            ahead[self._within(time, [(one.begin, one.end)])] = one.ahead
        return Following(rows, is_off[here], ahead, 1 - share(lost, whole), float(distance))

    def _within(self, times: pd.Series | np.ndarray, periods: Sequence[tuple[float, float]]) -> np.ndarray:
        """As `within`; a period that lasts to the end has the last instant too."""
        return within(times, [(begin, math.inf if end >= self.until else end) for begin, end in periods])

    @cached_property
    def together(self) -> list[Stretch]:
        """Periods in which it follows, has been locked on, and is not split off; where SUMO drives it, has a gap."""
        if self.has_laser:
            return together(self.events, self.follows, self.split_off)
        time = self.rows.time_s.to_numpy()
        gaps = self.rows.gap_m.notna().to_numpy()
        until = np.append(time, math.inf)[1:]
        apart = [(a, b) for a, b, here in zip(time, until, gaps, strict=True) if not here]
        return [Stretch(*period, one.ahead) for one in self.follows for period in without((one.begin, one.end), apart)]

    @property
    def has_laser(self) -> bool:
        return "beams_enough" in self.statistics

    @cached_property
    def accel_gains(self) -> Gains:
        return gains_behind(self.motions[self.vehicle], self.motions, self.together)


class Following(NamedTuple):
    """A member while it follows and its predecessor is on the road."""

    rows: pd.DataFrame
    split: np.ndarray  # whether it was split off, by row
    ahead: np.ndarray  # its predecessor, by row
    share: float  # of that time in which it was not split off
    distance: float  # driven in that time while it was not split off [m]

    @property
    def in_platoon(self) -> pd.DataFrame:
        """Those of its rows at which it was not split off."""
        return self.rows[~self.split]


@dataclass(frozen=True, eq=False)
class Group:
    """Several members: a platoon, or all members of the run."""

    members: Sequence[Own]
    rows: pd.DataFrame  # of trajectories.csv
    collisions: pd.DataFrame  # events of the whole run
    near_misses: pd.DataFrame  # the same of near misses with others than the predecessor
    encroachments: pd.DataFrame  # the same of encroachments

    @cached_property
    def head_to_tail(self) -> Gains:
        """Gains from the first member of a platoon to its last, while each follows the one at the place ahead."""
        string = sorted(self.members, key=lambda m: m.place)
        periods = [(-math.inf, math.inf)]
        for ahead, own in pairwise(string):
            periods = overlaps(periods, [(one.begin, one.end) for one in own.together if one.ahead == ahead.vehicle])
        return head_to_tail([m.motions[m.vehicle] for m in string], periods)


def platoons(
    trajectories: pd.DataFrame, events: pd.DataFrame, statistics: pd.DataFrame, on_loops: Collection[str] | None = None
) -> Iterator[tuple[str, Group]]:
    """Each platoon of a run, by the tables of the files of those names; on_loops: as in `metrics.compute`."""
    start, end = span(trajectories, events)
    rows_of, events_of = (dict(tuple(table.groupby("vehicle_id"))) for table in (trajectories, events))
    statistics_of = by_vehicle(statistics)
    pairs = _pairs(events)
    everybody = statistics.drop_duplicates("vehicle_id").sort_values(["platoon_id", "place"])
    places = {m.vehicle_id: (m.platoon_id, m.place) for m in everybody.itertuples()}
    follows = stretches(places, events, end)
    motions = {vehicle: Motion.of(rows_of.get(vehicle, trajectories[:0])) for vehicle in places}
    for platoon, of_platoon in everybody.groupby("platoon_id"):
        members: list[Own] = []
        laps_count = on_loops is None or platoon in on_loops
        for vehicle, place in zip(of_platoon.vehicle_id, of_platoon.place, strict=True):
            rows, own = rows_of.get(vehicle, trajectories[:0]), events_of.get(vehicle, events[:0])
            since, until = _first(own, ("departed",), start), _first(own, GONE, end)
            period = since, until, follows[vehicle]
            tables = rows, statistics_of[vehicle], own
            members.append(Own(vehicle, place, *tables, *period, *pairs, motions, laps_count))
        yield platoon, Group(members, trajectories[trajectories.platoon_id == platoon], *pairs)


def all_of(members: list[Own], trajectories: pd.DataFrame, events: pd.DataFrame) -> Group:
    """All members of a run as one group."""
    return Group(members, trajectories, *_pairs(events))


def _pairs(events: pd.DataFrame) -> list[pd.DataFrame]:
    """The events of pairs: contacts, near misses with others than the predecessor, encroachments."""
    kinds = events.kind.to_numpy(object)
    return [events[kinds == kind] for kind in ("collision", "near_miss_other", "encroachment")]


def span(trajectories: pd.DataFrame, events: pd.DataFrame) -> tuple[float, float]:
    """First departure, or recorded instant where that is not known, and end of a run [s]."""
    start = _first(events, ("departed",), trajectories.time_s.min())
    return float(start), float(events.loc[events.kind == "end", "time_s"].iloc[0])


def share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def _first(own: pd.DataFrame, kinds: Sequence[str], otherwise: float) -> float:
    """Time of the first event of some kinds [s]."""
    events = zip(own.kind.tolist(), own.time_s.tolist(), strict=True)
    return next((time for kind, time in events if kind in kinds), otherwise)
