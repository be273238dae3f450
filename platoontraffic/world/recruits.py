"""Members from the traffic: which vehicles of SUMO's become members, and as what.

A vehicle is chosen by a number in [0, 1) that depends on the seed and its id (`road.demand.drawn`). So the choice does
not depend on the order or the time of departures, and a larger share contains a smaller one.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from typing import NamedTuple

from platoontraffic.errors import InputError
from platoontraffic.road.demand import drawn
from platoontraffic.road.network import Network
from platoontraffic.road.platooning import Plan
from platoontraffic.road.route import Route
from platoontraffic.scenario import Equip, Scenario
from platoontraffic.scenario.equip_tables import VEHICLE_OF
from platoontraffic.vehicles.bicycle import CARS, Car
from platoontraffic.vehicles.records import changed
from platoontraffic.world.deployment import Equipment, route_from
from platoontraffic.world.fleet import Member

SMALLEST, LARGEST = 0.6, 1.6  # length that is driven as such a vehicle [times its length]

# Why a vehicle of the share stays SUMO's.
OTHER_SIZE, HAS_STOPS, NO_ROUTE = "another size", "has stops", "a route that members cannot drive"
TOO_EARLY = "departed in the first two steps, in which the members are placed"


class Undrivable(NamedTuple):
    """Vehicles of the shares that stay SUMO's for one fault of their routes."""

    vehicles: int  # number of them
    such_as: str  # id of the first one
    why: str  # the fault of its route


class Newcomer(NamedTuple):
    """A vehicle of the traffic that SUMO has just inserted."""

    id: str
    vehicle_class: str
    edges: tuple[str, ...]  # its route
    lane: int
    position: float  # of its front bumper on the lane [m]
    pose: tuple[float, float, float]  # x, y of its centre [m], heading [rad]
    speed: float  # [m/s]
    length: float  # [m]
    width: float
    speed_factor: float  # of its driver: times the speed limit
    max_speed: float  # of its type [m/s]
    stops: bool  # it is to stop on its way


class Recruits:
    """The shares of a scenario's traffic that become members."""

    def __init__(self, scenario: Scenario, network: Network, plan: Plan | None = None) -> None:
        """plan: the platoons that they form; None: none"""
        self._scenario, self._network = scenario, network
        platoons = plan.platoons if plan else ()
        self._places = {name: (k, i) for k, one in enumerate(platoons) for i, name in enumerate(one.ids)}
        self.waits = plan.waits if plan else {}  # of vehicles, for others of their platoons [s]
        self._first = len(scenario.spec.platoon)  # group of the first share
        self._routes: dict[tuple, tuple[Route | None, str]] = {}  # as of `_route`
        self.tables = scenario.spec.equip
        self.left: Counter[str] = Counter()  # vehicles of the shares that stay SUMO's, by the reason
        self._undrivable: dict[str, Undrivable] = {}  # by the fault, without what depends on the vehicle

    def begin(self) -> None:
        """Begin a run: no vehicle has stayed SUMO's yet."""
        self.left.clear()
        self._undrivable.clear()

    @property
    def undrivable(self) -> list[Undrivable]:
        """Faults of the routes that members cannot drive, those of most vehicles first."""
        return sorted(self._undrivable.values(), key=lambda one: (-one.vehicles, one.why))

    def chosen(self, name: str, kind: str, vehicle_class: str, edge: str, time: float) -> int | None:
        """The number of the table `equip` whose share a vehicle is of; None: it is of none.

        Where several tables fit, their shares add up.

        kind, edge: its type, and the edge on which it departs; time: of its departure [s]
        """
        if name in self._places:  # it may have waited past `end_s`
            return 0
        number, below = drawn(self._scenario.seed, name), 0.0
        for i, equip in enumerate(self.tables):
            if _fits(equip, kind, vehicle_class, edge, time):
                below += equip.share
                if number < below:
                    return i
        return None

    def missed(self, name: str, kind: str, vehicle_class: str, edge: str) -> None:
        """A vehicle has departed before the time 0 of the run, after the warm-up; arguments as of `chosen`."""
        if self.chosen(name, kind, vehicle_class, edge, 0.0) is not None:
            self.left[TOO_EARLY] += 1

    def member(self, equip: int, vehicle: Newcomer, time: float) -> Member | None:
        """The vehicle as a member of a table `equip`; None if it stays SUMO's: see `left`.

        time: of its departure [s]
        """
        model, why = _model(vehicle.vehicle_class, vehicle.length, vehicle.width)
        route, fault = self._route(vehicle, model) if model else (None, "")
        if fault:
            why = NO_ROUTE
        if vehicle.stops:
            why = HAS_STOPS
        if why:
            self.left[why] += 1
            if why == NO_ROUTE:
                self._note(vehicle.id, fault)
            return None
        table = self.tables[equip]
        platoon, place = self._places.get(vehicle.id, (None, 0))
        role = "leader" if table.leader and place == 0 else "follower"
        equipment = Equipment.of(self._scenario, self._first + equip, role, model)
        return Member(
            id=vehicle.id,
            platoon=table.id if platoon is None else f"{table.id}.{platoon}",
            place=place,
            model=model,
            lidar=equipment.lidars[0],
            law=equipment.law,
            edge=vehicle.edges[0],
            lane=vehicle.lane,
            position=vehicle.position,
            pose=vehicle.pose,
            # The line of the route is shared by all that drive it, their speeds are not.
            route=changed(route, speed_factor=vehicle.speed_factor, top_speed=vehicle.max_speed),
            departs=time,
            speed=vehicle.speed,
            odometry=equipment.odometry,
            further_lidars=equipment.lidars[1:],
            sensors=equipment.sensors,
            equip=table.id,
            single=table.mode == "single",
        )

    def _note(self, name: str, fault: str) -> None:
        """Note a vehicle whose route cannot be driven. Faults that differ only in what is allowed count as one."""
        what = fault.partition(";")[0]
        vehicles, *first = self._undrivable.get(what, (0, name, fault))
        self._undrivable[what] = Undrivable(vehicles + 1, *first)

    def _route(self, vehicle: Newcomer, model: Car) -> tuple[Route | None, str]:
        """The route of the vehicle; or None, and why members cannot drive it."""
        key = vehicle.edges, vehicle.lane, vehicle.position, model.length, model.width
        if key not in self._routes:
            try:
                walls, rear = self._scenario.spec.scene.walls == "outline", vehicle.position - vehicle.length
                route = route_from(self._network, vehicle.edges, vehicle.lane, vehicle.position, rear, walls, model)
                route.curvature(model.length)  # computed now, it is shared by all that drive the route
                self._routes[key] = route, ""
            except InputError as error:
                self._routes[key] = None, error.faults[0]
        return self._routes[key]


def _fits(equip: Equip, kind: str, vehicle_class: str, edge: str, time: float) -> bool:
    return (
        (not equip.types or kind in equip.types)
        and vehicle_class in (equip.classes or VEHICLE_OF)
        and (not equip.edges or edge in equip.edges)
        and equip.begin_s <= time
        and (equip.end_s is None or time < equip.end_s)
    )


@cache
def _model(vehicle_class: str, length: float, width: float) -> tuple[Car | None, str]:
    """How a vehicle of a size [m] drives, one for all that are alike; or None, and why not."""
    like = CARS[VEHICLE_OF[vehicle_class]]
    size = length / like.length
    if not SMALLEST <= size <= LARGEST:
        return None, OTHER_SIZE
    return replace(like, length=length, width=width, axle=size * like.axle, wheelbase=size * like.wheelbase), ""
