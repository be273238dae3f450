"""Trips of members from the traffic, as SUMO's tripinfo has them of its own vehicles.

SUMO's device would compare a moved member with a driver ten times as fast as the limit (see `vehicle_types`); here it
is compared with the driver that it was. A vehicle that departs or arrives in a step does so at the step's begin.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import compress
from operator import ne

import numpy as np

from platoontraffic.sumo.client import Client, direct
from platoontraffic.sumo.placement import Placement
from platoontraffic.sumo.reads import Once
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.trips import Trip

WAITING = 0.1  # speed below which a vehicle waits, as of SUMO's device [m/s]
MG = 1e-6  # a milligram [kg]

SUMS = ("distance", "waiting", "time_loss", "co2", "fuel")  # over the steps, in SI


class Trips:
    """Follows the members from the traffic.

    step: of SUMO's [s]
    """

    def __init__(self, sumo: Client, placement: Placement, step: float) -> None:
        self._sumo, self._placement, self._step = sumo, placement, step
        self._trips: dict[str, Trip] = {}
        self._sums = np.empty((0, len(SUMS)))  # of each trip
        self._drivers = np.empty((0, 2))  # of each trip: speed factor, and top speed [m/s]
        self._row: dict[str, int] = {}
        # [m/s], by lane; and of the lanes that `_limits_on` was last called with
        self._limits = Once(lambda lane: sumo.lane.getMaxSpeed(lane) if lane else np.inf)
        self._lanes: list[str] = []
        self._limit = np.empty(0)
        self._names: list[str] = []  # of the members in the fleet that are from the traffic ...
        self._rows = np.empty(0, dtype=np.intp)  # ... their rows there ...
        self._of_rows = np.empty(0, dtype=np.intp)  # ... and their rows in the sums
        self._for: tuple[str, ...] = ()
        self._handed_over: set[str] = set()  # members that SUMO has taken over, until they arrive

    def begin(self, newcomers: Fleet, kinds: Iterable[str], waits: Mapping[str, float]) -> None:
        """
        newcomers : still as SUMO has inserted them
        kinds     : the types that they had in the traffic
        waits     : of vehicles, for others of their platoons [s]
        """
        for member, kind in zip(newcomers.members, kinds, strict=True):
            self._row[member.id] = len(self._trips)
            delay = self._sumo.vehicle.getDepartDelay(member.id) + waits.get(member.id, 0.0)
            self._trips[member.id] = Trip(member.id, kind, round(member.departs - self._step, 6), delay)
        routes = [member.route for member in newcomers.members]
        self._drivers = np.concatenate([self._drivers, [(r.speed_factor, r.top_speed) for r in routes]])
        more = len(self._trips) - len(self._sums)
        self._sums = np.concatenate([self._sums, np.zeros((more, len(SUMS)))])

    def knows(self, name: str) -> bool:
        """It is, or was, a member from the traffic."""
        return name in self._row

    def driver(self, name: str) -> tuple[str, float]:
        """The type that a member had in the traffic, and its speed factor."""
        return self._trips[name].type, float(self._drivers[self._row[name], 0])

    def hand_over(self, name: str) -> None:
        """SUMO drives a member from now on."""
        self._handed_over.add(name)

    def observe(self, fleet: Fleet, time: float) -> None:
        """After every step. time: now [s]"""
        if fleet.ids is not self._for:
            self._for = fleet.ids
            rows = [i for i, name in enumerate(fleet.ids) if name in self._row]
            self._rows, self._names = np.array(rows, dtype=np.intp), [fleet.ids[i] for i in rows]
            self._of_rows = np.array([self._row[name] for name in self._names], dtype=np.intp)
        vehicle = self._sumo.vehicle
        if len(self._rows):
            names, lanes = self._names, self._placement.lanes(fleet)
            if len(names) < len(lanes):
                lanes = [lanes[i] for i in self._rows.tolist()]
            if not all(lanes):  # off the road
                lanes = [lane or vehicle.getLaneID(name) for name, lane in zip(names, lanes, strict=True)]
            self._add(self._of_rows, names, np.abs(fleet.motion.speed[self._rows]), lanes)
        if self._handed_over:
            arrived = self._handed_over.intersection(self._sumo.simulation.getArrivedIDList())
            self.end(arrived, round(time - self._step, 6), "arrived")
            self._handed_over -= arrived
            names = sorted(self._handed_over.intersection(vehicle.getIDList()))
            rows = np.array([self._row[name] for name in names], dtype=np.intp)
            self._add(rows, names, np.array([*map(vehicle.getSpeed, names)]), [*map(vehicle.getLaneID, names)])

    def _add(self, rows: np.ndarray, names: list[str], speed: np.ndarray, lanes: list[str]) -> None:
        """Count a step of vehicles in. rows: of the sums; all (m,)"""
        vehicle = self._sumo.vehicle
        factor, top_speed = self._drivers[rows].T
        desired = np.minimum(factor * self._limits_on(lanes), top_speed)
        emissions = map(direct, (vehicle.getCO2Emission, vehicle.getFuelConsumption))
        co2, fuel = (MG * np.fromiter(map(get, names), float, len(names)) for get in emissions)
        rates = speed, speed < WAITING, 1 - speed / desired, co2, fuel
        self._sums[rows] += self._step * np.column_stack(rates)

    def _limits_on(self, lanes: list[str]) -> np.ndarray:
        """Speed limits of lanes [m/s], (m,). They are looked up where a lane is another one than at the last call."""
        if len(lanes) != len(self._lanes):
            self._lanes, self._limit = [""] * len(lanes), np.full(len(lanes), np.inf)
        for k in compress(range(len(lanes)), map(ne, lanes, self._lanes)):
            self._limit[k] = self._limits[lanes[k]]
        self._lanes = lanes.copy()
        return self._limit

    def end(self, names: Iterable[str], time: float, status: str) -> None:
        """Members that have left: status "arrived" or "removed". time: of the begin of the step in which they do [s]"""
        for name in names:
            if name in self._trips:
                self._trips[name] = self._trips[name]._replace(ended=time, status=status)

    def rows(self) -> list[Trip]:
        """All trips, by their beginning."""
        return [
            trip._replace(**dict(zip(SUMS, sums, strict=True)))
            for trip, sums in zip(self._trips.values(), self._sums.tolist(), strict=True)
        ]
