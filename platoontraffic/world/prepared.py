"""A scenario made ready to be simulated: its road read, its members placed, all faults of the input found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from platoontraffic.errors import InputError, counted, did_you_mean
from platoontraffic.lidar import Scene
from platoontraffic.road.demand import Demand, Selection, Vehicle, read_demand
from platoontraffic.road.network import Network
from platoontraffic.road.platooning import Plan, plan
from platoontraffic.road.sumo_configuration import ON, in_seconds
from platoontraffic.scenario import Scenario
from platoontraffic.scenario.equip_tables import VEHICLE_OF
from platoontraffic.world import manoeuvres, obstacles
from platoontraffic.world.deployment import deploy, static_scene
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.manoeuvres import Order
from platoontraffic.world.obstacles import Plan as ObstaclePlan


class Platooning(NamedTuple):
    """Platoons that vehicles of the traffic form."""

    plan: Plan
    demand: Demand
    lanes: dict[str, int]  # on which they depart


@dataclass(frozen=True)
class Prepared:
    scenario: Scenario
    network: Network
    scene: Scene  # static obstacles
    members: tuple[Member, ...]
    obstacles: tuple[ObstaclePlan, ...] = ()  # moving or temporary ones
    orders: tuple[Order, ...] = ()
    platooning: Platooning | None = None  # of members from the traffic; None: they are in no platoons
    unsorted: Demand | None = None  # of a scenario with `equip`, where SUMO ignores a part of it for its order
    then: tuple[Member, ...] = ()  # the members as they are after the scenario's branch; (): it has none


def prepare(scenario: Scenario, network: Network | None = None) -> Prepared:
    """network: if it was read before. raises: InputError with one line for every fault found"""
    network = network or Network.read(scenario.net)
    # In large networks these two take seconds, which should not count as the loop's.
    network.middle_lines()
    network.entered_from  # noqa: B018
    scene = static_scene(scenario, network)
    members = deploy(scenario, network, scene)
    plans = obstacles.plans_of(scenario, network, members)
    orders = manoeuvres.orders(scenario, network, members)
    _check_edges(scenario, network)
    demand = _demand(scenario)
    _check_types(scenario, demand)
    _check_routes(scenario, network, demand)
    platooning = _platooning(scenario, network, demand)
    unsorted = demand if scenario.spec.equip and demand.unsorted else None
    prepared = Prepared(scenario, network, scene, members, plans, orders, platooning, unsorted)
    return branched(prepared, scenario) if scenario.then else prepared


def _check_edges(scenario: Scenario, network: Network) -> None:
    """raises: InputError where a list of edges names one that there is not"""
    lists = {("equip", i, "edges"): equip.edges for i, equip in enumerate(scenario.spec.equip)}
    lists["record", "passages"] = scenario.spec.record.passages
    faults = [
        scenario.fault((*key, k), f"{edge!r}: no such edge{did_you_mean(edge, network.edges)}")
        for key, edges in lists.items()
        for k, edge in enumerate(edges)
        if edge not in network.edges
    ]
    if faults:
        raise InputError(*faults)


def _check_types(scenario: Scenario, demand: Demand) -> None:
    """raises: InputError where a share is to be of a vehicle type that the demand does not have"""
    named = [(i, k, name) for i, equip in enumerate(scenario.spec.equip) for k, name in enumerate(equip.types)]
    if not named:
        return
    types = demand.types
    known = {kind.type for kinds in types.values() for kind in kinds}
    faults = []
    for i, k, name in named:
        if name not in known:
            drawn = ", ".join(kind.type for kind in types.get(name, ()))
            what = (
                f"a distribution; must be types: {drawn}"
                if drawn
                else f"no such vehicle type{did_you_mean(name, known)}"
            )
            faults.append(scenario.fault(("equip", i, "types", k), f"{name!r}: {what}"))
    if faults:
        raise InputError(*faults)


def _check_routes(scenario: Scenario, network: Network, demand: Demand) -> None:
    """raises: InputError where SUMO would refuse vehicles: for edges that there are not, for a route that is not
    connected, or for a lane of departure that there is not
    """
    config = scenario.configuration
    if config and config.options.get("ignore-route-errors", "false").lower() in ON:
        return
    end = scenario.start + scenario.spec.run.duration_s
    faults: dict[object, str] = {}  # by what is wrong: vehicles may share it
    connected: set[tuple[str, str]] = set()  # routes share most of their connections
    for vehicle in {(one.edges, one.lane): one for one in reversed(demand.vehicles)}.values():
        name = f"{vehicle.file}: {vehicle.flow or vehicle.id!r}"
        missing = [edge for edge in vehicle.edges if not network.has_edge(edge)]
        for edge in missing:
            if edge not in faults:
                faults[edge] = f"{name}: no edge {edge!r}{did_you_mean(edge, network.edges)}"
        if not missing and (vehicle.depart is None or vehicle.depart < end):  # SUMO finds these at departure
            for what, words in _faults_at_departure(vehicle, network, connected):
                faults.setdefault(what, f"{name}: {words}")
    if faults:
        raise InputError(*faults.values())


def _faults_at_departure(
    vehicle: Vehicle, network: Network, connected: set[tuple[str, str]]
) -> Iterator[tuple[tuple[str, str], str]]:
    """What is wrong with the route and the lane of departure of a vehicle whose edges there are, and words on it.

    connected: pairs of edges that are known to be connected; new ones are added
    """
    for pair in pairwise(() if vehicle.routed else vehicle.edges):
        if pair in connected:
            continue
        one, following = pair
        if network.leads_to(one, following):
            connected.add(pair)
            continue
        known = f"; it leads to: {', '.join(onward)}" if (onward := network.edges_after(one)) else ""
        yield pair, f"no connection from edge {one!r} to {following!r}{known}"
    if vehicle.edges and not vehicle.taz and vehicle.lane.isdecimal():
        lanes = network.number_of_lanes(vehicle.edges[0])
        if len(vehicle.lane) > 9 or int(vehicle.lane) >= lanes:
            has = f"edge {vehicle.edges[0]!r} has {counted(lanes, 'lane')}, numbered from 0"
            yield (vehicle.edges[0], vehicle.lane), f"departLane = {vehicle.lane!r}: {has}"


def _demand(scenario: Scenario) -> Demand:
    """raises: InputError"""
    config = scenario.configuration
    in_order = not (config and in_seconds(config.options.get("route-steps", "200")) <= 0)
    end = config.end if config else None
    return read_demand(scenario.route_files, scenario.additional_of_sumo, scenario.begin, end, in_order)


def _platooning(scenario: Scenario, network: Network, demand: Demand) -> Platooning | None:
    """The platoons of the traffic's share."""
    equip = next((one for one in scenario.spec.equip if one.mode == "platoons"), None)
    if equip is None:
        return None
    start = scenario.start
    end = math.inf if equip.end_s is None else start + equip.end_s
    chosen = Selection(
        scenario.seed,
        equip.share,
        frozenset(equip.types),
        frozenset(equip.classes) or frozenset(VEHICLE_OF),
        frozenset(equip.edges),
        start + equip.begin_s,
        end,
    )
    found = plan(demand, chosen, equip.size, equip.window_s, network)
    classes = {one.id: {kind.vclass for kind in demand.kinds(one)} for one in demand.vehicles}
    lanes = {}
    for one in found.platoons:
        lane = network.lane_for(one.edges, set().union(*(classes[name] for name in one.ids)))
        lanes |= dict.fromkeys(one.ids, lane)
    return Platooning(found, demand, lanes)


def branched(prepared: Prepared, scenario: Scenario) -> Prepared:
    """The same for the same scenario with a branch. raises: InputError"""
    then = deploy(scenario.then, prepared.network, prepared.scene)
    return replace(prepared, scenario=scenario, then=then)


def after_branch(prepared: Prepared) -> Prepared:
    """The same for what the scenario is after its branch."""
    return replace(prepared, scenario=prepared.scenario.then, members=prepared.then, then=())


def departures(members: Sequence[Member], dt: float) -> tuple[Fleet, list[Fleet]]:
    """The members that are on the road at time 0, and one fleet for each platoon that departs later."""
    number = {m.id: i for i, m in enumerate(members)}

    def fleet(some: Sequence[Member]) -> Fleet:
        return Fleet.deployed(some, dt, np.array([number[m.id] for m in some], dtype=int))

    platoons: dict[str, list[Member]] = {}
    for m in members:
        platoons.setdefault(m.platoon, []).append(m)
    later = [fleet(platoon) for platoon in platoons.values() if platoon[0].departs > 0]
    return fleet([m for m in members if m.departs == 0]), later
