"""Vehicles of the traffic that become members in the step in which SUMO inserts them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from platoontraffic.sumo.client import Client
from platoontraffic.sumo.frame import centre_of, heading_of
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.recruits import Newcomer, Recruits

AHEAD = 0.5  # length of lane that gives its direction [m]


class Recruiting:
    """Finds the new members of each step.

    step: of SUMO's [s]
    """

    def __init__(self, sumo: Client, recruits: Recruits, step: float) -> None:
        self._sumo, self._recruits, self._step = sumo, recruits, step
        self._number = 0  # of the next member of the run

    @property
    def waits(self) -> Mapping[str, float]:
        """Of vehicles, for others of their platoons [s]."""
        return self._recruits.waits

    def begin(self, members: int, departed: Iterable[str]) -> None:
        """
        members  : that the run has without those from the traffic
        departed : vehicles that departed while these were placed; they stay SUMO's
        """
        self._number = members
        self._recruits.begin()
        vehicle = self._sumo.vehicle
        here = set(vehicle.getIDList())
        for name in (one for one in departed if one in here):
            edge = vehicle.getRoute(name)[vehicle.getRouteIndex(name)]
            self._recruits.missed(name, vehicle.getTypeID(name), vehicle.getVehicleClass(name), edge)

    def newcomers(self, time: float, own: set[str]) -> Fleet | None:
        """Members among the vehicles that SUMO has inserted in the last step; None: there are none.

        time : now [s]
        own  : ids of vehicles that the run itself has inserted
        """
        found = []
        for name in self._sumo.simulation.getDepartedIDList():
            if name in own or not self._sumo.vehicle.getLaneID(name):  # a calibrator has removed it in the same step
                continue
            if member := self._member(name, time):
                found.append(member)
        if not found:
            return None
        numbers = np.arange(self._number, self._number + len(found))
        self._number += len(found)
        return Fleet.deployed(found, self._step, numbers)

    def _member(self, name: str, time: float) -> Member | None:
        vehicle = self._sumo.vehicle
        kind, vehicle_class = vehicle.getTypeID(name), vehicle.getVehicleClass(name)
        edges = vehicle.getRoute(name)
        equip = self._recruits.chosen(name, kind, vehicle_class, edges[vehicle.getRouteIndex(name)], time)
        return None if equip is None else self._recruits.member(equip, self._read(name, vehicle_class, edges), time)

    def _read(self, name: str, vehicle_class: str, edges: Sequence[str]) -> Newcomer:
        vehicle = self._sumo.vehicle
        length, heading = vehicle.getLength(name), self._heading(name)
        x, y = centre_of(*vehicle.getPosition(name), heading, length)
        return Newcomer(
            id=name,
            vehicle_class=vehicle_class,
            edges=tuple(edges[vehicle.getRouteIndex(name) :]),
            lane=vehicle.getLaneIndex(name),
            position=vehicle.getLanePosition(name),
            pose=(float(x), float(y), heading),
            speed=vehicle.getSpeed(name),
            length=length,
            width=vehicle.getWidth(name),
            speed_factor=vehicle.getSpeedFactor(name),
            max_speed=vehicle.getMaxSpeed(name),
            stops=bool(vehicle.getStops(name)),
        )

    def _heading(self, name: str) -> float:
        """Of a vehicle that has just been inserted [rad].

        Where its lane begins behind its front bumper, SUMO draws its rear on some lane that leads there. That is not on
        its route, and up to 115 degrees off on shipped networks. Its route goes straight back from there.
        """
        vehicle, position = self._sumo.vehicle, self._sumo.vehicle.getLanePosition(name)
        if position >= vehicle.getLength(name):
            return float(heading_of(vehicle.getAngle(name)))
        edge, lane = vehicle.getRoadID(name), vehicle.getLaneIndex(name)
        ahead = min(position + AHEAD, self._sumo.lane.getLength(vehicle.getLaneID(name)))
        ends = (self._sumo.simulation.convert2D(edge, place, lane) for place in (max(ahead - AHEAD, 0.0), ahead))
        (x, y), (there_x, there_y) = ends
        return math.atan2(there_y - y, there_x - x)
