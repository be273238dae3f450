"""Runs beside each other: how the metrics and the motion of some differ from those of the first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from platoontraffic.analysis import figures
from platoontraffic.analysis.results import Results, load_run

KEYS = ["scope", "platoon_id", "vehicle_id", "metric", "unit"]
DRAWN = {"gap_m": "gap [m]", "speed_mps": "speed [m/s]"}
LEAST_AXIS = 1e-3  # half the height of an axis of differences, at least [m, m/s]


def compared(folders: Sequence[Path], scope: str | None = None) -> pd.DataFrame:
    """Metrics of runs, one a row: the columns of metrics.csv, with `value` of the first run, and `difference_1`,
    `value_1` and so on.

    A difference is the other run's value, `value_1`, minus the first one's; NaN where one of them has none. Metrics
    that are equal in all runs are left out.

    scope : of the metrics, such as "run" or "vehicle"; None: all
    raises: ResultsError
    """
    values = []
    for folder in folders:
        metrics = load_run(Path(folder)).metrics
        metrics = metrics[metrics.scope == scope] if scope else metrics
        values.append(metrics.set_index(KEYS).value)
    table = pd.concat(values, axis=1, keys=range(len(values)), sort=False)
    equal = table.eq(table[0], axis=0) | (table.isna() & table[0].isna().to_numpy()[:, None])
    table = table[~equal.all(axis=1)]
    columns = {f"difference_{i}": table[i] - table[0] for i in range(1, len(values))}
    columns |= {f"value_{i}": table[i] for i in range(1, len(values))}
    return table[[0]].rename(columns={0: "value"}).assign(**columns).reset_index()


def cells(row: Any) -> list[str]:
    """The cells of a row of `compared`: differences, and the value of the first run.

    Where there is no difference, since one of both has no value, the cell has the other run's value, or "none".
    """
    texts, others = [], (name for name in row._fields if name.startswith("difference_"))
    for one, value in ((getattr(row, name), getattr(row, name.replace("difference", "value"))) for name in others):
        if pd.isna(one):
            gone = "" if pd.isna(row.value) else "none"
            texts.append(gone if pd.isna(value) else f"= {value:.4g}")
        else:
            texts.append(f"{one:+.4g}" if one else "")
    return [*texts, "none" if pd.isna(row.value) else f"{row.value:.4g}"]


def difference(first: pd.DataFrame, other: pd.DataFrame, column: str) -> pd.DataFrame:
    """Trajectories of a run, with a column minus that of the first run, at the instants that both have."""
    both = other.merge(first[["time_s", "vehicle_id", column]], on=["time_s", "vehicle_id"], suffixes=("", "_first"))
    return both.assign(**{column: both[column] - both[f"{column}_first"]})


def shared_platoon(first: Results, other: Results) -> str | None:
    """The platoon of the first run with the most members that the other run has at the same instants; None: none."""
    rows = first.trajectories
    both = rows.merge(other.trajectories[["time_s", "vehicle_id", "platoon_id"]])
    return None if both.empty else figures.main_platoon(both)


def difference_figure(first: Results, others: Sequence[Results], names: Sequence[str]) -> Figure:
    """Gap and speed of each other run minus those of the first, over time: a row a run.

    others: each with a `shared_platoon`, whose members are drawn
    names : of the other runs
    """
    made = Figure(figsize=(9, 0.8 + 2.2 * len(others)), layout="constrained")
    FigureCanvasAgg(made)
    table = first.trajectories
    columns = [column for column in DRAWN if table[column].notna().any()]
    axes = made.subplots(len(others), len(columns), sharex=True, sharey="col", squeeze=False)
    for row, other, name in zip(axes, others, names, strict=True):
        platoon = shared_platoon(first, other)
        for one, column in zip(row, columns, strict=True):
            for place, vehicle, rows in figures.lines_of_members(
                difference(table, other.trajectories, column), platoon
            ):
                one.plot(rows.time_s, rows[column], **figures.line_style(place, rows), label=vehicle)
            one.axhline(0, color="#999999", linewidth=0.8, zorder=0)
            one.set_ylabel(f"Δ {DRAWN[column]}")
            one.spines[["top", "right"]].set_visible(False)
        row[0].set_title(name, loc="left", fontsize=10)
    for one in axes[0]:
        low, high = one.get_ylim()
        one.set_ylim(min(low, -LEAST_AXIS), max(high, LEAST_AXIS))
    for one in axes[-1]:
        one.set_xlabel("time [s]")
    handles = {
        label: handle for row in axes for handle, label in zip(*row[-1].get_legend_handles_labels(), strict=True)
    }
    if handles:
        made.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return made
