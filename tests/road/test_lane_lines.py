"""The lines of lanes that come close to each other."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from shapely.geometry import LineString

from platoontraffic.road.lane_routes import ABREAST, TO_BORDER, TO_KERB, LaneRoute

X = np.linspace(0.0, 80.0, 9)


def beside(apart: np.ndarray, cars: tuple[bool, bool] = (True, True)):
    """Two lanes of an edge along the x axis, so far apart (k,) [m]."""
    nowhere = SimpleNamespace(getOutgoing=list)
    edge = SimpleNamespace(getFunction=str, getToNode=lambda: nowhere, getFromNode=lambda: nowhere)
    lines = [np.column_stack([X, side * apart / 2]) for side in (-1, 1)]
    lanes = [
        SimpleNamespace(
            getShape=lambda line=line: [tuple(point) for point in line],
            getEdge=lambda: edge,
            getIndex=lambda k=k: k,
            getWidth=lambda: 3.2,
            getSpeed=lambda: 14.0,
            allows=lambda _, cars=cars[k]: cars,
        )
        for k, line in enumerate(lines)
    ]
    edge.getLanes = lambda: lanes
    return lanes


def both_ways(line: np.ndarray, beside: np.ndarray, function: str = "", width: float = 3.2):
    """The lanes of two edges between two nodes, one to the other one and back, along points (k, 2) [m]."""
    nodes = [SimpleNamespace(), SimpleNamespace()]
    edges = [SimpleNamespace(getFunction=lambda: function) for _ in nodes]
    for k, (edge, points) in enumerate(zip(edges, (line, beside[::-1]), strict=True)):
        edge.getFromNode, edge.getToNode = (lambda k=k: nodes[k]), (lambda k=k: nodes[1 - k])
        nodes[k].getOutgoing = lambda edge=edge: [edge]
        lane = SimpleNamespace(
            getShape=lambda points=points: [tuple(point) for point in points],
            getEdge=lambda edge=edge: edge,
            getIndex=lambda: 0,
            getWidth=lambda: width,
            getSpeed=lambda: 14.0,
            allows=lambda _: True,
        )
        edge.getLanes = lambda lane=lane: [lane]
    return [edge.getLanes()[0] for edge in edges]


def line_of(lane, left_hand: bool = False) -> LineString:
    route = LaneRoute(net=None, left_hand=left_hand)
    route.add(lane)
    return LineString(route.joined()[0])


def test_lanes_that_come_too_close_are_driven_apart_within_their_widths():
    """As in a long bend of a junction in Bologna, where bodies side by side overlapped by 0.2 m."""
    lanes = beside(np.array([3.2, 2.8, 2.4, 2.0, 1.6, 1.8, 2.2, 2.8, 3.2]))
    lines, before = [line_of(lane) for lane in lanes], [LineString(lane.getShape()) for lane in lanes]
    for line, its, other in zip(lines, before, reversed(before), strict=True):
        assert line.distance(other) == pytest.approx(ABREAST, abs=0.02)
        assert line.hausdorff_distance(its) <= 1.6 - TO_BORDER + 1e-9
        assert line.coords[0] == its.coords[0]
        assert line.coords[-1] == its.coords[-1]
        assert np.abs(np.diff(line.coords, axis=0)[:, 1]).max() < 0.15  # nowhere a jump


@pytest.mark.parametrize(
    ("apart", "cars"),
    [
        (np.full(9, 3.2), (True, True)),
        (np.linspace(0.0, 3.2, 9), (True, True)),  # they begin as one
        (np.linspace(3.2, 0.0, 9), (True, True)),
        (np.linspace(3.2, -3.2, 9), (True, True)),  # they cross; the rounding of the line never ended
        (np.full(9, 1.8), (True, False)),  # a footpath beside
    ],
)
def test_other_lanes_are_driven_in_the_middle(apart, cars):
    lane = beside(apart, cars)[0]
    assert list(line_of(lane).coords) == lane.getShape()


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize("apart", [2.0, 1.4, 0.6, -0.4])
def test_where_lanes_of_two_directions_overlap_drivers_keep_to_their_side(apart, left_hand):
    """On roads with kinks; a member touched oncoming cars there, up to 0.4 m over, with 0.7 m beside it in its lane."""
    to_left = np.array([0.0, -1.0 if left_hand else 1.0])
    line = np.column_stack([X, np.zeros(9)])
    lane, its = both_ways(line, line + apart * to_left)
    by = min(ABREAST - apart, 1.6 - TO_KERB)
    driven = line_of(lane, left_hand)
    assert np.array(driven.coords)[5:-5] @ to_left == pytest.approx(-by, abs=0.03)
    assert line_of(its, left_hand).interpolate(0.5, normalized=True).y * to_left[1] == pytest.approx(apart + by)
    assert driven.coords[0] == (0.0, 0.0)
    assert driven.coords[-1] == (80.0, 0.0)


def test_it_leaves_a_bend_to_the_outside_or_the_inside_of_it():
    """Concentric arcs: the radius grows or shrinks by the same at every place."""
    angle = np.linspace(0.0, 1.5, 60)
    arc = np.column_stack([np.sin(angle), np.cos(angle)])  # to the right
    inner, outer = both_ways(38.0 * arc, 39.5 * arc)  # right-hand traffic: the outer one drives back
    assert np.hypot(*np.array(line_of(inner).coords)[12:-12].T) == pytest.approx(38.0 - (1.6 - TO_KERB), abs=0.02)
    assert np.hypot(*np.array(line_of(outer).coords)[12:-12].T) == pytest.approx(39.5 + (1.6 - TO_KERB), abs=0.02)


@pytest.mark.parametrize(("apart", "function", "width"), [(3.2, "", 3.2), (1.4, "internal", 3.2), (0.3, "", 0.6)])
def test_beside_an_oncoming_lane_that_is_far_enough_in_junctions_and_on_narrow_lanes_it_stays(apart, function, width):
    line = np.column_stack([X, np.zeros(9)])
    lane, _ = both_ways(line, line + np.array([0.0, apart]), function, width)
    assert list(line_of(lane).coords) == lane.getShape()
