"""The instants at which a run was recorded. A table has no rows of those at which nothing was on the road."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pandas as pd

from platoontraffic.analysis.reading import inside
from platoontraffic.analysis.results import Results


def instants(results: Results, table: pd.DataFrame, interval: str) -> np.ndarray:
    """Instants of a table's rows, and behind each stretch of them the first recorded one that has none [s].

    interval: key of the table's recording interval in [record] of config.toml
    """
    times = np.unique(table.time_s)
    every = config_of(results).get("record", {}).get(interval) or float(
        np.median(np.diff(times) if len(times) > 1 else np.inf)
    )
    last = np.append(np.diff(times) > 1.5 * every, True)[: len(times)]
    empty = np.round(times[last] + every, 6)
    return np.union1d(times, empty[empty < end_of(results) + 1e-6])


def end_of(results: Results) -> float:
    """Time at which the run ended [s]."""
    end = results.events.loc[results.events.kind == "end", "time_s"]
    return float(end.iloc[0]) if len(end) else float(results.trajectories.time_s.max())


def config_of(results: Results) -> dict[str, Any]:
    """The scenario of the run; empty if it cannot be read."""
    try:
        return tomllib.loads(inside(results.folder, "config.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
