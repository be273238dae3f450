"""Rows of records of arrays, NamedTuples and dataclasses in one another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from platoontraffic.vehicles.records import concatenate, put, stack, take


class Pair(NamedTuple):
    one: np.ndarray
    two: np.ndarray  # (n, 2)


@dataclass(frozen=True, kw_only=True)
class Nested:
    pair: Pair
    flag: np.ndarray


def nested(*values: int) -> Nested:
    """A record whose row i holds values[i] everywhere."""
    one = np.array(values, dtype=float)
    return Nested(pair=Pair(one, np.column_stack([one, one])), flag=one > 2)


def same(one: Nested, other: Nested) -> None:
    for a, b in zip((*one.pair, one.flag), (*other.pair, other.flag), strict=True):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype


@pytest.mark.parametrize("rows", [[2, 0, 0], [], [True, False, True]])
def test_take_picks_the_same_rows_of_every_part(rows):
    rows = np.array(rows, dtype=bool if True in rows else int)
    same(take(nested(1, 2, 3), rows), nested(*np.array([1, 2, 3])[rows]))


def test_concatenated_records_are_taken_apart_again():
    both = concatenate(nested(1, 2), nested(3, 4, 5))
    same(take(both, np.arange(5) < 2), nested(1, 2))
    same(take(both, np.arange(5) >= 2), nested(3, 4, 5))


def test_put_changes_its_rows_alone_and_not_the_record_it_is_given():
    record = nested(1, 2, 3, 4)
    same(put(record, [np.array([3, 0]), np.array([1])], [nested(7, 8), nested(9)]), nested(8, 9, 3, 7))
    same(record, nested(1, 2, 3, 4))


def test_lists_and_none_have_rows_too():
    record = Pair(["a", "b", "c"], None)
    assert take(record, np.array([2, 0])) == (["c", "a"], None)
    assert take(record, np.array([False, True, True])) == (["b", "c"], None)


@pytest.mark.parametrize("part", [{"a": 1}, 3.0, (1, 2), "abc", np.zeros(2), np.zeros(()), ["a"]])
def test_a_part_without_a_row_for_each_vehicle_is_refused(part):
    with pytest.raises(TypeError, match=f"a {type(part).__name__}; must be arrays"):
        take(Pair(np.zeros(3), part), np.array([True, False, True]))


@dataclass(frozen=True)
class Size:
    length: float
    width: float


def test_stacked_records_have_a_row_each():
    sizes = stack([Size(1.0, 2.0), Size(3.0, 4.0)])
    assert (sizes.length.tolist(), sizes.width.tolist()) == ([1.0, 3.0], [2.0, 4.0])
