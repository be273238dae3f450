"""Rows as lines of CSV: the same bytes however they are given."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from platoontraffic.observation.instant import Instant
from platoontraffic.results.columns import Column


def header(columns: Sequence[Column]) -> str:
    return ",".join(c.name for c in columns) + "\n"


def lines(rows: Iterable[tuple], columns: Sequence[Column]) -> str:
    """Lines of rows that are given as tuples, one value a column."""
    return "".join(",".join(_field(v, c) for v, c in zip(row, columns, strict=True)) + "\n" for row in rows)


def lines_at(now: Instant, columns: Sequence[Column], order: Sequence[int] | None = None) -> str:
    """Lines of one instant, by the columns' sources; order: of the rows."""
    return _lines_of_columns([c.source(now) for c in columns], columns, order)


def _lines_of_columns(values: Sequence[Sequence], columns: Sequence[Column], order: Sequence[int] | None = None) -> str:
    """Lines of a table given by columns (n,): the same text as `lines`, ten times as fast.

    All numbers are formatted at once, into a text with a %s for each string; the strings are filled in afterwards,
    because they may contain what looks like a missing number.
    """
    given = list(zip(columns, values, strict=True))
    numbers = np.array([v for c, v in given if c.type != "string"], dtype=float).T
    strings = np.array([v for c, v in given if c.type == "string"], dtype=object).T
    if order is not None:
        numbers, strings = numbers[order], strings[order]
    line = ",".join("%%s" if c.type == "string" else c.format for c in columns) + "\n"
    text = (line * len(numbers)) % tuple(numbers.ravel().tolist())
    text = text.replace("nan", "").replace("-0.000000", "0.000000")
    texts = strings.ravel().tolist()
    if _needs_quotes("".join(texts)):
        texts = [_quoted(one) for one in texts]
    return text % tuple(texts)


def _field(value: Any, column: Column) -> str:
    if column.type == "string":
        return _quoted(value)
    if value is None or (isinstance(value, float | np.floating) and np.isnan(value)):
        return ""
    text = column.format % value
    # -0.000000 and 0.000000 are one number; the order of additions must not decide which of them is written.
    return text.removeprefix("-") if float(text) == 0 else text


def _quoted(value: str) -> str:
    return f'"{value.replace(chr(34), chr(34) * 2)}"' if _needs_quotes(value) else value


def _needs_quotes(value: str) -> bool:
    return "," in value or '"' in value or "\n" in value or "\r" in value
