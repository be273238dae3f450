"""Vehicles that pass the ends of edges, whoever drives them.

SUMO's own detectors are not asked: they see a moved vehicle only where SUMO thinks that it drove through them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.trips import Trips
from platoontraffic.world.passages import Passage

ONCE = 10.0  # a member that is put back and forth between two edges does not pass twice in this time [s]


class Passages:
    """edges: that are counted"""

    def __init__(self, sumo: Client, network: Network, edges: Sequence[str], trips: Trips) -> None:
        self._sumo, self._trips, self.counted = sumo, trips, edges
        self._lanes = {edge: [f"{edge}_{i}" for i in range(len(network.edges[edge]))] for edge in edges}
        self._beyond = {edge: network.beyond(edge) for edge in edges}
        self._on: dict[str, dict[str, int]] = {edge: {} for edge in edges}  # vehicles on each edge, and their lanes
        self._last: dict[tuple[str, str], float] = {}  # time of the last passage, by edge and vehicle
        self._inside: dict[str, set[str]] = {edge: set() for edge in edges}  # that have passed, and are still there

    def observe(self, members: Collection[str], time: float) -> list[Passage]:
        """Those of the last step. members: on the road now"""
        found = []
        for edge, lanes in self._lanes.items():
            self._inside[edge] = {vehicle for vehicle in self._inside[edge] if self._is_at(edge, vehicle)}
            before, listed = self._on[edge], self._sumo.lane.getLastStepVehicleIDs
            self._on[edge] = now = {vehicle: i for i, lane in enumerate(lanes) for vehicle in listed(lane)}
            for vehicle in sorted(before.keys() - now.keys()):
                if self._has_passed(edge, vehicle, time):
                    found.append(self._passage(edge, before[vehicle], vehicle, vehicle in members, time))
        return found

    def _has_passed(self, edge: str, vehicle: str, time: float) -> bool:
        road = self._road(vehicle)
        if not self._beyond[edge](road) or vehicle in self._inside[edge]:
            return False
        if time - self._last.get((edge, vehicle), -ONCE) < ONCE:
            return False
        self._last[edge, vehicle] = time
        self._inside[edge].add(vehicle)
        return True

    def _is_at(self, edge: str, vehicle: str) -> bool:
        """Whether a vehicle is in a junction, or was put back onto the edge before it: it stands at red there."""
        road = self._road(vehicle)
        return road == edge or road[:1] == ":"

    def _road(self, vehicle: str) -> str:
        """The edge of a vehicle; "" if it has left the road."""
        try:
            return self._sumo.vehicle.getRoadID(vehicle)
        except self._sumo.TraCIException:
            return ""

    def _passage(self, edge: str, lane: int, vehicle: str, member: bool, time: float) -> Passage:
        ours = self._trips.knows(vehicle)
        kind = self._trips.driver(vehicle)[0] if ours else self._sumo.vehicle.getTypeID(vehicle)
        return Passage(time, edge, lane, vehicle, kind, member, self._sumo.vehicle.getSpeed(vehicle))
