"""The predecessor, as a laser tells it: rear centre, heading, speed and curvature, by an extended Kalman filter.

A vehicle's odometry frame is where its own driven axle was when it set out, x forward, y left: it knows its way in it
by its own speed and yaw rate alone, so the frame drifts, and what is tracked in it drifts along.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from platoontraffic.lidar import ScanBatch
from platoontraffic.lidar.segments import Segments

X, Y, HEADING, SPEED, ACCELERATION, CURVATURE = range(6)  # of a track's mean

OVERHANG = 1.0  # of cars behind the rear axle [m]: 0.8 to 1.2


class Odometry(NamedTuple):
    """Own driven axle in the odometry frame, arrays (n,), and the motion that was told last."""

    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray  # not wrapped
    speed: np.ndarray
    yaw_rate: np.ndarray

    @classmethod
    def begin(cls, speed: np.ndarray, yaw_rate: np.ndarray) -> Odometry:
        return cls(*np.zeros((3, len(speed))), speed, yaw_rate)

    def moved(self, speed: np.ndarray, yaw_rate: np.ndarray, dt: float) -> Odometry:
        """After dt in which speed and yaw rate changed evenly, on the arc of their means."""
        way, angle = (self.speed + speed) / 2 * dt, (self.yaw_rate + yaw_rate) / 2 * dt
        chord, along = way * np.sinc(angle / (2 * np.pi)), self.heading + angle / 2
        return Odometry(
            self.x + chord * np.cos(along), self.y + chord * np.sin(along), self.heading + angle, speed, yaw_rate
        )


class Track(NamedTuple):
    """What is known of the predecessors of n vehicles, each in the odometry frame of its own follower.

    mean  : x, y of the rear axle's middle [m], heading [rad], speed [m/s], acceleration [m/s2], curvature of its path
            to the left [1/m], (n, 6); NaN where nothing is known
    cov   : of these, (n, 6, 6)
    width : of the vehicle [m], (n,)
    blind : since it was last seen [s], (n,); inf where nothing is known
    nis   : squared innovation over its covariance, chi-squared of 3 degrees of freedom, (n,); NaN if not seen just now
    """

    mean: np.ndarray
    cov: np.ndarray
    width: np.ndarray
    blind: np.ndarray
    nis: np.ndarray

    @classmethod
    def none(cls, n: int) -> Track:
        return cls(
            np.full((n, 6), np.nan),
            np.full((n, 6, 6), np.nan),
            np.full(n, np.nan),
            np.full(n, np.inf),
            np.full(n, np.nan),
        )

    @property
    def known(self) -> np.ndarray:
        return np.isfinite(self.blind)

    @property
    def seen(self) -> np.ndarray:
        """In the last scan."""
        return self.blind == 0

    def predicted(self, odometry: Odometry, dt: float) -> Track:
        """After dt, seen from there: it goes on along its arc; a driver may change acceleration and curvature."""
        from platoontraffic.controllers.tracker.track_kernel import (
            predict,  # here, for it costs half a second to import numba
        )

        mean, cov = self.mean.copy(), self.cov.copy()
        predict(mean, cov, odometry.x, odometry.y, dt)
        return self._replace(mean=mean, cov=cov, blind=self.blind + dt, nis=np.full(len(mean), np.nan))

    def corrected(
        self,
        scan: ScanBatch,
        segments: Segments,
        odometry: Odometry,
        ahead: np.ndarray,
        expected: np.ndarray,
        ways: np.ndarray,
        dt: float,
    ) -> tuple[Track, np.ndarray, np.ndarray]:
        """With what the scan shows of them: the group of returns that fits best, if one fits.

        Where nothing is known, the nearest rear within `LANE` of the way ahead is taken.

        ahead    : of the laser before the own driven axle [m], (n,)
        expected : the way ahead where nothing is known: its curvature to the left [1/m], (n,)
        ways     : or that way as points seen from the own driven axle [m], (n, k, 2); k = 0: it is not given
        returns  : also distance and bearing of its rear centre from the laser, (n, 2), NaN if not seen; and the first
                   and last beam that met it, (n, 2), -1 if none
        """
        from platoontraffic.controllers.tracker.track_kernel import correct

        track = Track(*(values.copy() for values in self))
        target, beams = np.full((len(self.mean), 2), np.nan), np.full((len(self.mean), 2), -1)
        noise, model = scan.model.noise, scan.model
        own = np.column_stack([odometry.x, odometry.y, odometry.heading, odometry.speed])
        sensor = np.column_stack([ahead, np.full(len(ahead), model.mount.y), np.full(len(ahead), model.mount.yaw)])
        correct(
            *track,
            target,
            beams,
            own,
            sensor,
            expected,
            ways,
            dt,
            scan.ranges,
            model.angle_increment,
            (noise.sigma, noise.sigma_per_metre),
            segments.offset,
            segments.first,
            segments.last,
            segments.count,
            segments.start,
            segments.stop,
            segments.line_heading,
            segments.line_distance,
            segments.line_rms,
            segments.corner,
            segments.leg_heading,
            segments.leg_lengths,
            segments.corner_rms,
            segments.convex,
        )
        return track, target, beams

    def aside(self, ways: np.ndarray, odometry: Odometry) -> np.ndarray:
        """Distance of their axles from the ways [m], (n,); 0 where nothing is known.

        ways : points (n, k, 2) as seen from the own driven axle [m]
        """
        from platoontraffic.controllers.tracker.track_kernel import aside

        off = np.zeros(len(self.mean))
        aside(ways, self.mean[:, :2], odometry.x, odometry.y, odometry.heading, off)
        return off

    def forgotten(self, rows: np.ndarray) -> Track:
        """Without what is known of some, (n,) bool."""
        if not rows.any():
            return self
        nothing = Track.none(len(rows))
        return Track(
            *(
                np.where(rows.reshape(-1, *[1] * (values.ndim - 1)), none, values)
                for values, none in zip(self, nothing, strict=True)
            )
        )
