"""Which lanes and edges of a network are for cars, and which are no road at all. Lanes and edges are sumolib's."""

from __future__ import annotations

from typing import Any

CAR = "passenger"  # SUMO's vehicle class of platoon members
NO_ROAD = frozenset(
    ("pedestrian", "wheelchair", "tram", "rail_urban", "rail", "rail_electric", "rail_fast", "lightrail", "cityrail",
     "rail_slow", "subway", "cable_car", "ship", "container", "aircraft", "drone")
)  # fmt: skip


def is_road(lane: Any) -> bool:
    """Whether road vehicles may use a lane: no railway, waterway or footpath."""
    return not NO_ROAD.issuperset(lane.getPermissions())


def users(lane_or_edge: Any) -> str:
    """The vehicle classes that a lane or an edge allows: `for bus, taxi`."""
    allowed = sorted(lane_or_edge.getPermissions())
    return f"for {', '.join(allowed[:3])}{' and others' if len(allowed) > 3 else ''}" if allowed else "closed to all"
