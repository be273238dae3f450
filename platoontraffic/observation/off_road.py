"""Members outside the drivable area."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from platoontraffic.observation.step import Step
from platoontraffic.world.events import OFF_ROAD_DISTANCE, Event


class OffRoad:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, drivable: shapely.Geometry, scale: np.ndarray) -> None:
        """scale: size of each member beside a car, (N,); OFF_ROAD_DISTANCE shrinks with it"""
        self._drivable, self._scale = drivable, scale
        self.distance = np.zeros(len(scale))  # of the driven axle from the drivable area [m]; 0 in it
        self._since = np.full(len(scale), np.nan)  # [s]; NaN: on the road

    def observe(self, step: Step) -> Iterator[Event]:
        """off_road, on_road"""
        number = step.number
        distance = np.zeros(len(number))
        away = np.flatnonzero(~shapely.contains_xy(self._drivable, step.x, step.y))
        if len(away):
            distance[away] = shapely.distance(self._drivable, shapely.points(step.x[away], step.y[away]))
        self.distance[number] = distance
        off, since = distance > OFF_ROAD_DISTANCE * self._scale[number], self._since[number]
        left, back = off & np.isnan(since), ~off & ~np.isnan(since)
        for i in np.flatnonzero(left):
            yield step.event("off_road", i, detail=f"{distance[i]:.3f} m outside")
        for i in np.flatnonzero(back):
            yield step.event("on_road", i, duration=step.time - since[i])
        self._since[number] = np.where(left, step.time, np.where(back, np.nan, since))
