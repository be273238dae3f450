"""Contacts against an exact test of rectangles, and the bookkeeping of vehicles that come and go."""

import numpy as np
import pytest
import shapely

from lidar import Boxes, Scene
from platoontraffic.contact import Contacts
from platoontraffic.traffic import TrafficSnapshot

NO_WALLS = Scene.from_shapely()
NEAR = 1e-6  # of touching, where either answer is right [m]


def snapshot(rows):
    """Rows id -> x, y, heading, length, width."""
    x, y, heading, length, width = np.array(list(rows.values()), dtype=float).T
    return TrafficSnapshot(0.0, tuple(rows), x, y, heading, np.zeros_like(x), length, width)


def contacts_of(rows, scene=NO_WALLS, watched=None):
    return Contacts(scene, set(rows) if watched is None else watched).of(snapshot(rows))


def separation(a, b):
    """Gap between two convex polygons (k, 2) along the best axis (2,), which leads from a to b; negative: overlap.

    The axes are the directions of all sides and their normals.
    """
    sides = np.vstack([np.roll(shape, -1, axis=0) - shape for shape in (a, b)])
    axes = np.vstack([sides, np.column_stack([-sides[:, 1], sides[:, 0]])]) / np.tile(np.hypot(*sides.T), 2)[:, None]
    axes = np.vstack([axes, -axes])
    gaps = (b @ axes.T).min(axis=0) - (a @ axes.T).max(axis=0)
    return float(gaps.max()), axes[gaps.argmax()]


def corners(*row):
    return Boxes(*([value] for value in row), owner=[0]).corners()[0]


def random_row(rng, spread):
    return (*rng.uniform(-spread, spread, 2), rng.uniform(-np.pi, np.pi), *rng.uniform(0.05, 0.5, 2))


@pytest.mark.parametrize("closeness", [None, 1e-5])
def test_vehicles_touch_as_separating_axes_say(closeness):
    """Anywhere, and pushed together or apart along the best axis until they all but touch."""
    rng = np.random.default_rng(11)
    touching = 0
    for _ in range(1500):
        a, b = random_row(rng, 0.25), random_row(rng, 0.25)
        between, axis = separation(corners(*a), corners(*b))
        if closeness:
            b = (*(b[:2] + (rng.choice([-closeness, closeness]) - between) * axis), *b[2:])
            between, _ = separation(corners(*a), corners(*b))
        if abs(between) > NEAR:
            found = contacts_of({"a": a, "b": b}, watched={"a"})
            assert found == ({("a", "b")} if between < 0 else set()), (a, b, between)
        touching += between < 0
    assert 300 < touching < 1200


def test_walls_are_touched_as_separating_axes_say():
    rng = np.random.default_rng(12)
    for _ in range(1000):
        robot, wall = random_row(rng, 0.4), rng.uniform(-0.5, 0.5, (2, 2))
        between, _ = separation(corners(*robot), wall)
        if abs(between) > NEAR:
            found = contacts_of({"a": robot}, Scene(wall.reshape(1, 4)))
            assert found == ({("a", "wall")} if between < 0 else set()), (robot, wall, between)


@pytest.mark.parametrize("miss", [1e-5, -1e-5])
def test_bumper_to_bumper_and_bumper_to_wall(miss):
    wall = Scene.from_shapely(walls=[shapely.LineString([(0.4 + miss, -1), (0.4 + miss, 1)])])
    rows = {"a": (0.3, 0, 0, 0.2, 0.15), "b": (0.1 - miss, 0.05, 0, 0.2, 0.15)}
    assert contacts_of(rows, wall) == (set() if miss > 0 else {("a", "wall"), ("a", "b")})


def test_a_vehicle_that_moves_away_or_is_gone_touches_no_more():
    contacts = Contacts(NO_WALLS, {"a"})
    a, b = (0.0, 0.0, 0.0, 0.2, 0.15), (0.15, 0.0, 0.0, 0.2, 0.15)
    for _ in range(3):
        assert contacts.of(snapshot({"a": a, "b": b})) == {("a", "b")}
    assert contacts.of(snapshot({"a": a, "b": (0.25, *b[1:])})) == set()
    assert contacts.of(snapshot({"a": a, "b": b})) == {("a", "b")}
    assert contacts.of(snapshot({"a": a})) == set()
    assert contacts.of(snapshot({"a": a, "c": b})) == {("a", "c")}


def test_contacts_do_not_depend_on_the_order_of_vehicles():
    rng = np.random.default_rng(13)
    rows = {f"veh.{i}": random_row(rng, 0.8) for i in range(30)}
    watched = {f"veh.{i}" for i in range(0, 30, 3)}
    wall = Scene(np.array([(-1, 0, 1, 0)]))
    found = contacts_of(rows, wall, watched)
    assert len(found) > 10
    for _ in range(5):
        shuffled = {name: rows[name] for name in rng.permutation(list(rows))}
        assert contacts_of(shuffled, wall, watched) == found


def test_only_pairs_with_a_watched_vehicle_are_told_and_it_comes_first():
    at = (0.0, 0.0, 0.0, 0.2, 0.15)
    rows = {"a": at, "m": at, "z": at}
    assert contacts_of(rows, watched={"m"}) == {("m", "a"), ("m", "z")}
