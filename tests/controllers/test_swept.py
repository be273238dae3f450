"""What the body would touch in a tight bend, where its front swings out of the strip about its path."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from shapely import affinity

from platoontraffic.controllers import swept_kernel
from platoontraffic.controllers.law import Body, RouteAhead
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount, Noise, Scene
from platoontraffic.road.route import Route
from platoontraffic.vehicles.bicycle import CARS
from tests.controllers.test_creeping import footprints
from tests.support.bench import drive, platoon

CAR = CARS["car"]
EYES = {
    "path": replace(PRESETS["car-leader"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise()),
    "tracking": replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03), noise=Noise()),
}
LAWS = {"path": PathLeader(), "tracking": TrackingFollower(policy="obey", on_loss="drive")}
RADIUS, BEGINS = 6.5, 40.0


def bend(side: int) -> Route:
    """To the left (1) or to the right (-1)."""
    angle = np.linspace(0, math.pi / 2, 40)
    arc = np.column_stack([BEGINS + RADIUS * np.sin(angle), RADIUS * (1 - np.cos(angle))])
    points = np.vstack([[-200.0, 0.0], arc, [BEGINS + RADIUS, 300.0]]) * (1, side)
    return Route.along(("road",), points, np.full(len(points), 10.0)).drivable_by(CAR)


def beyond(radius: float, side: int) -> shapely.Polygon:
    """A body in the middle of the bend, so far from its centre, and 1 m long across."""
    body = shapely.box(radius, -0.5, radius + 1.0, 0.5)
    turned = affinity.translate(affinity.rotate(body, -45, origin=(0, 0)), BEGINS, RADIUS)
    return turned if side > 0 else affinity.scale(turned, 1, -1, origin=(0, 0))


def driven(law: str, side: int, body: shapely.Polygon):
    (member,) = platoon(LAWS[law], at=(0.0, 0.0, 0.0), leader_eye=EYES[law], model=CAR)
    member = replace(member, route=bend(side), speed=6.0)
    return drive([member], Scene.from_shapely(solids=[body]), 30.0, 0.1)


@cache
def undisturbed(law: str, side: int):
    log = driven(law, side, beyond(50.0, side))
    return log, shapely.union_all(footprints(log))


def outermost(law: str, side: int) -> float:
    """Distance from the centre of the bend that the body reaches in the middle of it [m]."""
    ground = undisturbed(law, side)[1]
    return next(radius for radius in np.arange(7.0, 9.0, 0.01) if not beyond(radius, side).intersects(ground))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("overlap", [0.05, 0.2])
def test_it_stops_before_a_body_that_its_front_would_swing_into(law, side, overlap):
    """As in Bologna, where cars in turn touched a bus that stood beside a sharp corner."""
    body = beyond(outermost(law, side) - overlap, side)
    assert body.distance(shapely.LineString(bend(side).line.points)) > 0.6 * CAR.width  # it is not in the strip
    log = driven(law, side, body)
    assert log.speed[-1, 0] < 0.01
    assert 0.02 < shapely.distance(footprints(log), body).min() < 3.0


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("side", [1, -1])
def test_it_does_not_slow_down_for_one_beside_that(law, side):
    body, (free, _) = beyond(outermost(law, side) + 0.25, side), undisturbed(law, side)
    log = driven(law, side, body)
    assert abs(log.y[-1, 0]) == pytest.approx(abs(free.y[-1, 0]), abs=0.5)


@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_what_it_would_touch_does_not_depend_on_what_is_in_memory(monkeypatch, speed):
    """The last place looked at was mixed with one that nobody had filled in, so runs of one seed went apart."""
    along = np.arange(0.0, 30.0, 0.5)
    arc = np.column_stack([np.sin(along / 8), 1 - np.cos(along / 8)]) * 8
    row = np.full((1, len(along)), 1 / 8)
    route = RouteAhead(along[None], arc[None], 10 * row, row, 0 * row)
    body = Body(*(np.array([getattr(CAR, name)]) for name in Body._fields))
    now = np.array([speed]), np.array([1 / 8])
    laser, whole = (np.array([CAR.length / 2 - CAR.axle]), 0.0), (np.full((1, 2), -1), np.array([np.inf]))

    def found(fill: float) -> list[float]:
        filled = SimpleNamespace(empty=lambda shape: np.full(shape, fill), inf=np.inf)
        monkeypatch.setattr(swept_kernel, "np", filled)
        frees = []
        for bearing in np.radians(np.arange(-40, 60, 5)):
            beams = np.array([[np.cos(bearing)], [np.sin(bearing)]])
            for r in np.arange(1.0, 8.0, 0.1):
                free, first = np.array([np.inf]), np.array([-1])
                seen = np.array([[r]]), 0.1, beams
                swept_kernel.first_touched.py_func(route, arc[None], *now, body, seen, laser, *whole, free, first)
                frees.append(free[0])
        return frees

    clean = found(0.0)
    assert np.isfinite(clean).any()
    assert not np.isfinite(clean).all()
    assert found(np.nan) == clean


@pytest.mark.parametrize(("aside", "heading"), [(0.5, -0.3), (-0.5, 0.3), (0.0, 0.3), (0.0, 0.0)])
def test_it_looks_at_its_body_on_a_straight_road_too_where_it_is_not_along_that(aside, heading):
    """In a lane change, at walking pace, a corner of a car's front touched the one from behind which it came."""
    along = np.arange(0.0, 30.0, 0.5)
    cos, sin = math.cos(heading), math.sin(heading)
    straight = np.column_stack([along, np.full_like(along, -aside)]) @ np.array([[cos, -sin], [sin, cos]])
    row = np.zeros((1, len(along)))
    route = RouteAhead(along[None], straight[None], 10 + row, row, row)
    body = Body(*(np.array([float(getattr(CAR, name))]) for name in Body._fields))
    places = np.empty((14, 4))
    swept_kernel.drive(route, straight, 0, swept_kernel.STEP, 0.5, 0.0, body, places)
    middle, half = CAR.length / 2, CAR.width / 2 + swept_kernel.CLEAR
    grown = shapely.union_all(
        [
            affinity.affine_transform(
                shapely.box(-middle - CAR.axle, -half, middle - CAR.axle, half), (c, -s, s, c, x, y)
            )
            for x, y, c, s in places
        ]
    )
    laser, whole = (np.array([middle - CAR.axle]), 0.0), (np.full((1, 2), -1), np.array([np.inf]))
    for bearing in np.radians(np.arange(-60.0, 61.0, 5.0)):
        for r in np.arange(0.5, 4.0, 0.25):
            beam = np.array([[math.cos(bearing)], [math.sin(bearing)]])
            place = shapely.Point(laser[0][0] + r * beam[0, 0], r * beam[1, 0])
            if abs(grown.exterior.distance(place)) < 0.03:
                continue
            free, first = np.array([np.inf]), np.array([-1])
            seen, now = (np.array([[r]]), 0.1, beam), (np.array([0.5]), np.array([0.0]))
            swept_kernel.first_touched(route, straight[None], *now, body, seen, laser, *whole, free, first)
            is_along = aside == heading == 0.0
            assert np.isfinite(free[0]) == (grown.contains(place) and not is_along)
