"""Fastest routes from one edge to all others, at the speed limits: those that SUMO finds on an empty network."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

# Times that SUMO adds to those of driving, by its options weights.minor-penalty and weights.turnaround-penalty [s].
MINOR_PENALTY = 1.5
TURNAROUND_PENALTY = 5.0
TURNS_BACK = "tT"  # directions of links that return on the same road; T in left-hand traffic


@dataclass
class FastestRoutes:
    """Routes of a vehicle class; the routes from an edge are found once for all their ends."""

    _net: Any  # sumolib's
    vclass: str
    _trees: dict[str, dict[str, str]] = field(default_factory=dict)  # start -> edge -> edge before it

    def through(self, edges: Sequence[str]) -> tuple[str, ...]:
        """The route over all the given edges, in their order; () if there is none."""
        if not edges or not all(map(self._net.hasEdge, edges)):
            return ()
        route = [edges[0]]
        for here, there in pairwise(edges):
            before, back = self._tree(here), [there]
            while back[-1] != here and back[-1] in before:
                back.append(before[back[-1]])
            if back[-1] != here:
                return ()
            route += back[-2::-1] if here != there else []
        return tuple(route)

    def _tree(self, start: str) -> dict[str, str]:
        """The edge before each edge that can be reached, on the fastest route."""
        if start not in self._trees:
            self._trees[start] = self._grown(start)
        return self._trees[start]

    def _grown(self, start: str) -> dict[str, str]:
        before: dict[str, str] = {}
        done: set[str] = set()
        todo = [(0.0, start, "")]
        while todo:
            spent, name, last = heapq.heappop(todo)
            if name in done:
                continue
            done.add(name)
            if last:
                before[name] = last
            edge = self._net.getEdge(name)
            spent += edge.getLength() / edge.getSpeed() if last else 0.0
            for onward, links in edge.getAllowedOutgoing(self.vclass).items():
                if onward.getID() not in done and onward.allows(self.vclass):
                    heapq.heappush(todo, (spent + min(map(self._inside, links)), onward.getID(), name))
        return before

    def _inside(self, link: Any) -> float:
        """Time that a link takes inside its junction [s]."""
        spent = TURNAROUND_PENALTY if link.getDirection() in TURNS_BACK else 0.0
        while lane_id := link.getViaLaneID():
            minor = not link.getTLSID() and not link.getState().isupper()
            lane = self._net.getLane(lane_id)
            spent += lane.getLength() / lane.getSpeed() + (MINOR_PENALTY if minor else 0.0)
            link = lane.getOutgoing()[0]
        return spent
