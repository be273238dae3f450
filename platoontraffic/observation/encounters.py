"""What comes of it when somebody gets in a member's way: who cuts in, who steps out, whether that could be helped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.lidar import Boxes
from platoontraffic.world.events import Event
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.obstacles import Crossing, CuttingIn, Obstacles, PathLine, Plan, SpeedProfile, row_of
from platoontraffic.world.traffic import TrafficSnapshot

WATCHED = 10.0  # so long after somebody got in the way it is measured what comes of it [s]
SOON = 0.5  # a pedestrian so near to somebody's strip is about to step on it [m]
CLOSING = 1e-3  # slower approach is none [m/s]


class Encounter(NamedTuple):
    """One row of encounters.csv; columns as in `recording.ENCOUNTERS`."""

    time: float
    kind: str  # of the obstacle
    obstacle: str
    vehicle: str  # the member in whose way it is
    behind: str  # whom a car has come in behind
    gap: float
    time_gap: float
    speed: float
    obstacle_speed: float
    braking: float  # that would just do [m/s2]; NaN: none does
    avoidable: int
    least_gap: float
    least_time_to_collision: float
    contact: int


def reaction(member: Member) -> float:
    """Time from what the laser could see to full braking [s]: one scan, and the delay of the vehicle's brakes."""
    return member.model.braking_delay(1 / member.lidar.rate, hardest(member))


def hardest(member: Member) -> float:
    """Braking that its vehicle has and its law uses [m/s2]; inf if both stop at once."""
    return min(member.model.hardest_braking, member.law.hardest_braking)


def stopping_distance(speed: float, member: Member) -> float:
    """v T + v^2 / 2 b [m], with T and b of `reaction` and `hardest`."""
    return speed * reaction(member) + speed * speed / (2 * hardest(member))


def least_gap(gap: float, speed: float, member: Member, ahead: SpeedProfile, braking: float | None = None) -> float:
    """The least gap there will be if the member brakes as hard as it can, T after now [m]; negative: it hits.

        least over t of  gap + s_ahead(t) - s(t),   s(t) = v t - b max(t - T, 0)^2 / 2  until it stands

    Between the instants at which one of both begins or ceases to brake the difference is a parabola, so the least one
    is at such an instant or where both are equally fast.

    braking: of the member [m/s2]; default: the hardest
    """
    most = hardest(member) if braking is None else braking
    own = SpeedProfile(speed, reaction(member), min(most, 1e6), 0.0)
    stands = own.ends
    times = sorted({0.0, stands, *(t for t in (own.brakes_at, ahead.brakes_at, ahead.ends) if 0 < t < stands)})

    def between(t: float) -> float:
        return gap + ahead.distance(t) - own.distance(t)

    least = min(map(between, times))
    for a, b in pairwise(times):
        one, other = (ahead.at(t) - own.at(t) for t in (a, b))
        if one < 0 < other:
            least = min(least, between(a + (b - a) * one / (one - other)))
    return least


def least_braking(gap: float, speed: float, member: Member, ahead: SpeedProfile) -> float:
    """The braking by which the gap just stays positive, after the member's reaction [m/s2]; inf: none does."""
    if least_gap(gap, speed, member, ahead, 1e6) <= 0:
        return math.inf
    low, high = 1e-3, 1e3
    if least_gap(gap, speed, member, ahead, low) > 0:
        return 0.0
    for _ in range(50):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if least_gap(gap, speed, member, ahead, middle) > 0 else (middle, high)
    return high


@dataclass
class _Watched:
    encounter: Encounter
    gap: float = math.inf
    time_to_collision: float = math.inf
    contact: bool = False


@dataclass
class Encounters:
    """Follows obstacles and members: `watch` in every step. `met` is what there was, by the time at which it began."""

    obstacles: Obstacles
    members: Sequence[Member]
    met: list[_Watched] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._here: set[str] = set()
        self._begun: set[tuple[str, str]] = set()  # obstacle, member
        self._given_up: set[str] = set()
        self._plans = {plan.id: plan for plan in self.obstacles.plans}
        self._member = {member.id: member for member in self.members}
        ways = {id(m.route): PathLine(m.route) for m in self.members if m.route}
        self._ways = {m.id: ways[id(m.route)] for m in self.members if m.route}

    def watch(self, traffic: TrafficSnapshot, fleet: Fleet, seen: Iterable[Event]) -> list[Event]:
        """The events of this step; seen: those of the members in it, of which contacts count."""
        if not self._plans:
            return []
        bodies = self.obstacles.bodies
        events = [*self._come_and_go(traffic, bodies)]
        rows = {name: i for i, name in enumerate(traffic.ids)}
        for name in bodies.ids:
            plan = self._plans[name]
            if not isinstance(plan, CuttingIn | Crossing):
                continue
            begin = self._cuts_in if isinstance(plan, CuttingIn) else self._steps_out
            if found := begin(plan, traffic, fleet, rows):
                self._begun.add((name, found.vehicle))
                self.met.append(_Watched(found))
                events.append(self._event(traffic, found, rows))
        self._follow(traffic, fleet, rows, {(e.vehicle, e.other) for e in seen if e.kind == "collision"})
        return events

    def rows(self) -> list[Encounter]:
        """All that there was."""
        return [
            w.encounter._replace(
                least_gap=w.gap, least_time_to_collision=_finite(w.time_to_collision), contact=int(w.contact)
            )
            for w in self.met
        ]

    def _come_and_go(self, traffic: TrafficSnapshot, bodies: TrafficSnapshot) -> Iterator[Event]:
        here = set(bodies.ids)
        for i, name in enumerate(bodies.ids):
            if name not in self._here:
                plan = self._plans[name]
                what = f"{plan.kind}, {plan.length:g} x {plan.width:g} m, {bodies.speed[i]:.2f} m/s"
                where = bodies.x[i], bodies.y[i], ""
                yield Event(traffic.time, "obstacle", name, "", *where, np.nan, what)
        for name in sorted(self._here - here):
            yield Event(traffic.time, "obstacle_gone", name, "", np.nan, np.nan, "", np.nan, "")
        for name, why in self.obstacles.given_up().items():
            if name not in self._given_up:
                self._given_up.add(name)
                behind = self._plans[name].gap.follower
                yield Event(traffic.time, "no_cut_in", behind, name, np.nan, np.nan, "", np.nan, why)
        self._here = here

    def _cuts_in(self, plan: CuttingIn, traffic: TrafficSnapshot, fleet: Fleet, rows: dict) -> Encounter | None:
        """When its body comes over the strip that the follower's body drives."""
        row = row_of(fleet, plan.gap.follower)
        if row is None or traffic.time < plan.lane_change.starts or (plan.id, plan.gap.follower) in self._begun:
            return None
        i = rows[plan.id]
        own, own_offset = plan.path.project(traffic.x[row], traffic.y[row])
        station, _ = plan.path.project(traffic.x[i], traffic.y[i], own)
        offsets = [plan.path.project(x, y, station)[1] - own_offset for x, y in _corners(traffic, [i])[0]]
        if min(offsets) * max(offsets) > 0 and min(map(abs, offsets)) >= traffic.width[row] / 2:
            return None
        gap = plan.path.ahead(own, station) - (traffic.length[i] + traffic.length[row]) / 2
        brakes = max(plan.lane_change.starts + plan.braking.after - traffic.time, 0.0)
        speed = float(traffic.speed[i])
        ahead = SpeedProfile(speed, brakes, plan.braking.rate, min(plan.braking.last_speed, speed))
        return self._encounter(plan, traffic, row, i, plan.gap.predecessor, gap, ahead)

    def _steps_out(self, plan: Crossing, traffic: TrafficSnapshot, fleet: Fleet, rows: dict) -> Encounter | None:
        """When a pedestrian comes over the strip that the next member's body drives."""
        i = rows[plan.id]
        if traffic.speed[i] == 0:
            return None
        nearest: tuple[float, int, bool] | None = None
        along = traffic.width[i]  # of one who walks straight across, the width lies along the road
        for row, member in enumerate(fleet.members):
            if member.id not in self._ways:
                continue
            way = self._ways[member.id]
            own, own_offset = way.project(traffic.x[row], traffic.y[row])
            station, offset = way.project(traffic.x[i], traffic.y[i])
            ahead = way.ahead(own, station)
            aside = abs(offset - own_offset) - (traffic.length[i] + traffic.width[row]) / 2
            if aside >= SOON or ahead < -(traffic.length[row] + along) / 2:  # or it has passed
                continue
            gap = ahead - (traffic.length[row] + along) / 2
            if nearest is None or gap < nearest[0]:
                nearest = gap, row, aside < 0
        if nearest is None or not nearest[2] or (plan.id, fleet.members[nearest[1]].id) in self._begun:
            return None
        gap, row, _ = nearest
        return self._encounter(plan, traffic, row, i, "", gap, SpeedProfile(0.0))

    def _encounter(
        self, plan: Plan, traffic: TrafficSnapshot, row: int, i: int, behind: str, gap: float, ahead: SpeedProfile
    ) -> Encounter:
        member, speed = self._member[traffic.ids[row]], float(traffic.speed[row])
        needed = least_braking(gap, speed, member, ahead) if gap > 0 else math.inf
        avoidable = int(gap > 0 and least_gap(gap, speed, member, ahead) > 0)
        time_gap = gap / speed if speed > CLOSING else math.nan
        names = plan.id, member.id, behind
        given = gap, time_gap, speed, float(traffic.speed[i]), _finite(needed), avoidable
        return Encounter(traffic.time, plan.kind, *names, *given, math.nan, math.nan, 0)

    def _event(self, traffic: TrafficSnapshot, met: Encounter, rows: dict) -> Event:
        row = rows[met.vehicle]
        could = "avoidable" if met.avoidable else "unavoidable"
        if met.avoidable and met.braking > 0:
            could += f" by {met.braking:.1f} m/s2"
        behind = f"behind {met.behind}, " if met.behind else ""
        headway = "" if math.isnan(met.time_gap) else f", {met.time_gap:.2f} s"
        what = f"{behind}gap {met.gap:.2f} m{headway}, {met.speed:.2f} m/s to its {met.obstacle_speed:.2f}; {could}"
        kind = "cut_in" if met.kind == "cut_in" else "steps_out"
        where = traffic.x[row], traffic.y[row], ""
        return Event(traffic.time, kind, met.vehicle, met.obstacle, *where, np.nan, what)

    def _follow(self, traffic: TrafficSnapshot, fleet: Fleet, rows: dict, touched: set[tuple[str, str]]) -> None:
        """Least gap between the two bodies, and least time to collision along the way, while it is watched."""
        for watched in self.met:
            met = watched.encounter
            if traffic.time > met.time + WATCHED or met.vehicle not in rows or met.obstacle not in rows:
                continue
            one, other = rows[met.vehicle], rows[met.obstacle]
            gap = float(shapely.distance(*shapely.polygons(_corners(traffic, [one, other]))))
            watched.gap = min(watched.gap, gap)
            watched.contact |= bool(touched & {(met.vehicle, met.obstacle), (met.obstacle, met.vehicle)})
            turned = traffic.heading[other] - traffic.heading[one]
            closing = traffic.speed[one] - traffic.speed[other] * math.cos(turned)
            if closing > CLOSING and self._in_its_way(met, traffic, one, other):
                watched.time_to_collision = min(watched.time_to_collision, gap / closing)

    def _in_its_way(self, met: Encounter, traffic: TrafficSnapshot, one: int, other: int) -> bool:
        way = self._ways[met.vehicle]
        own, own_offset = way.project(traffic.x[one], traffic.y[one])
        station, offset = way.project(traffic.x[other], traffic.y[other], own)
        across = traffic.length[other] if met.kind == "pedestrian" else traffic.width[other]
        return way.ahead(own, station) > 0 and abs(offset - own_offset) < (across + traffic.width[one]) / 2


def _corners(traffic: TrafficSnapshot, rows: list[int]) -> np.ndarray:
    where = (values[rows] for values in (traffic.x, traffic.y, traffic.heading, traffic.length, traffic.width))
    return Boxes(*where, np.arange(len(rows))).corners()


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan
