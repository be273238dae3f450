"""Which vehicles touch each other or a wall: pymunk's shapes, fed from arrays."""

from __future__ import annotations

import numpy as np
import pymunk

from lidar import Scene
from platoontraffic.traffic import TrafficSnapshot

WALL = "wall"


class Contacts:
    """Pairs in contact, step by step.

    Vehicles are kinematic bodies: they are put where the snapshot has them, and nothing is pushed. Only pairs with at
    least one watched vehicle are reported.
    """

    def __init__(self, scene: Scene, watched: set[str]) -> None:
        self._space = pymunk.Space()
        self._watched = watched
        self._bodies: dict[str, pymunk.Body] = {}
        self._touching: set[tuple[str, str]] = set()
        for x0, y0, x1, y1 in scene.segments:
            wall = pymunk.Segment(self._space.static_body, (x0, y0), (x1, y1), 0)
            wall.collision_type = 0
            self._space.add(wall)
        self._names: dict[pymunk.Shape, str] = {}
        self._space.on_collision(None, None, pre_solve=self._note)

    def _note(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        pair = sorted(self._names.get(shape, WALL) for shape in arbiter.shapes)
        if self._watched.intersection(pair):
            # A member comes first, and a wall last.
            first, second = pair if pair[0] in self._watched and pair[0] != WALL else pair[::-1]
            self._touching.add((first, second))

    def of(self, traffic: TrafficSnapshot) -> set[tuple[str, str]]:
        """Pairs (vehicle, other vehicle or "wall") that touch in this snapshot."""
        for i, name in enumerate(traffic.ids):
            body = self._bodies.get(name) or self._add(name, traffic.length[i], traffic.width[i])
            body.position = traffic.x[i], traffic.y[i]
            body.angle = traffic.heading[i]
        for name in self._bodies.keys() - set(traffic.ids):
            body = self._bodies.pop(name)
            for shape in body.shapes:
                del self._names[shape]
            self._space.remove(body, *body.shapes)
        self._touching = set()
        self._space.step(1e-9)  # finds the contacts; kinematic bodies at rest do not move
        return self._touching

    def _add(self, name: str, length: float, width: float) -> pymunk.Body:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (length / 2, width / 2)
        shape = pymunk.Poly(body, [tuple(corner) for corner in corners])
        self._space.add(body, shape)
        self._bodies[name], self._names[shape] = body, name
        return body
