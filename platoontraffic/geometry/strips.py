"""An area in strips, each prepared by itself: a place is looked for among the borders of one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

CORNERS = 500  # of the area, by strip, about
MOST = 64  # strips
BEYOND = 1.0  # how far strips overlap each way, so that no place is near the border of its own [m]


class Strips:
    """Tells which places are inside an area. That of a town has so many borders at any latitude that to compare a place
    with all of them takes long."""

    def __init__(self, area: shapely.Geometry) -> None:
        self._whole: shapely.Geometry | None = area  # None: strips take its place
        shapely.prepare(area)
        count = min(shapely.get_num_coordinates(area) // CORNERS, MOST)
        if count < 2:
            return
        west, south, east, north = area.bounds
        ends = np.linspace(west, east, count + 1)
        borders = ((begin - BEYOND, south - 1, end + BEYOND, north + 1) for begin, end in pairwise(ends.tolist()))
        strips = np.array([shapely.clip_by_rect(area, *each) for each in borders])
        if shapely.is_valid(strips).all():  # clipping is fast, but does not promise that
            shapely.prepare(strips)
            self._whole, self._strips, self._inner = None, strips, ends[1:-1]  # borders between strips, x [m]

    def contain(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether each of the places (n,) [m] is inside the area, not on its border; bool (n,)."""
        area = self._strips[self._inner.searchsorted(x)] if self._whole is None else self._whole
        return shapely.contains_xy(area, x, y)
