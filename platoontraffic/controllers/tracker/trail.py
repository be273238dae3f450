"""Trail of the predecessor: the path that a follower remembers and steers along."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Body
from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.lidar import ScanBatch
from platoontraffic.vehicles.records import some

BLOCK = 32  # least number of points for which there is room
POINTS = 256  # greatest number of points of a trail
BENDS = 14  # number of places ahead at which the curvature is given; close together at first


class Ahead(NamedTuple):
    """A trail as seen from the own driven axle, arrays (n,); along it, arrays (n, BENDS).

    Of one that lies along a route only the length is known, all else is NaN: the route itself is steered by.
    """

    offset: np.ndarray  # of the axle from the trail, to the left [m]
    off_heading: np.ndarray  # own heading less that of the trail [rad]
    curvature: np.ndarray  # of the trail at the preview, to the left [1/m]
    length: np.ndarray  # of the trail from the own axle to the predecessor's, or to its end if there is none [m]
    distance: np.ndarray  # of the places along the trail [m]
    bend: np.ndarray  # curvature there, to the left [1/m]


class RouteSection(NamedTuple):
    """Where trails are replaced by the given routes."""

    rows: np.ndarray  # replaced ones, bool (n,)
    points: np.ndarray  # of the routes as seen from the own driven axles, the first one beside it [m], (n, k, 2)
    distance: np.ndarray  # of the points along the routes [m], (n, k)
    length: np.ndarray  # of the section [m], (n,)
    rounding: np.ndarray  # corners are rounded by means over this distance each way [m], (n,)


class Strip(NamedTuple):
    """Ground that a vehicle will drive over, arrays (n,)."""

    half_width: np.ndarray  # about the trail, which goes on straight beyond its end [m]
    reach: np.ndarray  # from the own axle along the trail [m]
    body: np.ndarray  # half the width that the body sweeps where its front swings out of the strip [m]


class Trail(NamedTuple):
    """Points (n, k, 3), of which the first `size` (n,) count: x, y in the odometry frame [m], and station [m].

    The points from `size` on are undefined. A trail begins BEHIND (of `trail_kernel`) behind the own axle.
    """

    points: np.ndarray
    size: np.ndarray

    @classmethod
    def begin(cls, n: int) -> Trail:
        """Straight from behind to the own axle, where the odometry frame begins."""
        points = np.zeros((n, 2, 3))
        points[:, 0] = -1.0, 0.0, -1.0
        return cls(points, np.full(n, 2))

    def extended(self, track: Track, odometry: Odometry, gap: np.ndarray, route: RouteSection | None = None) -> Trail:
        """To the axle of each predecessor that was just seen, from the route section where there is one; a copy.

        gap : the predecessor was not seen in the scan before, bool (n,): an arc closes the gap
        """
        # Imported here, as below: importing numba takes half a second.
        from platoontraffic.controllers.tracker.trail_kernel import copy_points, extend, find_oldest, relay

        oldest, replaced = np.empty_like(self.size), np.zeros(len(self.size), bool) if route is None else route.rows
        find_oldest(self, odometry, replaced, oldest)
        size = self.size - oldest
        # The copy has room for one more point, or, where an arc or a route may be laid, for as many as there can be. In
        # whole blocks, so that trails of followers that departed at different times fit into one array.
        capacity = POINTS if route is not None or some(gap) else min((size.max() // BLOCK + 1) * BLOCK, POINTS)
        trail = Trail(np.zeros((len(size), capacity, 3)), size)
        copy_points(self, oldest, trail.points)
        if route is not None:
            relay(trail, odometry, route)
        extend(trail, odometry, track.mean[:, :2], track.seen, gap)
        return trail

    def ahead(
        self, odometry: Odometry, track: Track, on_route: np.ndarray, windows: tuple, preview: np.ndarray
    ) -> Ahead:
        """What to steer by, and the distance along the trail to the predecessor.

        on_route: it lies along a route, bool (n,)
        windows : parabolas are fitted to the trail over these distances each way, for offset and direction, for
                  the curvature that is steered, and for those that the speed is planned for [m], (n,) each
        preview : distance ahead at which the curvature is wanted [m], (n,)
        """
        from platoontraffic.controllers.tracker.trail_kernel import look_ahead

        n = len(self.size)
        ahead = Ahead(*np.empty((4, n)), *np.empty((2, n, BENDS)))
        look_ahead(self, odometry, track.mean[:, :2], on_route, windows, preview, ahead)
        return ahead

    def seen_from_axle(self, odometry: Odometry, most: int) -> np.ndarray:
        """Points from the oldest on as seen from the own driven axle, x forward, y to the left [m], (n, most, 2)."""
        rows = np.arange(len(self.size))[:, None]
        picked = np.rint(np.linspace(0, self.size - 1, most, axis=1)).astype(int)  # of short trails, some twice
        x = self.points[rows, picked, 0] - np.asarray(odometry.x)[:, None]
        y = self.points[rows, picked, 1] - np.asarray(odometry.y)[:, None]
        cos, sin = np.cos(odometry.heading)[:, None], np.sin(odometry.heading)[:, None]
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)

    def free_distance(
        self, odometry: Odometry, scan: ScanBatch, body: Body, strip: Strip, skipped: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """From the front bumper along the trail to the first return over the strip [m], and its beam, (n,).

        inf and -1 where there is none

        skipped : first and last of the beams on the predecessor, (n, 2); -1: none
        """
        from platoontraffic.controllers.tracker.trail_kernel import first_return

        n, mount, directions = len(self.size), scan.model.mount, scan.model.body_directions
        laser = mount.x - body.axle, mount.y
        front, free, first = body.length / 2 - body.axle, np.empty(n), np.empty(n, int)
        first_return(self, odometry, strip, front, laser, scan.ranges, directions, skipped, free, first)
        return free, first
