"""Which lanes a route takes."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from platoontraffic.road.lane_routes import ENOUGH_ROOM, Change, least_changes


class Edge(SimpleNamespace):
    __hash__ = object.__hash__


def lane(k: int, begin: float = 0.0) -> SimpleNamespace:
    """A lane along the x axis, from a place on it [m]."""
    shape = [(begin, 3.2 * k), (begin + 100.0, 3.2 * k)]
    return SimpleNamespace(getIndex=lambda: k, getShape=lambda: shape)


def road(*lengths: float) -> list[Edge]:
    """Edges of two lanes, each leading to the same lane of the next; the last but one leads on from its right lane."""
    edges = [Edge(getLength=lambda length=length: length) for length in lengths]
    for i, edge in enumerate(edges[:-1]):
        lanes = [lane(k) for k in ((0, 1) if i < len(edges) - 2 else (0,))]
        links = [SimpleNamespace(getFromLane=lambda one=one: one, getToLane=lambda one=one: one) for one in lanes]
        edge.getAllowedOutgoing = lambda _, links=links, onward=edges[i + 1]: {onward: links}
    return edges


@pytest.mark.parametrize(
    ("lengths", "position", "changes_on"),
    [
        ((200.0, 200.0, 200.0), 0.0, 0),  # early
        ((200.0, 200.0, 200.0), 150.0, 1),  # the first has only 50 m left
        ((40.0, 200.0, 200.0), 0.0, 1),
        ((40.0, 60.0, 90.0), 0.0, 1),  # where most room is
        ((60.0, 40.0, 90.0), 0.0, 0),
        ((ENOUGH_ROOM, 400.0, 90.0), 0.0, 0),  # more room than that is no better
        ((40.0, 60.0, 120.0, 90.0), 0.0, 2),
    ],
)
def test_lanes_are_changed_first_where_there_is_room(lengths, position, changes_on):
    links = least_changes(road(*lengths), 1, None, position)
    assert [link.getFromLane().getIndex() for link in links].index(0) == changes_on


def test_a_change_that_is_wanted_is_made_where_it_is_wanted_and_none_before():
    links = least_changes(road(200.0, 200.0, 200.0, 200.0), 1, None, 0.0, Change(1, 1, 0))
    assert [link.getFromLane().getIndex() for link in links] == [1, 0, 0]


@pytest.mark.parametrize("straight", [0, 1, 2])
def test_where_lanes_begin_the_straight_link_is_taken_rather_than_one_that_swerves(straight):
    """Of three lanes behind a bottleneck the first one was taken, 6 m aside within 8 m: members drove 4 m/s there."""
    here, there = Edge(getLength=lambda: 200.0), Edge(getLength=lambda: 200.0)
    one = lane(straight)
    links = [SimpleNamespace(getFromLane=lambda: one, getToLane=lambda k=k: lane(k, 108.0)) for k in range(3)]
    here.getAllowedOutgoing = lambda _: {there: links}
    (link,) = least_changes([here, there], straight, None)
    assert link.getToLane().getIndex() == straight
