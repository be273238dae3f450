"""Platoons in traffic against SUMO's own cars in their places: runs, and what all of them show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from concurrent.futures import Future, as_completed
from pathlib import Path
from typing import NamedTuple

import numpy as np

from platoontraffic import scenario as scenarios
from platoontraffic.analysis.limits import poisson_limits
from platoontraffic.errors import counted
from platoontraffic.prove.plans import LASER, SUMO, Plan
from platoontraffic.prove.rides import LONG, NO_REASON, Ride, Stand, ride
from platoontraffic.results.provenance import run_id
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.network import Network
from platoontraffic.study.executors import executor_of

AT_A_TIME = 2  # runs

# The bars.
LATEST = 1.25  # last arrival over that of SUMO's own cars, median over the seeds; a wait beside theirs over theirs
UNREGULATED = 180.0  # longest wait for a gap where nobody has to give way that is no fault [s]
YIELD_RATE = 0.1  # failures to yield [1 / vehicle hour]


class Pair(NamedTuple):
    """The two runs of one seed."""

    seed: int
    size: int  # members of each platoon
    routes: tuple[tuple[str, str, float], ...]  # first edge, last edge, length [m] of each platoon's
    platoons: Ride | None  # None: the run failed
    sumo: Ride | None
    lasts: float  # of both, at most [s]
    cars: int  # of the random demand
    error: str = ""

    @property
    def ratio(self) -> float:
        """Last arrival over that of SUMO's own cars; inf where only these arrive, NaN where they do not."""
        if self.platoons is None or self.sumo is None or math.isinf(self.sumo.last_arrival):
            return math.nan
        return self.platoons.last_arrival / self.sumo.last_arrival


def pairs(plans: Sequence[Plan], network: Network, folder: Path) -> Iterator[Pair]:
    """Run all scenarios, two at a time, and yield each seed's pair as soon as both of its runs have ended.

    Runs whose results are in the folder already are not repeated.
    """
    folder = folder.resolve()
    outcomes: dict[tuple[int, str], Ride | str] = {}
    # Runs of known length; which of them is slow is not said.
    with executor_of("processes", AT_A_TIME, lambda silence: None) as (submit, _):
        futures: dict[Future, tuple[Plan, str, Path]] = {}
        for plan in plans:
            for which, file in plan.files.items():
                name = run_id(scenarios.load(file))
                runs = file.parent / which / name
                job = {
                    "base": str(file.resolve()),
                    "changes": [],
                    "seed": plan.seed,
                    "id": name,
                    "folder": str(runs.resolve()),
                    "lock": str(folder / ".lock"),
                    "command_line": ["prove"],
                    "timeout_s": None,
                    "memory_mb": None,
                    "warm_up": None,
                }
                futures[submit(job)] = plan, which, runs
        for future in as_completed(futures):
            plan, which, runs = futures[future]
            outcome = future.result()
            outcomes[plan.seed, which] = outcome.get("error") or ride(runs, plan.trip_of, network)
            if len([key for key in outcomes if key[0] == plan.seed]) == len(plan.files):
                yield _pair(plan, outcomes[plan.seed, LASER], outcomes[plan.seed, SUMO])


def _pair(plan: Plan, platoons: Ride | str, sumo: Ride | str) -> Pair:
    errors = "; ".join(one for one in (platoons, sumo) if isinstance(one, str))
    routes = tuple((trip.edges[0], trip.edges[-1], trip.length) for trip in plan.trips)
    rides = (None if isinstance(one, str) else one for one in (platoons, sumo))
    return Pair(plan.seed, plan.size, routes, *rides, plan.duration, plan.cars, errors)


class Verdict(NamedTuple):
    """The sums and medians of all seeds of a network."""

    pairs: tuple[Pair, ...]
    ratio: float  # last arrival over that of SUMO's own cars, median over the seeds where these touch nothing
    ratio_overlapping: float  # the same over the seeds where these drive through each other, or through others
    hours: float
    caused: int
    red_lights: int
    failures_to_yield: int
    yield_limits: tuple[float, float]  # exact 95 % limits of failures to yield [1 / vehicle hour]
    faults: tuple[str, ...]  # bars that do not hold
    by_road: int = 0  # contacts of two vehicles in the middles of lanes that overlap

    @property
    def holds(self) -> bool:
        return not self.faults

    @property
    def not_compared(self) -> str:
        """Why no median tells how times of arrival compare with those of SUMO's own cars; "" if one does."""
        if not math.isnan(self.ratio):
            return ""
        if math.isnan(self.ratio_overlapping):
            return "SUMO's own cars do not all arrive"
        return "SUMO's own cars drive through others"

    @classmethod
    def of(cls, made: Sequence[Pair]) -> Verdict:
        own = [pair.platoons for pair in made if pair.platoons]
        hours, yields = sum(one.hours for one in own), sum(one.failures_to_yield for one in own)
        limits = tuple(limit / hours for limit in poisson_limits(yields)) if hours else (math.nan, math.nan)
        ratio, apart = _ratio(made, overlapping=False), _ratio(made, overlapping=True)
        caused, red = sum(one.caused for one in own), sum(one.red_lights for one in own)
        by_road = sum(one.by_road for one in own)
        faults = [pair.error for pair in made if pair.error]
        faults += [f"last arrival {ratio:.2f} times SUMO's"] if LATEST < ratio < math.inf else []
        faults += [f"{counted(caused, 'contact')} caused"] if caused else []
        faults += [counted(red, "red light")] if red else []
        faults += [f"{counted(yields, 'failure')} to yield"] if hours and yields / hours > YIELD_RATE else []
        if own and not any(one.arrivals for pair in made for one in (pair.platoons, pair.sumo) if one):
            faults.append("no member and none of SUMO's own cars arrives; a longer --duration may tell")
        fewer = [*_fewer(made)]
        if math.isinf(ratio) and not fewer:
            faults.append("most runs end before all members arrive; a longer --duration may tell")
        faults += [*fewer, *_stuck(made)]
        return cls(tuple(made), ratio, apart, hours, caused, red, yields, limits, tuple(faults), by_road)


def _ratio(made: Sequence[Pair], overlapping: bool) -> float:
    """Median over the seeds where SUMO's own cars touch something, or nothing; NaN where there are none."""
    found = [pair.ratio for pair in made if pair.sumo and (pair.sumo.contacts > 0) == overlapping]
    found = [ratio for ratio in found if not math.isnan(ratio)]
    return float(np.median(found)) if found else math.nan


def _fewer(made: Sequence[Pair]) -> Iterator[str]:
    """Seeds where fewer members arrive until the end of the run than of SUMO's own cars by a time LATEST times less."""
    for pair in made:
        if pair.platoons and pair.sumo:
            arrived, wanted = len(pair.platoons.arrivals), sum(LATEST * t <= pair.lasts for t in pair.sumo.arrivals)
            if arrived < wanted:
                yield (
                    f"seed {pair.seed}: {arrived} members arrive within {pair.lasts:.0f} s, "
                    f"{wanted} of SUMO's own within {pair.lasts / LATEST:.0f} s"
                )


def _stuck(made: Sequence[Pair]) -> Iterator[str]:
    """Standstills longer than LONG on lanes on which none of SUMO's cars stands for so long; those without a reason.

    Members behind one that stands where SUMO's cars do are a queue, and no fault, also where that one stands for a
    little less than LONG; so are those that keep a junction clear before it, those in a queue that reaches back into a
    junction, those that let a vehicle in beside it, and those that wait to change to a lane on which one of SUMO's own
    cars, or such a member, stands for as long. Where nobody has to give way, SUMO's cars drive through each other: they
    show no time to wait. One that comes to a light as it closes waits until it opens, whether one of SUMO's cars
    happens to come then or not. And one may stand behind a vehicle of SUMO's as long as that stands, which then waits
    for no member: no other one stands but for the queue behind, and the members do not arrive too late.
    """
    for pair in made:
        if pair.platoons is None or pair.sumo is None:
            continue
        long_on = {*pair.sumo.long_on, *(stand.lane for stand in pair.sumo.stands if stand.lasts > LONG)}
        beside = {stand.lane: stand.lasts for stand in sorted(pair.sumo.stands, key=lambda stand: stand.lasts)}
        excused = _excused(pair.platoons.stands, long_on, beside)
        if pair.platoons.last_arrival <= LATEST * pair.sumo.last_arrival:
            excused |= _behind_sumos(pair.platoons.stands)
        own = [stand for stand in pair.platoons.stands if stand.lasts > LONG and stand not in excused]
        if own:
            longest = max(own, key=lambda stand: stand.lasts)
            where = f"for {longest.lasts:.0f} s on {longest.lane} ({longest.why})"
            yield f"seed {pair.seed}: {longest.vehicle} stands {where}, where none of SUMO's cars stands for {LONG:g} s"
        if unknown := sum(stand.why == NO_REASON for stand in pair.platoons.stands):
            yield f"seed {pair.seed}: {unknown} standstills without a reason"


def _behind_sumos(stands: Sequence[Stand]) -> set[Stand]:
    """Standstills behind vehicles of SUMO's while no other member stands, and those of the queues behind."""
    members, found = {stand.vehicle for stand in stands}, set()
    for first in stands:
        if first.behind and first.behind not in members:
            queue = {first}
            while more := {stand for stand in stands if any(map(stand.is_in_queue_of, queue))} - queue:
                queue |= more
            if not any(map(first.is_with, set(stands) - queue)):
                found |= queue
    return found


def _excused(stands: Sequence[Stand], long_on: Set[str], beside: Mapping[str, float]) -> set[Stand]:
    """Standstills that are no fault, however long.

    long_on : lanes on which vehicles of SUMO's stand for longer than LONG
    beside  : longest time for which one of SUMO's own cars stands on a lane [s], by lane
    """
    waits_for_gap = {stand for stand in stands if stand.unregulated and stand.lasts <= UNREGULATED}
    excused = waits_for_gap | {stand for stand in stands if stand.lane in long_on or stand.one_red}
    while True:
        long = [stand for stand in excused if stand.lasts > LONG]
        edges = {edge_of(stand.lane) for stand in long} | {edge_of(lane) for lane in long_on}
        lasts = {**beside}
        for stand in long:
            if not stand.onto:  # those that wait beside others are no measure for the next
                lasts[stand.lane] = max(stand.lasts, lasts.get(stand.lane, 0.0))
        more = {
            stand
            for stand in stands
            if any(map(stand.is_in_queue_of, excused))
            or any(map(stand.lets_in_beside, excused))
            or stand.queue in edges - {""}
            or (stand.onto and stand.lasts <= LATEST * lasts.get(stand.onto, 0.0))
        }
        if more <= excused:
            return excused
        excused |= more
