"""The lines of lanes that come close to each other."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from shapely.geometry import LineString

from platoontraffic.road.lane_routes import ABREAST, TO_BORDER, LaneRoute

X = np.linspace(0.0, 80.0, 9)


def beside(apart: np.ndarray, cars: tuple[bool, bool] = (True, True)):
    """Two lanes of an edge along the x axis, so far apart (k,) [m]."""
    edge = SimpleNamespace()
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


def line_of(lane) -> LineString:
    route = LaneRoute(net=None)
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
