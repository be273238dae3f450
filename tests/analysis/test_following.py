"""Predecessors over time, by the orders that members receive."""

from __future__ import annotations

import pandas as pd
import pytest

from platoontraffic.analysis import following
from platoontraffic.analysis.following import Stretch, lengths, split_off, stretches, within
from platoontraffic.world import events as kinds
from tests.results.test_metrics import events

PLACES = {f"p.{i}": ("p", i) for i in range(4)} | {"q.0": ("q", 0)}
END = 100.0


def stretches_after(*rows) -> dict[str, list[Stretch]]:
    departed = [(0.0, "departed", name) for name in PLACES]
    return stretches(PLACES, events(*departed, *rows), END)


def order(time: float, vehicle: str, what: str, behind: str = "", done: int = 1) -> tuple:
    return (time, "told", vehicle, behind, 0.0, what, done)


def test_without_orders_a_member_follows_the_place_ahead_while_both_are_on_the_road():
    of = stretches_after((80.0, "arrived", "p.1"), (90.0, "arrived", "p.2"))
    assert of == {
        "p.0": [], "q.0": [],
        "p.1": [Stretch(0, 80, "p.0")], "p.2": [Stretch(0, 80, "p.1")], "p.3": [Stretch(0, 90, "p.2")],
    }  # fmt: skip


def test_between_a_split_and_a_join_a_member_follows_nobody():
    of = stretches_after(order(20.0, "p.2", "split"), order(50.0, "p.2", "join", "p.1"))
    assert of["p.2"] == [Stretch(0, 20, "p.1"), Stretch(20, 50, ""), Stretch(50, 100, "p.1")]
    assert of["p.3"] == [Stretch(0, 100, "p.2")]


def test_a_rejected_order_changes_nothing():
    assert stretches_after(order(60.0, "p.2", "join", "q.0", done=0)) == stretches_after()


def test_followers_of_a_leaving_member_close_up_to_its_predecessor():
    of = stretches_after(order(30.0, "p.1", "leave"))
    assert of["p.1"] == [Stretch(0, 30, "p.0")]
    assert of["p.2"] == [Stretch(0, 30, "p.1"), Stretch(30, 100, "p.0")]
    assert stretches_after(order(30.0, "p.0", "leave"))["p.1"] == [Stretch(0, 30, "p.0")]


def test_a_leader_that_joins_is_a_follower_from_then_on():
    assert stretches_after(order(40.0, "q.0", "join", "p.3"))["q.0"] == [Stretch(40, 100, "p.3")]


def test_a_split_begins_at_an_instant():
    ((begin, _),) = split_off(events((16.1, "split", "p.2")), [Stretch(0, 100, "p.1")])
    assert begin == 14.1 != 16.1 - following.SPLIT_AFTER


def test_a_member_is_split_off_by_events_and_from_its_orders_until_it_has_rejoined():
    own = events(
        (12.0, "split", "p.2"), (15.0, "rejoined", "p.2"), order(20.0, "p.2", "split"),
        order(50.0, "p.2", "join", "p.1"), (58.0, "rejoined", "p.2"),
    )  # fmt: skip
    follows = [Stretch(0, 20, "p.1"), Stretch(20, 50, ""), Stretch(50, 100, "p.1")]
    off = split_off(own, follows)
    assert sorted(off) == [(10, 15), (20, 50), (50, 58)]
    assert lengths([(one.begin, one.end) for one in follows], off) == pytest.approx((100, 5 + 30 + 8))
    assert within(pd.Series([9.0, 10.0, 15.0, 57.0, 58.0]), off).tolist() == [False, True, False, True, False]


def test_constants_are_those_of_the_events():
    assert (following.SPLIT_AFTER, following.GONE) == (kinds.SPLIT_AFTER, kinds.GONE)


def test_events_of_version_0_1_tell_no_orders():
    departed = events(*((0.0, "departed", name) for name in PLACES)).drop(columns=["what", "done"])
    assert stretches(PLACES, departed, END)["p.2"] == [(0.0, END, "p.1")]


def test_orders_to_members_that_are_not_asked_for_change_nothing():
    departed = ((0.0, "departed", name) for name in PLACES)
    told = events(*departed, order(20.0, "r.1", "leave"))
    assert stretches(PLACES, told, END) == stretches_after()
