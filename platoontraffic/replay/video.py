"""A run as a video: the map that follows the platoon, and its gaps over time with a cursor."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import animation, rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from platoontraffic.analysis import crowd, figures, pictures
from platoontraffic.analysis.results import Results, load_run
from platoontraffic.analysis.writing import replacing
from platoontraffic.errors import InputError, MissingError
from platoontraffic.replay.instants import instants

FRAMES = 10  # of a second of the video
SIZE, DPI = (9.6, 5.4), 100  # [inch, 1/inch]
LEAST_VIEW = 4.0  # shortest side of the map, in lengths of the longest vehicle
WIDE = 3.0  # width of the map, in heights
SEEN = 1 / 60  # length of the longest vehicle on the map of a crowd, of the map's width: they are enlarged
USUAL = {True: (4.74, 1.80), False: (0.20, 0.15)}  # length and width of a car, of a robot, where they are not known [m]


def video(folder: Path, to: Path, speed: float) -> Path:
    """Write a video of a finished run.

    to    : .gif, or .mp4 or .webm, which need ffmpeg; without a suffix, a folder for the frames as PNG
    speed : seconds of the run in a second of the video

    raises: ResultsError, InputError, MissingError (no ffmpeg), OSError
    """
    if not 0 < speed < math.inf:
        raise InputError(f"--speed: {speed:g}: must be positive{' and finite' if speed > 0 else ''}")
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
    column, many = "gap_m" if main.gap_m.notna().any() else "speed_mps", crowd.is_crowd(table)
    road, below = figure.subplots(2, height_ratios=[3, 1.2])
    figures.road(results.scene, road)
    sizes = _sizes(results)
    longest = max(sizes(v)[0] for v in main.vehicle_id.unique())
    if many:  # they are everywhere
        crowd.over_time(table, column, below)
        _look_at(road, table, longest)
        sizes = _enlarged(sizes, max(1.0, SEEN * np.ptp(road.get_xlim()) / longest))
    else:
        figures.over_time(table, column, below)
        figures.marks(results.events, below, main.vehicle_id.unique())
    below.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, fontsize=8)
    figures.from_to(below, table.time_s.min(), table.time_s.max())
    cursor = below.axvline(main.time_s.min(), color="black", linewidth=1)
    of_members = _Bodies(road, table, instants(results, table, "every_s"), sizes, figures.COLOURS)
    came = set(results.events[results.events.kind == "obstacle"].vehicle_id)
    of_traffic = None
    if results.traffic is not None and len(results.traffic):
        times = instants(results, results.traffic, "traffic_every_s")
        of_traffic = _Bodies(road, results.traffic, times, sizes, [], came)

    def show(time: float) -> None:
        there = of_members.show(time)
        if of_traffic:
            of_traffic.show(time)
        if len(there) and not many:
            _look_at(road, _in_view(there, main.platoon_id.iloc[0]), longest)
        cursor.set_xdata([time, time])
        figure.suptitle(f"{pictures.of_run(results)} · {time:.1f} s".replace("$", r"\$"), fontsize=10)

    return figure, show


def _in_view(there: pd.DataFrame, main: str) -> pd.DataFrame:
    """The members of the main platoon; if it is not on the road, of the largest one that is."""
    platoon = main if (there.platoon_id == main).any() else figures.main_platoon(there)
    return there[there.platoon_id == platoon]


def _look_at(road: Axes, members: pd.DataFrame, longest: float) -> None:
    """Show all of some members, and something around them.

    longest: length of the longest vehicle [m]
    """
    across, up = np.ptp(members.x_m), np.ptp(members.y_m)
    half = 0.65 * max(across, WIDE * up, LEAST_VIEW * longest) + longest
    x, y = (members.x_m.max() + members.x_m.min()) / 2, (members.y_m.max() + members.y_m.min()) / 2
    road.set_xlim(x - half, x + half)
    road.set_ylim(y - half / WIDE, y + half / WIDE)


class _Bodies:
    """The vehicles of a table on a map."""

    def __init__(
        self,
        axes: Axes,
        table: pd.DataFrame,
        times: np.ndarray,
        sizes: Callable[[str], tuple[float, float]],
        colours: list[str],
        obstacles: set[str] = frozenset(),
    ) -> None:
        """times: instants of the table, and those at which it has no rows; see `instants`"""
        self._rows, self._none = dict(tuple(table.groupby("time_s"))), table[:0]
        self._times = times
        self._sizes, self._colours, self._obstacles = sizes, colours, obstacles
        self._drawn = axes.add_collection(
            PolyCollection([], edgecolors="white", linewidths=0.5, zorder=4 + bool(colours))
        )

    def show(self, time: float) -> pd.DataFrame:
        """Draw the vehicles of the last recorded instant up to a time; returns their rows."""
        before = np.searchsorted(self._times, time + 1e-6) - 1
        rows = self._rows.get(self._times[before], self._none) if before >= 0 else self._none
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


def _enlarged(sizes: Callable[[str], tuple[float, float]], factor: float) -> Callable[[str], tuple[float, float]]:
    return lambda vehicle: tuple(factor * size for size in sizes(vehicle))


def _sizes(results: Results) -> Callable[[str], tuple[float, float]]:
    """Length and width of a vehicle [m]."""
    if results.vehicles is None:
        usual = USUAL[max(figures.extent(results.scene)) > figures.TOWN]
        return lambda vehicle: usual
    known = {v.vehicle_id: (v.length_m, v.width_m) for v in results.vehicles.itertuples()}
    return lambda vehicle: known.get(vehicle, USUAL[True])
