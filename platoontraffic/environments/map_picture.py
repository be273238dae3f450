"""The map of the replay as a picture, around the members."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from platoontraffic.analysis import figures
from platoontraffic.analysis.results import shapes_of

SIZE, DPI = (6.4, 4.8), 100  # [inch, 1/inch]
LEAST_VIEW = 8.0  # shortest side, in lengths of the longest member


class MapPicture:
    """Roads, walls and vehicles seen from above, north up."""

    def __init__(self, scene: dict[str, Any]) -> None:
        """scene: GeoJSON, as scene.geojson of a run"""
        self._figure = Figure(figsize=SIZE, dpi=DPI)
        self._canvas = FigureCanvasAgg(self._figure)
        self._axes = self._figure.add_axes((0, 0, 1, 1))
        figures.road(shapes_of(scene), self._axes)
        self._drawn = self._axes.add_collection(PolyCollection([], edgecolors="white", linewidths=0.5, zorder=4))

    def pixels(self, bodies: np.ndarray, members: int, learners: list[int]) -> np.ndarray:
        """Red, green and blue, (480, 640, 3) uint8.

        bodies   : x, y, heading, length and width of all vehicles, members first, (n, 5)
        learners : rows of the members that learn, which are coloured; other members are black
        """
        x, y, heading, length, width = bodies.T
        ahead = np.array([1, 1, -1, -1]) / 2 * length[:, None]
        left = np.array([1, -1, -1, 1]) / 2 * width[:, None]
        cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
        outlines = np.stack([x[:, None] + cos * ahead - sin * left, y[:, None] + sin * ahead + cos * left], axis=-1)
        self._drawn.set_verts(list(outlines))
        colours = [figures.COLOURS[0]] * members + [figures.OTHERS] * (len(bodies) - members)
        for i, row in enumerate(learners):
            colours[row] = figures.COLOURS[1 + i % (len(figures.COLOURS) - 1)]
        self._drawn.set_facecolor(colours)
        if members:
            longest = length[:members].max()
            half = 0.6 * max(np.ptp(x[:members]), np.ptp(y[:members]), LEAST_VIEW * longest) + longest
            centre = (x[:members].max() + x[:members].min()) / 2, (y[:members].max() + y[:members].min()) / 2
            self._axes.set_xlim(centre[0] - half * SIZE[0] / SIZE[1], centre[0] + half * SIZE[0] / SIZE[1])
            self._axes.set_ylim(centre[1] - half, centre[1] + half)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
