"""Creeping past what has not moved for long: which vehicles do, how fast, how near, and which do not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from shapely import affinity

from platoontraffic.controllers import creeping
from platoontraffic.controllers.path import PathLeader
from platoontraffic.lidar import PRESETS, Mount, Scene
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.world.traffic import TrafficSnapshot
from tests.controllers.test_path_leader import along, line

CAR = CARS["car"]
EYE = replace(PRESETS["car-leader"], mount=Mount(CAR.length / 2), noise=PRESETS["paper-leader"].noise)
STRAIGHT = line((0, 0), (400, 0))
STRIP = 0.6 * CAR.width  # the leader keeps free on each side


def nose(aside: float) -> shapely.Polygon:
    """A car that waits to turn across the path: oblique, a corner of its nose at x = 60 m, so far from the path."""
    car = affinity.rotate(shapely.box(0, 0, 4.7, 1.8), 150, origin="centroid")
    x, y = min(car.exterior.coords, key=lambda point: point[1])
    return affinity.translate(car, 60.0 - x, aside - y)


def footprints(log) -> np.ndarray:
    n = len(log.time)
    size = np.full(n, CAR.length), np.full(n, CAR.width)
    snapshot = TrafficSnapshot(
        0.0, tuple(map(str, range(n))), log.x[:, 0], log.y[:, 0], log.heading[:, 0], log.speed[:, 0], *size
    )
    return shapely.polygons(snapshot.boxes().corners())


def driven(body: shapely.Polygon, seconds: float = 60.0):
    return along(STRAIGHT, PathLeader(speed=10.0), Scene.from_shapely(solids=[body]), seconds, CAR, EYE, 10.0, 0.1)


@pytest.mark.parametrize("aside", [CAR.width / 2 + 0.12, STRIP - 0.05])
def test_it_creeps_past_a_nose_in_its_strip_that_its_body_passes(aside):
    log = driven(nose(aside))
    front, speed = log.x[:, 0] + CAR.length / 2, log.speed[:, 0]
    stood = log.time[speed < 0.05]
    assert stood[-1] - stood[0] > creeping.AFTER - 1.0
    assert front[-1] > 80
    assert speed[(front > 58) & (front < 60 + CAR.length / 2)].max() < creeping.SPEED * CAR.length + 0.05
    assert shapely.distance(footprints(log), nose(aside)).min() > 0.05


@pytest.mark.parametrize(("width", "passes"), [(0.5, False), (0.6, False), (1.2, True)])
def test_it_does_not_creep_past_what_may_be_a_person(width, passes):
    """In a grid with crossings members crept up to persons that waited for them, and touched them as they set out."""
    inner = CAR.width / 2 + 0.12
    body = shapely.box(60.0, inner, 60.0 + 0.5, inner + width)
    log = driven(body)
    assert (log.x[-1, 0] > 80) == passes


@pytest.mark.parametrize("aside", [-1.0, 0.0, CAR.width / 2 - 0.1, CAR.width / 2 + 0.02])
def test_it_stays_where_its_body_would_not_pass(aside):
    log = driven(nose(aside))
    assert log.speed[-1, 0] < 0.01
    assert shapely.distance(footprints(log), nose(aside)).min() > 0.2


def test_it_stops_when_what_it_creeps_past_moves():
    """The state alone: the obstacle comes 0.5 m nearer between two scans."""
    one = np.ones(1)
    sensed = SimpleNamespace(speed=1.0 * one, body=SimpleNamespace(length=CAR.length * one))
    state, no = creeping.Creeping(0 * one, CAR.length * one), np.zeros(1, dtype=bool)
    assert state.after(sensed, (2.9 * one, 0 * one, 3.0 * one), no, 0 * one, 0.1).active.all()
    assert not state.after(sensed, (2.4 * one, 0 * one, 3.0 * one), no, 0 * one, 0.1).active.any()
    assert not state.after(sensed, (2.9 * one, 0 * one, 3.0 * one), ~no, 0 * one, 0.1).active.any()  # a line closes


@pytest.mark.parametrize(("free", "speed", "sign"), [(0.0, 0.0, -1), (0.4, 0.0, -1), (0.4, 0.1, -1), (2.0, 0.0, 1)])
def test_it_does_not_set_out_nearer_than_it_stops(monkeypatch, free, speed, sign):
    """One that sets out at a stand, and brakes as soon as it moves, comes nearer by millimetres until it touches."""
    one = np.ones(1)
    monkeypatch.setattr(creeping, "swept", lambda *_: free)
    sensed = SimpleNamespace(speed=speed * one, age=0.0, body=SimpleNamespace(length=CAR.length * one))
    assert np.sign(creeping.acceleration(sensed, np.arange(1), 0 * one, 3.0)) == sign


def test_one_that_could_not_pass_tries_again_every_second(monkeypatch):
    """Hundreds stand in a jam: each of them in each step took a twentieth of a city's time."""
    one, tried = np.ones(1), []
    monkeypatch.setattr(creeping, "swept", lambda _, i, curvature: tried.append(round(state.stood[0], 1)) or 0.0)
    sensed = SimpleNamespace(speed=0 * one, body=SimpleNamespace(length=CAR.length * one))
    state, no = creeping.Creeping.none(1), np.zeros(1, dtype=bool)
    monkeypatch.setattr(creeping, "is_narrow", lambda *_: False)
    for _ in range(135):
        state = state.after(sensed, (1.0 * one, 0 * one, 1.0 * one), no, 0 * one, 0.1)
    assert tried == pytest.approx([creeping.AFTER + k for k in range(4)], abs=0.15)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("length", [4.0, 12.0, 25.0])
def test_it_creeps_on_with_a_body_close_beside_it(side, length):
    """It has come to a stand abreast; going straight on brings it no nearer, however long the body is."""
    wall = shapely.box(10.0, side * (CAR.width / 2 + 0.07), 10.0 + length, side * 4.0)
    log = along(STRAIGHT, PathLeader(speed=10.0), Scene.from_shapely(solids=[wall]), 60.0, CAR, EYE, 0.0, 0.1, at=10.0)
    assert log.x[-1, 0] > 40.0 + length
    assert shapely.distance(footprints(log), wall).min() > 0.03


def test_it_passes_a_nose_beside_its_strip_without_creeping():
    log = driven(nose(STRIP + 0.05), 20.0)
    assert log.speed[:, 0].min() > 9.5
