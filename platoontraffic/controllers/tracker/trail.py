"""Where the predecessor has driven: the path that a follower remembers and steers along."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.lidar import ScanBatch

POINTS = 256  # that are remembered, of each trail
BENDS = 6  # places ahead at which the curvature is told


class Ahead(NamedTuple):
    """A trail as seen from the own driven axle, arrays (n,); along it, arrays (n, BENDS)."""

    offset: np.ndarray  # of the axle from the trail, to the left [m]
    off_heading: np.ndarray  # own heading less that of the trail [rad]
    curvature: np.ndarray  # of the trail at the preview, to the left [1/m]
    way: np.ndarray  # from beside the own axle to beside the predecessor's [m]; to the trail's end, if it is not known
    distance: np.ndarray  # of the places along the trail [m]
    bend: np.ndarray  # curvature there, to the left [1/m]


class Trail(NamedTuple):
    """Points (n, POINTS, 3) of which the first `size` (n,) count: x, y in the odometry frame, and way along the trail.

    Both change in place, for they are large.
    """

    points: np.ndarray
    size: np.ndarray

    @classmethod
    def begin(cls, n: int) -> Trail:
        """Straight from behind to the own axle, where the odometry frame begins."""
        points = np.zeros((n, POINTS, 3))
        points[:, 0] = -1.0, 0.0, -1.0
        return cls(points, np.full(n, 2))

    def lengthen(self, track: Track, odometry: Odometry, anew: np.ndarray) -> None:
        """To where the predecessor's axle is, if it is seen.

        anew : who did not see it in the scan before, (n,) bool: what lies between becomes an arc
        """
        from platoontraffic.controllers.tracker.trail_kernel import (
            lengthen,  # here, for it costs half a second to import numba
        )

        lengthen(*self, track.mean[:, :2], track.seen, anew, odometry.x, odometry.y, odometry.heading)

    def lay(
        self,
        rows: np.ndarray,
        odometry: Odometry,
        way: np.ndarray,
        distance: np.ndarray,
        until: np.ndarray,
        half: np.ndarray,
    ) -> None:
        """Along a way instead, for some rows.

        rows     : (n,) bool
        way      : points as seen from the own driven axle, the first one beside it [m], (n, k, 2)
        distance : of these along the way [m], (n, k)
        until    : so far of it [m], (n,)
        half     : points are means over so much of it each way [m], (n,), for lanes in junctions have corners
        """
        from platoontraffic.controllers.tracker.trail_kernel import lay

        lay(*self, rows, odometry.x, odometry.y, odometry.heading, way, distance, until, half)

    def ahead(self, odometry: Odometry, track: Track, window: np.ndarray, preview: np.ndarray) -> Ahead:
        """What there is to steer by, and the way along it to where the predecessor is by now.

        window  : the trail is fitted by parabolas over so much of it each way [m], (n,)
        preview : how far ahead the curvature is wanted [m], (n,)
        """
        from platoontraffic.controllers.tracker.trail_kernel import look_ahead

        n = len(self.size)
        ahead = Ahead(*np.empty((4, n)), *np.empty((2, n, BENDS)))
        look_ahead(*self, track.mean[:, :2], odometry.x, odometry.y, odometry.heading, window, preview, *ahead)
        return ahead

    def seen_from_axle(self, odometry: Odometry, most: int) -> np.ndarray:
        """Points from the oldest on as seen from the own driven axle, x forward, y to the left [m], (n, most, 2)."""
        rows = np.arange(len(self.size))[:, None]
        of_all = np.rint(np.linspace(0, self.size - 1, most, axis=1)).astype(int)  # where there are fewer, some twice
        x = self.points[rows, of_all, 0] - np.asarray(odometry.x)[:, None]
        y = self.points[rows, of_all, 1] - np.asarray(odometry.y)[:, None]
        cos, sin = np.cos(odometry.heading)[:, None], np.sin(odometry.heading)[:, None]
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)

    def free_way(self, odometry: Odometry, scan: ScanBatch, skipped, body, half_width, reach) -> np.ndarray:
        """From the front bumper to the first return over the strip to be driven over [m], (n,); inf: none.

        skipped    : first and last beam of those that met the predecessor, (n, 2)
        half_width : of the strip about the trail, which goes on straight beyond its end [m], (n,)
        reach      : so far from the own axle one looks along the trail [m], (n,)
        """
        from platoontraffic.controllers.tracker.trail_kernel import free_way

        n, mount = len(self.size), scan.model.mount
        laser = np.column_stack([mount.x - body.axle, np.full(n, mount.y)])
        cos, sin = np.cos(mount.yaw), np.sin(mount.yaw)
        directions = np.array([[cos, -sin], [sin, cos]]) @ scan.model.directions
        free = np.empty(n)
        front = body.length / 2 - body.axle
        where = odometry.x, odometry.y, odometry.heading
        free_way(*self, *where, reach, half_width, front, laser, scan.ranges, skipped, directions, free)
        return free
