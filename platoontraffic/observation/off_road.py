"""Members outside the drivable area."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from platoontraffic.geometry.strips import Strips
from platoontraffic.observation.step import Step
from platoontraffic.vehicles.records import every
from platoontraffic.world.events import OFF_ROAD_DISTANCE, Event


class OffRoad:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, drivable: shapely.Geometry, scale: np.ndarray) -> None:
        """scale: size of each member beside a car, (N,); OFF_ROAD_DISTANCE shrinks with it"""
        self._drivable, self._strips, self._scale = drivable, Strips(drivable), scale
        self.distance = np.zeros(len(scale))  # of the driven axle from the drivable area [m]; 0 in it
        self._since = np.full(len(scale), np.nan)  # [s]; NaN: on the road
        self._entered = np.zeros(len(scale), dtype=bool)  # SUMO inserts vehicles with their rear before the first lane
        self._any_off = False  # a member was outside one step before

    def observe(self, step: Step) -> Iterator[Event]:
        """off_road, on_road"""
        number = step.fleet.number
        on_road = self._strips.contain(step.x, step.y)
        if not self._any_off and every(on_road):
            self._entered[number] = True
            return
        away = (~on_road).nonzero()[0]
        distance = np.zeros(len(number))
        if away.size:
            distance[away] = shapely.distance(self._drivable, shapely.points(step.x[away], step.y[away]))
        self._entered[number] |= distance == 0
        distance[~self._entered[number]] = 0.0
        self.distance[number] = distance
        off, since = distance > OFF_ROAD_DISTANCE * self._scale[number], self._since[number]
        left, back = off & np.isnan(since), ~off & ~np.isnan(since)
        for i in left.nonzero()[0]:
            yield step.event("off_road", i, detail=f"{distance[i]:.3f} m outside")
        for i in back.nonzero()[0]:
            yield step.event("on_road", i, duration=step.traffic.time - since[i])
        self._since[number] = np.where(left, step.traffic.time, np.where(back, np.nan, since))
        self._any_off = away.size > 0
