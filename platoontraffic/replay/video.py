"""A run as a video: the map that follows the platoon, and its gaps over time with a cursor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import animation, rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from platoontraffic.analysis import figures, pictures
from platoontraffic.analysis.results import Results, load_run
from platoontraffic.analysis.writing import replacing
from platoontraffic.errors import InputError, MissingError

FRAMES = 10  # of a second of the video
SIZE, DPI = (9.6, 5.4), 100  # [inch, 1/inch]
LEAST_VIEW = 4.0  # shortest side of the map, in lengths of the longest vehicle
USUAL = {True: (4.74, 1.80), False: (0.20, 0.15)}  # length and width of a car, of a robot, where they are not known [m]


def video(folder: Path, to: Path, speed: float) -> Path:
    """Write a video of a finished run.

    to    : .gif, or .mp4 or .webm, which need ffmpeg; without a suffix, a folder for the frames as PNG
    speed : seconds of the run in a second of the video

    raises: ResultsError, InputError, MissingError (no ffmpeg), OSError
    """
    if not speed > 0:
        raise InputError(f"--speed: {speed:g}: must be positive")
    if to.suffix not in ("", ".gif", ".mp4", ".webm"):
        raise InputError(f"--video: {str(to)!r}: must end in .gif, .mp4 or .webm, or be a folder for frames")
    writer = _writer(to)
    results = load_run(folder)
    figure, show = _drawing(results)
    table = results.trajectories
    times = np.arange(table.time_s.min(), table.time_s.max() + 1e-6, speed / FRAMES)
    if writer is None:
        to.mkdir(parents=True, exist_ok=True)
        for number, time in enumerate(times):
            show(time)
            figure.savefig(to / f"{number:05}.png", dpi=DPI)
        return to
    with replacing(to) as new, writer.saving(figure, str(new), DPI):
        for time in times:
            show(time)
            writer.grab_frame()
    return to


def _writer(to: Path) -> animation.AbstractMovieWriter | None:
    """raises: MissingError"""
    if to.suffix == "":
        return None
    if to.suffix == ".gif":
        return animation.PillowWriter(fps=FRAMES)
    try:
        import imageio_ffmpeg

        rcParams["animation.ffmpeg_path"] = imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):  # then that of the system
        pass
    if not animation.FFMpegWriter.isAvailable():
        what = 'pip install "platoontraffic[video]", or install ffmpeg; .gif needs neither'
        raise MissingError(f"ffmpeg is not installed, which writes {to.suffix}: {what}")
    return animation.FFMpegWriter(fps=FRAMES)


def _drawing(results: Results) -> tuple[Figure, Callable[[float], None]]:
    """The figure, and what brings it to a time."""
    table = results.trajectories
    main = table[table.platoon_id == figures.main_platoon(table)]
    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    follows = main.gap_m.notna().any()
    road, below = figure.subplots(2, height_ratios=[3, 1.2])
    figures.road(results.scene, road)
    figures.over_time(table, "gap_m" if follows else "speed_mps", below)
    figures.marks(results.events, below, main.vehicle_id.unique())
    below.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, fontsize=8)
    cursor = below.axvline(main.time_s.min(), color="black", linewidth=1)
    sizes = _sizes(results)
    of_members = _Bodies(road, table, sizes, figures.COLOURS)
    came = set(results.events[results.events.kind == "obstacle"].vehicle_id)
    of_traffic = (
        _Bodies(road, results.traffic, sizes, [], came)
        if results.traffic is not None and len(results.traffic)
        else None
    )
    longest = max(sizes(v)[0] for v in main.vehicle_id.unique())

    def show(time: float) -> None:
        there = of_members.show(time)
        if of_traffic:
            of_traffic.show(time)
        mine = there[there.platoon_id == main.platoon_id.iloc[0]] if len(there) else there
        if len(mine):
            half = 0.65 * max(np.ptp(mine.x_m), np.ptp(mine.y_m), LEAST_VIEW * longest) + longest
            x, y = (mine.x_m.max() + mine.x_m.min()) / 2, (mine.y_m.max() + mine.y_m.min()) / 2
            road.set_xlim(x - half, x + half)
            road.set_ylim(y - half / 3, y + half / 3)
        cursor.set_xdata([time, time])
        figure.suptitle(f"{pictures.of_run(results)} · {time:.1f} s".replace("$", r"\$"), fontsize=10)

    return figure, show


class _Bodies:
    """The vehicles of a table on a map."""

    def __init__(
        self,
        axes: Axes,
        table: pd.DataFrame,
        sizes: Callable[[str], tuple[float, float]],
        colours: list[str],
        obstacles: set[str] = frozenset(),
    ) -> None:
        self._rows = dict(tuple(table.groupby("time_s")))
        self._times = np.array(sorted(self._rows))
        self._sizes, self._colours, self._obstacles = sizes, colours, obstacles
        self._drawn = axes.add_collection(
            PolyCollection([], edgecolors="white", linewidths=0.5, zorder=4 + bool(colours))
        )

    def show(self, time: float) -> pd.DataFrame:
        """Draw the vehicles of the last recorded instant up to a time; returns their rows."""
        rows = self._rows[self._times[max(np.searchsorted(self._times, time + 1e-6) - 1, 0)]]
        self._drawn.set_verts([self._outline(row) for row in rows.itertuples()])
        grey = figures.OTHERS, figures.OBSTACLE
        self._drawn.set_facecolor(
            [
                self._colours[row.place % len(self._colours)]
                if self._colours
                else grey[row.vehicle_id in self._obstacles]
                for row in rows.itertuples()
            ]
        )
        return rows

    def _outline(self, row: object) -> np.ndarray:
        length, width = self._sizes(row.vehicle_id)
        ahead, left = length / 2 * np.array([1, 1, -1, -1]), width / 2 * np.array([1, -1, -1, 1])
        c, s = np.cos(row.heading_rad), np.sin(row.heading_rad)
        return np.column_stack([row.x_m + c * ahead - s * left, row.y_m + s * ahead + c * left])


def _sizes(results: Results) -> Callable[[str], tuple[float, float]]:
    """Length and width of a vehicle [m]."""
    if results.vehicles is None:
        usual = USUAL[max(figures.extent(results.scene)) > figures.TOWN]
        return lambda vehicle: usual
    known = {v.vehicle_id: (v.length_m, v.width_m) for v in results.vehicles.itertuples()}
    return lambda vehicle: known.get(vehicle, USUAL[True])
