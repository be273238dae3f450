"""Contacts against an exact test of rectangles, and vehicles that enter and leave the snapshot."""

import numpy as np
import pymunk
import pytest
import shapely

from platoontraffic.lidar import Boxes, Scene
from platoontraffic.world.contact import WALL, BodyPoses, Contacts
from platoontraffic.world.traffic import TrafficSnapshot

NO_WALLS = Scene.from_shapely()
NEAR = 1e-6  # separation up to which either answer is right [m]


def snapshot(rows):
    """rows: x, y, heading, length, width by id"""
    x, y, heading, length, width = np.array(list(rows.values()), dtype=float).T
    return TrafficSnapshot(0.0, tuple(rows), x, y, heading, np.zeros_like(x), length, width)


def contacts_of(rows, scene=NO_WALLS, members=None):
    return Contacts(scene, set(rows) if members is None else members).of(snapshot(rows))


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
    """At random, and moved along the best axis until they nearly touch, or just do."""
    rng = np.random.default_rng(11)
    touching = 0
    for _ in range(1500):
        a, b = random_row(rng, 0.25), random_row(rng, 0.25)
        between, axis = separation(corners(*a), corners(*b))
        if closeness:
            b = (*(b[:2] + (rng.choice([-closeness, closeness]) - between) * axis), *b[2:])
            between, _ = separation(corners(*a), corners(*b))
        if abs(between) > NEAR:
            found = contacts_of({"a": a, "b": b}, members={"a"})
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


def test_a_contact_ends_when_a_vehicle_moves_away_or_leaves():
    contacts = Contacts(NO_WALLS, {"a"})
    a, b = (0.0, 0.0, 0.0, 0.2, 0.15), (0.15, 0.0, 0.0, 0.2, 0.15)
    for _ in range(3):
        assert contacts.of(snapshot({"a": a, "b": b})) == {("a", "b")}
    assert contacts.of(snapshot({"a": a, "b": (0.25, *b[1:])})) == set()
    assert contacts.of(snapshot({"a": a, "b": b})) == {("a", "b")}
    assert contacts.of(snapshot({"a": a})) == set()
    assert contacts.of(snapshot({"a": a, "c": b})) == {("a", "c")}


def touching_by_shapely(rows, scene, members):
    names = list(rows)
    x, y, heading, length, width = np.array(list(rows.values())).T
    boxes = shapely.polygons(Boxes(x, y, heading, length, width, np.arange(len(rows))).corners())
    walls = shapely.linestrings(scene.segments.reshape(-1, 2, 2))
    vehicles = shapely.STRtree(boxes).query(boxes, "intersects").T
    pairs = {tuple(sorted(names[i] for i in pair)) for pair in vehicles if pair[0] != pair[1]}
    pairs = {pair if pair[0] in members else pair[::-1] for pair in pairs}
    pairs |= {(names[i], WALL) for i, _ in shapely.STRtree(walls).query(boxes, "intersects").T}
    return {pair for pair in pairs if pair[0] in members}


def test_contacts_in_a_changing_crowd_are_those_of_shapely():
    rng = np.random.default_rng(14)
    names = [f"veh.{i}" for i in range(80)]
    size = dict(zip(names, rng.uniform(0.05, 0.5, (80, 2)), strict=True))
    members = set(names[::3])
    scene = Scene(rng.uniform(-2, 2, (6, 4)))
    contacts = Contacts(scene, members)
    found = 0
    for _ in range(60):
        here = rng.permutation(names)[: rng.integers(1, 80)]
        rows = {name: (*rng.uniform(-2, 2, 2), rng.uniform(-np.pi, np.pi), *size[name]) for name in here.tolist()}
        touching = contacts.of(snapshot(rows))
        assert touching == touching_by_shapely(rows, scene, members)
        assert touching == contacts.of(snapshot(dict(reversed(rows.items()))))
        found += len(touching)
    assert found > 500


def test_a_vehicle_that_returns_has_its_new_size():
    contacts = Contacts(NO_WALLS, {"m"})
    other, small, large = (0.0, 0.0, 0.0, 0.2, 0.15), (0.25, 0.0, 0.0, 0.2, 0.15), (0.25, 0.0, 0.0, 0.4, 0.15)
    assert contacts.of(snapshot({"m": small, "z": other})) == set()
    assert contacts.of(snapshot({"z": other})) == set()
    assert contacts.of(snapshot({"z": other, "m": large})) == {("m", "z")}


def test_an_empty_road_has_no_contacts():
    contacts = Contacts(Scene(np.array([(-1, 0, 1, 0)])), {"m"})
    empty = TrafficSnapshot(0.0, (), *np.empty((6, 0)))
    at = (0.0, 0.0, 0.0, 0.2, 0.15)
    for _ in range(2):
        assert contacts.of(empty) == set()
        assert contacts.of(snapshot({"m": at})) == {("m", "wall")}


def test_walls_stay_in_place_while_vehicles_are_set():
    rng = np.random.default_rng(15)
    contacts = Contacts(Scene(np.array([(3, 2, 3, 4)])), {"m"})
    for step in range(100):
        others = {f"veh.{step + i}": random_row(rng, 5) for i in range(20)}
        for miss in (1e-5, -1e-5):
            touching = contacts.of(snapshot({"m": (2.9 - miss, 3, 0, 0.2, 0.15), **others}))
            assert (("m", "wall") in touching) == (miss < 0)
        contacts._space.reindex_static()  # pymunk reads the place of walls only then


@pytest.mark.parametrize("heading", [0, np.pi / 2, np.pi, -np.pi / 2])
def test_exactly_bumper_to_bumper_is_contact_in_every_order(heading):
    at = {f"veh.{i}": (*(i * np.array([np.cos(heading), np.sin(heading)])), heading, 1, 0.5) for i in range(9)}
    neighbours = {(f"veh.{i}", f"veh.{i + 1}") for i in range(8)}
    rng = np.random.default_rng(16)
    for _ in range(10):
        contacts = Contacts(NO_WALLS, set(at))
        for _ in range(3):
            here = rng.permutation(list(at))
            assert contacts.of(snapshot({name: at[name] for name in here})) == neighbours
            contacts.of(snapshot({name: at[name] for name in here[:3]}))


def space_of_bodies(n):
    space = pymunk.Space()
    space.add(pymunk.Segment(space.static_body, (-9, -9), (-9, 9), 0))
    bodies = [pymunk.Body(body_type=pymunk.Body.KINEMATIC) for _ in range(n)]
    for body in bodies:
        space.add(body, pymunk.Poly.create_box(body, (0.5, 0.5)))
    return space, bodies


@pytest.mark.parametrize("shape", [(3, 3), (5, 3), (4, 2), (12,)])
def test_the_wrong_number_of_poses_is_an_error_and_never_reaches_pymunk(shape):
    space, bodies = space_of_bodies(3)
    with pytest.raises(ValueError, match=r"the bodies of the space need \(4, 3\)"):
        BodyPoses(space).set(np.ones(shape))
    assert [body.position for body in bodies] == [(0, 0)] * 3


def test_each_body_is_set_to_its_own_pose_and_found_there_after_a_step():
    space, bodies = space_of_bodies(5)
    poses = BodyPoses(space)
    for x in (2, 4, 6):
        order = poses.order().tolist()
        where = np.zeros((len(order), 3))
        for i, body in enumerate(bodies):
            where[order.index(body.id)] = x, i, 0.1 * i
        poses.set(where)
        space.step(1e-9)
        for i, body in enumerate(bodies):
            assert (body.position, body.angle) == ((x, i), 0.1 * i)
            assert space.point_query_nearest((x, i), 0, pymunk.ShapeFilter()).shape.body is body
            assert not space.point_query((x - 2, i), 0, pymunk.ShapeFilter())
        assert (space.static_body.position, space.static_body.angle) == ((0, 0), 0)
        space.remove(bodies[0], *bodies.pop(0).shapes)  # this changes the order


def test_contacts_do_not_depend_on_the_order_of_vehicles():
    rng = np.random.default_rng(13)
    rows = {f"veh.{i}": random_row(rng, 0.8) for i in range(30)}
    members = {f"veh.{i}" for i in range(0, 30, 3)}
    wall = Scene(np.array([(-1, 0, 1, 0)]))
    found = contacts_of(rows, wall, members)
    assert len(found) > 10
    for _ in range(5):
        shuffled = {name: rows[name] for name in rng.permutation(list(rows))}
        assert contacts_of(shuffled, wall, members) == found


def test_only_pairs_with_a_member_are_reported_and_it_comes_first():
    at = (0.0, 0.0, 0.0, 0.2, 0.15)
    rows = {"a": at, "m": at, "z": at}
    assert contacts_of(rows, members={"m"}) == {("m", "a"), ("m", "z")}


def test_a_member_that_is_none_any_more_is_noted_with_members_only():
    rows = {"a": (0, 0, 0, 4, 2), "b": (1, 0, 0, 4, 2), "m": (2, 0, 0, 4, 2)}
    contacts = Contacts(NO_WALLS, {"a", "m"})
    assert contacts.of(snapshot(rows)) == {("a", "b"), ("a", "m"), ("m", "b")}
    contacts.release("a")
    assert contacts.of(snapshot(rows)) == {("m", "a"), ("m", "b")}


def test_no_wall_is_touched_that_was_not_asked_for():
    """Boxes that wander among walls: while no member may touch a wall, none does."""
    rng, may, touched = np.random.default_rng(5), 0, 0
    walls = rng.uniform(-4, 4, (10, 1, 2)) + rng.uniform(-1, 1, (10, 2, 2))
    contacts = always = Contacts(NO_WALLS, set())
    for k in range(3000):
        if k % 1000 == 0:
            contacts, always = (Contacts(Scene(walls.reshape(-1, 4)), set("ab")) for _ in range(2))
            rows = {name: np.array([0.0, 0.0, 0.0, *rng.uniform(0.1, 0.6, 2)]) for name in "abc"}
        if k % 100 == 0:
            for row in rows.values():
                row[:2] = rng.uniform(-4, 4, 2)
        for row in rows.values():
            row[:3] += rng.normal(0, 0.02, 3)
        now = snapshot(rows)
        touches = any(other == WALL for _, other in always.of(now))
        asked = contacts.may_touch_walls(now, 2)
        assert asked or not touches
        may, touched = may + asked, touched + touches
    assert 0 < touched == may < 2500
    assert not Contacts(NO_WALLS, {"a"}).may_touch_walls(now, 2)
