"""Records of arrays with one row for each vehicle: take rows, put other values in, join records, stack many.

A record is an array (n, ...), or a NamedTuple or dataclass of records.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")

# `all` and `any` of an array (n,), without numpy's Python functions around them: they are asked in every step.
every, some = np.logical_and.reduce, np.logical_or.reduce


def changed(record: Record, **values: Any) -> Record:
    """A copy of a dataclass with other values in some fields, as `dataclasses.replace` in a tenth of its time.

    It does not call `__init__`. Values of cached properties are kept: the new ones must not change them.
    """
    copy = object.__new__(type(record))
    copy.__dict__.update(record.__dict__, **values)
    return copy


def take(record: Record, rows: np.ndarray) -> Record:
    """Some rows of a record, in which lists of n values and None may stand too.

    rows   : indices (m,), or a mask (n,)
    raises : TypeError if a part is none of all that, or is not as long as the mask
    """
    if record is None:
        return None
    mask = rows.dtype == bool
    if not mask and isinstance(record, tuple) and hasattr(record, "_fields"):  # the usual one: fewer calls
        return type(record)(*[part[rows] if type(part) is np.ndarray else take(part, rows) for part in record])
    if isinstance(record, np.ndarray) and (not mask or record.shape[:1] == rows.shape):
        return record[rows]
    if isinstance(record, list) and (not mask or len(record) == len(rows)):
        return [record[i] for i in (np.flatnonzero(rows) if mask else rows)]
    return _part_by_part(lambda part: take(part, rows), record)


def row(record: Record, i: int) -> Record:
    """One row of a record, with values in place of arrays; None of None."""
    if record is None:
        return None
    return record[i] if isinstance(record, np.ndarray) else _part_by_part(lambda part: row(part, i), record)


def put(record: Record, rows: Sequence[np.ndarray], values: Sequence[Record]) -> Record:
    """A copy of a record, (n, ...), with each of the values, (m, ...), in its rows, (m,)."""
    if not isinstance(record, np.ndarray):
        return _part_by_part(lambda old, *new: put(old, rows, new), record, *values)
    copy = record.copy()
    for where, new in zip(rows, values, strict=True):
        copy[where] = new
    return copy


def concatenate(one: Record, other: Record) -> Record:
    """Two records as one: the rows of the other come last. Lists and None may stand in them, as in `take`.

    raises: TypeError, ValueError if they do not fit together
    """
    if type(one) is not type(other):
        raise TypeError(f"{type(one).__name__} and {type(other).__name__}")
    if one is None:
        return None
    if isinstance(one, list):
        return one + other
    if not isinstance(one, np.ndarray):
        return _part_by_part(concatenate, one, other)
    if one.dtype != other.dtype:
        raise TypeError(f"{one.dtype} and {other.dtype}")
    return np.concatenate([one, other])


def stack(models: Sequence[Record]) -> Record:
    """Dataclasses of floats, all of one class, as one of arrays (n,)."""
    kind = type(models[0])
    return kind(*(np.array([getattr(m, f.name) for m in models]) for f in fields(kind)))


def _part_by_part(function: Callable[..., Any], record: Record, *others: Record) -> Record:
    """The record made of function(part, the same part of each other record)."""
    if isinstance(record, tuple) and hasattr(record, "_fields"):
        return type(record)(*map(function, record, *others))
    if is_dataclass(record):
        names = [f.name for f in fields(record)]
        return replace(record, **{name: function(*(getattr(one, name) for one in (record, *others))) for name in names})
    what = f"a {type(record).__name__}; must be arrays, lists, NamedTuples or dataclasses of them"
    raise TypeError(f"{what}, with one row for each vehicle")
