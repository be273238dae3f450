"""Whether there is room on the road for a platoon that is to depart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from platoontraffic.controllers.lane_room import COMFORTABLE_BRAKING, REACTION
from platoontraffic.sumo.client import Client
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.ground import members_at
from platoontraffic.world.traffic import TrafficSnapshot

CLEARANCE_ALONG = 1.0  # free before and behind each member [its own lengths]
CLEARANCE_ASIDE = 0.5  # free beside each member, both sides together [m]
LANES_ASIDE = 8.0  # beside each member, both sides together, where nobody may be changing lanes [m]
CHANGING = 0.1  # lateral speed of a vehicle that changes lanes [m/s]


def in_the_way(platoon: Fleet, traffic: TrafficSnapshot, sumo: Client) -> list[str]:
    """Vehicles and people near the platoon's places, vehicles on its lanes too close to brake in comfort, and vehicles
    beside it that change lanes."""
    if set(traffic.ids) <= set(platoon.ids):
        return []  # nobody else is there
    found = near_places(platoon, traffic) | too_close_on_lanes(platoon, sumo)
    beside = near_places(platoon, traffic, LANES_ASIDE) - found
    found |= {name for name in beside & set(sumo.vehicle.getIDList()) if _changes_lanes(name, sumo)}
    return sorted(found - {m.id for m in platoon.members})


def _changes_lanes(name: str, sumo: Client) -> bool:
    return abs(sumo.vehicle.getLateralSpeed(name)) > CHANGING


def near_places(platoon: Fleet, traffic: TrafficSnapshot, aside: float = CLEARANCE_ASIDE) -> set[str]:
    """Ids in the traffic that overlap a member's place with its clearance, or the space up to its predecessor's.

    aside: clearance beside each member, both sides together [m]
    """
    here = members_at(platoon, traffic.time)
    room = replace(here, length=here.length * (1 + 2 * CLEARANCE_ALONG), width=here.width + aside)
    places = shapely.polygons(room.boxes().corners())
    followers = np.flatnonzero(platoon.predecessor >= 0)
    between = shapely.convex_hull(shapely.union(places[followers], places[platoon.predecessor[followers]]))
    bodies = shapely.STRtree(shapely.polygons(traffic.boxes().corners()))
    return {traffic.ids[row] for row in bodies.query(np.concatenate([places, between]), predicate="intersects")[1]}


def too_close_on_lanes(platoon: Fleet, sumo: Client) -> set[str]:
    """Vehicles behind the last member, or ahead of the leader, from which braking would be uncomfortable.

    The rear one of the two needs its reaction time at the closing speed and comfortable braking down to the other's
    speed.
    """
    found = set()
    followed = set(platoon.predecessor[platoon.predecessor >= 0].tolist())
    for i, member in enumerate(platoon.members):
        for name in sumo.lane.getLastStepVehicleIDs(f"{member.edge}_{member.lane}"):
            front, speed = sumo.vehicle.getLanePosition(name), sumo.vehicle.getSpeed(name)
            if i not in followed and front < member.position:
                gap, closing = member.position - member.model.length - front, speed - member.speed
            elif member.place == 0 and front > member.position:
                gap, closing = front - sumo.vehicle.getLength(name) - member.position, member.speed - speed
            else:
                continue
            closing = max(closing, 0.0)
            if gap < closing * REACTION + closing**2 / (2 * COMFORTABLE_BRAKING):
                found.add(name)
    return found
