"""Whom each member follows when, by what it was told."""

from __future__ import annotations

import pandas as pd
import pytest
from tests.results.test_metrics import events

from platoontraffic.results.following import Stretch, lengths, split_off, stretches, within

PLACES = {f"p.{i}": ("p", i) for i in range(4)} | {"q.0": ("q", 0)}
END = 100.0


def told(*rows) -> dict[str, list[Stretch]]:
    departed = [(0.0, "departed", name) for name in PLACES]
    return stretches(PLACES, events(*departed, *rows), END)


def test_who_is_told_nothing_follows_the_one_before_it_while_both_are_there():
    of = told((80.0, "arrived", "p.1"), (90.0, "arrived", "p.2"))
    assert of == {
        "p.0": [], "q.0": [],
        "p.1": [Stretch(0, 80, "p.0")], "p.2": [Stretch(0, 80, "p.1")], "p.3": [Stretch(0, 90, "p.2")],
    }  # fmt: skip


def test_who_splits_off_and_joins_again_follows_nobody_between():
    of = told(
        (20.0, "told", "p.2", "", 0.0, "to split"), (50.0, "told", "p.2", "p.1", 0.0, "to join"),
        (60.0, "told", "p.2", "q.0", 0.0, "to join, but q.0 is not on the road"),
    )  # fmt: skip
    assert of["p.2"] == [Stretch(0, 20, "p.1"), Stretch(20, 50, ""), Stretch(50, 100, "p.1")]
    assert of["p.3"] == [Stretch(0, 100, "p.2")]


def test_behind_who_leaves_one_follows_the_next_and_a_leader_who_joins_follows():
    of = told((30.0, "told", "p.1", "", 0.0, "to leave"), (40.0, "told", "q.0", "p.3", 0.0, "to join"))
    assert of["p.1"] == [Stretch(0, 30, "p.0")]
    assert of["p.2"] == [Stretch(0, 30, "p.1"), Stretch(30, 100, "p.0")]
    assert of["q.0"] == [Stretch(40, 100, "p.3")]
    assert told((30.0, "told", "p.0", "", 0.0, "to leave"))["p.1"] == [Stretch(0, 30, "p.0")]


def test_split_off_are_those_events_and_what_was_told_until_it_has_rejoined():
    own = events(
        (12.0, "split", "p.2"), (15.0, "rejoined", "p.2"), (20.0, "told", "p.2", "", 0.0, "to split"),
        (50.0, "told", "p.2", "p.1", 0.0, "to join"), (58.0, "rejoined", "p.2"),
    )  # fmt: skip
    follows = [Stretch(0, 20, "p.1"), Stretch(20, 50, ""), Stretch(50, 100, "p.1")]
    off = split_off(own, follows)
    assert sorted(off) == [(10, 15), (20, 50), (50, 58)]
    assert lengths([(one.begin, one.end) for one in follows], off) == pytest.approx((100, 5 + 30 + 8))
    assert within(pd.Series([9.0, 10.0, 15.0, 57.0, 58.0]), off).tolist() == [False, True, False, True, False]
