"""Where paths through a junction are near each other, against the distances of all their points."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import shapely
import shapely.ops

from platoontraffic.road.lane_routes import Line
from platoontraffic.sumo.conflicts import (
    EQUAL,
    TAIL,
    TOUCHES,
    JudgedLine,
    Sampled,
    _front_along,
    _met,
    _path,
    _sampled,
    _touches,
)


@pytest.mark.parametrize("apart", [0.01, 0.5, 2.0, 50.0])
def test_the_stretches_are_those_of_the_points_that_are_nearer(apart):
    rng = np.random.default_rng(1)
    for _ in range(20):
        one, other = (Sampled(np.arange(k) / 4, rng.uniform(-9, 9, 2) + rng.normal(0, 0.3, (k, 2)).cumsum(axis=0))
                      for k in (30, 40))  # fmt: skip
        near = np.hypot(*(one.points[:, None] - other.points).transpose(2, 0, 1)) < apart
        mine, its = one.stations[near.any(axis=1)], other.stations[near.any(axis=0)]
        expected = ((mine[0], mine[-1]), (its[0], its[-1])) if near.any() else None
        assert _met(one, other, apart) == expected


@pytest.mark.parametrize("angle", [15, 30, 60, 90, 120, 150, 165])
def test_a_car_that_waits_before_another_path_is_not_touched_by_a_bus_there(angle):
    """Paths that cross at a small angle: one that waited by the middle of its front was touched twice.

    angle: of the bus's path, which crosses that of the car at its 20 m, from that one [degrees]
    """
    stations, width, (length, half) = np.arange(0.0, 40.0, 0.25), 3.2, (4.74, 0.88)
    own = Sampled(stations, np.column_stack([stations, np.zeros_like(stations)]))
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    path = Sampled(stations, np.array([20.0, 0.0]) + np.outer(stations - 20.0, along))
    stop = _touches(_front_along(own, half), path, TOUCHES * width)
    car = shapely.box(stop - length, -half, stop, half)
    bus = shapely.LineString(path.points).buffer(1.25, cap_style="flat")
    assert 0.1 < shapely.distance(car, bus) < 0.4


@pytest.mark.parametrize("steps", [20.0, 3.0, 0.5])
@pytest.mark.parametrize("count", [1, 2])
def test_a_path_is_that_of_its_lanes_and_the_begin_of_the_lane_beyond(steps, count):
    """Against shapely; the lanes touch, and have points twice."""
    rng, width = np.random.default_rng(round(10 * steps) + count), 3.2
    for _ in range(50):
        whole = np.repeat(rng.normal(0, steps, (4 * (count + 1) - count, 2)).cumsum(axis=0), rng.integers(1, 3), axis=0)
        parts = np.array_split(np.arange(len(whole)), count + 1)
        shapes = {
            f"{k}": [tuple(whole[i]) for i in (*part, *part[-1:] + 1) if i < len(whole)] for k, part in enumerate(parts)
        }
        sumo = SimpleNamespace(lane=SimpleNamespace(getShape=shapes.__getitem__, getWidth=lambda _: width))
        via, onto = [f"{k}" for k in range(count)], f"{count}"
        inside = shapely.LineString(np.concatenate([shapes[name] for name in via])).length
        line = shapely.LineString(whole)
        path = _path(via, onto, sumo)
        expected = shapely.ops.substring(line, 0.0, min(inside + TAIL * width, line.length))
        assert shapely.LineString(path).equals_exact(shapely.remove_repeated_points(expected), 1e-9)
        sampled = _sampled(path, 0.25)
        assert np.diff(sampled.stations) == pytest.approx(sampled.stations[1])
        assert 0.2 < sampled.stations[1] <= 0.25 + 1e-9
        there = shapely.get_coordinates(shapely.LineString(path).interpolate(sampled.stations))
        assert sampled.points == pytest.approx(there, abs=1e-9)


def test_a_judged_line_is_equal_to_itself_only():
    line = Line(7.0, "m", "", 0, "road_0", "next_0", (":a_0",), 10.0)
    network = SimpleNamespace(unregulated=frozenset())
    one, other = (JudgedLine.of(line, "car", network) for _ in range(2))
    assert one in {one: "conflicts"}
    assert other not in {one: "conflicts"}
    assert one != other
    assert (one.station, one.state, one.kind) == (0.0, "m", "car")
    assert JudgedLine.of(line, "truck", SimpleNamespace(unregulated=frozenset({":a_0"}))).state == EQUAL[0]
