"""An area in strips, each prepared by itself: a place is looked for among the borders of one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

CORNERS = 500  # of the area, by strip, about
MOST = 64  # strips
BEYOND = 1.0  # how far strips overlap each way, so that no place is near the border of its own [m]


class Strips:
    """Of a town's area: at any latitude it has so many borders that to compare a place with all of them takes long."""

    def __init__(self, area: shapely.Geometry) -> None:
        west, south, east, north = area.bounds
        count = min(max(shapely.get_num_coordinates(area) // CORNERS, 1), MOST)
        self._inner = np.linspace(west, east, count + 1)[1:-1]  # borders between strips, x [m]
        ends = np.array([west, *self._inner, east])
        borders = ((begin - BEYOND, south - 1, end + BEYOND, north + 1) for begin, end in pairwise(ends.tolist()))
        self._strips = np.array([shapely.clip_by_rect(area, *each) for each in borders])
        if not shapely.is_valid(self._strips).all():  # it is fast, but does not promise that
            self._inner, self._strips = np.empty(0), np.array([area])
        shapely.prepare(self._strips)

    def contain(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether each of the places (n,) [m] is inside the area, not on its border; bool (n,)."""
        return shapely.contains_xy(self._strips[self._inner.searchsorted(x)], x, y)
