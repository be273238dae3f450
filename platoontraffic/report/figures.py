"""Pictures of the metrics of a study over its varied keys."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from platoontraffic.analysis.results import Batch

LONGEST = 28  # longest label of a value at an axis [characters]
POINTS, MEAN = "#56B4E9", "#0072B2"


def over_values(summary: pd.DataFrame, key: str, metric: str, unit: str) -> Figure:
    """Every run as a dot; mean and standard deviation at every value of the key."""
    rows = summary.dropna(subset=[metric])
    figure = _figure(7.5, 4)
    axes = figure.subplots()
    places, labels = _places(rows[key])
    axes.plot(places, rows[metric], "o", color=POINTS, markersize=4, alpha=0.7)
    groups = rows[metric].groupby(places)
    line = "-" if labels is None else ""
    spread = groups.std().fillna(0.0)
    axes.errorbar(groups.mean().index, groups.mean(), spread, fmt=f"o{line}", color=MEAN, capsize=4, markersize=6)
    if labels is not None:
        axes.set_xticks(range(len(labels)), labels, rotation=20, ha="right")
    axes.set_xlabel(key)
    axes.set_ylabel(_named(metric, unit))
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def heat_map(batch: Batch, key: str, other: str, metric: str, unit: str) -> Figure:
    """Mean at every pair of values in the study; the first key is on the horizontal axis."""
    summary = batch.summary
    (x, across), (y, up) = (_order(summary[name], batch.runs[name]) for name in (key, other))
    means = summary[metric].groupby([y, x]).mean().unstack().reindex(index=range(len(up)), columns=range(len(across)))
    figure = _figure(max(5.0, min(2.5 + 0.8 * len(across), 14)), max(3.0, min(1.8 + 0.5 * len(up), 12)))
    axes = figure.subplots()
    drawn = axes.imshow(
        np.ma.masked_invalid(means.to_numpy(dtype=float)), origin="lower", aspect="auto", cmap="cividis"
    )
    if means.size <= 200:
        middle = np.nanmean([means.min().min(), means.max().max()])
        for (row, column), value in np.ndenumerate(means.to_numpy(dtype=float)):
            if not np.isnan(value):
                colour = "black" if value > middle else "white"
                axes.text(column, row, f"{value:.3g}", ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(across)), across, rotation=30, ha="right")
    axes.set_yticks(range(len(up)), up)
    axes.set_xlabel(key)
    axes.set_ylabel(other)
    figure.colorbar(drawn, ax=axes, label=_named(metric, unit))
    return figure


def _places(values: pd.Series) -> tuple[np.ndarray, list[str] | None]:
    """Positions of values on an axis, and their labels; None for numbers."""
    if pd.api.types.is_numeric_dtype(values) and not pd.api.types.is_bool_dtype(values):
        return values.to_numpy(dtype=float), None
    return _order(values, values)


def _order(values: pd.Series, there: pd.Series) -> tuple[np.ndarray, list[str]]:
    """Index of each value among the known ones, numbers in ascending order; and the labels of the latter."""
    numeric = pd.api.types.is_numeric_dtype(there)
    known = sorted(there.unique()) if numeric else there.unique().tolist()
    labels = [f"{value:g}" if numeric else str(value) for value in known]
    short = [label if len(label) <= LONGEST else f"{label[: LONGEST - 1]}…" for label in labels]
    return pd.Index(known).get_indexer(values), [label.replace("$", r"\$") for label in short]


def _named(metric: str, unit: str) -> str:
    return f"{metric} [{unit}]" if unit else metric


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
