"""What members are told at set times: to split off, to join the end of a platoon, to leave.

Nothing passes between vehicles. Who is told to split off follows nobody: it drives its route as a leader does,
with a leader's headway, and those behind it go on following it. Told to join, it follows whoever is before it on its
route. Who leaves follows nobody on a way of its own; the one behind is told nothing: it loses it where their ways part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.lidar.pose import wrap
from platoontraffic.road.network import Network
from platoontraffic.road.route import Route
from platoontraffic.scenario import Scenario
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet, Member

PARTED = 0.2  # from another direction one does not turn into a way any more [rad]


class Order(NamedTuple):
    time: float  # [s]
    kind: str
    vehicle: str
    behind: str  # whom it shall join; "" for the others
    route: Route | None  # of who leaves


def orders(scenario: Scenario, network: Network, members: Sequence[Member]) -> tuple[Order, ...]:
    """In the order of their times. raises: InputError where a way to leave by does not connect"""
    by_id = {m.id: m for m in members}
    found, faults = [], _circles(scenario, members)
    for i, told in enumerate(scenario.spec.manoeuvre):
        route = None
        if told.kind == "leave":
            member = by_id[told.vehicle]
            try:
                edges = network.fastest_route(member.edge, told.to) if told.to else told.route
                if member.edge not in edges:
                    raise InputError(f"{edges}: does not contain the start edge {member.edge!r}")
                edges = edges[edges.index(member.edge) :]
                network.check_reversals(edges, member.model.turning_radius)
                route = Route.along(edges, *network.route_lanes(edges, member.lane, False, member.position))
            except InputError as error:
                key = "to" if told.to else "route"
                faults += [scenario.fault(("manoeuvre", i, key), fault) for fault in error.faults]
        found.append(Order(told.time_s, told.kind, told.vehicle, told.behind or "", route))
    if faults:
        raise InputError(*faults)
    return tuple(sorted(found, key=lambda order: order.time))


class Orders:
    """Gives them when their time has come."""

    def __init__(self, orders: Sequence[Order]) -> None:
        self._later = list(orders)

    def given(self, fleet: Fleet, time: float) -> tuple[Fleet, list[Noted]]:
        """The fleet that knows what it was told just now, and this; with why, if it was told in vain."""
        told = []
        while self._later and self._later[0].time < time + 1e-6:
            order = self._later.pop(0)
            row_of = {m.id: i for i, m in enumerate(fleet.members)}
            row, behind = row_of.get(order.vehicle, -1), row_of.get(order.behind, -1)
            if why := _in_vain(order, fleet, row, behind):
                told.append(
                    Noted(row, "told", f"to {order.kind}, but {why}", other=order.behind, vehicle=order.vehicle)
                )
                continue
            predecessor = fleet.predecessor.copy()
            if order.kind == "leave":  # who was behind it shall be behind whom it followed
                predecessor[predecessor == row] = predecessor[row]
            predecessor[row] = behind
            leads = fleet.leads.copy()
            leads[row] = order.kind != "join"
            fleet = fleet.with_orders(predecessor, leads)
            if order.route:
                fleet = fleet.with_route(row, order.route)
            told.append(Noted(row, "told", f"to {order.kind}", other=order.behind))
        return fleet, told


def _in_vain(order: Order, fleet: Fleet, row: int, behind: int) -> str:
    """Why an order cannot be followed now; "" if it can."""
    if row < 0:
        return "it is not on the road"
    if order.kind == "join" and behind < 0:
        return f"{order.behind} is not on the road"
    if order.kind == "join" and fleet.predecessor[row] == behind:
        return "it is behind that"
    if order.kind == "split" and fleet.leads[row]:
        return "it follows nobody"
    ahead = behind
    while ahead >= 0:
        if ahead == row:
            return f"{order.behind} is behind it"
        ahead = fleet.predecessor[ahead]
    x, y = fleet.model.axle_position(fleet.motion)
    length = fleet.model.length[row]
    if order.kind == "join" and (route := fleet.members[row].route):
        own, _ = route.line.project(float(x[row]), float(y[row]), 0.0, math.inf)
        there, aside = route.line.project(float(x[behind]), float(y[behind]), 0.0, math.inf)
        if abs(aside) > length or (there < own and not route.closed):
            return f"{order.behind} is not ahead of it on its way"
    if order.route:
        there, aside = order.route.line.project(float(x[row]), float(y[row]), 0.0, math.inf)
        along = np.diff(order.route.line.at(np.array([there, there + 0.2 * length])), axis=0)[0]
        turned = wrap(math.atan2(along[1], along[0]) - fleet.motion.heading[row])
        if abs(aside) > length or abs(turned) > PARTED:
            return "the ways have parted"
    return ""


def _circles(scenario: Scenario, members: Sequence[Member]) -> list[str]:
    """Faults of those who would join the end of what is behind themselves."""
    ahead = {m.id: f"{m.platoon}.{m.place - 1}" if m.place else "" for m in members}
    faults = []
    for i, told in sorted(enumerate(scenario.spec.manoeuvre), key=lambda one: one[1].time_s):
        if told.kind == "leave":
            ahead |= {name: ahead[told.vehicle] for name, other in ahead.items() if other == told.vehicle}
        ahead[told.vehicle] = told.behind or ""
        there = told.behind
        while there and there != told.vehicle:
            there = ahead[there]
        if there:
            faults.append(
                scenario.fault(("manoeuvre", i, "behind"), f"{told.behind!r}: is behind {told.vehicle} itself")
            )
            ahead[told.vehicle] = ""
    return faults
