"""Coverage of the intervals of `platoontraffic.analysis`: the share of made-up studies in which they contain the truth.

    .venv/bin/python tests/benchmarks/interval_coverage.py [--cases 2000]

The cases of a cell are independent studies of n runs each. A share of 0.95 in 2000 has a standard error of 0.005; a
cell is "not held" where it is two of them outside of what is wanted. Differences have a quarter as many cases.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.analysis import paired, summarise

RUNS = (8, 10, 20, 40)
RESAMPLES = 1000  # the default, 4000, gives the same coverage to the second decimal

Draw = Callable[[np.random.Generator, int], np.ndarray]


class Kind(NamedTuple):
    name: str
    draw: Draw  # values of n runs
    mean: float
    counts: bool = False
    exact: bool = False  # coverage must be 0.95 or more; else 0.93 to 0.98


def normal(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.normal(5, 2, n)


def lognormal(sigma: float) -> Draw:
    return lambda rng, n: rng.lognormal(0, sigma, n)


def poisson(rate: float) -> Draw:
    return lambda rng, n: rng.poisson(rate, n)


def clusters(rate: float, size: float) -> Draw:
    """Events that come in clusters of this mean size (negative binomial)."""
    return lambda rng, n: rng.negative_binomial(rate / (size - 1), 1 / size, n)


def share(p: float) -> Draw:
    return lambda rng, n: rng.random(n) < p


KINDS = (
    Kind("normal", normal, 5.0),
    *(Kind(f"lognormal, sigma {s:g}", lognormal(s), math.exp(s**2 / 2)) for s in (0.25, 0.5, 1.0)),
    *(Kind(f"Poisson, {r:g} a run", poisson(r), r, counts=True, exact=True) for r in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)),
    Kind("clusters of 3, 5 a run", clusters(5.0, 3.0), 5.0, counts=True),
    *(Kind(f"share of runs, {p:g}", share(p), p, exact=True) for p in (0.02, 0.05, 0.2, 0.5, 0.9)),
)


def of_means(kind: Kind, n: int, cases: int) -> float:
    """Coverage of the intervals of `summarise`."""
    rng = np.random.default_rng(n)
    values = np.concatenate([kind.draw(rng, n) for _ in range(cases)])
    table = pd.DataFrame({"case": np.repeat(np.arange(cases), n), "value": values})
    found = summarise(table, "value", "case", counts="value" if kind.counts else (), resamples=RESAMPLES)
    return _covered(found, kind.mean)


def of_differences(kind: Kind, n: int, cases: int) -> float:
    """Coverage of the intervals of `paired`, for two arms without a difference that share nothing."""
    rng = np.random.default_rng(n)
    arms = [np.concatenate([kind.draw(rng, n) for _ in range(cases)]) for _ in range(2)]
    case, seed = np.divmod(np.arange(cases * n), n)
    parts = [pd.DataFrame({"case": case, "seed": seed, "arm": arm, "value": v}) for arm, v in enumerate(arms)]
    counts = "value" if kind.counts else ()
    found = paired(pd.concat(parts), "value", "arm", (0, 1), "case", counts=counts, resamples=RESAMPLES)
    return _covered(found, 0.0)


def _covered(found: pd.DataFrame, truth: float) -> float:
    """An interval that is not there covers nothing."""
    return float(((found.low <= truth + 1e-12) & (found.high >= truth - 1e-12)).mean())


def verdict(kind: Kind, shares: Sequence[float], cases: int) -> str:
    """Exact limits cover in 0.95 or more, the others in 0.93 to 0.98; clusters may do so in more."""
    low, high = (0.95, 1.0) if kind.exact else (0.93, 1.0 if kind.counts else 0.98)
    by_chance = 2 * math.sqrt(0.95 * 0.05 / cases)
    return "" if all(low - by_chance <= share <= high + by_chance for share in shares) else "not held"


def print_table(title: str, measure: Callable[[Kind, int, int], float], cases: int) -> None:
    print(f"\n{title}, {cases} cases\n\n| values | {' | '.join(f'n = {n}' for n in RUNS)} | |")
    print("| --- " * (len(RUNS) + 2) + "|")
    for kind in KINDS:
        shares = [measure(kind, n, cases) for n in RUNS]
        print(
            f"| {kind.name} | {' | '.join(f'{share:.3f}' for share in shares)} | {verdict(kind, shares, cases)} |",
            flush=True,
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=2000)
    cases = parser.parse_args().cases
    warnings.simplefilter("ignore")
    print_table("Means (`summarise`)", of_means, cases)
    print_table("Differences on common seeds (`paired`)", of_differences, cases // 4)
