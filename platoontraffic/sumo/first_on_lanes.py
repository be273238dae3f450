"""SUMO's vehicles that stand first on a lane, and must go over to a lane on which members drive.

SUMO's drivers let each other in there. Members are not asked by SUMO: a column of them kept a bus in Bologna at the end
of its lane, and all that stood behind it, for ten minutes. A driver sees the indicator of such a vehicle. It may stand
far before the end of its lane, where SUMO's drivers leave room for each other: in Bologna 54 m before it, for 80 s.

One whose lane leads on along its route, and that does not stop for want of room, waits for a light or a gap: it goes on
from that lane, and changes lanes beyond the junction. Members that waited for it missed their own green light.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from platoontraffic.controllers.lane_room import room_needed
from platoontraffic.road.gap_acceptance import STANDING
from platoontraffic.road.lane_ids import index_of
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.reads import PLAN_LANE, PLAN_LEADS_ON, PLAN_OFFSET
from platoontraffic.sumo.room_to_change import Wanted

EVERY = 1.0  # time from one look to the next [s]
URGENT = 256  # bit of SUMO's state of a lane change: the vehicle stops where its lane leads on no further


class FirstOnLanes:
    """What these vehicles want; it stays the same until the next look."""

    def __init__(self, sumo: Client) -> None:
        self._sumo, self._due = sumo, 0.0
        self._wanted: dict[str, Wanted] = {}
        self._numbers: dict[str, int] = {}  # of lanes, by edge

    def room_wanted(
        self, members: Iterable[str], where: Mapping[str, tuple[str, str]], time: float
    ) -> Mapping[str, Wanted]:
        """The room that each of them wants on a lane with members.

        where: edge and lane of each member that SUMO has; the lane is "" off the road
        time : SUMO's clock [s]
        """
        if time >= self._due - 1e-6:
            self._due = time + EVERY
            lanes = sorted({where[name] for name in members if name in where})
            found = (self._first(edge, lane) for edge, lane in lanes if lane and self._number(edge) > 1)
            self._wanted = {name: wanted for both in found for name, wanted in both if name not in where}
        return self._wanted

    def _first(self, edge: str, onto: str) -> Iterator[tuple[str, Wanted]]:
        """The first vehicles on the lanes beside a lane, where they stand and must go over to it."""
        vehicle, index = self._sumo.vehicle, index_of(onto)
        for side in (-1, 1):
            lane = f"{edge}_{index - side}"
            there = self._sumo.lane.getLastStepVehicleIDs(lane) if 0 <= index - side < self._number(edge) else ()
            if not there or vehicle.getSpeed(there[-1]) >= STANDING or vehicle.isStopped(there[-1]):
                continue
            name = there[-1]
            plan = next((plan for plan in vehicle.getBestLanes(name) if plan[PLAN_LANE] == lane), None)
            if plan and side * plan[PLAN_OFFSET] > 0 and (not plan[PLAN_LEADS_ON] or self._is_urgent(name, side)):
                length = vehicle.getLength(name)
                yield name, Wanted(onto, length + room_needed(length, 0.0, 0.0), False)

    def _is_urgent(self, name: str, side: int) -> bool:
        """Whether SUMO's driver must change lanes to a side before it can drive on; side: 1: left, -1: right"""
        state, _ = self._sumo.vehicle.getLaneChangeState(name, side)
        return bool(state & URGENT)

    def _number(self, edge: str) -> int:
        if edge not in self._numbers:
            on_road = edge and edge[0] != ":"
            self._numbers[edge] = self._sumo.edge.getLaneNumber(edge) if on_road else 0
        return self._numbers[edge]
