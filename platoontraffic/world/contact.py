"""Which vehicles touch each other or a wall: pymunk's shapes, fed from arrays."""

from __future__ import annotations

import numpy as np
import pymunk
from pymunk import batch

from platoontraffic.lidar import Scene
from platoontraffic.world.events import WALL
from platoontraffic.world.traffic import TrafficSnapshot

TOUCH = 1e-9  # nearer counts as touching; at 0, rounding and the order inside pymunk would decide [m]

# Pairs without a watched vehicle are dropped before their shapes are compared.
_WATCHED = pymunk.ShapeFilter(categories=0b01)
_UNWATCHED = pymunk.ShapeFilter(categories=0b10, mask=0b01)  # other vehicles and walls


class Contacts:
    """Pairs in contact, step by step.

    Vehicles are kinematic bodies: they are put where the snapshot has them, and nothing is pushed. Only pairs with at
    least one watched vehicle are reported. A vehicle keeps the size it came with until it is gone.
    """

    def __init__(self, scene: Scene, watched: set[str]) -> None:
        self._space = pymunk.Space()
        self._poses = BodyPoses(self._space)
        self._watched = watched
        self._ids: tuple[str, ...] | None = None  # of the snapshot before
        self._rows = np.empty(0, dtype=np.intp)  # of its vehicles in the table
        self._table = np.empty((0, 3))  # x, y, angle of all bodies; zeros for that of the walls
        self._bodies: dict[str, pymunk.Body] = {}
        self._body_id: dict[str, int] = {}
        self._names: dict[pymunk.Shape, str] = {}
        self._touching: set[tuple[str, str]] = set()
        for x0, y0, x1, y1 in scene.segments.tolist():
            wall = pymunk.Segment(self._space.static_body, (x0, y0), (x1, y1), 0)
            wall.filter = _UNWATCHED
            self._space.add(wall)
        self._space.on_collision(None, None, pre_solve=self._note)

    def of(self, traffic: TrafficSnapshot) -> set[tuple[str, str]]:
        """Pairs (vehicle, other vehicle or "wall") that touch in this snapshot; of two watched, the first by name."""
        if traffic.ids != self._ids:
            self._come_and_go(traffic)
        self._table[self._rows] = np.column_stack([traffic.x, traffic.y, traffic.heading])
        self._poses.set(self._table)
        self._touching = set()
        self._space.step(1e-9)  # finds the contacts; kinematic bodies at rest do not move
        return self._touching

    def _note(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        pair = sorted(self._names.get(shape, WALL) for shape in arbiter.shapes)
        # A member comes first, and a wall last.
        first, second = pair if pair[0] in self._watched and pair[0] != WALL else pair[::-1]
        self._touching.add((first, second))

    def _come_and_go(self, traffic: TrafficSnapshot) -> None:
        # Never in the order of a set, which is another in each process: equal runs build equal spaces.
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
        # Before it is in the space, which would note all pairs of thousands of vehicles at the origin.
        body.position, body.angle = (traffic.x[i], traffic.y[i]), traffic.heading[i]
        corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (traffic.length[i] / 2, traffic.width[i] / 2)
        shape = pymunk.Poly(body, corners.tolist(), radius=TOUCH / 2)
        shape.filter = _WATCHED if name in self._watched else _UNWATCHED
        self._space.add(body, shape)
        self._bodies[name], self._body_id[name], self._names[shape] = body, body.id, name


class BodyPoses:
    """Where all bodies of a space are, set at once.

    pymunk.batch calls itself experimental. Relied upon here, and kept by tests/test_contact.py: it walks all bodies in
    an order that changes only when one is added or removed, and that BODY_ID tells; the body of the walls is among
    them; POSITION | ANGLE are three numbers each; and the next step finds the shapes at their new places. It reads on
    where the numbers end, into whatever lies there.
    """

    def __init__(self, space: pymunk.Space) -> None:
        self._space = space
        self._ids, self._values = batch.Buffer(), batch.Buffer()  # kept, since pymunk never frees what is in them

    def order(self) -> np.ndarray:
        """Body.id for each row that `set` takes, (n,)."""
        self._ids.clear()
        batch.get_space_bodies(self._space, batch.BodyFields.BODY_ID, self._ids)
        return np.frombuffer(self._ids.int_buf(), dtype=np.uintp).copy()

    def set(self, poses: np.ndarray) -> None:
        """Put each body at x, y, angle, (n, 3)."""
        expected = len(self.order()), 3
        if poses.shape != expected:
            raise ValueError(f"poses have shape {poses.shape}; the bodies of the space need {expected}")
        self._values.set_float_buf(np.ascontiguousarray(poses, dtype=np.float64))
        batch.set_space_bodies(self._space, batch.BodyFields.POSITION | batch.BodyFields.ANGLE, self._values)
