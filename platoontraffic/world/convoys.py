"""Platoons from the traffic: each member follows the one at the place ahead, until their routes part."""

from __future__ import annotations

from collections.abc import Sequence

from platoontraffic.road.demand import common_beginning
from platoontraffic.vehicles.records import changed
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet


class Convoys:
    """The predecessors of members from the traffic."""

    def __init__(self) -> None:
        self._together: dict[str, frozenset[str]] = {}  # edges that a member and its predecessor share, by the former

    def joined(self, fleet: Fleet, newcomers: Sequence[str]) -> Fleet:
        """The fleet in which new members follow the members at the places ahead, where these are on the road.

        They drive at least as fast as the drivers of those.
        """
        row_of = {(m.platoon, m.place): i for i, m in enumerate(fleet.members) if m.recruited and not m.single}
        predecessor, names = fleet.predecessor.copy(), set(newcomers)
        for place, i in sorted(row_of.items()):
            ahead = row_of.get((place[0], place[1] - 1), -1)
            if fleet.ids[i] in names and ahead >= 0:
                predecessor[i] = ahead
                own, theirs = fleet.members[i].route, fleet.members[ahead].route
                self._together[fleet.ids[i]] = frozenset(common_beginning(own.edges, theirs.edges))
                if theirs.speed_factor > own.speed_factor:  # it is to keep up
                    fleet = fleet.with_route(i, changed(own, speed_factor=theirs.speed_factor))
        return fleet.with_orders(predecessor, fleet.leads)

    def parted(self, fleet: Fleet, roads: Sequence[tuple[str, str]]) -> tuple[list[Noted], Fleet]:
        """Events of members that a predecessor has left for another route, and the fleet in which they have none.

        roads: edge and lane of each member, (n,)
        """
        if not self._together:
            return [], fleet
        events = []
        for row, name in enumerate(fleet.ids):
            if name not in self._together:
                continue
            ahead = fleet.predecessor[row]
            if ahead < 0:
                del self._together[name]
            elif (edge := roads[ahead][0]) and edge[0] != ":" and edge not in self._together[name]:
                events.append(Noted(row, "parted", f"on {edge}", other=fleet.ids[ahead]))
        if not events:
            return [], fleet
        predecessor = fleet.predecessor.copy()
        predecessor[[one.row for one in events]] = -1
        return events, fleet.with_orders(predecessor, fleet.leads)
