"""Pictures of the metrics of a study over its varied keys."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from platoontraffic.analysis import figures
from platoontraffic.analysis.results import Batch
from platoontraffic.analysis.tables import summarise

LONGEST = 28  # longest label of a value at an axis [characters]
POINTS = "#56B4E9"
AT = "place on the axis"  # column


def lines(batch: Batch, keys: Sequence[str], metric: str, unit: str) -> Figure:
    """Mean with its interval over the first key, a line for each value of the second; each run as a dot if there is
    none. Over the values of further keys each seed has its mean."""
    summary = batch.summary[[*keys, "seed", metric]].dropna(subset=[metric])
    if len(keys) > 2:
        summary = summary.groupby([*keys[:2], "seed"], sort=False)[metric].mean().reset_index()
    x, labels = _places(summary[keys[0]], batch.runs[keys[0]])
    summary = summary.assign(**{AT: x})
    made = _figure(7.5, 4)
    axes = made.subplots()
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # of points with too few runs
        points = summarise(summary, metric, [*keys[1:2], AT])
    if len(keys) > 1:
        figures.estimates(points, AT, axes, keys[1])
        axes.get_legend().remove()
        made.legend(title=_plain(keys[1]), loc="outside right upper", frameon=False, fontsize=8)
    else:
        axes.plot(x, summary[metric], "o", color=POINTS, markersize=4, alpha=0.7)
        figures.estimates(points, AT, axes)
    if labels is not None:
        axes.set_xticks(range(len(labels)), labels, rotation=20, ha="right")
    axes.set_xlabel(_plain(keys[0]))
    axes.set_ylabel(_named(metric, unit))
    return made


def heat_map(batch: Batch, key: str, other: str, metric: str, unit: str) -> Figure:
    """Mean at every pair of values in the study; the first key is on the horizontal axis."""
    summary = batch.summary
    (x, across), (y, up) = (_order(summary[name], batch.runs[name]) for name in (key, other))
    means = summary[metric].groupby([y, x]).mean().unstack().reindex(index=range(len(up)), columns=range(len(across)))
    made = _figure(max(5.0, min(2.5 + 0.8 * len(across), 14)), max(3.0, min(1.8 + 0.5 * len(up), 12)))
    axes = made.subplots()
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
    made.colorbar(drawn, ax=axes, label=_named(metric, unit))
    return made


def _places(values: pd.Series, there: pd.Series) -> tuple[np.ndarray, list[str] | None]:
    """Positions of values on an axis, and their labels; None for numbers."""
    if pd.api.types.is_numeric_dtype(values) and not pd.api.types.is_bool_dtype(values):
        return values.to_numpy(dtype=float), None
    return _order(values, there)


def _order(values: pd.Series, there: pd.Series) -> tuple[np.ndarray, list[str]]:
    """Index of each value among the known ones, numbers in ascending order; and the labels of the latter."""
    numeric = pd.api.types.is_numeric_dtype(there)
    known = sorted(there.unique()) if numeric else there.unique().tolist()
    labels = [f"{value:g}" if numeric else str(value) for value in known]
    short = [label if len(label) <= LONGEST else f"{label[: LONGEST - 1]}…" for label in labels]
    return pd.Index(known).get_indexer(values), [_plain(label) for label in short]


def _plain(text: str) -> str:
    """Text in which matplotlib finds no formula."""
    return text.replace("$", r"\$")


def _named(metric: str, unit: str) -> str:
    return f"{metric} [{unit}]" if unit else metric


def _figure(width: float, height: float) -> Figure:
    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made
