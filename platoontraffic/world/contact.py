"""Contacts between vehicles, and of vehicles with walls: pymunk's shapes, fed from arrays."""

from __future__ import annotations

import numpy as np
import pymunk
from pymunk import batch

from platoontraffic.lidar import Scene
from platoontraffic.world.events import WALL
from platoontraffic.world.traffic import TrafficSnapshot

TOUCH = 1e-9  # distance below which shapes touch [m]; at 0, rounding and the order inside pymunk would decide

ROUNDING = 1e-6  # distance beyond which two bodies do not touch, whatever is rounded [m]

POSE = batch.BodyFields.POSITION | batch.BodyFields.ANGLE

# Pairs without a member are dropped before their shapes are compared.
_MEMBER = pymunk.ShapeFilter(categories=0b01)
_OTHER = pymunk.ShapeFilter(categories=0b10, mask=0b01)  # other vehicles and walls


class Contacts:
    """Pairs in contact, step by step; only those with at least one platoon member.

    Vehicles are kinematic bodies: they are set to their poses in the snapshot, and no contact pushes them. A vehicle
    keeps its first size until it leaves the snapshot.
    """

    def __init__(self, scene: Scene, members: set[str]) -> None:
        """scene: its segments are the walls; members: ids of all platoon members of the run"""
        from platoontraffic.world.walls_kernel import Walls, may_touch  # importing numba takes half a second

        self._space = pymunk.Space()
        self._poses = BodyPoses(self._space)
        self.members = members
        self._walls = tuple(Walls.of(scene.segments)) if len(scene.segments) else None
        self._may_touch = may_touch
        self._ids: tuple[str, ...] | None = None  # of the previous snapshot
        self._rows = np.empty(0, dtype=np.intp)  # of its vehicles in the table
        self._table = np.empty((0, 3))  # x, y, angle of all bodies; zeros for the body of the walls
        self._bodies: dict[str, pymunk.Body] = {}
        self._body_id: dict[str, int] = {}
        self._names: dict[pymunk.Shape, str] = {}
        self._touching: set[tuple[str, str]] = set()
        for x0, y0, x1, y1 in scene.segments.tolist():
            wall = pymunk.Segment(self._space.static_body, (x0, y0), (x1, y1), 0)
            wall.filter = _OTHER
            self._space.add(wall)
        self._space.on_collision(None, None, pre_solve=self._note)

    def close(self) -> None:
        """Take everything out of the space.

        With nothing in it pymunk frees it without calls of Python, in which Ctrl-C would leave it half freed.
        """
        self._space.remove(*self._space.shapes, *self._space.bodies)

    def release(self, name: str) -> None:
        """A vehicle that stays on the road is a member no more."""
        self.members.discard(name)
        for shape in self._bodies[name].shapes if name in self._bodies else ():
            shape.filter = _OTHER

    def may_touch_walls(self, traffic: TrafficSnapshot, n: int) -> bool:
        """Whether one of the first n vehicles may touch a wall."""
        if self._walls is None:
            return False
        size = traffic.length, traffic.width
        return self._may_touch(self._walls, n, traffic.x, traffic.y, traffic.facing, *size, ROUNDING)

    def of(self, traffic: TrafficSnapshot) -> set[tuple[str, str]]:
        """Pairs (member, other vehicle or WALL) that touch in this snapshot; of two members the first by name leads."""
        if traffic.ids != self._ids:
            self._come_and_go(traffic)
        self._table[self._rows] = np.array([traffic.x, traffic.y, traffic.heading]).T
        self._poses.set(self._table)
        self._touching = set()
        self._space.step(1e-9)  # detects the contacts; kinematic bodies at rest do not move
        return self._touching

    def _note(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        pair = sorted(self._names.get(shape, WALL) for shape in arbiter.shapes)
        # A member comes first, and a wall last.
        first, second = pair if pair[0] in self.members and pair[0] != WALL else pair[::-1]
        self._touching.add((first, second))

    def _come_and_go(self, traffic: TrafficSnapshot) -> None:
        # Not in the order of a set, which differs between processes: equal runs build equal spaces.
        here = set(traffic.ids)
        for name in [name for name in self._bodies if name not in here]:
            body = self._bodies.pop(name)
            for shape in body.shapes:
                del self._names[shape]
            del self._body_id[name]
            self._space.remove(body, *body.shapes)
        for i, name in enumerate(traffic.ids):
            if name not in self._bodies:
                self._add(traffic, i)
        order = self._poses.order()
        row = dict(zip(order.tolist(), range(len(order)), strict=True))
        self._rows = np.array([row[self._body_id[name]] for name in traffic.ids], dtype=np.intp)
        self._table = np.zeros((len(order), 3))
        self._ids = traffic.ids

    def _add(self, traffic: TrafficSnapshot, i: int) -> None:
        name = traffic.ids[i]
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        # Set before it enters the space, which would else report all pairs of thousands of vehicles at the origin.
        body.position, body.angle = (traffic.x[i], traffic.y[i]), traffic.heading[i]
        corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (traffic.length[i] / 2, traffic.width[i] / 2)
        shape = pymunk.Poly(body, corners.tolist(), radius=TOUCH / 2)
        shape.filter = _MEMBER if name in self.members else _OTHER
        self._space.add(body, shape)
        self._bodies[name], self._body_id[name], self._names[shape] = body, body.id, name


class BodyPoses:
    """Poses of all bodies of a space, set at once.

    pymunk.batch calls itself experimental. This class relies on the following, which tests/world/test_contact.py
    checks: it visits all bodies in an order that BODY_ID gives and that changes only when a body is added or removed;
    the body of the walls is one of them; POSITION | ANGLE are three numbers a body; and the next step finds the shapes
    at their new places. Given too few numbers it reads memory beyond them.
    """

    def __init__(self, space: pymunk.Space) -> None:
        self._space = space
        self._ids, self._values = batch.Buffer(), batch.Buffer()  # kept: pymunk never frees their contents
        self.order()

    def order(self) -> np.ndarray:
        """Body.id of each row that `set` takes, (n,)."""
        self._ids.clear()
        batch.get_space_bodies(self._space, batch.BodyFields.BODY_ID, self._ids)
        order = np.frombuffer(self._ids.int_buf(), dtype=np.uintp).copy()
        self._bodies = len(order)  # in the space
        return order

    def set(self, poses: np.ndarray) -> None:
        """Set each body to x, y, angle, (n, 3). None may have come or gone since `order` was called.

        raises: ValueError, if there is not one row a body
        """
        expected = self._bodies, 3
        if poses.shape != expected:
            raise ValueError(f"poses have shape {poses.shape}; the bodies of the space need {expected}")
        self._values.set_float_buf(np.ascontiguousarray(poses, dtype=np.float64))
        batch.set_space_bodies(self._space, POSE, self._values)
