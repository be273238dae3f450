"""Pictures of the metrics of a study over its varied keys."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from platoontraffic.analysis import figures
from platoontraffic.analysis.results import Batch
from platoontraffic.analysis.tables import summarise

LONGEST = 28  # longest label of a value at an axis [characters]
SHORT = 4  # longest label that stands upright below an axis [characters]
POINTS = "#56B4E9"
AT = "place on the axis"  # column


class Values(NamedTuple):
    """The values of a varied key, and their labels in pictures."""

    known: list  # in the order of the axis
    labels: list[str]
    meaning: str  # of labels that are only numbers; "" if all say what they are of
    numeric: bool

    def places(self, values: pd.Series) -> np.ndarray:
        """Index of each value."""
        return pd.Index(self.known).get_indexer(values)


def values_of(batch: Batch, key: str) -> Values:
    """Numbers in ascending order; others in that of the study.

    Tables are called by the keys in which they differ. If labels are too long or equal, the values are numbered.
    """
    column = batch.runs[key]
    if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
        known = sorted(column.unique())
        labels = [f"{value:g}" for value in known]
        return Values(known, labels if len(set(labels)) == len(known) else list(map(str, known)), "", True)
    known = column.unique().tolist()
    texts = _differences([str(value).lower() if isinstance(value, bool) else str(value) for value in known])
    if max(map(len, texts)) <= LONGEST and len(set(texts)) == len(texts):
        return Values(known, [_plain(text) for text in texts], "", False)
    numbers = [str(number) for number in range(1, len(known) + 1)]
    listed = "; ".join(f"{number}: {text}" for number, text in zip(numbers, texts, strict=True))
    return Values(known, numbers, f"{key}: {listed}", False)


def _differences(texts: list[str]) -> list[str]:
    """Texts that are tables as JSON, by the keys whose values differ; others as they are."""
    try:
        tables = [dict(leaves(json.loads(text))) for text in texts]
    except ValueError:
        return texts
    keys = dict.fromkeys(key for table in tables for key in table)
    differ = [key for key in keys if len({repr(table.get(key)) for table in tables}) > 1]
    if not all(differ and key for key in keys):  # plain values
        return texts
    return [", ".join(f"{key} = {table[key]}" for key in differ if key in table) or "none of these" for table in tables]


def leaves(value: Any, path: str = "") -> list[tuple[str, Any]]:
    """The values in a table with their dotted keys; in a list, keys are numbers."""
    if isinstance(value, list):
        value = {str(i): one for i, one in enumerate(value)}
    if not isinstance(value, dict):
        return [(path, value)]
    return [leaf for key, one in value.items() for leaf in leaves(one, f"{path}.{key}" if path else key)]


def lines(batch: Batch, keys: Sequence[str], metric: str, unit: str) -> Figure:
    """Mean with its interval over the first key, a line for each value of the second; each run as a dot if there is
    none. Over the values of further keys each seed has its mean. Values that are no numbers are not joined."""
    summary = batch.summary[[*keys, "seed", metric]].dropna(subset=[metric])
    if len(keys) > 2:
        summary = summary.groupby([*keys[:2], "seed"], sort=False)[metric].mean().reset_index()
    across = values_of(batch, keys[0])
    x = summary[keys[0]].to_numpy(dtype=float) if across.numeric else across.places(summary[keys[0]])
    summary = summary.assign(**{AT: x})
    if len(keys) > 1:
        by = values_of(batch, keys[1])
        order = pd.CategoricalDtype(by.labels, ordered=True)
        places = by.places(summary[keys[1]])
        names = pd.Series(np.array(by.labels, dtype=object)[places], index=summary.index)
        beside = 0.0 if across.numeric else 0.5 * ((places + 0.5) / len(by.known) - 0.5)  # equal ones would hide others
        summary = summary.assign(**{keys[1]: names.astype(order), AT: x + beside})
    made = _figure(7.5, 4)
    axes = made.subplots()
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # of points with too few runs
        points = summarise(summary, metric, [*keys[1:2], AT])
    if len(keys) > 1:
        figures.estimates(points, AT, axes, keys[1], joined=across.numeric)
        axes.get_legend().remove()
        made.legend(title=_plain(keys[1]), loc="outside right upper", frameon=False, fontsize=8)
    else:
        axes.plot(x, summary[metric], "o", color=POINTS, markersize=4, alpha=0.7)
        figures.estimates(points, AT, axes, joined=across.numeric)
    if not across.numeric:
        axes.set_xticks(range(len(across.labels)), across.labels, **_turned(across.labels, 20))
        axes.set_xlim(-0.5, len(across.labels) - 0.5)
    elif all(float(value).is_integer() for value in across.known):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(_plain(keys[0]))
    axes.set_ylabel(_named(metric, unit))
    return made


def heat_map(batch: Batch, key: str, other: str, metric: str, unit: str) -> Figure:
    """Mean at every pair of values in the study; the first key is on the horizontal axis."""
    summary = batch.summary
    across, up = (values_of(batch, name) for name in (key, other))
    x, y = across.places(summary[key]), up.places(summary[other])
    means = summary[metric].groupby([y, x]).mean().unstack()
    means = means.reindex(index=range(len(up.known)), columns=range(len(across.known)))
    made = _figure(max(7.5, min(2.5 + 0.8 * len(across.known), 14)), max(3.0, min(1.8 + 0.5 * len(up.known), 12)))
    axes = made.subplots()
    drawn = axes.imshow(
        np.ma.masked_invalid(means.to_numpy(dtype=float)), origin="lower", aspect="auto", cmap="cividis"
    )
    if means.size <= 200:
        middle = np.nanmean([means.min().min(), means.max().max()])
        for (row, column), value in np.ndenumerate(means.to_numpy(dtype=float)):
            if not np.isnan(value):
                colour = "black" if value > middle else "white"
                axes.text(column, row, figures.number(value), ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(across.labels)), across.labels, **_turned(across.labels, 30))
    axes.set_yticks(range(len(up.labels)), up.labels)
    axes.set_xlabel(_plain(key))
    axes.set_ylabel(_plain(other))
    made.colorbar(drawn, ax=axes).set_label(_named(metric, unit), fontsize="small")  # long names fit in
    return made


def _turned(labels: Sequence[str], degrees: float) -> dict[str, Any]:
    """How labels below an axis stand: turned if one of them is long."""
    return {"rotation": degrees, "ha": "right"} if max(map(len, labels)) > SHORT else {}


def _plain(text: str) -> str:
    """Text in which matplotlib finds no formula."""
    return text.replace("$", r"\$")


def _named(metric: str, unit: str) -> str:
    return f"{metric} [{unit}]" if unit else metric


def _figure(width: float, height: float) -> Figure:
    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made
