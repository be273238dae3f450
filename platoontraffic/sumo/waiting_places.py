"""Where SUMO's vehicles wait inside a junction that members cross.

The place where a vehicle waits midway may lie in the path of the one to which it gives way: SUMO's own vehicles pass
through each other there. A member stops before such a body, which waits for the member: a bus and a member closed a
junction of Bologna for minutes. So a vehicle that will wait there, for a member or for others, stops before the path of
a member that comes or waits at its line.

And a driver does not set out while another vehicle drives round its own one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Set

from platoontraffic.road.gap_acceptance import STANDING
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.letting_in import OWN_DRIVER, speed_to_stop
from platoontraffic.sumo.right_of_way import STOPS_BY


class WaitingPlaces:
    """The vehicles that are kept from driving on.

    step: of SUMO's [s]
    """

    def __init__(self, sumo: Client, step: float) -> None:
        self._sumo, self._step = sumo, step
        self._kept: set[str] = set()

    def observe(self, stops: Mapping[str, float], passed: Set[str] = frozenset()) -> Set[str]:
        """Before every step. The vehicles that are not named drive on.

        stops  : distances after which vehicles are to stop [m]
        passed : vehicles that stay where they stand
        returns: those whose speed is given now
        """
        if not stops and not passed and not self._kept:
            return self._kept
        vehicle = self._sumo.vehicle
        stops = {**dict.fromkeys(filter(self._stands, sorted(passed)), 0.0), **stops}
        for name in sorted(self._kept - stops.keys()):
            with contextlib.suppress(self._sumo.TraCIException):  # it has left the simulation
                vehicle.setSpeed(name, OWN_DRIVER)
        for name, room in stops.items():
            vehicle.setSpeed(name, speed_to_stop(vehicle.getSpeed(name), room, STOPS_BY, self._step))
        self._kept = {*stops}
        return self._kept

    def _stands(self, name: str) -> bool:
        try:
            return self._sumo.vehicle.getSpeed(name) < STANDING
        except self._sumo.TraCIException:  # it is none of SUMO's
            return False
