"""Lanes with vehicles that a member conflicts with at a junction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from platoontraffic.road.gap_acceptance import MARGIN, time_for
from platoontraffic.road.lane_routes import Line
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.vehicles.motion import CAR_LENGTH

# Indices of fields of a link as SUMO returns it, and their number; via: first lane inside the junction, "" if none.
LINK_OPEN, LINK_VIA, LINK_STATE, LINK_LENGTH, LINK_FIELDS = 2, 4, 5, 7, 8

# States of links, as SUMO writes them.
PRIORITY = "GMO"  # gives way to no vehicle; O is a light that is off
RED, YELLOW = "ru", "yY"
MINOR = "mswo"  # gives way
STOP = "sw"  # gives way, after it has stood at the line

GAP_HORIZON = 3.6  # a gap is judged from this time before the line on, at the fastest foe's speed [s]


class Conflicts(NamedTuple):
    """Priority lanes at a stop line, and lanes crossing the path beyond it; constant during a run."""

    entering: tuple[tuple[str, float], ...]  # priority lanes, and the distance from each one's end to the junction [m]
    inside: Mapping[str, bool]  # crossing lanes from those -> whether a vehicle waits at its end
    reach: float  # distance before the junction from which a gap is judged [m]
    crossing: Mapping[str, tuple[str, str]]  # all crossing lanes -> the lane before the junction, its first lane inside

    @classmethod
    def at(cls, line: Line, network: Network, sumo: Client) -> Conflicts:
        entering = {name for name in sumo.lane.getFoes(line.lane, line.onto) if not name.startswith(":")}
        inside = {}
        for via in line.via:
            for name in sumo.lane.getInternalFoes(via):
                if name not in line.via and network.entered_from.get(name) in entering:
                    inside[name] = bool(sumo.lane.getLinks(name)[0][LINK_VIA])
        fastest = max(map(sumo.lane.getMaxSpeed, entering), default=0.0)
        watched = fastest * (time_for(line.across + CAR_LENGTH, 0.0) + MARGIN)
        upstream = tuple(one for name in sorted(entering) for one in network.upstream(name, watched))
        return cls(upstream, inside, GAP_HORIZON * fastest, _crossing(line, network, sumo))


def _crossing(line: Line, network: Network, sumo: Client) -> dict[str, tuple[str, str]]:
    """Lanes that cross the path beyond a line: by each, the lane before the junction and its first lane inside."""
    found = {}
    for name in {name for via in line.via for name in sumo.lane.getInternalFoes(via)} - set(line.via):
        before = network.entered_from.get(name)
        for link in sumo.lane.getLinks(before) if before else ():
            if name in _chain(link[LINK_VIA], sumo):
                found[name] = before, link[LINK_VIA]
    return dict(sorted(found.items()))


def _chain(via: str, sumo: Client) -> list[str]:
    """Consecutive lanes inside a junction, from this one on."""
    lanes = []
    while via:
        lanes.append(via)
        via = next(iter(sumo.lane.getLinks(via)), ("",) * LINK_FIELDS)[LINK_VIA]
    return lanes
