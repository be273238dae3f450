"""The table of event kinds: what the data dictionary says of thresholds, words and causes."""

from __future__ import annotations

import pytest

from platoontraffic.world import events
from platoontraffic.world.events import CAUSES, EVENT_KINDS, KINDS


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("split", f"for {events.SPLIT_AFTER:g} s"),
        ("split", f"more than {events.SPLIT_GAP_FACTOR:g} times"),
        ("split", f"more than {events.SPLIT_GAP_MARGIN:g} m (times length / 4.74 m if it is shorter than 2 m) longer"),
        ("held", f"{events.HELD_DISTANCE:g} m (both times length / 4.74 m"),
        ("standstill", f"{events.STANDSTILL_AFTER:g} s"),
        ("near_miss", f"{events.NEAR_MISS_GAP:g} m (times length / 4.74 m"),
        ("emergency_brake", f"{events.EMERGENCY_BRAKING:g} m/s2"),
        ("off_road", f"{events.OFF_ROAD_DISTANCE:g} m (times length / 4.74 m"),
        ("collision", f"{events.LANE_CHANGE_BLAME:g} s before"),
    ],
)
def test_the_data_dictionary_names_every_threshold_and_its_scaling(kind, text):
    assert text in KINDS[kind]


def test_the_data_dictionary_lists_the_words_of_a_kind():
    assert KINDS["told"].endswith("(what: split, join, leave)")
    assert "(what:" not in KINDS["rejoined"]


def test_words_are_words_and_no_kind_has_one_twice():
    for kind in EVENT_KINDS.values():
        assert len(set(kind.words)) == len(kind.words)
        assert all(word.replace("_", "").isalpha() and word.islower() for word in kind.words)


def test_causes_are_sorted_before_what_may_follow_from_them():
    assert {"departed", "obstacle", "told", "breaks_down", "repaired"} == CAUSES
