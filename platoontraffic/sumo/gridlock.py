"""Gridlock: nobody on the road moves any more, or will.

SUMO would take vehicles out of the road then (`--time-to-teleport`), which would make members' delays wrong. A run
that lasts until its demand has arrived would never end.
"""

from __future__ import annotations

import numpy as np

from platoontraffic.sumo.client import Client
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.standing import STANDS

AFTER = 600.0  # time for which nobody has moved [s]: more than any traffic light keeps anybody
EVERY = 10.0  # period of looking [s]


class Gridlock:
    """Since when nobody has moved."""

    def __init__(self, sumo: Client) -> None:
        self._sumo = sumo
        self._looked, self._since = -np.inf, np.inf  # [s]

    def observe(self, fleet: Fleet, time: float) -> bool:
        """After every step: whether members and vehicles of the traffic have stood for so long that they will stay.

        time: SUMO's clock [s]
        """
        if time >= self._looked + EVERY - 1e-6:
            self._looked = time
            moves = not len(fleet) or bool((np.abs(fleet.motion.speed) > STANDS).any()) or self._may_move(fleet)
            self._since = time if moves else min(self._since, time)
        return time - self._since > AFTER - 1e-6

    def _may_move(self, fleet: Fleet) -> bool:
        """Whether a vehicle of SUMO's moves, or stops by plan: it will drive on, and others behind it."""
        vehicle, members = self._sumo.vehicle, fleet.row_of
        return any(
            name not in members and (vehicle.getSpeed(name) > STANDS or vehicle.isStopped(name))
            for name in vehicle.getIDList()
        )
