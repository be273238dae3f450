"""SUMO's values at one instant, each asked for once: the members of a platoon ask for the same vehicles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from platoontraffic.sumo.client import Client


class Once(dict):
    """Values of a function by its argument, which is called when a value is first looked up."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def __missing__(self, key: Any) -> Any:
        value = self[key] = self._function(key)
        return value


class Reads:
    """Values of SUMO's by the id of a vehicle, lane, edge or traffic light, named as SUMO's functions.

    Sizes of vehicles and lanes are kept; all others hold for one instant: see `renew`.
    """

    def __init__(self, sumo: Client) -> None:
        # A remote client has its domains only after it has started.
        self.lane_length = Once(lambda lane: sumo.lane.getLength(lane))
        self.length = Once(lambda vehicle: sumo.vehicle.getLength(vehicle))
        self.max_speed = Once(lambda lane: sumo.lane.getMaxSpeed(lane))
        self.links = Once(lambda lane: sumo.lane.getLinks(lane))
        self.on_lane = Once(lambda lane: sumo.lane.getLastStepVehicleIDs(lane))
        self.people = Once(lambda edge: sumo.edge.getLastStepPersonIDs(edge))
        self.speed = Once(lambda vehicle: sumo.vehicle.getSpeed(vehicle))
        self.position = Once(lambda vehicle: sumo.vehicle.getLanePosition(vehicle))
        self.acceleration = Once(lambda vehicle: sumo.vehicle.getAccel(vehicle))
        self.next_links = Once(lambda vehicle: sumo.vehicle.getNextLinks(vehicle))
        self.waited = Once(lambda vehicle: sumo.vehicle.getWaitingTime(vehicle))
        self.lights = Once(lambda light: sumo.trafficlight.getRedYellowGreenState(light))
        self._of_instant = [
            self.max_speed, self.links, self.on_lane, self.people, self.speed, self.position, self.acceleration,
            self.next_links, self.waited, self.lights,
        ]  # fmt: skip

    def renew(self) -> None:
        """To be called where SUMO has made a step, or something in it was changed."""
        for values in self._of_instant:
            values.clear()
