"""Figures of hundreds of members, such as a share of a city's traffic: shares of them and places, in place of lines
with names."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import shapely
from matplotlib.axes import Axes

from platoontraffic.analysis import figures
from platoontraffic.analysis.results import ResultsError
from platoontraffic.analysis.tables import columns_of

MOST = 20  # members of a platoon that are told apart
CELLS = 90  # across a map
FULL_COLOUR = 97.0  # share of the cells of a map up to which their colours differ [%]
STANDS = 0.1  # a vehicle that is slower stands, as in SUMO's trips [m/s]
COLOUR = figures.COLOURS[1]


def is_crowd(trajectories: pd.DataFrame) -> bool:
    """Whether the largest platoon, or what is in none, has more members than can be told apart."""
    if trajectories.empty:
        raise ResultsError("the trajectories have no rows: no member was ever on the road")
    return trajectories.groupby("platoon_id").vehicle_id.nunique().max() > MOST


def over_time(trajectories: pd.DataFrame, column: str, axes: Axes) -> Axes:
    """Median of a column over the members, and the range of 90 % of them, over time."""
    columns_of(trajectories, ["time_s", column])
    quantiles = trajectories.groupby("time_s")[column].quantile([0.05, 0.5, 0.95]).unstack()
    if quantiles[0.5].isna().all():
        raise ResultsError(f"{column!r}: has no values")
    axes.fill_between(quantiles.index, quantiles[0.05], quantiles[0.95], color=COLOUR, alpha=0.25, label="90 %")
    axes.plot(quantiles.index, quantiles[0.5], color=COLOUR, linewidth=1.2, label="median of the members")
    axes.set_xlabel(figures.label(trajectories, "time_s"))
    axes.set_ylabel(figures.label(trajectories, column))
    return figures.plain(axes)


def number(trajectories: pd.DataFrame, axes: Axes) -> Axes:
    """Members on the road over time, and those of them that stand."""
    rows = trajectories.groupby("time_s").speed_mps
    on_road, standing = rows.size(), rows.apply(lambda speed: (speed.abs() < STANDS).sum())
    axes.plot(on_road.index, on_road, color=COLOUR, linewidth=1.2, label="members on the road")
    axes.fill_between(standing.index, standing, color=figures.OBSTACLE, alpha=0.5, label="of these stand")
    axes.set_ylim(bottom=0)
    axes.set_xlabel(figures.label(trajectories, "time_s"))
    axes.set_ylabel("members")
    return figures.plain(axes)


def density(trajectories: pd.DataFrame, axes: Axes, scene: figures.Scene) -> Axes:
    """Mean number of members in each cell of a grid over the road."""
    columns_of(trajectories, ["time_s", "x_m", "y_m"])
    share = np.full(len(trajectories), 1 / trajectories.time_s.nunique())
    return _cells(trajectories, axes, scene, "mean number of members", share, np.sum, "viridis_r", FULL_COLOUR)


def speeds(trajectories: pd.DataFrame, axes: Axes, scene: figures.Scene) -> Axes:
    """Mean speed of the members in each cell of a grid over the road."""
    columns_of(trajectories, ["x_m", "y_m", "speed_mps"])
    return _cells(trajectories, axes, scene, "mean speed [m/s]", trajectories.speed_mps.abs(), np.mean, "viridis")


def _cells(
    trajectories: pd.DataFrame,
    axes: Axes,
    scene: figures.Scene,
    name: str,
    values,
    reduce: Callable,
    colours: str,
    most: float = 100.0,
) -> Axes:
    """Fill each cell with what `reduce` makes of the values of the rows in it.

    most: share of the cells up to which their colours differ [%]: one in which members stood would leave the others a
          single colour
    """
    figures.road(scene, axes)
    x, y = trajectories.x_m, trajectories.y_m
    size = max(np.ptp(x), np.ptp(y)) / CELLS or 1.0
    drawn = axes.hexbin(
        x, y, C=values, reduce_C_function=reduce, cmap=colours, mincnt=1,
        gridsize=[max(2, round(np.ptp(one) / size)) for one in (x, y)], linewidths=0.2, zorder=2,
    )  # fmt: skip
    filled = np.ma.compressed(drawn.get_array())
    top = float(np.percentile(filled, most))
    clipped = filled.min() < top < filled.max()
    if clipped:
        drawn.set_clim(vmax=top)
    axes.figure.colorbar(
        drawn, ax=axes, location="bottom", shrink=0.5, aspect=40, label=f"{name}; cells of {size:.0f} m",
        extend="max" if clipped else "neither",
    )  # fmt: skip
    return axes


def time_space(trajectories: pd.DataFrame, axes: Axes, traffic: pd.DataFrame | None = None) -> Axes:
    """Positions over time along the path of the member that drove farthest, for all that drive along it.

    traffic: in grey, if it was recorded
    """
    line = farthest(trajectories)
    for rows, style in ((traffic, {"color": figures.OTHERS, "alpha": 0.6}), (trajectories, {"color": COLOUR})):
        if rows is not None:
            for _, own in rows.groupby("vehicle_id"):
                axes.plot(own.time_s, figures.along(own, line), linewidth=0.6, **style)
    axes.set_xlabel(figures.label(trajectories, "time_s"))
    axes.set_ylabel("distance along the path of the\nmember that drove farthest [m]")
    return figures.plain(axes)


def farthest(trajectories: pd.DataFrame) -> shapely.LineString:
    """The longest path of a member that does not meet itself. raises: ResultsError if there is none"""
    paths = [shapely.LineString(own) for _, own in trajectories.groupby("vehicle_id")[["x_m", "y_m"]] if len(own) > 1]
    for path in sorted(paths, key=lambda path: -path.length):
        if path.is_simple:
            return path
    raise ResultsError("no member has a path that does not meet itself")
