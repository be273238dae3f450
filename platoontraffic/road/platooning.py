"""Platoons of a share of a demand: vehicles with the same start that share the beginning of their routes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import NamedTuple

from platoontraffic.errors import counted
from platoontraffic.road.demand import Demand, Selection, Vehicle, common_beginning
from platoontraffic.road.fastest_routes import FastestRoutes
from platoontraffic.road.network import Network

ALONE = "no other with their start and route departs soon enough"
UNCHECKED = "this includes vehicles on routes that members cannot drive: the run leaves them to SUMO and counts them"
RANDOM_POSITIONS = ("random", "random_free")

RouteOf = Callable[[Vehicle], tuple[str, ...]]


class Platoon(NamedTuple):
    """Vehicles that wait for each other at their start."""

    ids: tuple[str, ...]  # in order of departure, the leader first
    edges: tuple[str, ...]  # the common beginning of their routes
    depart: float  # of the leader; a follower is up to 0.001 s after its predecessor, which keeps them in order [s]
    waits: tuple[float, ...]  # of each vehicle [s]


class Plan(NamedTuple):
    """The platoons of a share of a demand, and the vehicles of the share that are in none."""

    platoons: tuple[Platoon, ...]
    single: Mapping[str, str]  # id -> why
    size: int
    window: float  # [s]
    random_flows: Mapping[str, float]  # of the demand

    @property
    def waits(self) -> dict[str, float]:
        """Waits of the vehicles that have to wait [s]."""
        pairs = (pair for platoon in self.platoons for pair in zip(platoon.ids, platoon.waits, strict=True))
        return {name: wait for name, wait in pairs if wait > 0}

    def summary(self, scale: float = 1.0, end: float = math.inf) -> list[str]:
        """What was found and what is left over, in plain lines.

        scale : of the demand, in the run
        end   : of the run [s]
        """
        waits = [wait for platoon in self.platoons for wait in platoon.waits]
        sizes = sorted(Counter(len(platoon.ids) for platoon in self.platoons).items())
        lines = [f"no two vehicles can form a platoon within {self.window:g} s"]
        if waits:
            lines = [
                f"{counted(len(self.platoons), 'platoon')} found, of {len(waits):,} vehicles: "
                + ", ".join(f"{number:,} of {size}" for size, number in sizes)
                + f"; a vehicle waits {sum(waits) / len(waits):.1f} s on average, {max(waits):.1f} s at most"
            ]
        if later := sum(platoon.depart >= end for platoon in self.platoons):
            lines.append(f"{counted(later, 'platoon')} of these would depart after the end of the run")
        if self.single:
            reasons = ", ".join(f"{number:,}: {why}" for why, number in Counter(self.single.values()).most_common())
            lines.append(f"{counted(len(self.single), 'vehicle')} left over, each a platoon of one ({reasons})")
        if self.random_flows:
            lines.append(
                f"{counted(len(self.random_flows), 'flow')} with random departures (some "
                f"{sum(self.random_flows.values()):,.0f} vehicles before the share is taken): platoons of one"
            )
        if scale > 1:
            lines.append(f"the demand is scaled by {scale:g}: the vehicles that this adds are platoons of one")
        elif scale < 1:
            lines.append(f"the demand is scaled by {scale:g}: platoons lack the vehicles that this leaves out")
        if waits or self.single:
            lines.append(UNCHECKED)
        return lines


def plan(demand: Demand, selection: Selection, size: int, window: float, network: Network) -> Plan:
    """The platoons of a share of a demand.

    size   : vehicles of a platoon, at most
    window : longest wait [s]
    """
    fit, single = [], {}
    for vehicle in demand.vehicles:
        edge, depart = (*vehicle.edges, "")[0], selection.begin if vehicle.depart is None else vehicle.depart
        taken = [selection.takes(vehicle.id, kind, edge, depart) for kind in demand.kinds(vehicle)]
        if any(taken):
            if why := _unfit(vehicle, all(taken)):
                single[vehicle.id] = why
            else:
                fit.append(vehicle)
    by_class: dict[str, FastestRoutes] = {}

    def route(vehicle: Vehicle) -> tuple[str, ...]:
        if not vehicle.routed:
            return vehicle.edges
        routes = []
        for vclass in {kind.vclass for kind in demand.kinds(vehicle)}:
            by_class.setdefault(vclass, network.fastest_routes(vclass))
            routes.append(by_class[vclass].through(vehicle.edges))
        return reduce(common_beginning, routes)

    found, alone = platoons(fit, size, window, route)
    single |= dict.fromkeys(alone, ALONE)
    return Plan(found, single, size, window, demand.random_flows)


def _unfit(vehicle: Vehicle, taken: bool) -> str:
    """Why a vehicle cannot be in a platoon; "" if it can. taken: the share has it whatever its type"""
    if not taken:
        return "SUMO draws their type at departure"
    if vehicle.depart is None:
        return "their departure is triggered"
    if vehicle.taz or not vehicle.edges or (vehicle.routed and len(vehicle.edges) < 2):
        return "their route is known at departure only"
    if vehicle.stops:
        return "they stop on their route"
    if vehicle.position in RANDOM_POSITIONS:
        return "they depart at a random position"
    return ""


@dataclass
class _Open:
    """A platoon that others may join."""

    edges: tuple[str, ...]
    whole: bool  # these are the whole routes of all
    members: list[Vehicle]
    after: list[int] = field(default_factory=lambda: [0])  # departures after that of the platoon [ms]

    def together(self, edges: tuple[str, ...], whole: bool) -> tuple[str, ...]:
        """What a vehicle's route has in common with the platoon's; () if that is too short."""
        together = common_beginning(self.edges, edges)
        same = self.whole and whole and self.edges == edges
        return together if len(together) > 1 or same else ()

    def finished(self) -> Platoon:
        last = _ms(self.members[-1])
        waits = tuple((last + after - _ms(v)) / 1000 for v, after in zip(self.members, self.after, strict=True))
        return Platoon(tuple(v.id for v in self.members), self.edges, last / 1000, waits)


def platoons(
    vehicles: Iterable[Vehicle], size: int, window: float, route: RouteOf = lambda vehicle: vehicle.edges
) -> tuple[tuple[Platoon, ...], list[str]]:
    """Join vehicles in their order of departure; all depart with the last of their platoon.

    A vehicle joins the platoon with its start (edge, lane if that is a number, and position) with which it shares the
    most edges: two at least, or the whole route of all. A platoon is closed when it is full, or when its first vehicle
    would wait longer than the window.

    size    : vehicles of a platoon, at most
    window  : longest wait [s]
    route   : route of a vehicle, asked only if another one departs from its start soon enough
    returns : platoons in order of departure, and the ids of vehicles that are in none
    """
    starts: dict[tuple[str, str, str], list[Vehicle]] = {}
    rank: dict[str, int] = {}
    for vehicle in vehicles:
        rank[vehicle.id] = len(rank)
        lane = vehicle.lane if vehicle.lane.isdecimal() else ""
        starts.setdefault((vehicle.edges[0], lane, vehicle.position), []).append(vehicle)
    found: list[Platoon] = []
    alone: list[str] = []
    for queue in starts.values():
        queue.sort(key=_ms)  # stable: in the order of the files where departures are equal
        for group in _joined(queue, size, round(window * 1000), route, rank):
            if len(group.members) > 1:
                found.append(group.finished())
            else:
                alone.append(group.members[0].id)
    found.sort(key=lambda platoon: (platoon.depart, rank[platoon.ids[0]]))
    return tuple(found), sorted(alone, key=rank.__getitem__)


def _joined(
    queue: Sequence[Vehicle], size: int, window: int, route: RouteOf, rank: Mapping[str, int]
) -> Iterable[_Open]:
    """Platoons of vehicles with the same start, in order of departure, those of one vehicle included."""
    groups: list[_Open] = []
    open_ones: list[_Open] = []
    for i, vehicle in enumerate(queue):
        near = [other for other in queue[max(i - 1, 0) : i + 2] if abs(_ms(other) - _ms(vehicle)) <= window]
        edges = route(vehicle) if len(near) > 1 else vehicle.edges[:1]
        open_ones = [g for g in open_ones if len(g.members) < size and _ms(vehicle) - _ms(g.members[0]) <= window]
        best, together, later = None, (), 0
        for group in open_ones:
            after = group.after[-1] + (not _in_order(group.members[-1], vehicle, rank))
            common = group.together(edges, not vehicle.drawn)
            if len(common) > len(together) and _ms(vehicle) + after - _ms(group.members[0]) <= window:
                best, together, later = group, common, after
        if best:
            best.whole = best.whole and not vehicle.drawn and best.edges == edges
            best.edges = together
            best.members.append(vehicle)
            best.after.append(later)
        else:
            groups.append(_Open(edges, not vehicle.drawn, [vehicle]))
            open_ones.append(groups[-1])
    return groups


def _in_order(one: Vehicle, next_one: Vehicle, rank: Mapping[str, int]) -> bool:
    """Whether SUMO inserts vehicles in this order if both depart at the same time: it has loaded them in this order."""
    source = (one.file, one.flow) == (next_one.file, next_one.flow)
    return source and rank[one.id] < rank[next_one.id]


def _ms(vehicle: Vehicle) -> int:
    """Departure [ms]."""
    return round((vehicle.depart or 0.0) * 1000)
