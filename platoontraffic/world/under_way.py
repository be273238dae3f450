"""Scans and odometry readings under way from the sensor, which takes them, to the law, which is given them later."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.lidar import ScanBatch
from platoontraffic.vehicles.motion import Twist
from platoontraffic.vehicles.records import take
from platoontraffic.world.traffic import TrafficSnapshot


class Seen(NamedTuple):
    """The world at the instant at which m members were scanning."""

    traffic: TrafficSnapshot  # the hits of these scans are its rows
    rows: np.ndarray  # of the members in it, (m,)


class Taken(NamedTuple):
    """Scans of one laser of a group."""

    due: int  # step in which the law is given them
    scan: ScanBatch
    seen: Seen

    def part(self, stays: np.ndarray) -> Taken:
        """Those of some members, (m,) bool."""
        scan = self.scan.rows(stays)
        for array in (scan.ranges, scan.hits):
            array.setflags(write=False)  # as the laser's, or numba compiles once more
        return self._replace(scan=scan, seen=self.seen._replace(rows=self.seen.rows[stays]))


class UnderWay(NamedTuple):
    """Of one group, the oldest first. A laser's delay is constant, so none of its scans overtakes another."""

    scans: tuple[Taken, ...] = ()
    odometry: tuple[Twist, ...] = ()  # a reading a step

    def part(self, stays: np.ndarray) -> UnderWay:
        """That of some members, (m,) bool."""
        return UnderWay(tuple(one.part(stays) for one in self.scans), tuple(take(one, stays) for one in self.odometry))

    def after(self, taken: list[Taken], step: int) -> tuple[list[Taken], UnderWay]:
        """The scans that are due, and what is under way without them; taken: the new ones."""
        scans = (*self.scans, *taken)
        late = tuple(one for one in scans if one.due > step)
        return [one for one in scans if one.due <= step], self._replace(scans=late)

    def read(self, reading: Twist, delay: int) -> tuple[Twist, UnderWay]:
        """The reading of `delay` steps ago, or the first one before there is such, and what is under way after it."""
        readings = (*self.odometry, reading)[-delay - 1 :]
        return readings[0], self._replace(odometry=readings)
