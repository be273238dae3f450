"""A change that replaces the law of a scenario file: gains of the file that the other law lacks are left out."""

from __future__ import annotations

import pytest

from platoontraffic import scenario
from platoontraffic.errors import InputError


def test_gains_of_the_file_s_law_are_left_out_where_another_law_lacks_them():
    loaded = scenario.load("highway_traffic", ["platoon.follower.law=sumo"])
    assert {law.native for law in loaded.laws.values()} == {True}
    same = scenario.load("highway_traffic", ["platoon.follower.law=tracking"])
    assert {law.drives_alone for role, law in same.laws.items() if role[1] == "follower"} == {True}


def test_a_law_may_be_replaced_in_one_platoon():
    loaded = scenario.load("highway_traffic", ["platoon.2.follower.law=sumo"])
    assert [loaded.laws[i, "follower"].native for i in range(4)] == [False, False, True, False]


@pytest.mark.parametrize(
    "changes",
    [
        ["platoon.follower.law=sumo", "platoon.follower.on_loss=stop"],
        ["platoon.follower.on_loss=stop", "platoon.follower.law=sumo"],
        ["platoon.follower.on_los=stop", "platoon.follower.law=tracking"],
    ],
)
def test_gains_of_changes_are_never_left_out(changes):
    with pytest.raises(InputError, match="on_los"):
        scenario.load("highway_traffic", changes)
