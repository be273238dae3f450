"""Obstacles as vehicles of SUMO's, for its drivers to brake for."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Set
from itertools import compress

import numpy as np
import shapely

from platoontraffic.sumo.background import Background
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.frame import front_of, sumo_angle
from platoontraffic.sumo.placement import ANY_LANE, EXACTLY
from platoontraffic.sumo.vehicle_types import ANY_SPEED, kind_of, make_type, release
from platoontraffic.world.traffic import TrafficSnapshot

MAX_SPEED = 150.0  # of their vehicle types [m/s]


class HeldObstacles:
    """Obstacles on the road; those that SUMO has as vehicles are moved in every step.

    drivable: area; an obstacle is a vehicle in SUMO only while its centre is in it
    """

    def __init__(self, sumo: Client, drivable: shapely.Geometry, background: Background) -> None:
        self._sumo, self._drivable, self._background = sumo, drivable, background
        self.bodies: TrafficSnapshot | None = None  # all obstacles; None: there are none
        self._routes: dict[str, tuple[str, ...]] = {}  # edges that each obstacle in SUMO means to drive
        self.in_sumo: Set[str] = self._routes.keys()  # ids of obstacles that SUMO has as vehicles
        self._routed: dict[str, str] = {}  # first edge of the route last set in SUMO

    def hold(self, obstacles: TrafficSnapshot, routes: Mapping[str, tuple[str, ...]], members: Collection[str]) -> None:
        """Obstacles at the end of the coming step, or now before the first.

        routes : by obstacle that SUMO shall have, the edges it means to drive, which may be none
        members: ids; a background vehicle where an obstacle appears is removed, a member is not
        """
        if not obstacles.ids and not self._routes:
            self.bodies = None
            return
        on_road = shapely.contains_xy(self._drivable, obstacles.x, obstacles.y)
        routes = {name: routes[name] for name in compress(obstacles.ids, on_road) if name in routes}
        self._remove(self._routes.keys() - routes.keys())
        self.bodies = obstacles
        x, y = front_of(obstacles.x, obstacles.y, obstacles.heading, obstacles.length)
        angle = sumo_angle(obstacles.heading)
        for i, name in enumerate(obstacles.ids):
            if name not in routes:
                continue
            if name not in self._routes:
                self._make_room(i, members)
                self._insert(i)
                self._routes[name] = routes[name]
            self._sumo.vehicle.moveToXY(name, *ANY_LANE, float(x[i]), float(y[i]), float(angle[i]), *EXACTLY)

    def _remove(self, names: Set[str]) -> None:
        for name in sorted(names):
            self._sumo.vehicle.remove(name)
            del self._routes[name]
            self._routed.pop(name, None)

    def _make_room(self, i: int, members: Collection[str]) -> None:
        """Remove background vehicles that the obstacle in row i overlaps."""
        names = [name for name in self._sumo.vehicle.getIDList() if name not in members and name not in self._routes]
        vehicles = shapely.polygons(self._background.read(names, self.bodies.time).boxes().corners())
        own = shapely.polygons(self.bodies.boxes().corners()[i])
        for k in np.flatnonzero(shapely.intersects(vehicles, own)):
            self._sumo.vehicle.remove(names[k])

    def _insert(self, i: int) -> None:
        """Add a vehicle of the obstacle's size, on the edge to which it is then moved."""
        name = self.bodies.ids[i]
        kind = kind_of(name)
        if kind not in self._sumo.vehicletype.getIDList():
            make_type(self._sumo, kind, float(self.bodies.length[i]), float(self.bodies.width[i]))
            self._sumo.vehicletype.setSpeedFactor(kind, ANY_SPEED)
            self._sumo.vehicletype.setMaxSpeed(kind, MAX_SPEED)
        self._sumo.vehicle.add(name, "", typeID=kind)
        release(self._sumo, name)

    def settle(self) -> None:
        """Correct their speeds and routes in SUMO after a step."""
        if not self._routes:
            return
        vehicle, speeds = self._sumo.vehicle, dict(zip(self.bodies.ids, self.bodies.speed.tolist(), strict=True))
        for name, route in self._routes.items():
            if not vehicle.getLaneID(name):  # getRoadID of a vehicle that was never on a lane kills the process
                continue
            vehicle.setPreviousSpeed(name, speeds[name])
            edge = vehicle.getRoadID(name) if route else ""
            if edge not in route or self._routed.get(name) == edge:
                continue
            if vehicle.getRoute(name)[vehicle.getRouteIndex(name)] == edge:
                vehicle.setRoute(name, list(route[route.index(edge) :]))
                self._routed[name] = edge
