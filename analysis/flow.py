"""Flow, headways and queues from the passages of vehicles at the ends of edges (passages.csv)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

FROM_POSITION = 4  # vehicles of a queue up to this one lose time by starting (Highway Capacity Manual, 2010, ch. 31)
RED = 8.0  # a longer headway at a stop line separates two queues [s]


class Mean(NamedTuple):
    value: float
    error: float  # standard error, of independent batches of headways; NaN: too few
    n: int  # headways


def at(passages: pd.DataFrame, edge: str, since: float = 0.0) -> pd.DataFrame:
    """Passages at one edge of one run, with the column headway_s: time since the passage before in the same lane.

    since: earlier ones are left out [s]
    """
    rows = passages[(passages.edge_id == edge) & (passages.time_s >= since)]
    rows = rows.sort_values(["lane_index", "time_s"], kind="stable")
    return rows.assign(headway_s=rows.groupby("lane_index").time_s.diff())


def mean_headway(rows: pd.DataFrame, batches: int = 10) -> Mean:
    """Mean headway of a saturated lane, whose inverse is its capacity; rows: as `at` gives them."""
    return _mean(rows.headway_s.dropna().to_numpy(), batches)


def saturation_headway(rows: pd.DataFrame, per_cycle: int, batches: int = 10) -> Mean:
    """Mean headway of the vehicles that discharge behind the first FROM_POSITION of a queue; its inverse is the
    saturation flow (Highway Capacity Manual, 2010, chapter 31).

    rows      : at a stop line with a light, as `at` gives them
    per_cycle : vehicles of each queue that have stood, or come up to it while it stands; later ones do not count
    """
    position = queue_positions(rows)
    inside = (position > FROM_POSITION) & (position <= per_cycle)
    return _mean(rows.headway_s[inside].to_numpy(), batches)


def queue_positions(rows: pd.DataFrame) -> pd.Series:
    """Position of each vehicle in the discharge of its queue, from 1; headways above RED begin another."""
    begins = rows.headway_s.isna() | (rows.headway_s > RED)
    return begins.groupby([rows.lane_index, begins.cumsum()]).cumcount() + 1


def harmonic(share: Sequence[float] | np.ndarray, of_others: float, of_members: float) -> np.ndarray:
    """Mean headway of a lane whose vehicles keep the headway of their kind, whoever is ahead: p h_a + (1 - p) h_m.

    The capacity, its inverse, is the harmonic mean of the two capacities, weighted by the shares.
    """
    share = np.asarray(share, dtype=float)
    return share * of_members + (1 - share) * of_others


def by_interval(passages: pd.DataFrame, edge: str, every: float = 60.0, until: float = np.inf) -> pd.DataFrame:
    """Flow, density and speed at the end of an edge by interval, as a detector gives them: a fundamental diagram.

    The speed is the harmonic mean, which is the mean over space (Wardrop, 1952), so that flow = density x speed. A
    vehicle that passes at rest, to the digits of the table, counts in the flow only.

    every : length of the intervals [s]
    until : end of the run [s]; an interval that goes on after it is left out. Default: none is

    returns: columns time_s (begin), flow_1ph, density_1pkm, speed_mps; an interval without a passage has none
    """
    rows = passages[passages.edge_id == edge]
    rows = rows[(np.floor(rows.time_s / every) + 1) * every <= until * (1 + 1e-9)]
    grouped = rows.groupby(np.floor(rows.time_s / every) * every)
    flow = grouped.size() * 3600 / every
    speed = grouped.speed_mps.apply(lambda v: 1 / (1 / v[v > 0]).mean())
    table = pd.DataFrame({"flow_1ph": flow, "density_1pkm": flow / speed / 3.6, "speed_mps": speed})
    return table.rename_axis("time_s").reset_index()


def _mean(headways: np.ndarray, batches: int) -> Mean:
    """Successive headways depend on each other, so that the error is taken from the means of batches of them."""
    if len(headways) < 2 * batches:
        return Mean(float(headways.mean()) if len(headways) else np.nan, np.nan, len(headways))
    means = [batch.mean() for batch in np.array_split(headways, batches)]
    return Mean(float(headways.mean()), float(np.std(means, ddof=1) / np.sqrt(batches)), len(headways))
