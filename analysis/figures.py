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
from matplotlib.patheffects import withStroke
from pandas.api.types import is_numeric_dtype

from platoontraffic.analysis.following import split_off, stretches
from platoontraffic.analysis.results import ResultsError
from platoontraffic.analysis.tables import columns_of, summarise

Scene = dict[str, list[list[list[float]]]]  # as `Results.scene`

# Okabe and Ito's colours. The leader is black.
COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
MARKERS = "osD^vPX*"
MARKED = 7  # markers on a line, by which members can be told apart without colours
ROAD, MIDDLE, WALL, OTHERS, BUILDING = "#e4e4e4", "#ffffff", "#444444", "#999999", "#efe9e2"
OBSTACLE = "#D55E00"
ENCOUNTERS = ("cut_in", "steps_out")  # events
MARKS = {  # events that are marked in figures over time: name, marker, colour
    "cut_in": ("cut-in", "v", "#D55E00"),
    "steps_out": ("steps out", "v", "#D55E00"),
    "split": ("split off", "d", "#555555"),
    "collision": ("contact", "X", "#B00020"),
}
STATES = {  # events that begin and end them, colour and height of the bar; splits also begin and end by orders
    "split off": ("split", "rejoined", "#c9c9c9", 0.8),
    "held": ("held", "released", "#555555", 0.5),
    "broken": ("breaks_down", "repaired", "#D55E00", 0.3),
}
TOWN = 100.0  # a larger road is for cars: lines are drawn thinner on it, and vehicles enlarged [m]
BESIDE = 6.0  # greatest distance from a line at which a vehicle is on its road [m]
TTC_SHOWN = 15.0  # longer times to collision are no danger, and off the axis [s]
CUT_GAP = 8.0  # axis limit, in median gaps: the gap of a split platoon would flatten all others [1]

WORDS = {
    "gap_m": "gap to the member ahead", "gap_error_m": "spacing error", "accel_mps2": "acceleration",
    "ttc_s": "time to collision", "cross_track_m": "lateral offset from the path ahead",
}  # fmt: skip
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
    for place, vehicle, rows in lines_of_members(trajectories, platoon):
        if rows[column].notna().any():
            axes.plot(rows.time_s, rows[column], **line_style(place, rows), label=vehicle)
            drawn.append(rows)
    if not drawn:
        raise ResultsError(f"{column!r}: has no values")
    _cut(axes, column, pd.concat(drawn), trajectories)
    _mark_cut(axes, column, drawn)
    axes.set_xlabel(label(trajectories, "time_s"))
    axes.set_ylabel(label(trajectories, column))
    return plain(axes)


def _cut(axes: Axes, column: str, drawn: pd.DataFrame, trajectories: pd.DataFrame) -> None:
    """Let gaps begin at 0, and keep the gaps of a split platoon and long times to collision off the axis."""
    values, usual = drawn[column], trajectories.gap_m.median() if "gap_m" in trajectories else math.nan
    if column == "gap_m":
        # Above gaps that are all the same there would be no room.
        greatest = max(1.08 * values.max(), axes.get_ylim()[1])
        axes.set_ylim(min(0, values.min()), 4 * usual if values.max() > CUT_GAP * usual else greatest)
    elif column == "gap_error_m" and values.abs().max() > 1.5 * usual:
        axes.set_ylim(max(values.min(), -1.5 * usual), min(values.max(), 1.5 * usual))
    elif column == "ttc_s":
        axes.set_ylim(0, min(TTC_SHOWN, 1.05 * values.max()))


def _mark_cut(axes: Axes, column: str, drawn: Sequence[pd.DataFrame]) -> None:
    """An arrowhead at the edge of the axes where a line first leaves them."""
    low, high = axes.get_ylim()
    for rows in drawn if column != "ttc_s" else ():
        for beyond, edge, mark in ((rows[column] > high, 1, "^"), (rows[column] < low, 0, "v")):
            if beyond.any():
                at = rows.time_s[beyond.idxmax()]
                axes.plot(
                    at, edge, mark, color=_colour(rows.place.iloc[0]), transform=axes.get_xaxis_transform(),
                    clip_on=False, markersize=5, zorder=4,
                )  # fmt: skip


def marks(events: pd.DataFrame, axes: Axes, vehicles: Sequence[str]) -> Axes:
    """Cut-ins, contacts and splits of some vehicles, as lines at their times with a symbol at the top."""
    for kind, (name, mark, colour) in MARKS.items():
        rows = events[(events.kind == kind) & events.vehicle_id.isin(vehicles)]
        for time in rows.time_s:
            axes.axvline(time, color=colour, linewidth=0.8, linestyle=":", zorder=1)
        if len(rows):
            axes.plot(
                rows.time_s, np.ones(len(rows)), mark, color=colour, transform=axes.get_xaxis_transform(),
                clip_on=False, markersize=7, label=name, zorder=5,
            )  # fmt: skip
    return axes


def offsets(trajectories: pd.DataFrame, axes: Axes, platoon: str | None = None) -> Axes:
    """Lateral offset of each follower from the path of its predecessor, over the distance driven from the leader's
    start."""
    columns_of(trajectories, ["time_s", "x_m", "y_m", "cross_track_m"])
    members = list(lines_of_members(trajectories, platoon))
    start = members[0][2][["x_m", "y_m"]].iloc[0].to_numpy()
    if not any(rows.cross_track_m.notna().any() for *_, rows in members):
        raise ResultsError("'cross_track_m': has no values")
    for place, vehicle, rows in members[1:]:
        named = _named(vehicle, rows.cross_track_m)
        axes.plot(_driven(rows, start), rows.cross_track_m, **line_style(place, rows), **named)
    axes.axhline(0, color=WALL, linewidth=0.6)
    axes.set_xlabel("distance driven from the leader's start [m]")
    axes.set_ylabel("offset from the path of\nthe predecessor, left > 0 [m]")
    return plain(axes)


def gains(metrics: pd.DataFrame, axes: Axes, platoon: str) -> Axes:
    """String amplification of one run by place: each follower's acceleration over that of its predecessor.

    metrics: of a run
    """
    names = {"accel_gain_l2": "L2 norm", "accel_gain_linf": "maximum"}
    of_platoon = metrics[(metrics.scope == "vehicle") & (metrics.platoon_id == platoon)]
    rows = of_platoon[of_platoon.metric.isin(names)]
    if rows.value.notna().sum() == 0:
        raise ResultsError("accel_gain_l2: has no values: no predecessor disturbed a follower that was locked on")
    vehicles = rows.vehicle_id.unique().tolist()
    for (metric, name), mark, colour in zip(names.items(), "os", COLOURS[1:], strict=False):
        own = rows[rows.metric == metric].set_index("vehicle_id").value.reindex(vehicles)
        axes.plot(range(len(vehicles)), own, mark, linestyle="-", linewidth=1, color=colour, label=name)
    axes.axhline(1, color=WALL, linewidth=0.8, dashes=(4, 3), zorder=1)
    axes.set_xticks(range(len(vehicles)), vehicles, rotation=20 if len(vehicles) > 6 else 0)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("gain behind the predecessor;\nabove 1: amplified")
    return plain(axes)


def gap_distribution(
    trajectories: pd.DataFrame, axes: Axes, events: pd.DataFrame | None = None, platoon: str | None = None
) -> Axes:
    """Gaps of each follower: median, quartiles, and 5 to 95 % of the recorded instants.

    events: of the run, to leave out the time in which a follower was split off
    """
    names, values, split = [], [], splits(events, trajectories) if events is not None else {}
    for _, vehicle, rows in rows_of_members(trajectories, platoon):
        out = np.zeros(len(rows), bool)
        for begin, end in split.get(vehicle, []):
            out |= ((rows.time_s >= begin) & (rows.time_s <= end)).to_numpy()
        if len(there := rows.gap_m[~out].dropna()):
            names, values = [*names, vehicle], [*values, there]
    if not names:
        raise ResultsError("'gap_m': has no values")
    axes.boxplot(
        values, orientation="horizontal", whis=(5, 95), showfliers=False, widths=0.55,
        medianprops={"color": COLOURS[1], "linewidth": 2},
    )  # fmt: skip
    axes.set_yticks(range(1, len(names) + 1), names)
    axes.invert_yaxis()
    axes.set_xlim(left=min(0, axes.get_xlim()[0]))
    axes.set_xlabel(label(trajectories, "gap_m"))
    return plain(axes)


def lanes(trajectories: pd.DataFrame, axes: Axes, platoon: str | None = None) -> Axes:
    """Index of each member's lane over time, 0 the outermost: the rightmost, on left-hand roads the leftmost; nothing
    inside junctions."""
    columns_of(trajectories, ["time_s", "lane_id"])
    members = list(lines_of_members(trajectories, platoon))
    most = 0
    for place, vehicle, rows in members:
        lane = rows.lane_id.astype("str")
        index = pd.to_numeric(lane.str.rpartition("_")[2], errors="coerce").where(~lane.str.startswith(":"))
        most = max(most, 0 if index.isna().all() else index.max())
        beside = 0.5 * (place / max(len(members) - 1, 1) - 0.5)  # members on one lane lie beside each other
        style = line_style(place, rows) | {"linewidth": 1.6}
        axes.plot(rows.time_s, index - beside, **style, **_named(vehicle, index))
    axes.set_yticks(range(int(most) + 1))
    axes.set_ylim(-0.6, most + 0.6)
    axes.set_xlabel(label(trajectories, "time_s"))
    axes.set_ylabel("lane, 0 the outermost")
    return plain(axes)


def losses(events: pd.DataFrame, axes: Axes, trajectories: pd.DataFrame, platoon: str | None = None) -> Axes:
    """Lock losses of each follower over time: a row each, the first follower on top."""
    columns_of(events, ["time_s", "kind", "vehicle_id"])
    followers = [
        (place, vehicle, rows.time_s) for place, vehicle, rows in rows_of_members(trajectories, platoon) if place > 0
    ]
    if not followers:
        raise ResultsError("losses: the platoon has no followers")
    never = True
    for place, vehicle, times in followers:
        spans = _spans(events, vehicle, "lock_lost", "lock_regained", times.max())
        axes.broken_barh(spans, (-place - 0.4, 0.8), facecolor=_colour(place))
        never = never and not spans
    if never:
        axes.text(0.5, 0.5, "never", transform=axes.transAxes, ha="center", va="center", color=WALL)
    from_to(axes, min(times.min() for *_, times in followers), max(times.max() for *_, times in followers))
    axes.set_ylim(-followers[-1][0] - 0.6, -0.4)
    axes.set_yticks([])
    axes.set_ylabel("lock lost", rotation=0, ha="right", va="center")
    axes.set_xlabel(label(events, "time_s"))
    axes.spines[["top", "right", "left"]].set_visible(False)
    return axes


def states(events: pd.DataFrame, axes: Axes, trajectories: pd.DataFrame, platoon: str | None = None) -> Axes:
    """Periods in which members were held at a stop line, split off or broken down: a row each, the leader on top."""
    columns_of(events, ["time_s", "kind", "vehicle_id"])
    members = [(vehicle, rows.time_s) for _, vehicle, rows in rows_of_members(trajectories, platoon)]
    split = splits(events, trajectories)
    for name, (begin, end, colour, height) in STATES.items():
        for row, (vehicle, times) in enumerate(members):
            spans = _spans(events, vehicle, begin, end, times.max())
            if begin == "split":
                spans = [(since, until - since) for since, until in split[vehicle]]
            axes.broken_barh(spans, (-row - height / 2, height), facecolor=colour, label=name if row == 0 else None)
    from_to(axes, min(times.min() for _, times in members), max(times.max() for _, times in members))
    axes.set_ylim(0.4 - len(members), 0.6)
    axes.set_yticks([])
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False, fontsize=8)
    axes.set_xlabel(label(events, "time_s"))
    axes.spines[["top", "right", "left"]].set_visible(False)
    return axes


def splits(events: pd.DataFrame, trajectories: pd.DataFrame) -> dict[str, list[tuple[float, float]]]:
    """Periods in which each member was split off, by an event or an order, within those of its rows [s]."""
    rows = trajectories.groupby("vehicle_id", sort=False)
    places = {m.vehicle_id: (m.platoon_id, m.place) for m in rows.head(1).itertuples()}
    first, last = rows.time_s.min(), rows.time_s.max()
    follows, own = stretches(places, events, last.max()), dict(tuple(events.groupby("vehicle_id")))
    found = {}
    for vehicle in places:
        periods = split_off(own.get(vehicle, events[:0]), follows[vehicle])
        within = [(max(begin, first[vehicle]), min(end, last[vehicle])) for begin, end in periods]
        found[vehicle] = [(begin, end) for begin, end in within if end > begin]
    return found


def _spans(events: pd.DataFrame, vehicle: str, begin: str, end: str, last: float) -> list[tuple[float, float]]:
    """Begin and length of the periods between events of two kinds, the last one up to `last` [s]."""
    own = events[(events.vehicle_id == vehicle) & (events.time_s <= last)]
    ends = [*own.loc[own.kind == end, "time_s"], last]
    return [(a, min(b for b in ends if b >= a) - a) for a in own.loc[own.kind == begin, "time_s"]]


def time_space(
    table: pd.DataFrame,
    axes: Axes,
    line: Sequence[Sequence[float]] | None = None,
    platoon: str | None = None,
    events: pd.DataFrame | None = None,
) -> Axes:
    """Position of each vehicle along the road over time.

    table : trajectories; or, with a line, traffic, in grey
    line  : of the road, (k, 2) [m]; the position is the station along it, for vehicles within BESIDE of it. Without a
            line it is the distance that a member has driven, measured from the leader's start
    events: of the run, to mark the members' cut-ins, contacts and splits
    """
    columns_of(table, ["time_s", "vehicle_id", "x_m", "y_m"])
    members = "place" in table.columns
    if not members and line is None:
        raise ResultsError("time_space: traffic needs a line of the road to be placed along")
    if members and line is None:
        of_platoon = list(lines_of_members(table, platoon))
        start = of_platoon[0][2][["x_m", "y_m"]].iloc[0].to_numpy()
        drawn = [(place, vehicle, rows, _driven(rows, start)) for place, vehicle, rows in of_platoon]
    else:
        own = lines_of_members(table, platoon) if members else ((None, *one) for one in table.groupby("vehicle_id"))
        road = shapely.LineString(np.asarray(line, dtype=float))
        drawn = [(place, vehicle, rows, along(rows, road)) for place, vehicle, rows in own]
    for place, vehicle, rows, station in drawn:
        if place is None:
            axes.plot(rows.time_s, station, color=OTHERS, linewidth=0.5, alpha=0.7, zorder=1)
        else:
            style = line_style(place, rows) | {"linewidth": 1.2, "zorder": 2}
            axes.plot(rows.time_s, station, **style, **_named(vehicle, station))
    if events is not None:
        _mark_stations(events, axes, drawn)
    axes.set_xlabel(label(table, "time_s"))
    axes.set_ylabel("distance along the road [m]")
    return plain(axes)


def _mark_stations(events: pd.DataFrame, axes: Axes, drawn: Sequence[tuple]) -> None:
    """Marks at the position of the member that an event happens to."""
    at = {vehicle: (rows.time_s.to_numpy(), station) for _, vehicle, rows, station in drawn}
    for kind, (name, mark, colour) in MARKS.items():
        rows = events[(events.kind == kind) & events.vehicle_id.isin(list(at))]
        if len(rows):
            where = [np.interp(time, *at[vehicle]) for time, vehicle in zip(rows.time_s, rows.vehicle_id, strict=True)]
            axes.plot(
                rows.time_s, where, mark, color=colour, markersize=8, markeredgecolor="white", label=name, zorder=5
            )


def _driven(rows: pd.DataFrame, start: np.ndarray) -> np.ndarray:
    """Distance driven, counted from `start` [m]: a member begins at minus its straight distance to it."""
    steps = np.hypot(rows.x_m.diff(), rows.y_m.diff()).fillna(0.0)
    return steps.cumsum().to_numpy() - np.hypot(*(rows[["x_m", "y_m"]].iloc[0].to_numpy() - start))


def along(rows: pd.DataFrame, road: shapely.LineString) -> np.ndarray:
    """Station along the road [m]; NaN beside it, against its direction, and where it starts again, as on a ring."""
    points = shapely.points(rows.x_m, rows.y_m)
    station = shapely.line_locate_point(road, points)
    off = (shapely.distance(road, points) > BESIDE) | (station <= 0) | (station >= road.length)
    if "heading_rad" in rows:
        a, b = (shapely.get_coordinates(shapely.line_interpolate_point(road, station + d)) for d in (-1.0, 1.0))
        along = np.column_stack([np.cos(rows.heading_rad), np.sin(rows.heading_rad)])
        off |= ((b - a) * along).sum(axis=1) <= 0
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


def estimates(table: pd.DataFrame, x: str, axes: Axes, by: str | None = None, joined: bool = True) -> Axes:
    """Means with their intervals over a column, from a table of `tables.summarise` or `tables.paired`.

    A curve with two points or more in common with curves above it is thicker than these, so that equal ones can all be
    seen.

    x      : a column of numbers, or of texts, which stand side by side in the order of the table
    by     : another column; a line, or for texts a row of points, for each of its values
    joined : whether a line joins the points of numbers
    """
    columns_of(table, [x, *([by] if by else []), "metric", "mean", "low", "high"])
    metrics = table.metric.unique()
    if len(metrics) != 1:
        raise ResultsError(f"estimates: must be of one metric; there are {', '.join(metrics)}")
    groups = list(table.groupby(by, sort=False)) if by else [(None, table)]
    texts = None if is_numeric_dtype(table[x]) else list(table[x].unique())
    span = np.ptp(table["mean"].dropna()) or 1.0
    points = [{*zip(rows[x], (rows["mean"] / span).round(2), strict=True)} for _, rows in groups]
    for i, (value, rows) in enumerate(groups):
        above = sum(len(points[i] & others) >= min(2, len(points[i])) for others in points[i + 1 :])
        places = rows[x] if texts is None else rows[x].map(texts.index)
        values = rows.assign(**{x: places}).sort_values(x)[[x, "mean", "low", "high"]]
        at, mean, low, high = values.to_numpy(dtype=float).T
        colour, marker = COLOURS[1:][i % 7] if by else COLOURS[1], MARKERS[i % len(MARKERS)]
        axes.errorbar(
            at, mean, np.nan_to_num([mean - low, high - mean]), color=colour, marker=marker,
            markersize=5 + 3 * above, linewidth=1.2 + 2 * above, capsize=3 + 2 * above,
            linestyle="-" if texts is None and joined else "",
            label=None if value is None else str(value),
        )  # fmt: skip
    if texts is not None:
        axes.set_xticks(range(len(texts)), texts)
    if by:
        axes.legend(title=label(table, by), frameon=False)
    axes.set_xlabel(label(table, x))
    axes.set_ylabel(label(table, metrics[0]))
    return plain(axes)


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


def show_part(axes: Axes, trajectories: pd.DataFrame, margin: float = 0.06) -> Axes:
    """Cut a map to where the members were, and give it a scale and an arrow to the north.

    margin: share of the larger side that is shown around it
    """
    (left, low), (right, high) = (getattr(trajectories[["x_m", "y_m"]], end)() for end in ("min", "max"))
    around = max(margin * max(right - left, high - low), 1.0)
    across, up = right - left + 2 * around, high - low + 2 * around
    up = max(up, 0.22 * across)  # of a straight road something beside it is shown, too
    middle = (low + high) / 2
    axes.set_xlim(left - around, left - around + across)
    axes.set_ylim(middle - up / 2, middle + up / 2)
    bar = max(one for p in range(-2, 5) for one in (10.0**p, 2 * 10.0**p, 5 * 10.0**p) if one <= 0.3 * across)
    share = bar / across
    over_road = {"path_effects": [withStroke(linewidth=2.5, foreground="white")], "zorder": 6}
    axes.plot([0.02, 0.02 + share], [0.03, 0.03], color="black", linewidth=2.5, transform=axes.transAxes, **over_road)
    axes.text(
        0.02 + share / 2, 0.045, f"{bar:g} m", transform=axes.transAxes, ha="center", va="bottom", fontsize=8,
        **over_road,
    )  # fmt: skip
    axes.annotate(
        "N", xy=(0.985, 0.97), xytext=(0.985, 0.82), xycoords="axes fraction", ha="center", va="top", fontsize=8,
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1},
    )  # fmt: skip
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
    main, length = main_platoon(trajectories), length or 0.28 * max(1.0, _reach(trajectories) / TOWN * 6)
    members = list(lines_of_members(trajectories, main))
    leads = any(place for place, *_ in rows_of_members(trajectories, main))
    others = trajectories[trajectories.platoon_id != main].groupby(["platoon_id", "place", "vehicle_id"])
    drawn = [(OTHERS, {"color": OTHERS, "linewidth": 0.9}, rows) for _, rows in others]
    drawn += [(_colour(number), line_style(number, rows), rows) for number, _, rows in members]
    for colour, style, rows in drawn:
        axes.plot(rows.x_m, rows.y_m, **style, alpha=0.75)
        arrow = _arrowhead(rows.iloc[-1], length)
        axes.add_patch(Polygon(arrow, facecolor=colour, edgecolor="white", linewidth=0.5, zorder=3))
    for number, vehicle, rows in members:
        axes.plot([], [], **line_style(number, rows), label=f"{vehicle}{' (leader)' if leads and number == 0 else ''}")
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


def _reach(trajectories: pd.DataFrame) -> float:
    """Larger side of the area in which the members were [m]."""
    return float((trajectories[["x_m", "y_m"]].max() - trajectories[["x_m", "y_m"]].min()).max())


def unrolled(trajectories: pd.DataFrame, axes: Axes, scene: Scene, platoon: str | None = None) -> Axes:
    """The road straightened along the leader's path: lateral position of each member over the distance along it.

    raises: ResultsError if that path is shorter than TOWN, or meets itself
    """
    members = list(lines_of_members(trajectories, platoon))
    line = driven_line(trajectories, platoon)
    if line is None:
        raise ResultsError(f"unrolled: the path of the platoon is shorter than {TOWN:g} m, or meets itself")
    outline = [ring for kind in ("road", "walls", "lanes", "middle") for ring in scene.get(kind, [])]
    styles = [
        {"color": WALL, "linewidth": 0.8} if kind in ("road", "walls") else {"color": OTHERS, "linewidth": 0.6}
        for kind in ("road", "walls", "lanes", "middle") for _ in scene.get(kind, [])
    ]  # fmt: skip
    road = shapely.LineString(line)
    for ring, style in zip(outline, styles, strict=True):
        dense = shapely.get_coordinates(shapely.segmentize(shapely.LineString(ring), 2.0))
        station, left = _beside(dense, road)
        station[np.abs(np.diff(station, prepend=station[:1])) > 20.0] = np.nan
        axes.plot(station, np.where(np.abs(left) < 2 * BESIDE, left, np.nan), **style, zorder=1)
    for place, vehicle, rows in members:
        station, left = _beside(rows[["x_m", "y_m"]].to_numpy(), road)
        seen = np.where(np.abs(left) <= 2 * BESIDE, left, np.nan)
        axes.plot(station, left, **line_style(place, rows), **_named(vehicle, seen), zorder=2)
    axes.set_ylim(-2 * BESIDE, 2 * BESIDE)
    axes.set_xlabel("distance along the path of the leader [m]")
    axes.set_ylabel("to the left of that path [m]")
    return plain(axes)


def driven_line(trajectories: pd.DataFrame, platoon: str | None = None) -> np.ndarray | None:
    """Path of a platoon's leader along a street, from the start of its last member on, (k, 2) [m].

    None if it is shorter than TOWN, or meets itself
    """
    members = [rows[["x_m", "y_m"]].to_numpy() for *_, rows in rows_of_members(trajectories, platoon)]
    line, tail = members[0], members[-1]
    distance = np.hypot(*(tail - line[0]).T)
    if distance.min() < BESIDE / 2:
        line = np.concatenate([tail[: distance.argmin()], line])
    path = shapely.LineString(line).simplify(0.05) if len(line) > 1 else shapely.LineString()
    if path.length < TOWN:  # a street is longer
        return None
    return shapely.get_coordinates(path) if path.is_simple and not path.is_ring else None


def _beside(points: np.ndarray, road: shapely.LineString) -> tuple[np.ndarray, np.ndarray]:
    """Station along a line, and distance to the left of it, of points (k, 2) [m]; NaN before its begin and after its
    end."""
    station = shapely.line_locate_point(road, shapely.points(points))
    a, b = (shapely.get_coordinates(shapely.line_interpolate_point(road, station + d)) for d in (-0.5, 0.5))
    along = (b - a) / np.hypot(*(b - a).T)[:, None]
    foot = shapely.get_coordinates(shapely.line_interpolate_point(road, station))
    x, y = (points - foot).T
    left = along[:, 0] * y - along[:, 1] * x
    outside = (station <= 0) | (station >= road.length)
    return np.where(outside, np.nan, station), np.where(outside, np.nan, left)


def with_followers(trajectories: pd.DataFrame) -> list[str]:
    """The platoons that have followers; [] if none has. Members in no platoon all have place 0."""
    return list(trajectories.platoon_id[trajectories.place > 0].unique())


def main_platoon(trajectories: pd.DataFrame) -> str:
    """The platoon with the most members, the first of them in the table; one without followers only if none has."""
    if trajectories.empty:
        raise ResultsError("the trajectories have no rows: no member was ever on the road")
    if platoons := with_followers(trajectories):
        trajectories = trajectories[trajectories.platoon_id.isin(platoons)]
    return trajectories.groupby("platoon_id", sort=False).vehicle_id.nunique().idxmax()


def extent(scene: Scene) -> tuple[float, float]:
    """Width and height of the road [m]."""
    points = [point for ring in scene["road"] for point in ring]
    (left, right), (low, high) = ((min(values), max(values)) for values in zip(*points, strict=True))
    return right - left, high - low


def rows_of_members(trajectories: pd.DataFrame, platoon: str | None = None) -> Iterator[tuple[int, str, pd.DataFrame]]:
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


def lines_of_members(trajectories: pd.DataFrame, platoon: str | None = None) -> Iterator[tuple[int, str, pd.DataFrame]]:
    """As `rows_of_members`, with a number for `line_style`: the place, or of vehicles in no platoon, which all have
    place 0, a number of each."""
    members = list(rows_of_members(trajectories, platoon))
    single = len({vehicle for _, vehicle, _ in members}) > 1 and not any(place for place, *_ in members)
    for i, (place, vehicle, rows) in enumerate(members):
        yield i if single else place, vehicle, rows


def _arrowhead(row: pd.Series, length: float) -> list[tuple[float, float]]:
    """Triangle at a vehicle's pose, pointing along its heading."""
    shape = [(0.57 * length, 0), (-0.43 * length, 0.36 * length), (-0.43 * length, -0.36 * length)]
    c, s = math.cos(row.heading_rad), math.sin(row.heading_rad)
    return [(row.x_m + c * x - s * y, row.y_m + s * x + c * y) for x, y in shape]


def _colour(place: int) -> str:
    return COLOURS[place % len(COLOURS)]


def line_style(place: int, rows: pd.DataFrame) -> dict[str, object]:
    """Style of a member's line: colour, and a marker that shows without it, at other instants than its neighbours'.

    Where the colours begin anew, each comes with the next marker: 64 members differ.
    """
    every, marker = max(1, len(rows) // MARKED), (place + place // len(COLOURS)) % len(MARKERS)
    return {
        "color": _colour(place), "linewidth": 1, "marker": MARKERS[marker], "markersize": 4.5,
        "markerfacecolor": "white", "markeredgewidth": 0.9, "markevery": (place * every // 5 % every, every),
    }  # fmt: skip


def _named(vehicle: str, values: Sequence[float]) -> dict[str, str]:
    """The label of a member's line; none for a line without a value, which a legend does not list."""
    return {"label": vehicle} if np.isfinite(values).any() else {}


def _short(value: object) -> str:
    return number(value) if isinstance(value, float) else str(value)


def number(value: float) -> str:
    """Three digits, and of large numbers all before the point."""
    return f"{value:.0f}" if 1000 <= abs(value) < 1e7 else f"{value:.3g}"


def from_to(axes: Axes, first: float, last: float) -> None:
    """Limit the horizontal axis to a period; of one instant, to half a second around it [s]."""
    around = 0.0 if last > first else 0.5
    axes.set_xlim(first - around, last + around)


def plain(axes: Axes) -> Axes:
    """With a light grid, and no frame above and to the right."""
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return axes
