"""Whether leaders see as far as they need to stop."""

from __future__ import annotations

from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.profiles import Trace
from platoontraffic.observation.avoidance import stopping_distance
from platoontraffic.world.fleet import Member
from platoontraffic.world.prepared import Prepared


def warnings(prepared: Prepared) -> list[str]:
    """One line for every leader whose stopping distance at its greatest speed is longer than its laser's range."""
    texts = []
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
