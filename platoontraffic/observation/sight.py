"""Whether leaders, and members from the traffic, see as far as they need to stop."""

from __future__ import annotations

from collections.abc import Iterator

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.profiles import Trace
from platoontraffic.observation.avoidance import stopping_distance
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.deployment import Equipment
from platoontraffic.world.fleet import Member
from platoontraffic.world.prepared import Prepared

FAST = 1.2  # speed factor of a fast driver: SUMO's default for cars is 1.0, with a standard deviation of 0.1


def warnings(prepared: Prepared) -> list[str]:
    """One line for every leader whose stopping distance at its greatest speed is longer than its laser's range.

    And one for every share of the traffic where that is so of a fast driver's car on the network's fastest lane.
    """
    texts = [*_of_shares(prepared)]
    number = {platoon.id: i for i, platoon in enumerate(prepared.scenario.spec.platoon)}
    for member in prepared.members:
        speed = greatest_speed(member) if member.place == 0 else None
        if speed is None:
            continue
        needed, seen = stopping_distance(speed, member), member.lidar.range_max
        if needed > seen:
            what = f"at {speed:.3g} m/s it stops within {needed:.0f} m, and its laser reaches {seen:g} m"
            texts.append(prepared.scenario.fault(("platoon", number[member.platoon], "leader"), what))
    return texts


def _of_shares(prepared: Prepared) -> Iterator[str]:
    scenario, network = prepared.scenario, prepared.network
    fastest = FAST * max((network.limit(edge, lane) for edge, lane, _ in network.lanes_for_cars()), default=0.0)
    for i, table in enumerate(scenario.spec.equip, start=len(scenario.spec.platoon)):
        of_car = Equipment.of(scenario, i, "follower", VEHICLES["car"])
        if of_car.law.native:
            continue
        place = "", 0, 0.0, (0.0, 0.0, 0.0)
        car = Member(table.id, table.id, 0, of_car.model, of_car.lidars[0], of_car.law, *place)
        needed, seen = stopping_distance(fastest, car), car.lidar.range_max
        if needed > seen:
            what = (
                f"a fast driver's car, at {fastest:.3g} m/s, stops within {needed:.0f} m; its laser reaches {seen:g} m"
            )
            yield scenario.fault(scenario.spec.key_of(i), what)


def greatest_speed(member: Member) -> float | None:
    """The greatest speed at which a member drives along its route [m/s], bends apart.

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
