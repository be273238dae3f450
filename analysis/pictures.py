"""Pictures of a run: paths on the road, gaps over time."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path as Outline

from analysis.results import Results, ResultsError, load

# Okabe and Ito's colours: told apart by colour-blind eyes. The leader is black.
COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
ROAD, MIDDLE, WALL, OTHERS = "#ececec", "#ffffff", "#444444", "#999999"


def picture(folder: Path | str, to: Path | str) -> Path:
    """Draw a finished run into a file (.png, .svg or .pdf): its first platoon of several members in colours.

    raises: ResultsError
    """
    results = load(folder)
    gaps = results.trajectories.dropna(subset="gap_m")
    figure = Figure(figsize=(11, 5) if len(gaps) else (6.5, 5), layout="constrained")
    FigureCanvasAgg(figure)
    road, *beside = figure.subplots(1, 2 if len(gaps) else 1, squeeze=False)[0]
    draw_road(road, results)
    draw_paths(road, results)
    for axes in beside:
        draw_gaps(axes, results)
    figure.legend(*road.get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    to = Path(to)
    try:
        figure.savefig(to, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)
    except (OSError, ValueError) as error:
        raise ResultsError(f"{to}: cannot be written: {error}") from error
    return to


def draw_road(axes: Axes, results: Results) -> None:
    """Drivable area, its middle lines, walls and obstacles."""
    outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in results.scene["road"]))
    axes.add_patch(PathPatch(outline, facecolor=ROAD, edgecolor="none"))
    for line in results.scene["middle"]:
        axes.plot(*zip(*line, strict=True), color=MIDDLE, linewidth=1.2, dashes=(6, 4))
    for line in results.scene["walls"]:
        axes.plot(*zip(*line, strict=True), color=WALL, linewidth=1.5, solid_capstyle="round")
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_paths(axes: Axes, results: Results) -> None:
    """Every member's path, and the member itself where it was at the end."""
    main = _main_platoon(results)
    for (platoon, place, vehicle), rows in results.trajectories.groupby(["platoon_id", "place", "vehicle_id"]):
        colour = COLOURS[place % len(COLOURS)] if platoon == main else OTHERS
        axes.plot(rows.x_m, rows.y_m, color=colour, linewidth=0.9, alpha=0.75)
        last = rows.iloc[-1]
        axes.add_patch(Polygon(_arrowhead(last), facecolor=colour, edgecolor="white", linewidth=0.5, zorder=3))
        if platoon == main:
            axes.plot([], [], color=colour, label=f"{vehicle}{' (leader)' if place == 0 else ''}")
    collisions = results.events[results.events.kind == "collision"]
    if len(collisions):
        axes.plot(collisions.x_m, collisions.y_m, "x", color="#D55E00", markersize=9, label="contact", zorder=4)


def draw_gaps(axes: Axes, results: Results) -> None:
    """Gap of every follower of the main platoon over time; ticks at zero where its lock was lost."""
    main = results.trajectories[results.trajectories.platoon_id == _main_platoon(results)]
    for (place, vehicle), rows in main[main.place > 0].groupby(["place", "vehicle_id"]):
        axes.plot(rows.time_s, rows.gap_m, color=COLOURS[place % len(COLOURS)], linewidth=1, label=vehicle)
        lost = rows[rows.target_id != _ahead(main, place)]
        if len(lost):
            axes.plot(lost.time_s, [0.0] * len(lost), "|", color=COLOURS[place % len(COLOURS)], markersize=4 + 4 * place)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("gap to the member ahead [m]")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _main_platoon(results: Results) -> str:
    """The platoon with the most members, the first of them in the tables."""
    sizes = results.trajectories.groupby("platoon_id", sort=False).vehicle_id.nunique()
    return sizes.idxmax()


def _ahead(rows: pd.DataFrame, place: int) -> str:
    return rows.loc[rows.place == place - 1, "vehicle_id"].iloc[0]


def _arrowhead(row: pd.Series) -> list[tuple[float, float]]:
    """A triangle at a vehicle's pose, pointing where it heads."""
    from math import cos, sin

    shape = [(0.16, 0), (-0.12, 0.1), (-0.12, -0.1)]
    c, s = cos(row.heading_rad), sin(row.heading_rad)
    return [(row.x_m + c * x - s * y, row.y_m + s * x + c * y) for x, y in shape]
