"""SUMO's values at one instant, each asked for once: the members of a platoon ask for the same vehicles."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any

from platoontraffic.sumo.client import Client, direct

# In a row of getBestLanes: a lane, how many lanes to the left of it the best one is, whether it leads on along the
# route, and the lanes on which a vehicle goes on from it.
PLAN_LANE, PLAN_OFFSET, PLAN_LEADS_ON, PLAN_ONWARD = 0, 3, 4, 5


class Once(dict):
    """Values of a function by its argument, which is called when a value is first looked up."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def __missing__(self, key: Any) -> Any:
        value = self[key] = self._function(key)
        return value

    def look_up(self, keys: Iterable[Any]) -> None:
        """Ask the function for those of many arguments that have no value yet: faster than one by one."""
        new = [key for key in keys if key not in self]
        self.update(zip(new, map(self._function, new), strict=True))


class OfSumo(Once):
    """Values of a function of SUMO's. A remote client has it only after it has started."""

    def __init__(self, sumo: Client, domain: str, name: str) -> None:
        self._named = sumo, domain, name

    @cached_property
    def _function(self) -> Callable[[Any], Any]:
        sumo, domain, name = self._named
        return direct(getattr(getattr(sumo, domain), name))


class Reads:
    """Values of SUMO's by the id of a vehicle, lane, edge or traffic light, named as SUMO's functions.

    Sizes of vehicles and lanes are kept; all others hold for one instant: see `renew`.
    """

    def __init__(self, sumo: Client) -> None:
        self.lane_length = OfSumo(sumo, "lane", "getLength")
        self.lane_width = OfSumo(sumo, "lane", "getWidth")
        self.length = OfSumo(sumo, "vehicle", "getLength")
        self.max_speed = OfSumo(sumo, "lane", "getMaxSpeed")
        self.links = OfSumo(sumo, "lane", "getLinks")
        self.on_lane = OfSumo(sumo, "lane", "getLastStepVehicleIDs")
        self.people = OfSumo(sumo, "edge", "getLastStepPersonIDs")
        self.speed = OfSumo(sumo, "vehicle", "getSpeed")
        self.position = OfSumo(sumo, "vehicle", "getLanePosition")
        self.aside = OfSumo(sumo, "vehicle", "getLateralLanePosition")
        self.front = OfSumo(sumo, "vehicle", "getPosition")
        self.angle = OfSumo(sumo, "vehicle", "getAngle")
        self.acceleration = OfSumo(sumo, "vehicle", "getAccel")
        self.accelerates_by = OfSumo(sumo, "vehicle", "getAcceleration")
        self.next_links = OfSumo(sumo, "vehicle", "getNextLinks")
        self.best_lanes = OfSumo(sumo, "vehicle", "getBestLanes")
        self.waited = OfSumo(sumo, "vehicle", "getWaitingTime")
        self.stopped = OfSumo(sumo, "vehicle", "isStopped")
        self.lights = OfSumo(sumo, "trafficlight", "getRedYellowGreenState")
        self.next_switch = OfSumo(sumo, "trafficlight", "getNextSwitch")
        self._of_instant = [
            self.max_speed, self.links, self.on_lane, self.people, self.speed, self.position, self.aside,
            self.front, self.angle, self.acceleration, self.accelerates_by, self.next_links, self.best_lanes,
            self.waited, self.stopped, self.lights, self.next_switch,
        ]  # fmt: skip

    def renew(self) -> None:
        """To be called where SUMO has made a step, or something in it was changed."""
        for values in self._of_instant:
            values.clear()
