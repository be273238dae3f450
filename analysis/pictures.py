"""Pictures of a run: paths on the road; gaps, speeds and spacing errors over time."""

from __future__ import annotations

from math import cos, sin
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path as Outline

from analysis.results import Results, ResultsError, load_run

# Okabe and Ito's colours: told apart by colour-blind eyes. The leader is black.
COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
ROAD, MIDDLE, WALL, OTHERS, BUILDING = "#e4e4e4", "#ffffff", "#444444", "#999999", "#efe9e2"
OBSTACLE = "#D55E00"
ENCOUNTERS = ("cut_in", "steps_out")  # events
TOWN = 100.0  # a road that extends farther is of cars; things are drawn smaller on it, and vehicles larger [m]


def picture(folder: Path | str, to: Path | str) -> Path:
    """Draw a finished run into a file (.png, .svg or .pdf): its first platoon of several members in colours.

    raises: ResultsError
    """
    results = load_run(Path(folder))
    gaps = results.trajectories.dropna(subset="gap_m")
    wide = _extent(results)[0] > 2.5 * _extent(results)[1]
    figure = Figure(figsize=((11, 6) if wide else (11, 5)) if len(gaps) else (6.5, 5), layout="constrained")
    FigureCanvasAgg(figure)
    if len(gaps):
        beside, below = [["road", "gaps"], ["road", "locks"]], [["road"], ["gaps"], ["locks"]]
        parts = figure.subplot_mosaic(below if wide else beside, height_ratios=[4, 5, 1] if wide else [6, 1])
        draw_gaps(parts["gaps"], results)
        draw_losses(parts["locks"], results)
        parts["locks"].sharex(parts["gaps"])
        road = parts["road"]
    else:
        road = figure.subplots()
    draw_road(road, results)
    draw_obstacles(road, results)
    draw_paths(road, results)
    figure.legend(*road.get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    to = Path(to)
    if to.is_dir():
        raise ResultsError(f"{to}: is a folder; must be a picture file: .png, .svg or .pdf")
    try:
        figure.savefig(to, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)
    except (OSError, ValueError) as error:
        raise ResultsError(f"{to}: cannot be written: {error}") from error
    return to


def road_figure(results: Results) -> Figure:
    """The road with every member's path."""
    across, up = _extent(results)
    figure = _figure(9, min(max(9 * up / max(across, 1e-9), 2.2), 8))
    axes = figure.subplots()
    draw_road(axes, results)
    draw_obstacles(axes, results)
    draw_paths(axes, results)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return figure


def strips_figure(results: Results) -> Figure:
    """Gap, speed, spacing error and losses of lock of the main platoon over time."""
    follows = bool(len(_followers(results)))
    strips = ["gaps", "speeds", "errors", "locks"] if follows else ["speeds"]
    figure = _figure(9, 7.5 if follows else 2.5)
    parts = figure.subplot_mosaic([[name] for name in strips], height_ratios=[4, 4, 4, 1.5][: len(strips)], sharex=True)
    rows = results.trajectories[results.trajectories.platoon_id == _main_platoon(results)]
    for (place, vehicle), own in rows.groupby(["place", "vehicle_id"]):
        colour = COLOURS[place % len(COLOURS)]
        parts["speeds"].plot(own.time_s, own.speed_mps, color=colour, linewidth=1, label=vehicle)
        if follows and place > 0:
            parts["errors"].plot(own.time_s, own.gap_error_m, color=colour, linewidth=1)
    parts["speeds"].set_ylabel("speed [m/s]")
    if follows:
        draw_gaps(parts["gaps"], results)
        parts["gaps"].set_ylabel("gap [m]")
        draw_losses(parts["locks"], results)
        parts["errors"].set_ylabel("spacing error [m]")
        usual = 1.5 * rows.gap_m.median()  # beyond, a platoon has parted
        low, high = rows.gap_error_m.min(), rows.gap_error_m.max()
        if low < -usual or high > usual:
            parts["errors"].set_ylim(max(low, -usual), min(high, usual))
    for name in set(strips) - {"gaps", "locks"}:
        parts[name].grid(alpha=0.3)
        parts[name].spines[["top", "right"]].set_visible(False)
        parts[name].tick_params(labelbottom=name == strips[-1])
    parts[strips[-1]].set_xlabel("time [s]")
    legend = parts["speeds"].get_legend_handles_labels()
    figure.legend(*legend, loc="outside upper center", ncols=6, frameon=False, fontsize=9)
    return figure


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def draw_road(axes: Axes, results: Results) -> None:
    """Drivable area, its middle lines, walls and obstacles."""
    outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in results.scene["road"]))
    town = max(_extent(results)) > TOWN
    axes.add_patch(PathPatch(outline, facecolor=ROAD, edgecolor=ROAD, linewidth=1.5 if town else 0))
    for ring in results.scene.get("buildings", []):
        axes.fill(*zip(*ring, strict=True), facecolor=BUILDING)
    for line in results.scene.get("lanes", []):
        axes.plot(*zip(*line, strict=True), color=MIDDLE, linewidth=0.4, dashes=(6, 6))
    for line in results.scene["middle"]:
        axes.plot(*zip(*line, strict=True), color=MIDDLE, linewidth=0.6 if town else 1.2, dashes=(6, 4))
    for line in results.scene["walls"]:
        axes.plot(*zip(*line, strict=True), color=WALL, linewidth=0.6 if town else 1.5, solid_capstyle="round")
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_paths(axes: Axes, results: Results) -> None:
    """Every member's path, and the member itself where it was at the end."""
    main, size = _main_platoon(results), max(1.0, max(_extent(results)) / TOWN * 6)
    for (platoon, place, vehicle), rows in results.trajectories.groupby(["platoon_id", "place", "vehicle_id"]):
        colour = COLOURS[place % len(COLOURS)] if platoon == main else OTHERS
        axes.plot(rows.x_m, rows.y_m, color=colour, linewidth=0.9, alpha=0.75)
        last = rows.iloc[-1]
        axes.add_patch(Polygon(_arrowhead(last, size), facecolor=colour, edgecolor="white", linewidth=0.5, zorder=3))
        if platoon == main:
            axes.plot([], [], color=colour, label=f"{vehicle}{' (leader)' if place == 0 else ''}")
    collisions = results.events[results.events.kind == "collision"]
    if len(collisions):
        axes.plot(collisions.x_m, collisions.y_m, "x", color="#D55E00", markersize=9, label="contact", zorder=4)


def draw_obstacles(axes: Axes, results: Results) -> None:
    """Where they came up, and their ways if the traffic was recorded; where somebody cut in or stepped out."""
    came = results.events[results.events.kind == "obstacle"]
    for _, event in came.iterrows():
        if results.traffic is not None:
            rows = results.traffic[results.traffic.vehicle_id == event.vehicle_id]
            axes.plot(rows.x_m, rows.y_m, color=OBSTACLE, linewidth=0.9, linestyle=":")
    if len(came):
        axes.plot(came.x_m, came.y_m, "s", color=OBSTACLE, markersize=5, label="obstacle", zorder=4)
    met = results.events[results.events.kind.isin(ENCOUNTERS)]
    if len(met):
        axes.plot(met.x_m, met.y_m, "v", color=OBSTACLE, markersize=7, label="in its way", zorder=4)


def draw_gaps(axes: Axes, results: Results) -> None:
    """Gap of every follower of the main platoon over time."""
    for place, _, rows in _followers(results):
        axes.plot(rows.time_s, rows.gap_m, color=COLOURS[place % len(COLOURS)], linewidth=1)
    gaps = pd.concat([rows.gap_m for *_, rows in _followers(results)])
    axes.set_ylabel("gap to the member ahead [m]")
    # A platoon that has parted would press the others' gaps onto the axis.
    axes.set_ylim(0, 4 * gaps.median() if gaps.max() > 8 * gaps.median() else None)
    for time in results.events.loc[results.events.kind.isin(ENCOUNTERS), "time_s"]:
        axes.axvline(time, color=OBSTACLE, linewidth=1, linestyle=":")
    axes.tick_params(labelbottom=False)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def draw_losses(axes: Axes, results: Results) -> None:
    """When each follower of the main platoon did not take its true predecessor for it: one line a follower."""
    end = results.trajectories.time_s.max()
    for place, vehicle, _ in _followers(results):
        events = results.events[results.events.vehicle_id == vehicle]
        lost = events.loc[events.kind == "lock_lost", "time_s"].to_list()
        until = [*events.loc[events.kind == "lock_regained", "time_s"], end]
        spans = [(a, b - a) for a, b in zip(lost, until, strict=False)]
        axes.broken_barh(spans, (-place - 0.4, 0.8), facecolor=COLOURS[place % len(COLOURS)])
    if not any(results.events.kind == "lock_lost"):
        axes.text(0.5, 0.5, "never", transform=axes.transAxes, ha="center", va="center", color=WALL)
    axes.set_ylim(-max(place for place, *_ in _followers(results)) - 0.6, -0.4)
    axes.set_yticks([])
    axes.set_ylabel("lock lost", rotation=0, ha="right", va="center")
    axes.set_xlabel("time [s]")
    axes.spines[["top", "right", "left"]].set_visible(False)


def _followers(results: Results) -> list[tuple[int, str, pd.DataFrame]]:
    """(place, vehicle, its rows) of the main platoon."""
    rows = results.trajectories
    rows = rows[(rows.platoon_id == _main_platoon(results)) & (rows.place > 0)]
    return [(place, vehicle, own) for (place, vehicle), own in rows.groupby(["place", "vehicle_id"])]


def _main_platoon(results: Results) -> str:
    """The platoon with the most members, the first of them in the tables."""
    sizes = results.trajectories.groupby("platoon_id", sort=False).vehicle_id.nunique()
    return sizes.idxmax()


def _extent(results: Results) -> tuple[float, float]:
    """Width and height of the road [m]."""
    points = [point for ring in results.scene["road"] for point in ring]
    (left, right), (low, high) = ((min(values), max(values)) for values in zip(*points, strict=True))
    return right - left, high - low


def _arrowhead(row: pd.Series, size: float) -> list[tuple[float, float]]:
    """A triangle at a vehicle's pose, pointing where it heads; of size 1 it is that of a robot."""
    shape = [(0.16 * size, 0), (-0.12 * size, 0.1 * size), (-0.12 * size, -0.1 * size)]
    c, s = cos(row.heading_rad), sin(row.heading_rad)
    return [(row.x_m + c * x - s * y, row.y_m + s * x + c * y) for x, y in shape]
