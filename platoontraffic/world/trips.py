"""The trip of a member from the traffic."""

from __future__ import annotations

import math
from typing import NamedTuple


class Trip(NamedTuple):
    """As a row of SUMO's tripinfo."""

    vehicle: str
    type: str  # that it had in the traffic
    departed: float  # [s]
    depart_delay: float  # [s]
    ended: float = math.nan  # [s]; NaN: it is on the road
    status: str = "running"  # or "arrived", "removed"
    distance: float = 0.0  # [m]
    waiting: float = 0.0  # time slower than 0.1 m/s [s]
    time_loss: float = 0.0  # by driving slower than the limit times its speed factor [s]
    co2: float = 0.0  # [kg]
    fuel: float = 0.0
