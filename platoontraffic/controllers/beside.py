"""Looking beside and behind before a follower goes over to another lane, by its own laser.

A follower knows by its route where the lanes lie. The lane offset of a place is its distance to the left of the lane on
which the route began, prolonged beside the route. The goal of a follower is the place of its predecessor, or its route.
If the goal is on another lane, the first returns ahead and behind on that side, and the rates at which they come
nearer, say whether there is room (`lane_room`); a rate is known from the second scan on. Without room the follower
stays on its lane: it drives its route, shifted to that lane. When there has been room for a moment it goes over, along
a cosine. The laser sees nothing that a body hides or that is out of range.

The rule itself is in `beside_kernel`. In a street, near stop lines, it is too slow: a follower that stays or goes over
there comes to the line on the wrong lane. So below ENDS it gives it up as soon as nothing is abreast or will soon be so
from behind, and drives as its predecessor did, without looking, until it is faster than BEGINS.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.lane_room import ANOTHER
from platoontraffic.controllers.law import RouteAhead, Sensed
from platoontraffic.controllers.tracker.own_motion import seen_from
from platoontraffic.controllers.tracker.records import X, Y
from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracker.trail import Trail
from platoontraffic.lidar import ScanBatch

INNER, OUTER = (
    0.5,
    0.3,
)  # the strip looked at: from so far beside the own body, to so far beyond it on the goal's lane [m]
NARROWEST = 2.0  # least distance of another lane [m]
SAME, FILTER = 1.5, 0.3  # of the closing speed: as in `closing_speed` [m], [s]
LEAST_SHRUNK = 0.3  # share to which a bend may shrink on its inner side


class Side(NamedTuple):
    """The strip beside a follower on the side of its goal, arrays (n,)."""

    side: np.ndarray  # 1: left, -1: right, 0: it is not looked at
    ahead: np.ndarray  # distance from the front bumper to the first return [m]; negative: abreast; inf: none
    ahead_closing: np.ndarray  # rate at which that shrinks [m/s]; NaN: not known yet
    behind: np.ndarray  # the same from the rear bumper backwards
    behind_closing: np.ndarray

    @classmethod
    def unknown(cls, n: int) -> Side:
        inf, nan = np.full(n, np.inf), np.full(n, np.nan)
        return cls(np.zeros(n), inf, nan, inf, nan)


class Beside(NamedTuple):
    """What a follower remembers of its lane and the one beside it, arrays (n,). Offsets are lane offsets [m]."""

    lane: np.ndarray  # own, when it last was in line with a goal that kept to a lane, or had gone over; NaN: not yet
    stays: np.ndarray  # to which its route is shifted, while its goal is on another lane; NaN: it is not
    goal: np.ndarray  # to which it goes over; NaN: to the route
    driven: np.ndarray  # since it began to go over [m]; NaN: it has not
    length: np.ndarray  # of going over [m]
    side: Side
    room_for: np.ndarray  # time for which there has been room [s]
    waits: np.ndarray  # time since it stays [s]
    seen_at: np.ndarray  # where its goal has been for `steady_for`; NaN: there was none
    steady_for: np.ndarray  # [s]
    yields: np.ndarray  # it stops where its predecessor left the lane, for what is beside it, bool

    @classmethod
    def none(cls, n: int) -> Beside:
        nan, no = np.full(n, np.nan), np.zeros(n, dtype=bool)
        return cls(nan, nan, nan, nan, nan, Side.unknown(n), np.zeros(n), np.zeros(n), nan, np.zeros(n), no)

    @property
    def active(self) -> np.ndarray:
        """Its route is shifted, bool (n,)."""
        return ~np.isnan(self.stays)

    @property
    def held(self) -> np.ndarray:
        """It stays on its lane, and its goal is on another one, bool (n,)."""
        return self.active & np.isnan(self.driven) | self.yields

    def drives(self, route: RouteAhead | None) -> RouteAhead | None:
        """The route, shifted to the lane on which a follower stays, and to its goal where it goes over."""
        if route is None or not self.active.any():
            return route
        offset, bend = self._planned(route.distance, route.aside)
        shift = np.where(self.active[:, None], offset - route.aside, 0.0)
        steps = np.diff(route.points, axis=1)
        steps = np.concatenate([steps, steps[:, -1:]], axis=1)
        steps /= np.maximum(np.hypot(steps[..., 0], steps[..., 1]), 1e-9)[..., None]
        left = np.stack([-steps[..., 1], steps[..., 0]], axis=-1)
        curvature = route.curvature / np.maximum(1 - shift * route.curvature, LEAST_SHRUNK) + bend
        return route._replace(points=route.points + shift[..., None] * left, curvature=curvature)

    def closes(self, given: RouteAhead, distance: np.ndarray) -> np.ndarray:
        """It would come to places at distances ahead (n,) [m] on another lane than its route, bool (n,)."""
        aside = _at(given.aside, given.distance, distance)
        offset, _ = self._planned(distance[:, None], aside[:, None])
        return self.active & (np.abs(offset[:, 0] - aside) > ANOTHER)

    def _planned(self, distance: np.ndarray, aside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lane offset [m] at distances ahead (n, k), and the curvature of going over [1/m]; NaN and 0: not active.

        aside: of the route there (n, k)
        """
        stays, driven, length = (values[:, None] for values in (self.stays, self.driven, self.length))
        goal = np.where(np.isnan(self.goal[:, None]), aside, self.goal[:, None])
        share = np.nan_to_num(np.clip((driven + distance) / length, 0.0, 1.0))
        between = (share > 0) & (share < 1)
        bend = np.where(between, (goal - stays) / 2 * (np.pi / length) ** 2 * np.cos(np.pi * share), 0.0)
        return stays + (goal - stays) * (1 - np.cos(np.pi * share)) / 2, bend

    def aligned(self, track: Track, given: RouteAhead, odometry: Odometry) -> Track:
        """The predecessors where they would be on the shifted routes, so that the trail leads along these."""
        if not self.active.any():
            return track
        station, offset, heading = places(track, given, odometry)
        aside = _at(given.aside, given.distance, station)
        planned, _ = self._planned(station[:, None], aside[:, None])
        shift = np.where(self.active, planned[:, 0] - aside - offset, 0.0)
        mean = track.mean.copy()
        mean[:, X] -= shift * np.sin(heading + odometry.heading)
        mean[:, Y] += shift * np.cos(heading + odometry.heading)
        return track._replace(mean=mean)


class Scene(NamedTuple):
    """What a follower looks beside with."""

    given: RouteAhead  # not shifted
    odometry: Odometry
    track: Track  # of the predecessor
    trail: Trail
    follows: np.ndarray  # its goal is its predecessor, bool (n,); else it is the route
    sensed: Sensed
    scan: ScanBatch | None  # of the laser that looks beside; None: not due
    age: float  # of that scan [s]
    scanned: Odometry  # at its instant
    dt: float


def places(track: Track, given: RouteAhead, odometry: Odometry) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of predecessors on routes: distance [m], offset to the left [m], heading of the route there [rad]; NaN: none."""
    from platoontraffic.controllers.tracker.beside_kernel import find_places

    station, offset, heading = np.full((3, len(track.mean)), np.nan)
    find_places(given.points, given.distance, track.mean, odometry, station, offset, heading)
    return station, offset, heading


class Trails(NamedTuple):
    """Lane offsets of the trails on which slow followers drive, arrays (n,) [m]; NaN: of the others."""

    least: np.ndarray  # up to the predecessor
    greatest: np.ndarray
    soon: np.ndarray  # where the follower would stop


class Goals(NamedTuple):
    """Where followers drive, and where they are to drive, arrays (n,). Offsets are lane offsets [m]."""

    there: np.ndarray  # of the goal: of the predecessor, or of the route
    lane: np.ndarray  # as of `Beside`
    base: np.ndarray  # of the lane that is driven along
    away: np.ndarray  # the goal from that; of a slow follower, the place farthest aside of the trail up to it
    reach: np.ndarray  # distance ahead at which the strip ends [m]; inf: without a predecessor
    steady_for: np.ndarray  # time for which the goal has kept within STEADY [s]


def look(beside: Beside, scene: Scene) -> Beside:
    """After a scan: whether each follower stays on its lane or goes over to that of its goal."""
    from platoontraffic.controllers.beside_kernel import BEGINS, SOON, YIELDS_BY, change, find_goals
    from platoontraffic.controllers.tracker.beside_kernel import find_trails

    given, speed, length = scene.given, scene.odometry.speed, scene.sensed.body.length
    n, own = len(speed), _own_offset(given) + given.aside[:, 0]
    station, offset, _ = places(scene.track, given, scene.odometry)
    goals, before = Goals(*np.empty((6, n))), Side(*np.empty((5, n)))
    on_trail = scene.follows & ~beside.active & (speed < BEGINS)
    trails, soon = Trails(*np.empty((3, n))), SOON + speed**2 / (2 * YIELDS_BY)
    find_trails(given, scene.trail, scene.odometry, station, on_trail, soon, trails)
    find_goals(given, scene.follows, own, (station, offset), trails, beside, scene.dt, goals, before)
    side, values = _looked(before, scene, goals.base, goals.away, goals.reach), np.empty((9, n))
    after = Beside(*values[:5], side, *values[5:], np.empty(n, dtype=bool))
    change(beside, own, goals, trails.soon, length, speed, scene.age, scene.dt, after)
    return after


def slowed(
    beside: Beside, length: np.ndarray, speed: np.ndarray, target: np.ndarray, error: np.ndarray, age: float, wanted
):
    """The wanted acceleration, less where it yields, or a gap must be opened beside what keeps pace [m/s2], (n,).

    length, speed : own [m], [m/s]
    target        : speed of the predecessor [m/s]; NaN without one
    error         : distance to it less the desired one [m]
    age           : of the scan that looks beside [s]
    """
    from platoontraffic.controllers.beside_kernel import slow_down

    less = wanted.copy()
    slow_down(beside, length, speed, target, error, age, less)
    return less


def _own_offset(given: RouteAhead) -> np.ndarray:
    """Of the own axle from the route, to the left [m], (n,)."""
    foot, onward = given.points[:, 0], given.points[:, 1]
    heading = np.arctan2(onward[:, 1] - foot[:, 1], onward[:, 0] - foot[:, 0])
    return foot[:, 0] * np.sin(heading) - foot[:, 1] * np.cos(heading)


def _at(values: np.ndarray, distance: np.ndarray, station: np.ndarray) -> np.ndarray:
    """Values (n, k) at the points at or before stations (n,)."""
    k = np.clip((distance <= station[:, None]).sum(axis=1) - 1, 0, None)
    return values[np.arange(len(station)), k]


def _looked(before: Side, scene: Scene, base: np.ndarray, away: np.ndarray, reach: np.ndarray) -> Side:
    """The strip on the side of the goal, where that is off the own lane; as before where no scan is due.

    Without a laser that looks beside it is free for all that is known.

    before     : unknown where the goal was on another side
    base, away : lane offset of the own lane, and of the goal from it [m], (n,)
    reach      : distance at which the strip ends [m], (n,)
    """
    side, scan = before.side, scene.scan
    if not side.any() or scan is None:
        return before
    from platoontraffic.controllers.tracker.beside_kernel import first_returns

    n, body = len(base), scene.sensed.body
    inner = body.width / 2 + INNER
    outer = np.maximum(np.abs(away), NARROWEST) + body.width / 2 + OUTER
    ends = -body.length / 2 - body.axle, body.length / 2 - body.axle
    strip = side, base, inner, outer, reach, *ends
    mount = scan.model.mount
    laser = np.column_stack([mount.x - body.axle, np.full(n, mount.y)])
    ahead, behind = np.full((2, n), np.inf)
    route, points, driven = scene.given, scene.given.points, 0.0
    if scene.age:  # the route as seen from there, then distances as there
        points = seen_from(points, scene.odometry, scene.scanned)
        driven = np.hypot(scene.odometry.x - scene.scanned.x, scene.odometry.y - scene.scanned.y)
        ends = ends[0] - driven, ends[1] - driven
        strip = side, base, inner, outer, reach, *ends
    first_returns(
        points, route.distance, route.aside, route.curvature, strip, laser, scan.ranges, scan.model.body_directions,
        ahead, behind,
    )  # fmt: skip
    speed, decisions = scene.scanned.speed, round(1 / (scan.model.rate * scene.dt))  # from its last scan to this one
    interval = max(decisions, 1) * scene.dt
    closings = [
        closing_speed(now, last, closing, speed, interval, same=SAME, time_constant=FILTER)
        for now, last, closing in (
            (ahead, before.ahead, before.ahead_closing),
            (behind, before.behind, before.behind_closing),
        )
    ]
    return Side(side, ahead, closings[0], behind, closings[1])
