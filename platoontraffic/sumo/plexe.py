"""Members that SUMO drives by its car-following model CC, the controllers of Plexe: switched on, and fed with states.

Keys and order of values: src/microsim/cfmodels/MSCFModel_CC.cpp and CC_Const.h of SUMO 1.28.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from platoontraffic.sumo.client import Client
from platoontraffic.sumo.frame import front_of, sumo_angle
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.neighbours import State, chains

NUMBERS = {"ACC": 1, "CACC": 2, "PLOEG": 4, "CONSENSUS": 5, "FLATBED": 6}  # of the controllers
NO_CHECKS = 0  # speed mode


def switch_on(sumo: Client, platoon: Fleet, i: int) -> None:
    """Let the controller of a platoon's member i drive it; a member without a predecessor has the cruise control."""
    member = platoon.members[i]
    follows = platoon.predecessor[i] >= 0
    sumo.vehicle.setSpeedMode(member.id, NO_CHECKS)
    _set(sumo, member.id, "ccds", min(member.law.max_speed, member.model.top_speed))
    if headway := member.law.vehicle_type.get("ccaht"):
        _set(sumo, member.id, "ccaht", headway)
    _set(sumo, member.id, "ccps", len(platoon))
    _set(sumo, member.id, "ccvp", member.place)
    _set(sumo, member.id, "ccac", NUMBERS[member.law.controller if follows else "ACC"])


def feed(sumo: Client, fleet: Fleet) -> None:
    """Give every member with a controller the states of predecessor and leader, or of its whole platoon."""
    driven = [i for i in fleet.native_rows if fleet.members[i].law.controller]
    if not driven:
        return
    heads, _ = chains(fleet)
    motion, length, now = fleet.motion, fleet.model.length, sumo.simulation.getTime()
    demand = State.of(fleet).demand
    for i in driven:
        demand[i] = float(sumo.vehicle.getParameter(fleet.members[i].id, "carFollowModel.ccsa").split(":")[2])
    x, y = front_of(motion.x, motion.y, motion.heading, length)
    vx, vy = motion.speed * np.cos(motion.heading), motion.speed * np.sin(motion.heading)
    angle = sumo_angle(motion.heading)

    for i in driven:
        name, ahead = fleet.members[i].id, fleet.predecessor[i]
        if ahead < 0:
            continue
        if fleet.members[i].law.controller == "CONSENSUS":
            platoon = fleet.members[i].platoon
            for j, other in enumerate(fleet.members):
                if other.platoon == platoon and j != i:
                    values = (motion.speed, motion.acceleration, x, y, now, length, demand, vx, vy, angle)
                    _set(sumo, name, "ccvd", other.place, *_at(j, values))
            continue
        for key, j in (("cclsa", heads[i]), ("ccpsa", ahead)):
            _set(sumo, name, key, *_at(j, (motion.speed, motion.acceleration, x, y, now, demand, vx, vy, angle)))


def _at(j: int, values: Iterable) -> list[float]:
    return [float(value if np.isscalar(value) else value[j]) for value in values]


def _set(sumo: Client, name: str, key: str, *values: object) -> None:
    sumo.vehicle.setParameter(name, f"carFollowModel.{key}", ":".join(map(str, values)))
