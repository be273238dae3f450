"""Which lanes a route takes."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from platoontraffic.road.lane_routes import ENOUGH_ROOM, Change, least_changes


class Edge(SimpleNamespace):
    __hash__ = object.__hash__


def road(*lengths: float) -> list[Edge]:
    """Edges of two lanes, each leading to the same lane of the next; the last but one leads on from its right lane."""
    edges = [Edge(getLength=lambda length=length: length) for length in lengths]
    for i, edge in enumerate(edges[:-1]):
        lanes = [SimpleNamespace(getIndex=lambda k=k: k) for k in ((0, 1) if i < len(edges) - 2 else (0,))]
        links = [
            SimpleNamespace(getFromLane=lambda lane=lane: lane, getToLane=lambda lane=lane: lane) for lane in lanes
        ]
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
