"""Platoons from the traffic: the predecessor of each member, and until when it is one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from platoontraffic.world.convoys import Convoys


@dataclass(frozen=True)
class Fleet:
    """As much of a fleet as `Convoys` uses."""

    members: tuple
    predecessor: np.ndarray
    leads: np.ndarray

    @property
    def ids(self):
        return tuple(m.id for m in self.members)

    def with_orders(self, predecessor, leads):
        return replace(self, predecessor=predecessor, leads=leads)


def fleet(*members):
    """members: id, platoon, place, edges; a platoon "" stands for a member that is in none"""
    made = tuple(
        SimpleNamespace(id=name, platoon=platoon, place=place, recruited=True, single=not platoon,
                        route=SimpleNamespace(edges=tuple(edges), speed_factor=1.0))
        for name, platoon, place, edges in members
    )  # fmt: skip
    return Fleet(made, np.full(len(made), -1), np.zeros(len(made), bool))


def test_members_follow_those_at_the_places_ahead():
    three = fleet(("b", "p.0", 1, "xy"), ("other", "", 0, "xy"), ("a", "p.0", 0, "xy"), ("c", "p.0", 2, "xy"))
    assert Convoys().joined(three, ["a", "b", "c", "other"]).predecessor.tolist() == [2, -1, -1, 0]


def test_a_member_that_departs_before_its_predecessor_has_none():
    convoys = Convoys()
    first = convoys.joined(fleet(("b", "p.0", 1, "xy")), ["b"])
    both = replace(fleet(("b", "p.0", 1, "xy"), ("a", "p.0", 0, "xy")), predecessor=np.array([*first.predecessor, -1]))
    assert convoys.joined(both, ["a"]).predecessor.tolist() == [-1, -1]


def test_a_member_has_no_predecessor_once_that_has_left_its_route():
    convoys = Convoys()
    both = convoys.joined(fleet(("a", "p.0", 0, "xyz"), ("b", "p.0", 1, "xyw")), ["a", "b"])
    for edge in ("x", "y", ":junction", ""):
        events, same = convoys.parted(both, [(edge, edge), ("x", "x_0")])
        assert events == []
        assert same is both
    events, after = convoys.parted(both, [("z", "z_0"), ("y", "y_0")])
    assert [(one.row, one.kind, one.other) for one in events] == [(1, "parted", "a")]
    assert after.predecessor.tolist() == [-1, -1]
    assert convoys.parted(after, [("z", "z_0"), ("y", "y_0")]) == ([], after)


def test_members_on_one_route_do_not_part():
    convoys = Convoys()
    both = convoys.joined(fleet(("a", "p.0", 0, "xyz"), ("b", "p.0", 1, "xyz")), ["a", "b"])
    assert convoys.parted(both, [("z", "z_0"), ("x", "x_0")]) == ([], both)
