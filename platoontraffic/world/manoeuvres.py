"""Orders to members at set times: to split off, to join the end of a platoon, to leave.

Vehicles exchange no messages. A member ordered to split off follows nothing: it drives its route as a leader does, with
a leader's headway, and its follower goes on following it. A member ordered to join follows the vehicle ahead of it on
its route. A member ordered to leave drives a route of its own and follows nothing; its follower receives no order, and
loses it where the routes part.
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
from platoontraffic.scenario.tables import Manoeuvre
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet, Member

PARTED = 0.2  # heading error from which a vehicle no longer turns into a route [rad]
LOOK_AHEAD = 0.2  # piece of a route over which its direction is taken [vehicle lengths]


class Order(NamedTuple):
    time: float  # [s]
    kind: str  # split, join or leave
    vehicle: str
    behind: str  # the member to join behind; "" unless kind is join
    route: Route | None  # to leave by; None unless kind is leave


def orders(scenario: Scenario, network: Network, members: Sequence[Member]) -> tuple[Order, ...]:
    """The manoeuvres of a scenario by their time.

    raises: InputError where a route to leave by does not connect, or joins would form a cycle
    """
    by_id = {m.id: m for m in members}
    found, faults = [], _cycles(scenario, members)
    for i, table in enumerate(scenario.spec.manoeuvre):
        route = None
        if table.kind == "leave":
            try:
                route = _route_to_leave(table, by_id[table.vehicle], network)
            except InputError as error:
                key = "to" if table.to else "route"
                faults += [scenario.fault(("manoeuvre", i, key), fault) for fault in error.faults]
        found.append(Order(table.time_s, table.kind, table.vehicle, table.behind or "", route))
    if faults:
        raise InputError(*faults)
    return tuple(sorted(found, key=lambda order: order.time))


def _route_to_leave(table: Manoeuvre, member: Member, network: Network) -> Route:
    """From the member's start edge on. raises: InputError"""
    edges = network.fastest_route(member.edge, table.to) if table.to else table.route
    if member.edge not in edges:
        raise InputError(f"{edges}: does not contain the start edge {member.edge!r}")
    edges = edges[edges.index(member.edge) :]
    network.check_reversals(edges, member.model.turning_radius)
    lanes = network.route_lanes(edges, member.lane, False, member.position)
    return Route.along(edges, *lanes).drivable_by(member.model)


class Manoeuvres:
    """Carries out orders when their time has come."""

    def __init__(self, orders: Sequence[Order]) -> None:
        """orders: by their time"""
        self._pending = list(orders)

    def applied(self, fleet: Fleet, time: float) -> tuple[Fleet, list[Noted]]:
        """The fleet after the orders now due, and a note for each, with the reason if it was rejected."""
        notes = []
        while self._pending and self._pending[0].time < time + 1e-6:
            order = self._pending.pop(0)
            row_of = {m.id: i for i, m in enumerate(fleet.members)}
            row, behind = row_of.get(order.vehicle, -1), row_of.get(order.behind, -1)
            rejected = _rejection(order, fleet, row, behind)
            if not rejected:
                fleet = _carried_out(order, fleet, row, behind)
            detail = f"to {order.kind}" + (rejected and f"; rejected: {rejected}")
            note = Noted(row, "told", detail, other=order.behind, vehicle=order.vehicle, what=order.kind)
            notes.append(note._replace(done=int(not rejected)))
        return fleet, notes


def _carried_out(order: Order, fleet: Fleet, row: int, behind: int) -> Fleet:
    predecessor, leads = fleet.predecessor.copy(), fleet.leads.copy()
    if order.kind == "leave":  # its follower gets its predecessor
        predecessor[predecessor == row] = predecessor[row]
    predecessor[row] = behind
    leads[row] = order.kind != "join"
    fleet = fleet.with_orders(predecessor, leads)
    return fleet.with_route(row, order.route) if order.route else fleet


def _rejection(order: Order, fleet: Fleet, row: int, behind: int) -> str:
    """Why an order cannot be carried out now; "" if it can. row, behind: of the two members; -1: not on the road."""
    if row < 0:
        return f"{order.vehicle} is not on the road"
    if order.kind == "split" and fleet.leads[row]:
        return f"{order.vehicle} leads already"
    if order.kind == "join":
        return _join_rejection(order, fleet, row, behind)
    if order.route and _has_passed(order.route, fleet, row):
        return f"{order.vehicle} has passed the place where the routes part"
    return ""


def _join_rejection(order: Order, fleet: Fleet, row: int, behind: int) -> str:
    if behind < 0:
        return f"{order.behind} is not on the road"
    if fleet.predecessor[row] == behind:
        return f"{order.vehicle} is behind {order.behind} already"
    if _is_behind(fleet, behind, row):
        return f"{order.behind} is behind {order.vehicle}"
    if (route := fleet.members[row].route) and not _is_ahead(route, fleet, behind, row):
        return f"{order.behind} is not ahead of {order.vehicle} on its route"
    return ""


def _is_behind(fleet: Fleet, row: int, other: int) -> bool:
    """Whether following predecessors from one row leads to another, or starts there."""
    while row >= 0 and row != other:
        row = fleet.predecessor[row]
    return row == other


def _is_ahead(route: Route, fleet: Fleet, row: int, own: int) -> bool:
    """Whether the member in `row` is on a route, ahead of the member in row `own` to which the route belongs."""
    station, aside = _on_route(route, fleet, row)
    own_station, _ = _on_route(route, fleet, own)
    return abs(aside) <= fleet.model.length[own] and (station >= own_station or route.closed)


def _has_passed(route: Route, fleet: Fleet, row: int) -> bool:
    """Whether a member is beside a route, or no longer turns into it."""
    length = fleet.model.length[row]
    station, aside = _on_route(route, fleet, row)
    along = np.diff(route.line.at(np.array([station, station + LOOK_AHEAD * length])), axis=0)[0]
    turned = wrap(math.atan2(along[1], along[0]) - fleet.motion.heading[row])
    return abs(aside) > length or abs(turned) > PARTED


def _on_route(route: Route, fleet: Fleet, row: int) -> tuple[float, float]:
    """Station [m] and offset to the left [m] of the middle of a member's driven axle."""
    x, y = fleet.model.axle_position(fleet.motion)
    return route.line.project(float(x[row]), float(y[row]), 0.0, math.inf)


def _cycles(scenario: Scenario, members: Sequence[Member]) -> list[str]:
    """Faults of joins behind a member that is itself behind the one that joins."""
    ahead = {m.id: f"{m.platoon}.{m.place - 1}" if m.place else "" for m in members}
    faults = []
    for i, table in sorted(enumerate(scenario.spec.manoeuvre), key=lambda one: one[1].time_s):
        if table.kind == "leave":
            ahead |= {name: ahead[table.vehicle] for name, other in ahead.items() if other == table.vehicle}
        ahead[table.vehicle] = table.behind or ""
        there = table.behind
        while there and there != table.vehicle:
            there = ahead[there]
        if there:
            fault = f"{table.behind!r}: is behind {table.vehicle} itself"
            faults.append(scenario.fault(("manoeuvre", i, "behind"), fault))
            ahead[table.vehicle] = ""
    return faults
