"""Gaps along the paths that predecessors drove, and the gaps that laws want."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from platoontraffic.controllers.calls import desired_distance
from platoontraffic.controllers.law import Law
from platoontraffic.geometry.driven_paths import DrivenPaths
from platoontraffic.observation.gaps_kernel import locate
from platoontraffic.observation.step import Step
from platoontraffic.world.fleet import Fleet, Member

POINTS_PER_LENGTH = 24  # most points of a driven path within one vehicle length


class Gaps:
    """Gap and cross-track error of every follower, from the paths of all members' driven axles.

    Before its first point a path is prolonged backwards. Arrays (N,) of all members of the run, by their number; NaN
    without a predecessor, for a follower far aside of the prolonged part, for one that passes its predecessor, and for
    one that SUMO drives while it is not behind its predecessor on that path.
    """

    def __init__(self, members: Sequence[Member]) -> None:
        n = len(members)
        self.gap = np.full(n, np.nan)  # bumper to bumper along the predecessor's path [m]
        self.cross_track = np.full(n, np.nan)  # driven axle to the left of that path [m]
        self.beside = np.zeros(n, dtype=bool)  # so far aside of that path that it would not touch its predecessor there
        self._passed = np.zeros(n, dtype=bool)  # it has passed its predecessor
        self._paths = DrivenPaths(np.array([m.model.length for m in members]) / POINTS_PER_LENGTH)
        self._end = np.zeros(n)  # length of the own path one step before [m]
        self._station = np.zeros(n)  # on the predecessor's path [m]
        self._ahead = np.full(n, -1)  # number of that predecessor

    def begin(self, step: Step, new: np.ndarray) -> None:
        """Begin the path of each new member where its follower stands, which thereby is on it from the start.

        new: rows of the members that have just entered the road, (m,)
        """
        fleet, number, x, y = step.fleet, step.fleet.number, step.x, step.y
        length, heading = fleet.model.length, fleet.motion.heading
        back_x, back_y = x - length * np.cos(heading), y - length * np.sin(heading)
        followers = (fleet.predecessor >= 0).nonzero()[0]
        back_x[fleet.predecessor[followers]], back_y[fleet.predecessor[followers]] = x[followers], y[followers]
        self._paths.begin(number[new], back_x[new], back_y[new], x[new], y[new])
        self._end[number[new]] = self._paths.end(number[new])
        follows = new[fleet.predecessor[new] >= 0]
        ahead, anywhere = number[fleet.predecessor[follows]], np.full(len(follows), np.inf)
        station, _ = self._paths.project(ahead, x[follows], y[follows], np.zeros(len(follows)), anywhere)
        self._station[number[follows]], self._ahead[number[follows]] = np.nan_to_num(station), ahead

    def observe(self, step: Step) -> None:
        """Extend all paths to where the members are now; locate each follower on its predecessor's path."""
        fleet, model = step.fleet, step.fleet.model
        followers = self.gap, self.cross_track, self._end, self._station, self._ahead, self.beside, self._passed
        body, backwards = (model.length, model.width, model.axle), fleet.motion.speed < 0
        locate(self._paths.arrays, followers, step.fleet.number, fleet.predecessor, step.x, step.y, backwards, body,
               fleet.native)  # fmt: skip


class DesiredGaps:
    """The gaps that laws want at their vehicles' speeds; each law is asked once for all its vehicles."""

    def __init__(self, members: Sequence[Member]) -> None:
        self.laser_to_bumper = np.array([m.seen_ahead_of_gap for m in members])  # (N,) [m]
        self._members: Sequence[Member] = ()  # that are grouped by law
        self._laws: list[tuple[Law, np.ndarray]] = []
        self._less = np.empty(0)  # that the laws' distances are to be shortened by, (n,) [m]

    def of(self, fleet: Fleet) -> np.ndarray:
        """Bumper to bumper [m], (n,); NaN where a law names no distance."""
        if fleet.members is not self._members:
            self._members, self._laws = fleet.members, _by_law(fleet.members)
            by_laser = np.array([m.law.distance_from == "laser" for m in fleet.members], dtype=bool)
            self._less = np.where(by_laser, self.laser_to_bumper[fleet.number], 0.0)
        distance = np.empty(fleet.number.size)
        distance[:] = np.nan
        for law, rows in self._laws:
            speed = fleet.motion.speed[rows]
            try:
                distance[rows] = law.desired_distance(speed)
            except Exception:  # it takes one speed at a time; or it is faulty, and fails again here with a message
                distance[rows] = [desired_distance(law, v) for v in speed]
        return distance - self._less


def _by_law(members: Sequence[Member]) -> list[tuple[Law, np.ndarray]]:
    """Laws that keep a distance, each with the rows of its members."""
    rows: dict[Law, list[int]] = {}
    for i, m in enumerate(members):
        if type(m.law).desired_distance is not Law.desired_distance:
            rows.setdefault(m.law, []).append(i)
    return [(law, np.array(of_law)) for law, of_law in rows.items()]
