"""The leader `path` on lines that no road builder would draw, alone and without SUMO."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from platoontraffic.controllers.path import PathLeader
from platoontraffic.road.route import Route
from platoontraffic.road.turning import tight_turns
from platoontraffic.vehicles.bicycle import CARS
from tests.support.bench import FAR, NO_WALLS, drive, platoon

LIMIT = 13.9


def kinked(seed: int) -> np.ndarray:
    """A winding line with points shifted at random by up to 3 m, some of them close together."""
    rng = np.random.default_rng(seed)
    count = 30
    heading = np.cumsum(rng.normal(0, 0.35, count))
    step = rng.choice([3.0, 8.0, 20.0, 40.0], count)
    steps = np.column_stack([step * np.cos(heading), step * np.sin(heading)])
    points = np.cumsum(np.vstack([(0.0, 0.0), (30.0, 0.0), steps]), axis=0)
    points[2:] += rng.uniform(-1, 1, (count, 2)) * np.minimum(rng.exponential(1.0, (count, 1)), 3.0)
    return points


def driven(line: np.ndarray, kind: str, lateral: float = 0.0, turned: float = 0.0, speed: float = 0.0):
    """Distances from the line less the least ones there (k,) [m], log; without a limit of grip."""
    model = replace(CARS[kind], grip=np.inf)
    route = Route.along(("road",), line, np.full(len(line), LIMIT)).drivable_by(model)
    (member,) = platoon(PathLeader(), at=(-model.axle, lateral, turned), leader_eye=FAR, model=model)
    log = drive([replace(member, route=route, speed=speed)], NO_WALLS, 600.0, 0.1)
    heading = log.heading[:, 0]
    x, y = log.x[:, 0] + model.axle * np.cos(heading), log.y[:, 0] + model.axle * np.sin(heading)
    whole = shapely.LineString(line)
    off = shapely.distance(shapely.points(x, y), whole)
    stations = shapely.line_locate_point(whole, shapely.points(x, y))
    least = tight_turns([line], model.turning_radius).least_offset(stations)
    return off - least, log


def lateral_acceleration(log) -> np.ndarray:
    return np.abs(log.speed[1:, 0] * np.diff(log.turned[:, 0]) / np.diff(log.time))


@pytest.mark.parametrize("kind", ["car", "van"])
@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(s, marks=pytest.mark.slow) for s in range(4, 60))])
def test_it_keeps_to_any_line(seed, kind):
    beyond, log = driven(line := kinked(seed), kind)
    assert beyond.max() < 1.0
    assert lateral_acceleration(log).max() < 4.5
    assert np.hypot(log.x[-1, 0] - line[-1, 0], log.y[-1, 0] - line[-1, 1]) < 6.0


@pytest.mark.parametrize(("lateral", "turned", "speed"), [(2.0, 0.0, 14.0), (-15.0, 0.5, 8.0), (0.0, 3.0, 5.0)])
def test_it_comes_back_to_its_line_from_anywhere(lateral, turned, speed):
    line = np.array([(0.0, 0.0), (600.0, 0.0)])
    _, log = driven(line, "car", lateral, turned, speed)
    assert abs(log.y[-1, 0]) < 0.05
    assert lateral_acceleration(log).max() < 4.5
    assert np.abs(log.y[log.time > log.time[-1] - 10]).max() < 0.1


def test_from_a_stand_shortly_before_a_corner_it_is_no_faster_than_it_steers():
    """The engine's acceleration outlasts the command: farther off its line if that is left out."""
    model, line = CARS["car"], np.array([(0.0, 0.0), (7.0, 0.0), (7.0, 60.0)])
    route = Route.along(("road",), line, np.full(len(line), LIMIT)).drivable_by(model)
    (member,) = platoon(PathLeader(), at=(-model.axle, 0.0, 0.0), leader_eye=FAR, model=model)
    log = drive([replace(member, route=route, speed=0.0)], NO_WALLS, 20.0, 0.1)
    heading = log.heading[:, 0]
    axle = shapely.points(log.x[:, 0] + model.axle * np.cos(heading), log.y[:, 0] + model.axle * np.sin(heading))
    line = shapely.LineString(route.line.at(np.linspace(0.0, route.length, 2000)))
    assert log.y[-1, 0] > 50.0
    assert shapely.distance(axle, line).max() < 0.25
