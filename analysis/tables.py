"""Tables over runs: means with intervals, and differences on common seeds."""

from __future__ import annotations

import difflib
import math
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.analysis.limits import (
    ENOUGH,
    LEVEL,
    RESAMPLES,
    Limits,
    binomial_limits,
    interval,
    of_difference,
    poisson_limits,
    sign_flip_p,
)
from platoontraffic.analysis.results import Batch, ResultsError

Names = str | Sequence[str]

BOOTSTRAP, POISSON, BINOMIAL = "bootstrap", "exact Poisson", "exact binomial"
WIDENED = " or bootstrap"  # the exact limits, widened to those of the bootstrap
FEW = f"bootstrap, n < {ENOUGH}"
EQUAL, IDENTICAL, ONE = "none: equal values", "none: identical runs", "none: one value"


class Estimate(NamedTuple):
    mean: float
    low: float
    high: float
    method: str  # of the limits


def summarise(
    table: pd.DataFrame | Batch,
    metrics: Names,
    by: Names = (),
    *,
    counts: Names = (),
    geometric: bool = False,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> pd.DataFrame:
    """Mean of each metric over the runs of each combination of `by`, with its interval.

    table     : a row a run, as `Batch.summary`
    by        : all columns that vary, except the seed. To average over one of them, take the mean of each seed first:
                `table.groupby([*by, "seed"], as_index=False)[metrics].mean()`
    counts    : metrics that count events, besides those that the data dictionary of `table` has as such
    geometric : means of logarithms: for ratios
    returns   : a row a combination and metric: by, metric, mean, low, high, n (runs that have a value), method of the
                interval: exact Poisson limits for counts, widened to the bootstrap's where events come in clusters;
                exact binomial limits for a column of truth values, such as `table.collisions > 0`; else `interval`

    Warns (UserWarning) of fewer values than an interval needs, of equal ones, and of runs that are identical although
    their seeds differ: none of these has an interval that means something.

    raises: ResultsError
    """
    table = _rows(table)
    metrics, by = columns_of(table, metrics), columns_of(table, by)
    counted = _counted(table, counts)
    rows = []
    for point, group in groups(table, by):
        runs = group.drop_duplicates("id") if "id" in group else group  # a run may have a row for each member
        if "seed" in group:
            _check_seeds(runs.seed, _named(by, point))
        identical = are_identical(group)
        for metric in metrics:
            values = _numbers(group, metric)
            if geometric and (values <= 0).any():
                raise ResultsError(f"{metric!r}: has values that are not positive: no geometric mean")
            found = _estimate(np.log(values) if geometric else values, metric in counted, identical, level, resamples)
            if geometric:
                found = Estimate(*np.exp(found[:3]), found.method)
            rows.append((*point, metric, *found[:3], len(values), found.method))
    _warn(rows)
    return tidy(rows, [*by, "metric", "mean", "low", "high", "n", "method"], table)


def paired(
    table: pd.DataFrame | Batch,
    metrics: Names,
    column: str,
    between: tuple[Any, Any],
    by: Names = (),
    *,
    counts: Names = (),
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> pd.DataFrame:
    """Difference of a metric between two values of `column`: mean over the seeds that both have.

    The effect of a seed on both runs of a pair cancels.

    table   : a row a run, as `Batch.summary`
    between : the two values of `column`; the difference is that at the second minus that at the first
    by      : the other columns that vary
    counts  : see `summarise`. Limits of differences of counts and shares are made of the exact limits of each, and
              widened to the bootstrap's
    returns : a row a combination of `by` and metric: by, metric, mean, low, high, n (pairs), method of the interval,
              sd (standard deviation of the differences, for `runs_needed`), p (of no difference, by flips of signs; to
              be corrected by `holm` where there are many), left_out (the other seeds, as text)

    Warns as `summarise` does.

    raises: ResultsError
    """
    table = _rows(table)
    metrics, by = columns_of(table, metrics), columns_of(table, by)
    counted = _counted(table, counts)
    columns_of(table, [column, "seed"])
    first, second = between
    for value in between:
        if not (table[column] == value).any():
            there = ", ".join(map(str, table[column].drop_duplicates()))
            raise ResultsError(f"{column}: no run has {value!r}; there are {there}")
    rows = []
    for point, group in groups(table, by):
        at = f", {_named(by, point)}" if by else ""
        sides = [group[group[column] == value].set_index("seed") for value in between]
        for value, side in zip(between, sides, strict=True):
            _check_seeds(side.index, f"{column} = {value}{at}")
        identical = all(are_identical(side) for side in sides)
        for metric in metrics:
            pairs = pd.concat([_numbers(side, metric) for side in sides], axis=1, join="inner")
            if pairs.empty:
                raise ResultsError(f"{column} = {first} and {second}{at}: no seed has {metric} of both")
            more = (pairs.iloc[:, 1].astype(float) - pairs.iloc[:, 0].astype(float)).sort_values()
            found = _estimate(more, False, identical, level, resamples)
            if not identical and (metric in counted or _is_share(table, metric)):
                each = [_estimate(pairs.iloc[:, i], metric in counted, False, level, resamples) for i in (0, 1)]
                limits = of_difference(*((one.mean, (one.low, one.high)) for one in each))
                found = _widened(found.mean, limits, (found.low, found.high), each[0].method.removesuffix(WIDENED))
            left_out = sorted({*sides[0].index, *sides[1].index} - {*pairs.index})
            seeds = " ".join(map(str, left_out))
            rest = found.method, float(more.std()), sign_flip_p(more), seeds
            rows.append((*point, metric, *found[:3], len(more), *rest))
    _warn([row[:-3] for row in rows])
    return tidy(rows, [*by, "metric", "mean", "low", "high", "n", "method", "sd", "p", "left_out"], table)


def _named(by: Names, point: tuple) -> str:
    return ", ".join(f"{name} = {value}" for name, value in zip(by, point, strict=True))


def _check_seeds(seeds: pd.Series | pd.Index, at: str) -> None:
    """raises: ResultsError if several runs have one seed, so that they are not independent"""
    if not seeds.is_unique:
        what = f"several runs have seed {seeds[seeds.duplicated()].to_list()[0]}; `by` must name what else varies"
        raise ResultsError(f"{at}: {what}" if at else what)


def are_identical(runs: pd.DataFrame) -> bool:
    """Whether several runs have the same value of every metric to the last digit, and not only of counts."""
    values = runs[[name for name in runs.columns if name not in ("id", "seed")]]
    if len(values) < 2 or len(values.drop_duplicates()) > 1:
        return False
    return any(isinstance(value, float) and value % 1 != 0 for value in values.iloc[0] if value == value)


def _estimate(values: pd.Series, counts: bool, identical: bool, level: float, resamples: int) -> Estimate:
    """values: without missing ones; bool: whether something happened in a run"""
    n = len(values)
    mean = float(np.sort(values.to_numpy(dtype=float)).mean()) if n else math.nan
    if identical or not n:
        return Estimate(mean, math.nan, math.nan, IDENTICAL if n else "")
    if values.dtype == bool:
        return Estimate(mean, *binomial_limits(int(values.sum()), n, level), BINOMIAL)
    between = interval(values, level, resamples)
    if counts:
        return _widened(mean, poisson_limits(round(values.sum()), n, level), between, POISSON)
    method = ONE if n == 1 else EQUAL if math.isnan(between[0]) else FEW if n < ENOUGH else BOOTSTRAP
    return Estimate(mean, *between, method)


def _widened(mean: float, exact: Limits, bootstrap: Limits, method: str) -> Estimate:
    low, high = np.fmin(exact[0], bootstrap[0]), np.fmax(exact[1], bootstrap[1])
    return Estimate(mean, float(low), float(high), method + (WIDENED if (low, high) != exact else ""))


def _warn(rows: Sequence[tuple]) -> None:
    """One warning for each thing that is wrong with some rows: (..., metric, mean, low, high, n, method)."""
    said = {
        FEW: f"fewer than {ENOUGH} values: the interval is too narrow",
        EQUAL: "equal values have no interval; if they count events, name them in `counts`",
        IDENTICAL: "the runs are identical although their seeds differ: nothing in them is random, one is enough",
    }
    for method, what in said.items():
        of = list(dict.fromkeys(row[-6] for row in rows if row[-1] == method))
        if of:
            warnings.warn(f"{', '.join(of)}: {what}", stacklevel=3)


def _counted(table: pd.DataFrame, counts: Names) -> set[str]:
    """The metrics that count events, by the data dictionary and by name."""
    named = set(columns_of(table, counts))
    for name in named:
        values = _numbers(table, name)
        if ((values < 0) | (values % 1 != 0)).any():
            raise ResultsError(f"{name!r}: is no count: it has {values[(values < 0) | (values % 1 != 0)].iloc[0]:g}")
    return named | {*table.attrs.get("counts", ())}


def _is_share(table: pd.DataFrame, metric: str) -> bool:
    return table[metric].dtype == bool


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
    values = table[metric].dropna()
    return values if values.dtype == bool else values.astype(float)


def groups(table: pd.DataFrame, by: list[str]) -> Iterator[tuple[tuple, pd.DataFrame]]:
    """(values of `by`, rows), in the order of these values."""
    if not by:
        yield (), table
    else:
        yield from table.groupby(by, dropna=False)


def tidy(rows: list[tuple], columns: list[str], source: pd.DataFrame) -> pd.DataFrame:
    """A table with the units of its source."""
    table = pd.DataFrame(rows, columns=columns)
    table.attrs["units"] = dict(source.attrs.get("units", {}))
    return table
