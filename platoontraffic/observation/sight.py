"""Whether leaders can drive at the speed of their law: their vehicle limits it, and how far their laser reaches.

Of members from the traffic only the laser is judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.profiles import Trace
from platoontraffic.observation.avoidance import stopping_distance
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.deployment import Equipment
from platoontraffic.world.fleet import Member
from platoontraffic.world.prepared import Prepared

NOTABLY = 0.99  # share of its speed below which a vehicle is slower
FAST = 1.2  # speed factor of a fast driver: SUMO's default for cars is 1.0, with a standard deviation of 0.1


def warnings(prepared: Prepared) -> list[str]:
    """A line for every leader whose law has a speed above the top speed of its vehicle; that cannot stop within its
    laser's range from its greatest speed; or that drives slower so that it can, as laws that drive by speed limits do.

    And a line for every share of the traffic, if either holds for a fast driver's car on the network's fastest lane.
    """
    texts = [*_of_shares(prepared)]
    number = {platoon.id: i for i, platoon in enumerate(prepared.scenario.spec.platoon)}
    for member in prepared.members:
        wanted, most = getattr(member.law, "speed", None), member.model.top_speed
        if member.place == 0 and isinstance(wanted, float) and wanted > most:
            key = "platoon", number[member.platoon], "leader", "speed_mps"
            texts.append(prepared.scenario.fault(key, f"{wanted:g}: its vehicle drives {most:.3g} m/s at most"))
        speed = greatest_speed(member) if member.place == 0 else None
        if speed is not None and (what := _short_sight(member, speed)):
            texts.append(prepared.scenario.fault(("platoon", number[member.platoon], "leader"), what))
    return texts


def _of_shares(prepared: Prepared) -> Iterator[str]:
    scenario, network = prepared.scenario, prepared.network
    fastest = FAST * max((network.limit(edge, lane) for edge, lane, _ in network.lanes_for_cars()), default=0.0)
    for i, table in enumerate(scenario.spec.equip, start=len(scenario.spec.platoon)):
        of_car = Equipment.of(scenario, i, "follower", VEHICLES["car"])
        if of_car.law.native or not table.share:
            continue
        place = "", 0, 0.0, (0.0, 0.0, 0.0)
        car = Member(table.id, table.id, 0, of_car.model, of_car.lidars[0], of_car.law, *place)
        if what := _short_sight(car, fastest):
            yield scenario.fault(scenario.spec.key_of(i), f"a fast driver's car: {what}")


def _short_sight(member: Member, speed: float) -> str:
    """What a member's laser is too short for, if it would drive at a speed [m/s]; "": for nothing."""
    by_sight, seen = _by_sight(member), member.lidar.range_max
    if (needed := stopping_distance(min(speed, by_sight), member)) > seen:
        return f"at {min(speed, by_sight):.3g} m/s it stops within {needed:.0f} m, and its laser reaches {seen:g} m"
    if by_sight < NOTABLY * speed:
        return f"its laser reaches {seen:g} m, so it drives up to {by_sight:.3g} m/s in place of {speed:.3g} m/s"
    return ""


def greatest_speed(member: Member) -> float | None:
    """The greatest speed at which a member drives along its route [m/s], bends and what its laser sees apart.

    None if SUMO drives it, or if its law takes no route. By the law's profile, or by the speed limits of the route,
    as far as the vehicle is capable of it.
    """
    law = getattr(member.law, "alone", member.law)  # as `tracking` drives without a predecessor
    if member.route is None or "route" not in member.law.needs or member.law.native:
        return None
    wanted = float(member.route.limit.max())
    if isinstance(law, PathLeader):
        wanted *= law.speed_factor
        if law.trace is not None:
            wanted = float(Trace.read(law.trace).speed.max())
        elif law.speed != "road":
            wanted = max(law.speed + law.amplitude, law.last_speed)
    return min(wanted, member.model.top_speed)


def _by_sight(member: Member) -> float:
    """The greatest speed that its law allows itself by what its laser sees [m/s]; inf: any."""
    law = getattr(member.law, "alone", member.law)
    if not isinstance(law, PathLeader):
        return math.inf
    return law.greatest_speed_by_sight(member.lidar, member.model)
