"""Limits of means: exact for counts and shares of runs, bootstrap for other values; p values, and power beforehand.

Coverage at n = 8 to 40 runs is measured by tests/benchmarks/interval_coverage.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from statistics import NormalDist

import numpy as np

LEVEL = 0.95
RESAMPLES = 4000
ENOUGH = 8  # fewest values for which a bootstrap interval is wide enough
AT_ONCE = 2_000_000  # random numbers that are held in memory at once
FLIPPED = 14  # most values of which all signs are flipped; of more, as many flips are drawn

Limits = tuple[float, float]


@lru_cache(maxsize=1000)
def poisson_limits(events: int, runs: int = 1, level: float = LEVEL) -> Limits:
    """Exact limits of the mean count a run (Garwood, Biometrika 28, 1936): they cover in `level` of all cases or more.

    events : total over all runs. Independent events, at one rate; if they come in clusters, the limits are too narrow

    raises: ValueError (events below 0, or no run)
    """
    _check(level)
    if events < 0 or runs <= 0:
        raise ValueError(f"{events} events in {runs} runs; must be 0 or more in some runs")
    tail = (1 - level) / 2
    logs = _log_factorials(events)
    count = np.arange(events + 1)

    def at_most(mean: float, most: int) -> float:  # P(X <= most)
        return float(np.exp(count[: most + 1] * math.log(mean) - mean - logs[: most + 1]).sum())

    top = events + 1.0
    while at_most(top, events) > tail:
        top *= 2
    low = _root(lambda mean: tail - (1 - at_most(mean, events - 1)), 1e-12, top) if events else 0.0
    return low / runs, _root(lambda mean: at_most(mean, events) - tail, 1e-12, top) / runs


@lru_cache(maxsize=1000)
def binomial_limits(hits: int, runs: int, level: float = LEVEL) -> Limits:
    """Exact limits of the share of runs in which something happens (Clopper & Pearson, Biometrika 26, 1934).

    raises: ValueError (hits below 0, or more than runs)
    """
    _check(level)
    if not 0 <= hits <= runs:
        raise ValueError(f"{hits} hits in {runs} runs; must be 0 to the number of runs")
    tail = (1 - level) / 2
    logs = _log_factorials(runs)
    count = np.arange(runs + 1)
    ways = logs[-1] - logs - logs[::-1]

    def at_most(share: float, most: int) -> float:
        terms = ways + count * math.log(share) + (runs - count) * math.log1p(-share)
        return float(np.exp(terms[: most + 1]).sum())

    low = _root(lambda share: tail - (1 - at_most(share, hits - 1)), 1e-12, 1 - 1e-12) if hits else 0.0
    high = _root(lambda share: at_most(share, hits) - tail, 1e-12, 1 - 1e-12) if hits < runs else 1.0
    return low, high


def interval(values: Iterable[float], level: float = LEVEL, resamples: int = RESAMPLES) -> Limits:
    """Bootstrap interval of the mean of independent values; (NaN, NaN) for fewer than two, or if all are equal.

    Percentiles of the means of samples drawn with replacement, at levels widened by the ratio of Student's t to the
    normal distribution: for n values the plain percentiles are too narrow (T. C. Hesterberg, What teachers should know
    about the bootstrap, The American Statistician 69 (2015) 371, "expanded percentile"). For fewer than eight values
    the interval stays too narrow, because no mean of a sample lies beyond the values; for skewed values (lognormal, a
    rare large one) also for some dozens. Equal values say nothing about what another run would give.

    The same values, in whatever order, give the same interval.
    """
    values = np.sort(np.asarray(values, dtype=float))
    n = len(values)
    if not np.isfinite(values).all():
        raise ValueError("interval: values must be finite")
    _check(level)
    if n < 2 or values[0] == values[-1]:
        return math.nan, math.nan
    tail = NormalDist().cdf(-math.sqrt(n / (n - 1)) * _student(1 - (1 - level) / 2, n - 1))
    low, high = np.quantile(_resampled_means(values, resamples), [tail, 1 - tail])
    return float(low), float(high)


def of_difference(before: tuple[float, Limits], after: tuple[float, Limits]) -> Limits:
    """Limits of a difference of two means from the limits of each (Zou & Donner, Statistics in Medicine 27, 2008).

    before, after : mean, (low, high). For independent or positively correlated values
    """
    (first, (low, high)), (second, (lowest, highest)) = before, after
    more = second - first
    return more - math.hypot(second - lowest, high - first), more + math.hypot(highest - second, first - low)


def sign_flip_p(differences: Iterable[float]) -> float:
    """Two-sided p value of differences with a mean of zero: the share of flips of their signs with as large a mean.

    Exact where the differences are as likely to be of either sign. Its least value is 2 / 2^n: below six differences
    it cannot be under 0.05.
    """
    values = np.sort(np.asarray(differences, dtype=float))
    n = len(values)
    means = np.abs(_flips(n) @ values)
    return float((means >= means[0] * (1 - 1e-9)).mean()) if n else math.nan


@lru_cache(maxsize=4)
def _flips(n: int) -> np.ndarray:
    """Signs of n values in each flip, (flips, n); none is flipped in the first."""
    if n <= FLIPPED:
        return 1.0 - 2 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
    signs = np.random.default_rng(n).choice([-1.0, 1.0], size=(2**FLIPPED, n))
    signs[0] = 1
    return signs


def holm(p: Sequence[float]) -> np.ndarray:
    """p values corrected for their number (Holm, Scandinavian Journal of Statistics 6, 1979), in the given order.

    If those that are below 0.05 after it are called effects, any of these is a false one in at most 5 % of studies.
    NaN is no p value: it stays, and does not count in their number.
    """
    p = np.asarray(p, dtype=float)
    order, n = np.argsort(p), np.count_nonzero(~np.isnan(p))  # NaN last
    corrected = np.full(len(p), np.nan)
    order = order[:n]
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(n, 0, -1)), 1)
    return corrected


def runs_needed(sd: float, difference: float, power: float = 0.8, level: float = LEVEL, verdicts: int = 1) -> int:
    """Pairs of runs that find a difference with this probability, if there is one.

    sd       : standard deviation of the paired differences, as `paired` gives it for a pilot study
    verdicts : comparisons that the study makes; the level is corrected for them

    From the normal distribution, corrected for Student's t (Guenther, The American Statistician 35, 1981).

    raises: ValueError (no such standard deviation, or the difference is 0: no number of runs finds it)
    """
    _check_sd(sd)
    wanted, allowance = _quantiles(power, level, verdicts)
    if difference == 0:
        raise ValueError("difference = 0; must be another number: no number of runs finds it")
    return max(2, math.ceil((wanted * sd / difference) ** 2 + allowance))


def detectable(sd: float, n: int, power: float = 0.8, level: float = LEVEL, verdicts: int = 1) -> float:
    """Smallest difference that n pairs of runs find with this probability: the inverse of `runs_needed`; inf: none."""
    _check_sd(sd)
    wanted, allowance = _quantiles(power, level, verdicts)
    return wanted * sd / math.sqrt(n - allowance) if n > allowance else math.inf


def _quantiles(power: float, level: float, verdicts: int) -> tuple[float, float]:
    _check(level)
    if not 0 < power < 1:
        raise ValueError(f"power = {power}: must be between 0 and 1")
    z = NormalDist().inv_cdf(1 - (1 - level) / (2 * verdicts))
    return z + NormalDist().inv_cdf(power), z**2 / 2


def _check(level: float) -> None:
    if not 0 < level < 1:
        raise ValueError(f"level = {level}: must be between 0 and 1")


def _check_sd(sd: float) -> None:
    if not 0 <= sd < math.inf:
        raise ValueError(f"sd = {sd}: must be finite, and not negative")


def _log_factorials(most: int) -> np.ndarray:
    """log 0!, ..., log most!."""
    return np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, most + 1)))])


def _root(falls: Callable[[float], float], low: float, high: float) -> float:
    """Where a falling function is zero, by bisection."""
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if falls(middle) > 0 else (low, middle)
    return (low + high) / 2


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
