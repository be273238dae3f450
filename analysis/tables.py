"""Tables over runs: means with intervals, differences on common seeds, growth of a disturbance along a platoon."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator, Sequence
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
import pandas as pd

from platoontraffic.analysis.results import Batch, ResultsError

LEVEL = 0.95
RESAMPLES = 4000
AT_ONCE = 2_000_000  # random numbers that are held in memory at once
STILL = 1e-3  # least swing of a leader for amplification to be defined [m/s]

Names = str | Sequence[str]


def summarise(
    table: pd.DataFrame | Batch, metrics: Names, by: Names = (), *, level: float = LEVEL, resamples: int = RESAMPLES
) -> pd.DataFrame:
    """Mean of each metric over the runs of each combination of `by`, with a bootstrap interval of that mean.

    table   : a row a run, as `Batch.summary`
    returns : a row a combination and metric: by, metric, mean, low, high, n (runs that have a value); see `interval`

    raises: ResultsError
    """
    table = _rows(table)
    metrics, by = columns_of(table, metrics), columns_of(table, by)
    rows = []
    for point, group in _groups(table, by):
        for metric in metrics:
            values = _numbers(group, metric)
            rows.append((*point, metric, *_mean_and_interval(values, level, resamples), len(values)))
    return _tidy(rows, [*by, "metric", "mean", "low", "high", "n"], table)


def paired(
    table: pd.DataFrame | Batch,
    metrics: Names,
    column: str,
    between: tuple[Any, Any],
    by: Names = (),
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> pd.DataFrame:
    """Difference of a metric between two values of `column`: mean over the seeds that both have.

    The effect of a seed on both runs of a pair cancels.

    table   : a row a run, as `Batch.summary`
    between : the two values of `column`; the difference is that at the second minus that at the first
    by      : the other columns that vary
    returns : a row a combination of `by` and metric: by, metric, mean, low, high, n (pairs), left_out (the other seeds,
              as text)

    raises: ResultsError
    """
    table = _rows(table)
    metrics, by = columns_of(table, metrics), columns_of(table, by)
    columns_of(table, [column, "seed"])
    first, second = between
    for value in between:
        if not (table[column] == value).any():
            there = ", ".join(map(str, table[column].drop_duplicates()))
            raise ResultsError(f"{column}: no run has {value!r}; there are {there}")
    rows = []
    for point, group in _groups(table, by):
        at = "".join(f", {name} = {value}" for name, value in zip(by, point, strict=True))
        sides = [group[group[column] == value].set_index("seed") for value in between]
        for value, side in zip(between, sides, strict=True):
            if not side.index.is_unique:
                what = (
                    f"several runs have seed {side.index[side.index.duplicated()][0]}; `by` must name what else varies"
                )
                raise ResultsError(f"{column} = {value}{at}: {what}")
        for metric in metrics:
            before, after = (_numbers(side, metric) for side in sides)
            more = (after - before).dropna()  # of the seeds that both have
            if more.empty:
                raise ResultsError(f"{column} = {first} and {second}{at}: no seed has {metric} of both")
            left_out = sorted({*sides[0].index, *sides[1].index} - {*more.index})
            seeds = " ".join(map(str, left_out))
            rows.append((*point, metric, *_mean_and_interval(more, level, resamples), len(more), seeds))
    return _tidy(rows, [*by, "metric", "mean", "low", "high", "n", "left_out"], table)


def interval(values: Iterable[float], level: float = LEVEL, resamples: int = RESAMPLES) -> tuple[float, float]:
    """Bootstrap interval of the mean of independent values; (NaN, NaN) for fewer than two.

    Percentiles of the means of samples drawn with replacement, at levels widened by the ratio of Student's t to the
    normal distribution: for n values the plain percentiles are too narrow (T. C. Hesterberg, What teachers should know
    about the bootstrap, The American Statistician 69 (2015) 371, "expanded percentile"). For fewer than six values the
    interval stays too narrow, because no mean of a sample lies beyond the values.

    The same values, in whatever order, give the same interval.
    """
    values = np.sort(np.asarray(values, dtype=float))
    n = len(values)
    if not np.isfinite(values).all():
        raise ValueError("interval: values must be finite")
    if not 0 < level < 1:
        raise ValueError(f"interval: level = {level}: must be between 0 and 1")
    if n < 2:
        return math.nan, math.nan
    tail = NormalDist().cdf(-math.sqrt(n / (n - 1)) * _student(1 - (1 - level) / 2, n - 1))
    low, high = np.quantile(_resampled_means(values, resamples), [tail, 1 - tail])
    return float(low), float(high)


def amplification(
    trajectories: pd.DataFrame,
    frequency: float | None = None,
    norm: Literal["l2", "linf"] = "l2",
    window: tuple[float, float] | None = None,
) -> pd.DataFrame:
    """Disturbance of speed at each member, divided by that at its leader; above 1 the string amplifies it.

    trajectories : of a run, or of a batch with id and varied values before `time_s`
    frequency    : of the leader's swing [Hz]; amplitudes at it are fitted together with mean and linear trend
    norm         : without a frequency: root mean square, or maximum, of the deviation from the linear trend
    window       : period that is used [s]; default: all instants that leader and member have in common
    returns      : the columns before `time_s`, platoon_id, vehicle_id, place, amplification (1 for leaders, NaN where
                   the leader hardly swings)

    raises: ResultsError
    """
    if norm not in ("l2", "linf"):
        raise ResultsError(f"norm = {norm!r}: must be 'l2' or 'linf'")
    if frequency is not None and not frequency > 0:
        raise ResultsError(f"frequency = {frequency}: must be positive")
    columns_of(trajectories, ["time_s", "platoon_id", "vehicle_id", "place", "speed_mps"])
    of_run = list(trajectories.columns[: trajectories.columns.get_loc("time_s")])
    rows = trajectories
    if window is not None:
        rows = rows[rows.time_s.between(*window)]
    rows = rows.dropna(subset="speed_mps")
    if rows.empty:
        raise ResultsError(f"amplification: no rows{f' within {window} s' if window else ''}")
    table = []
    for point, platoon in _groups(rows, [*of_run, "platoon_id"]):
        leader = platoon[platoon.place == 0].set_index("time_s").speed_mps
        if leader.empty:
            raise ResultsError(f"amplification: platoon {point[-1]}: its leader is not in the table")
        for (place, vehicle), own in platoon.groupby(["place", "vehicle_id"]):
            own = own.set_index("time_s").speed_mps
            times = own.index.intersection(leader.index)
            swing = [_swing(times.to_numpy(), speed[times].to_numpy(), frequency, norm) for speed in (leader, own)]
            table.append((*point, vehicle, place, swing[1] / swing[0] if swing[0] > STILL else math.nan))
    return _tidy(table, [*of_run, "platoon_id", "vehicle_id", "place", "amplification"], trajectories)


def _swing(time: np.ndarray, speed: np.ndarray, frequency: float | None, norm: str) -> float:
    """Amplitude of a speed [m/s]; NaN for too few instants."""
    trend = [np.ones_like(time), time - time.mean() if len(time) else time]
    if frequency is not None:
        phase = 2 * np.pi * frequency * time
        trend += [np.cos(phase), np.sin(phase)]
    if len(time) <= len(trend):
        return math.nan
    base = np.stack(trend, axis=1)
    factors, *_ = np.linalg.lstsq(base, speed, rcond=None)
    if frequency is not None:
        return float(np.hypot(*factors[2:]))
    rest = speed - base @ factors
    return float(np.sqrt((rest**2).mean()) if norm == "l2" else np.abs(rest).max())


def _mean_and_interval(values: pd.Series, level: float, resamples: int) -> tuple[float, float, float]:
    mean = float(np.sort(values.to_numpy()).mean()) if len(values) else math.nan
    return mean, *interval(values, level, resamples)


def _resampled_means(values: np.ndarray, resamples: int) -> np.ndarray:
    """Means of samples of the same size, drawn with replacement: the same draws for equally many values."""
    n, draws = len(values), np.random.default_rng(len(values))
    means = np.empty(resamples)
    rows = max(1, AT_ONCE // n)
    for begin in range(0, resamples, rows):
        part = means[begin : begin + rows]
        part[:] = values[draws.integers(n, size=(len(part), n))].mean(axis=1)
    return means


def _student(p: float, freedom: int) -> float:
    """Quantile of Student's t, by its expansion about the normal one (Abramowitz & Stegun 26.7.5)."""
    z = NormalDist().inv_cdf(p)
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + sum(term / freedom ** (i + 1) for i, term in enumerate(terms))


def _rows(table: pd.DataFrame | Batch) -> pd.DataFrame:
    rows = table.summary if isinstance(table, Batch) else table
    if rows.empty:
        raise ResultsError("the table has no rows: no run is done")
    return rows


def columns_of(table: pd.DataFrame, names: Names) -> list[str]:
    """The names as a list. raises: ResultsError if one is not a column"""
    names = [names] if isinstance(names, str) else list(names)
    for name in names:
        if name not in table.columns:
            close = difflib.get_close_matches(str(name), map(str, table.columns), n=1)
            some = ", ".join(map(str, table.columns[:8])) + (" …" if len(table.columns) > 8 else "")
            hint = f"did you mean {close[0]!r}?" if close else f"there are {some}"
            raise ResultsError(f"{name!r}: not a column; {hint}")
    return names


def _numbers(table: pd.DataFrame, metric: str) -> pd.Series:
    """The values without missing ones. raises: ResultsError if they are not numbers"""
    if not pd.api.types.is_numeric_dtype(table[metric]):
        raise ResultsError(f"{metric!r}: has no numbers, such as {table[metric].iloc[0]!r}")
    return table[metric].dropna().astype(float)


def _groups(table: pd.DataFrame, by: list[str]) -> Iterator[tuple[tuple, pd.DataFrame]]:
    """(values of `by`, rows), in the order of these values."""
    if not by:
        yield (), table
    else:
        yield from table.groupby(by, dropna=False)


def _tidy(rows: list[tuple], columns: list[str], source: pd.DataFrame) -> pd.DataFrame:
    """A table with the units of its source."""
    table = pd.DataFrame(rows, columns=columns)
    table.attrs["units"] = dict(source.attrs.get("units", {}))
    return table
