"""Cut-ins and pedestrians that step into a member's path: whether contact was avoidable, and the outcome."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.lidar import Boxes
from platoontraffic.observation.avoidance import least_braking, least_gap
from platoontraffic.world.events import ENCOUNTER_TIME, Event
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.obstacles import Crossing, CuttingIn, Obstacles, PathLine, Plan, SpeedProfile, row_of
from platoontraffic.world.traffic import TrafficSnapshot

ABOUT_TO_STEP = 0.5  # distance from a member's strip within which a pedestrian is about to step on it [m]
CLOSING = 1e-3  # least speed for a time gap, and least closing speed for a time to collision [m/s]


class Encounter(NamedTuple):
    """One row of encounters.csv. The values up to `avoidable` are of the instant at which it began."""

    time: float  # [s]
    kind: str  # of the obstacle: cut_in or pedestrian
    obstacle: str
    vehicle: str  # the member that has it in its path
    behind: str  # the member that a car was to cut in behind
    gap: float  # from the member's front bumper along its path [m]
    time_gap: float  # [s]
    speed: float  # of the member [m/s]
    obstacle_speed: float  # [m/s]
    braking: float  # that just avoids contact [m/s2]; NaN: no braking does
    avoidable: int  # 1: by the member's hardest braking
    least_gap: float  # within ENCOUNTER_TIME [m]
    least_time_to_collision: float  # within ENCOUNTER_TIME [s]; NaN: never closing
    contact: int  # 1: within ENCOUNTER_TIME


class _Instant(NamedTuple):
    traffic: TrafficSnapshot
    fleet: Fleet
    rows: dict[str, int]  # of each vehicle in `traffic`
    roads: Sequence[tuple[str, str]]  # edge and lane of each member, first in `traffic`


class Encounters:
    """Follows obstacles and members: `observe` in every step, `rows` at the end of the run."""

    def __init__(self, obstacles: Obstacles, members: Sequence[Member]) -> None:
        """members: all of the run"""
        self._obstacles = obstacles
        self._presence = _ObstaclePresence(obstacles)
        of_route = {id(m.route): PathLine(m.route) for m in members if m.route}
        self._paths = {m.id: of_route[id(m.route)] for m in members if m.route}
        self._met: list[_Outcome] = []
        self._begun: set[tuple[str, str]] = set()  # obstacle, member

    def extend(self, newcomers: Sequence[Member]) -> None:
        """Further members of the run."""
        if self._obstacles.plans:
            self._paths |= {m.id: PathLine(m.route) for m in newcomers if m.route}

    def observe(
        self, traffic: TrafficSnapshot, fleet: Fleet, roads: Sequence[tuple[str, str]], events: Iterable[Event]
    ) -> list[Event]:
        """The events of obstacles in this step.

        roads  : edge and lane of each member, (n,)
        events : of the members in it, for their collisions
        """
        if not self._obstacles.plans:
            return []
        now = _Instant(traffic, fleet, {name: i for i, name in enumerate(traffic.ids)}, roads)
        found = [*self._presence.observe(traffic)]
        for plan in self._presence.present:
            if encounter := self._begins(plan, now):
                self._begun.add((plan.id, encounter.vehicle))
                self._met.append(_Outcome(encounter, self._paths[encounter.vehicle]))
                found.append(_event(encounter, now))
        touching = {frozenset((e.vehicle, e.other)) for e in events if e.kind == "collision"}
        for outcome in self._met:
            outcome.observe(now, touching)
        return found

    def rows(self) -> list[Encounter]:
        """All encounters of the run, by their beginning."""
        return [outcome.row() for outcome in self._met]

    def _begins(self, plan: Plan, now: _Instant) -> Encounter | None:
        """The encounter that begins in this step with an obstacle that is present."""
        if isinstance(plan, CuttingIn):
            return self._cut_in(plan, now)
        return self._step_out(plan, now) if isinstance(plan, Crossing) else None

    def _cut_in(self, plan: CuttingIn, now: _Instant) -> Encounter | None:
        """Begins when its body enters the strip that the follower's body drives."""
        traffic, row = now.traffic, row_of(now.fleet, plan.gap.follower)
        if row is None or traffic.time < plan.lane_change.starts or (plan.id, plan.gap.follower) in self._begun:
            return None
        i = now.rows[plan.id]
        own, own_offset = plan.path.project(traffic.x[row], traffic.y[row])
        station, _ = plan.path.project(traffic.x[i], traffic.y[i], own)
        offsets = [plan.path.project(x, y, station)[1] - own_offset for x, y in _corners(traffic, [i])[0]]
        if min(offsets) * max(offsets) > 0 and min(map(abs, offsets)) >= traffic.width[row] / 2:
            return None
        gap = plan.path.ahead(own, station) - (traffic.length[i] + traffic.length[row]) / 2
        brakes_in = max(plan.lane_change.starts + plan.braking.after - traffic.time, 0.0)
        speed = float(traffic.speed[i])
        ahead = SpeedProfile(speed, brakes_in, plan.braking.rate, min(plan.braking.last_speed, speed))
        return self._encounter(plan, now, row, plan.gap.predecessor, gap, ahead)

    def _step_out(self, plan: Crossing, now: _Instant) -> Encounter | None:
        """Begins when a pedestrian enters the strip that the next member's body drives."""
        if now.traffic.speed[now.rows[plan.id]] == 0:
            return None
        strips = [self._strip(plan, now, row) for row in range(len(now.fleet))]
        nearest = min((strip for strip in strips if strip), key=lambda strip: strip.gap, default=None)
        if nearest is None or not nearest.entered:
            return None
        if (plan.id, now.fleet.members[nearest.row].id) in self._begun:
            return None
        return self._encounter(plan, now, nearest.row, "", nearest.gap, SpeedProfile(0.0))

    def _strip(self, plan: Crossing, now: _Instant, row: int) -> _Strip | None:
        """A member's strip, if the pedestrian is on it or about to step on it, and the member has not passed."""
        traffic, i = now.traffic, now.rows[plan.id]
        path = self._paths.get(now.fleet.members[row].id)
        if path is None:
            return None
        own, own_offset = path.project(traffic.x[row], traffic.y[row])
        station, offset = path.project(traffic.x[i], traffic.y[i])
        ahead = path.ahead(own, station)
        # The pedestrian walks straight across: its length lies across the road, and its width along it.
        aside = abs(offset - own_offset) - (traffic.length[i] + traffic.width[row]) / 2
        lengths = (traffic.length[row] + traffic.width[i]) / 2
        if aside >= ABOUT_TO_STEP or ahead < -lengths:
            return None
        return _Strip(row, ahead - lengths, aside < 0)

    def _encounter(
        self, plan: Plan, now: _Instant, row: int, behind: str, gap: float, ahead: SpeedProfile
    ) -> Encounter:
        traffic = now.traffic
        member, speed = now.fleet.members[row], float(traffic.speed[row])
        needed = least_braking(gap, speed, member, ahead) if gap > 0 else math.inf
        return Encounter(
            time=traffic.time,
            kind=plan.kind,
            obstacle=plan.id,
            vehicle=member.id,
            behind=behind,
            gap=gap,
            time_gap=gap / speed if gap >= 0 and speed > CLOSING else math.nan,
            speed=speed,
            obstacle_speed=float(traffic.speed[now.rows[plan.id]]),
            braking=_finite(needed),
            avoidable=int(gap > 0 and least_gap(gap, speed, member, ahead) > 0),
            least_gap=math.nan,
            least_time_to_collision=math.nan,
            contact=0,
        )


class _Strip(NamedTuple):
    """The strip that a member's body drives, seen from a pedestrian."""

    row: int  # of the member
    gap: float  # from the member's front bumper to the pedestrian [m]
    entered: bool


class _ObstaclePresence:
    """Obstacles that enter and leave the road, and cut-ins that are given up."""

    def __init__(self, obstacles: Obstacles) -> None:
        self._obstacles = obstacles
        self._plans = {plan.id: plan for plan in obstacles.plans}
        self._here: set[str] = set()
        self._given_up: set[str] = set()

    @property
    def present(self) -> list[Plan]:
        return [self._plans[name] for name in self._obstacles.bodies.ids]

    def observe(self, traffic: TrafficSnapshot) -> Iterator[Event]:
        """obstacle, obstacle_gone, no_cut_in"""
        bodies, nowhere = self._obstacles.bodies, (np.nan, np.nan, "", np.nan)
        before, self._here = self._here, set(bodies.ids)
        for i, name in enumerate(bodies.ids):
            if name not in before:
                plan = self._plans[name]
                detail = f"{plan.kind}, {plan.length:g} x {plan.width:g} m, {bodies.speed[i]:.2f} m/s"
                where = bodies.x[i], bodies.y[i], "", np.nan
                yield Event(traffic.time, "obstacle", name, "", *where, detail, plan.kind)
        for name in sorted(before - self._here):
            yield Event(traffic.time, "obstacle_gone", name, "", *nowhere, "")
        for name, reason in self._obstacles.given_up().items():
            if name not in self._given_up:
                self._given_up.add(name)
                yield Event(traffic.time, "no_cut_in", self._plans[name].gap.follower, name, *nowhere, reason)


@dataclass
class _Outcome:
    """An encounter, and what has come of it until now."""

    encounter: Encounter
    path: PathLine  # of the member
    gap: float = math.inf  # the least one [m]
    time_to_collision: float = math.inf  # the least one [s]
    contact: bool = False

    def observe(self, now: _Instant, touching: set[frozenset[str]]) -> None:
        """Least gap between the two bodies, least time to collision along the path, contact; for ENCOUNTER_TIME.

        touching: pairs that begin to touch in this step
        """
        met, traffic = self.encounter, now.traffic
        if traffic.time > met.time + ENCOUNTER_TIME or met.vehicle not in now.rows or met.obstacle not in now.rows:
            return
        own, other = now.rows[met.vehicle], now.rows[met.obstacle]
        gap = float(shapely.distance(*shapely.polygons(_corners(traffic, [own, other]))))
        self.gap = min(self.gap, gap)
        self.contact |= frozenset((met.vehicle, met.obstacle)) in touching
        turned = traffic.heading[other] - traffic.heading[own]
        closing = traffic.speed[own] - traffic.speed[other] * math.cos(turned)
        if closing > CLOSING and self._is_in_path(traffic, own, other):
            self.time_to_collision = min(self.time_to_collision, gap / closing)

    def row(self) -> Encounter:
        return self.encounter._replace(
            least_gap=self.gap, least_time_to_collision=_finite(self.time_to_collision), contact=int(self.contact)
        )

    def _is_in_path(self, traffic: TrafficSnapshot, own: int, other: int) -> bool:
        own_station, own_offset = self.path.project(traffic.x[own], traffic.y[own])
        station, offset = self.path.project(traffic.x[other], traffic.y[other], own_station)
        across = traffic.length[other] if self.encounter.kind == "pedestrian" else traffic.width[other]
        is_ahead = self.path.ahead(own_station, station) > 0
        return is_ahead and abs(offset - own_offset) < (across + traffic.width[own]) / 2


def _event(met: Encounter, now: _Instant) -> Event:
    """cut_in or steps_out"""
    what = "avoidable" if met.avoidable else "unavoidable"
    needed = f" by {met.braking:.1f} m/s2" if met.avoidable and met.braking > 0 else ""
    behind = f"behind {met.behind}, " if met.behind else ""
    time_gap = "" if math.isnan(met.time_gap) else f", {met.time_gap:.2f} s"
    detail = f"{behind}gap {met.gap:.2f} m{time_gap}, own speed {met.speed:.2f} m/s, its {met.obstacle_speed:.2f} m/s; "
    kind, row = "cut_in" if met.kind == "cut_in" else "steps_out", now.rows[met.vehicle]
    where = now.traffic.x[row], now.traffic.y[row], now.roads[row][0], np.nan
    return Event(now.traffic.time, kind, met.vehicle, met.obstacle, *where, detail + what + needed, what)


def _corners(traffic: TrafficSnapshot, rows: list[int]) -> np.ndarray:
    """Corners of the footprints in some rows (m,), (m, 4, 2) [m]."""
    where = (values[rows] for values in (traffic.x, traffic.y, traffic.heading, traffic.length, traffic.width))
    return Boxes(*where, np.arange(len(rows))).corners()


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan
