"""SUMO's vehicles that stand first on lanes beside each other, each of which must go over to the lane of the other.

Neither ever has room. SUMO's drivers alone rarely come to that, for they keep room for each other at the ends of their
lanes; among members they do, and all that is behind them stands for good: in Bologna half of the traffic, because of a
bus and a car. SUMO answers by teleporting whoever stands first for 300 s (`--time-to-teleport`). That is off, since it
would take members, and whoever waits behind them, out of the road. So only one of such two is taken across the
junction, onto its next road.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from itertools import chain

from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.conflicts import LINK_ONTO
from platoontraffic.sumo.reads import PLAN_LANE, PLAN_OFFSET
from platoontraffic.sumo.room_to_change import Wanted

AFTER = 30.0  # time for which both have stood [s]
EVERY = 5.0  # period of looking [s]
AT_END = 3.0  # distance from the end of a lane within which a vehicle is at its end [m]
BEHIND_LAST = 3.0  # to the last vehicle on the road beyond [m]


class LaneSwaps:
    """Takes them apart."""

    def __init__(self, sumo: Client) -> None:
        self._sumo, self._due = sumo, 0.0

    def observe(
        self,
        where: Mapping[str, tuple[str, str]],
        room_wanted: Mapping[str, Wanted],
        time: float,
        obstacles: Set[str] = frozenset(),
    ) -> None:
        """Before every step.

        where       : edge and lane of each member
        room_wanted : `StopLines.room_wanted` of members
        time        : SUMO's clock [s]
        obstacles   : vehicles in SUMO that stay where they are
        """
        if time < self._due - 1e-6:
            return
        self._due = time + EVERY
        vehicle = self._sumo.vehicle
        stands = (name for name in vehicle.getIDList() if vehicle.getWaitingTime(name) >= AFTER)
        wanted = {name: self._wanted(name) for name in stands if name not in where and name not in obstacles}
        for name, onto in wanted.items():
            other = self._first(onto) if onto else ""
            lane = vehicle.getLaneID(name)
            its = room_wanted[other].lane if other in room_wanted else wanted.get(other)
            if not its or its != lane or vehicle.getWaitingTime(other) < AFTER:
                continue
            shorter_first = sorted({name, other} - where.keys(), key=lambda one: (vehicle.getLength(one), one))
            if taken := next(filter(self._take_across, shorter_first), ""):
                self._sumo.simulation.writeMessage(
                    f"Vehicle '{taken}' is taken across the junction: '{name}' and '{other}' would have to swap lanes "
                    f"at the ends of '{lane}' and '{onto}'; time={time:.2f}."
                )

    def _wanted(self, name: str) -> str:
        """The lane beside to which one of SUMO's vehicles that stands at the end of its lane must go; "": none."""
        vehicle, lane = self._sumo.vehicle, self._sumo.vehicle.getLaneID(name)
        if lane[:1] in ("", ":") or self._first(lane) != name or vehicle.isStopped(name):
            return ""
        if self._sumo.lane.getLength(lane) - vehicle.getLanePosition(name) > AT_END or self._onward(name, lane):
            return ""
        to_left = next((plan[PLAN_OFFSET] for plan in vehicle.getBestLanes(name) if plan[PLAN_LANE] == lane), 0)
        side = (to_left > 0) - (to_left < 0)
        return f"{edge_of(lane)}_{index_of(lane) + side}" if side else ""

    def _first(self, lane: str) -> str:
        names = self._sumo.lane.getLastStepVehicleIDs(lane)
        return names[-1] if names else ""

    def _take_across(self, name: str) -> bool:
        """Put a vehicle where its next road begins; whether there was room."""
        vehicle, lane = self._sumo.vehicle, self._sumo.lane
        place = vehicle.getLength(name) + 0.1
        here = vehicle.getRoadID(name)
        beside = (f"{here}_{k}" for k in range(self._sumo.edge.getLaneNumber(here)))
        for onto in chain.from_iterable(self._onward(name, one) for one in beside):
            there = lane.getLastStepVehicleIDs(onto)
            rear = vehicle.getLanePosition(there[0]) - vehicle.getLength(there[0]) if there else lane.getLength(onto)
            if rear > place + BEHIND_LAST:
                vehicle.moveTo(name, onto, place)
                return True
        return False

    def _onward(self, name: str, lane: str) -> list[str]:
        """Lanes of the next road on a vehicle's route to which a lane of its present road leads."""
        ahead = self._sumo.vehicle.getRoute(name)[self._sumo.vehicle.getRouteIndex(name) + 1 :][:1]
        return [link[LINK_ONTO] for link in self._sumo.lane.getLinks(lane) if edge_of(link[LINK_ONTO]) in ahead]
