"""Roads that cross on another level, by their lines alone."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic.road.levels import crossings


def straight(start, end, lanes=1):
    start, end = np.array(start, float), np.array(end, float)
    along = (end - start) / np.hypot(*(end - start))
    left = np.array([-along[1], along[0]])
    return [np.array([start, end]) + 3.2 * k * left for k in range(lanes)]


EAST = straight((0, 0), (200, 0), lanes=2)


@pytest.mark.parametrize("lanes", [1, 2])
def test_roads_that_cross_away_from_their_ends_are_on_two_levels(lanes):
    found = crossings({"a": EAST, "b": straight((60, -80), (60, 90), lanes)}, ["a", "b"])
    middle = (60.0 - 1.6 * (lanes - 1), 1.6)
    assert found["a"] == [("b", pytest.approx(middle[0]), pytest.approx(middle[1]))]
    assert found["b"] == [("a", pytest.approx(middle[0]), pytest.approx(middle[1]))]


@pytest.mark.parametrize(
    "other",
    [
        straight((200, 0), (200, 90)),  # they meet at a junction
        straight((60, 0), (60, 90)),  # as does one that ends on the other
        straight((60, -3), (60, 90)),  # with a lane that reaches beyond it
        straight((0, 6.4), (200, 6.4)),  # side by side
        straight((60, 20), (60, 90)),
        EAST,
    ],
)
def test_roads_that_meet_at_an_end_or_not_at_all_are_on_one(other):
    assert crossings({"a": EAST, "b": other}, ["a"]) == {"a": []}


def test_a_road_may_have_several_bridges():
    over = {f"b{k}": straight((x, -50), (x + 10, 60)) for k, x in enumerate((40, 120))}
    found = crossings({"a": EAST, **over}, ["a"])
    assert [name for name, *_ in found["a"]] == ["b0", "b1"]
