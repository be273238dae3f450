"""Figures: each function draws a table on axes and returns them.

Colours can be distinguished by colour-blind readers and in greyscale. Labels state units, from the table's
`attrs["units"]` or from the name of the column.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path as Outline

from platoontraffic.analysis.results import ResultsError
from platoontraffic.analysis.tables import columns_of, summarise

Scene = dict[str, list[list[list[float]]]]  # as `Results.scene`

# Okabe and Ito's colours. The leader is black.
COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
MARKERS = "osD^vPX*"
ROAD, MIDDLE, WALL, OTHERS, BUILDING = "#e4e4e4", "#ffffff", "#444444", "#999999", "#efe9e2"
OBSTACLE = "#D55E00"
ENCOUNTERS = ("cut_in", "steps_out")  # events
STATES = {  # events that begin and end them, colour and height of the bar
    "split off": ("split", "rejoined", "#c9c9c9", 0.8),
    "held": ("held", "released", "#555555", 0.5),
    "broken": ("breaks_down", "repaired", "#D55E00", 0.3),
}
TOWN = 100.0  # a larger road is for cars: lines are drawn thinner on it, and vehicles enlarged [m]
BESIDE = 6.0  # greatest distance from a line at which a vehicle is on its road [m]
CUT_GAP = 8.0  # axis limit, in median gaps: the gap of a split platoon would flatten all others [1]

WORDS = {"gap_m": "gap to the member ahead", "gap_error_m": "spacing error"}
UNITS = {
    "m": "m", "km": "km", "s": "s", "hz": "Hz", "deg": "°", "rad": "rad", "mps": "m/s", "mps2": "m/s²", "mps3": "m/s³",
    "radps": "rad/s", "degps": "°/s", "per_s": "1/s", "perh": "1/h", "perkm": "1/km", "kg": "kg", "kgpkm": "kg/km",
    "kwh": "kWh", "s2": "s²",
}  # fmt: skip


def label(table: pd.DataFrame, column: str) -> str:
    """Axis label of a column: words, and its unit in brackets."""
    suffix = next((s for s in sorted(UNITS, key=len, reverse=True) if column.endswith(f"_{s}")), "")
    known = table.attrs.get("units", {}).get(column, "")
    unit = re.sub(r"(?<=[a-z])([23])", lambda power: "²³"[int(power[1]) - 2], known) or UNITS.get(suffix, "")
    plain = column.removesuffix(f"_{suffix}").removeprefix("platoon.").replace(".", " ").replace("_", " ")
    words = WORDS.get(column, plain)
    return f"{words} [{unit}]" if unit else words


def over_time(trajectories: pd.DataFrame, column: str, axes: Axes, platoon: str | None = None) -> Axes:
    """A column of trajectories over time, such as gap_m, gap_error_m or speed_mps: a line a member.

    platoon: default: the largest
    """
    columns_of(trajectories, ["time_s", "platoon_id", "vehicle_id", "place", column])
    drawn = []
    for place, vehicle, rows in _members(trajectories, platoon):
        if rows[column].notna().any():
            axes.plot(rows.time_s, rows[column], color=_colour(place), linewidth=1, label=vehicle)
            drawn.append(rows[column])
    if not drawn:
        raise ResultsError(f"{column!r}: has no values")
    _cut(axes, column, pd.concat(drawn), trajectories)
    axes.set_xlabel(label(trajectories, "time_s"))
    axes.set_ylabel(label(trajectories, column))
    return _plain(axes)


def _cut(axes: Axes, column: str, values: pd.Series, trajectories: pd.DataFrame) -> None:
    """Let gaps begin at 0, and keep the gaps of a split platoon off the axis."""
    usual = trajectories.gap_m.median() if "gap_m" in trajectories else math.nan
    if column == "gap_m":
        axes.set_ylim(min(0, values.min()), 4 * usual if values.max() > CUT_GAP * usual else None)
    elif column == "gap_error_m" and values.abs().max() > 1.5 * usual:
        axes.set_ylim(max(values.min(), -1.5 * usual), min(values.max(), 1.5 * usual))


def losses(events: pd.DataFrame, axes: Axes, trajectories: pd.DataFrame, platoon: str | None = None) -> Axes:
    """Lock losses of each follower over time: a row each, the first follower on top."""
    columns_of(events, ["time_s", "kind", "vehicle_id"])
    followers = [(place, vehicle, rows.time_s) for place, vehicle, rows in _members(trajectories, platoon) if place > 0]
    if not followers:
        raise ResultsError("losses: the platoon has no followers")
    never = True
    for place, vehicle, times in followers:
        own = events[events.vehicle_id == vehicle]
        begins = own.loc[own.kind == "lock_lost", "time_s"].to_list()
        ends = [*own.loc[own.kind == "lock_regained", "time_s"], times.max()]
        spans = [(a, b - a) for a, b in zip(begins, ends, strict=False)]
        axes.broken_barh(spans, (-place - 0.4, 0.8), facecolor=_colour(place))
        never = never and not begins
    if never:
        axes.text(0.5, 0.5, "never", transform=axes.transAxes, ha="center", va="center", color=WALL)
    axes.set_xlim(min(times.min() for *_, times in followers), max(times.max() for *_, times in followers))
    axes.set_ylim(-followers[-1][0] - 0.6, -0.4)
    axes.set_yticks([])
    axes.set_ylabel("lock lost", rotation=0, ha="right", va="center")
    axes.set_xlabel(label(events, "time_s"))
    axes.spines[["top", "right", "left"]].set_visible(False)
    return axes


def states(events: pd.DataFrame, axes: Axes, trajectories: pd.DataFrame, platoon: str | None = None) -> Axes:
    """Periods in which members were held at a stop line, split off or broken down: a row each, the leader on top."""
    columns_of(events, ["time_s", "kind", "vehicle_id"])
    members = [(place, vehicle, rows.time_s) for place, vehicle, rows in _members(trajectories, platoon)]
    for name, (begin, end, colour, height) in STATES.items():
        for place, vehicle, times in members:
            own = events[events.vehicle_id == vehicle]
            ends = [*own.loc[own.kind == end, "time_s"], times.max()]
            begins = own.loc[own.kind == begin, "time_s"]
            spans = [(a, min(b for b in ends if b >= a) - a) for a in begins if a <= times.max()]
            axes.broken_barh(
                spans, (-place - height / 2, height), facecolor=colour, label=name if place == members[0][0] else None
            )
    axes.set_xlim(min(times.min() for *_, times in members), max(times.max() for *_, times in members))
    axes.set_ylim(-members[-1][0] - 0.6, -members[0][0] + 0.6)
    axes.set_yticks([])
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False, fontsize=8)
    axes.set_xlabel(label(events, "time_s"))
    axes.spines[["top", "right", "left"]].set_visible(False)
    return axes


def time_space(
    table: pd.DataFrame, axes: Axes, line: Sequence[Sequence[float]] | None = None, platoon: str | None = None
) -> Axes:
    """Position of each vehicle along the road over time.

    table : trajectories; or, with a line, traffic, in grey
    line  : of the road, (k, 2) [m]; the position is the station along it, for vehicles within BESIDE of it. Without a
            line it is the distance that a member has driven, measured from the leader's start
    """
    columns_of(table, ["time_s", "vehicle_id", "x_m", "y_m"])
    members = "place" in table.columns
    if not members and line is None:
        raise ResultsError("time_space: traffic needs a line of the road to be placed along")
    if members and line is None:
        of_platoon = list(_members(table, platoon))
        start = of_platoon[0][2][["x_m", "y_m"]].iloc[0].to_numpy()
        drawn = [(place, vehicle, rows, _driven(rows, start)) for place, vehicle, rows in of_platoon]
    else:
        groups = table.groupby(["place", "vehicle_id"] if members else "vehicle_id")
        road = shapely.LineString(np.asarray(line, dtype=float))
        drawn = [(k[0] if members else None, k[-1] if members else k, rows, _along(rows, road)) for k, rows in groups]
    for place, vehicle, rows, station in drawn:
        if place is None:
            axes.plot(rows.time_s, station, color=OTHERS, linewidth=0.5, alpha=0.7, zorder=1)
        else:
            axes.plot(rows.time_s, station, color=_colour(place), linewidth=1.2, label=vehicle, zorder=2)
    axes.set_xlabel(label(table, "time_s"))
    axes.set_ylabel("distance along the road [m]")
    return _plain(axes)


def _driven(rows: pd.DataFrame, start: np.ndarray) -> np.ndarray:
    """Distance driven, counted from `start` [m]: a member begins at minus its straight distance to it."""
    steps = np.hypot(rows.x_m.diff(), rows.y_m.diff()).fillna(0.0)
    return steps.cumsum().to_numpy() - np.hypot(*(rows[["x_m", "y_m"]].iloc[0].to_numpy() - start))


def _along(rows: pd.DataFrame, road: shapely.LineString) -> np.ndarray:
    """Station along the road [m]; NaN beside it, and where the line starts again, as on a ring."""
    points = shapely.points(rows.x_m, rows.y_m)
    station = shapely.line_locate_point(road, points)
    off = (shapely.distance(road, points) > BESIDE) | (station <= 0) | (station >= road.length)
    station[off | (np.abs(np.diff(station, prepend=station[:1])) > road.length / 2)] = np.nan
    return station


def growth(
    table: pd.DataFrame, axes: Axes, by: str | None = None, name: str = "speed swing over that of the leader"
) -> Axes:
    """String amplification by place, from a table of `tables.amplification`; geometric means with intervals
    over several runs.

    by: a column; a line for each of its values
    """
    followers = summarise(table[table.place > 0], "amplification", [*([by] if by else []), "place"], geometric=True)
    leaders = followers.drop_duplicates(by or "metric").assign(place=0, mean=1.0, low=math.nan, high=math.nan)
    points = pd.concat([leaders, followers])
    points.attrs = table.attrs
    estimates(points, "place", axes, by)
    axes.axhline(1, color=WALL, linewidth=0.8, dashes=(4, 3), zorder=1)
    axes.set_xticks(sorted(table.place.unique()))
    axes.set_xlabel("place behind the leader")
    axes.set_ylabel(name)
    return axes


def estimates(table: pd.DataFrame, x: str, axes: Axes, by: str | None = None) -> Axes:
    """Means with their intervals over a column, from a table of `tables.summarise` or `tables.paired`.

    by: another column; a line for each of its values
    """
    columns_of(table, [x, *([by] if by else []), "metric", "mean", "low", "high"])
    metrics = table.metric.unique()
    if len(metrics) != 1:
        raise ResultsError(f"estimates: must be of one metric; there are {', '.join(metrics)}")
    groups = list(table.groupby(by, sort=False)) if by else [(None, table)]
    for i, (value, rows) in enumerate(groups):
        at, mean, low, high = rows.sort_values(x)[[x, "mean", "low", "high"]].to_numpy(dtype=float).T
        colour, marker = COLOURS[1:][i % 7] if by else COLOURS[1], MARKERS[i % len(MARKERS)]
        axes.errorbar(
            at, mean, np.nan_to_num([mean - low, high - mean]), color=colour, marker=marker, markersize=5,
            linewidth=1.2, capsize=3, label=None if value is None else str(value),
        )  # fmt: skip
    if by:
        axes.legend(title=label(table, by), frameon=False)
    axes.set_xlabel(label(table, x))
    axes.set_ylabel(label(table, metrics[0]))
    return _plain(axes)


def heat_map(
    table: pd.DataFrame,
    x: str,
    y: str,
    metric: str,
    axes: Axes,
    limits: tuple[float, float] | None = None,
    bar: bool = True,
) -> Axes:
    """Mean of a metric over two columns: a cell for each pair of their values, crossed out if it has no run.

    table  : a row a run, as `Batch.summary`
    limits : of the colour scale; default: the least and the largest mean
    bar    : whether to draw the colour bar
    """
    columns_of(table, [x, y, metric])
    means = table.groupby([y, x])[metric].mean().unstack()
    values = means.to_numpy(dtype=float)
    if np.isnan(values).all():
        raise ResultsError(f"{metric!r}: has no values")
    scale = Normalize(*(limits or (np.nanmin(values), np.nanmax(values))))
    axes.set_facecolor("white")
    image = axes.imshow(values, origin="lower", aspect="auto", cmap="cividis", norm=scale)
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            axes.text(column, row, "×", ha="center", va="center", color=OTHERS)
        else:
            colour = "white" if scale(value) < 0.55 else "black"
            axes.text(column, row, _short(value), ha="center", va="center", color=colour, fontsize=8)
    axes.set_xticks(range(len(means.columns)), [_short(v) for v in means.columns])
    axes.set_yticks(range(len(means.index)), [_short(v) for v in means.index])
    axes.set_xlabel(label(table, x))
    axes.set_ylabel(label(table, y))
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    if bar:
        axes.figure.colorbar(image, ax=axes, label=label(table, metric))
    return axes


def road(scene: Scene, axes: Axes) -> Axes:
    """Drivable area, lane borders, middle lines, walls and buildings, from `Results.scene`."""
    outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in scene["road"]))
    town = max(extent(scene)) > TOWN
    axes.add_patch(PathPatch(outline, facecolor=ROAD, edgecolor=ROAD, linewidth=1.5 if town else 0))
    for ring in scene.get("buildings", []):
        axes.fill(*zip(*ring, strict=True), facecolor=BUILDING)
    for line in scene.get("lanes", []):
        axes.plot(*zip(*line, strict=True), color=MIDDLE, linewidth=0.4, dashes=(6, 6))
    for line in scene["middle"]:
        axes.plot(*zip(*line, strict=True), color=MIDDLE, linewidth=0.6 if town else 1.2, dashes=(6, 4))
    for line in scene["walls"]:
        axes.plot(*zip(*line, strict=True), color=WALL, linewidth=0.6 if town else 1.5, solid_capstyle="round")
    axes.set_aspect("equal")
    axes.set_axis_off()
    return axes


def paths(
    trajectories: pd.DataFrame,
    axes: Axes,
    scene: Scene,
    events: pd.DataFrame | None = None,
    length: float | None = None,
) -> Axes:
    """Path of every member on the road, and its last position.

    events : of the run, to mark contacts
    length : of the arrowhead that marks a member [m]; default: visible on the whole road
    """
    columns_of(trajectories, ["platoon_id", "vehicle_id", "place", "x_m", "y_m", "heading_rad"])
    road(scene, axes)
    main, length = main_platoon(trajectories), length or 0.28 * max(1.0, max(extent(scene)) / TOWN * 6)
    for (platoon, place, vehicle), rows in trajectories.groupby(["platoon_id", "place", "vehicle_id"]):
        colour = _colour(place) if platoon == main else OTHERS
        axes.plot(rows.x_m, rows.y_m, color=colour, linewidth=0.9, alpha=0.75)
        last = rows.iloc[-1]
        axes.add_patch(Polygon(_arrowhead(last, length), facecolor=colour, edgecolor="white", linewidth=0.5, zorder=3))
        if platoon == main:
            axes.plot([], [], color=colour, label=f"{vehicle}{' (leader)' if place == 0 else ''}")
    if events is not None and len(contacts := events[events.kind == "collision"]):
        axes.plot(contacts.x_m, contacts.y_m, "x", color="#D55E00", markersize=9, label="contact", zorder=4)
    return axes


def obstacles(events: pd.DataFrame, axes: Axes, traffic: pd.DataFrame | None = None) -> Axes:
    """Positions at which obstacles appeared and at which they entered a member's path; also their recorded paths."""
    came, met = events[events.kind == "obstacle"], events[events.kind.isin(ENCOUNTERS)]
    for name in came.vehicle_id if traffic is not None else ():
        rows = traffic[traffic.vehicle_id == name]
        axes.plot(rows.x_m, rows.y_m, color=OBSTACLE, linewidth=0.9, linestyle=":")
    for rows, mark, label in ((came, "s", "obstacle"), (met, "v", "in a member's path")):
        if len(rows):
            axes.plot(rows.x_m, rows.y_m, mark, color=OBSTACLE, markersize=6, label=label, zorder=4)
    return axes


def main_platoon(trajectories: pd.DataFrame) -> str:
    """The platoon with the most members, the first of them in the table."""
    if trajectories.empty:
        raise ResultsError("the trajectories have no rows: no member was ever on the road")
    return trajectories.groupby("platoon_id", sort=False).vehicle_id.nunique().idxmax()


def extent(scene: Scene) -> tuple[float, float]:
    """Width and height of the road [m]."""
    points = [point for ring in scene["road"] for point in ring]
    (left, right), (low, high) = ((min(values), max(values)) for values in zip(*points, strict=True))
    return right - left, high - low


def _members(trajectories: pd.DataFrame, platoon: str | None = None) -> Iterator[tuple[int, str, pd.DataFrame]]:
    """(place, vehicle, its rows) of one platoon of one run."""
    if "id" in trajectories.columns and trajectories.id.nunique() > 1:
        raise ResultsError(f"trajectories of {trajectories.id.nunique()} runs; must be of one")
    platoon = platoon or main_platoon(trajectories)
    rows = trajectories[trajectories.platoon_id == platoon]
    if rows.empty:
        raise ResultsError(
            f"platoon {platoon!r}: not in the table; there are {', '.join(trajectories.platoon_id.unique())}"
        )
    for (place, vehicle), own in rows.groupby(["place", "vehicle_id"]):
        yield place, vehicle, own


def _arrowhead(row: pd.Series, length: float) -> list[tuple[float, float]]:
    """Triangle at a vehicle's pose, pointing along its heading."""
    shape = [(0.57 * length, 0), (-0.43 * length, 0.36 * length), (-0.43 * length, -0.36 * length)]
    c, s = math.cos(row.heading_rad), math.sin(row.heading_rad)
    return [(row.x_m + c * x - s * y, row.y_m + s * x + c * y) for x, y in shape]


def _colour(place: int) -> str:
    return COLOURS[place % len(COLOURS)]


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _plain(axes: Axes) -> Axes:
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return axes
