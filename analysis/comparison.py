"""Runs beside each other: how the metrics of some differ from those of the first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from platoontraffic.analysis.results import load

KEYS = ["scope", "platoon_id", "vehicle_id", "metric", "unit"]


def compared(folders: Sequence[Path], scope: str | None = None) -> pd.DataFrame:
    """Metrics of runs, one a row: the columns of metrics.csv, `value` of the first run, `difference_1` and so on.

    A difference is the other run's value minus the first one's; NaN where one of them has none. Metrics that are equal
    in all runs are left out.

    scope : of the metrics, such as "run" or "vehicle"; None: all
    raises: ResultsError
    """
    values = []
    for folder in folders:
        metrics = load(folder).metrics
        metrics = metrics[metrics.scope == scope] if scope else metrics
        values.append(metrics.set_index(KEYS).value)
    table = pd.concat(values, axis=1, keys=range(len(values)), sort=False)
    differs = ~(table.eq(table[0], axis=0) | (table.isna() & table[0].isna().to_numpy()[:, None])).all(axis=1)
    table = table[differs]
    columns = {f"difference_{i}": table[i] - table[0] for i in range(1, len(values))}
    return table[[0]].rename(columns={0: "value"}).assign(**columns).reset_index()
