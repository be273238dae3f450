"""A leader that SUMO drives: the human-led platoon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from platoontraffic.controllers.law import Law
from platoontraffic.vehicles.motion import Positive


@dataclass(frozen=True)
class SumoDriver(Law):
    """SUMO's own driver: follows cars, changes lanes, obeys lights and right of way. Its motion is read, not set.

    It accelerates with 0.65 of what the vehicle can at its speed, and brakes with half of what it can, in emergencies
    with all of it: as a car it is SUMO's passenger car, with 2.6, 4.5 and 9 m/s2. It has no laser and decides nothing
    in this package. With followers behind it, it stays on the lane on which it overtook: changing back would put its
    followers beside a vehicle that they have not yet passed. On roads with such a driver, a lane change takes 3 s
    (`sumo.lane_change_s`).
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route"})
    native: ClassVar[bool] = True

    max_speed: Annotated[Positive, Field(alias="max_speed_mps")] = 50.0
    speed_factor: Positive = 1.0  # its speed by the limit, on a free road
    imperfection: Annotated[float, Field(ge=0, le=1)] = 0.5  # SUMO's sigma: random braking, 0: none
