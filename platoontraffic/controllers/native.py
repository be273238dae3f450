"""A leader that SUMO drives: the human-led platoon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from platoontraffic.vehicles.motion import Positive


@dataclass(frozen=True)
class SumoDriver:
    """SUMO's own driver: follows cars, changes lanes, obeys lights and right of way. It is read, not moved.

    It has no laser and decides nothing here. Who has followers stays on the lane on which it has overtaken, for those
    would come back before whom they have not yet passed. Where it drives, lane changes take 3 s (`sumo.lane_change_s`).
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route"})
    native: ClassVar[bool] = True  # SUMO moves it

    max_speed: Annotated[Positive, Field(alias="max_speed_mps")] = 50.0
    speed_factor: Positive = 1.0  # of the limit that it drives at, where it may
