"""The predecessor, as a laser tells it: rear axle, heading, speed and curvature, by an extended Kalman filter.

A vehicle's odometry frame has its origin where the vehicle's driven axle was at the start, x forward, y left. The
vehicle knows its place in it by its own speed and yaw rate alone, so the frame drifts, and tracked places drift along.
"""

from __future__ import annotations

from operator import attrgetter
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.tracker.records import SPEED, UNKNOWN_SPEED, Groups, Hiding, Laser, Sighting
from platoontraffic.lidar import ScanBatch
from platoontraffic.lidar.segments import Segments
from platoontraffic.vehicles.records import some

columns_of = attrgetter(*Groups._fields)


class Odometry(NamedTuple):
    """Own driven axle in the odometry frame, and own motion, arrays (n,)."""

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
        length, angle = (self.speed + speed) / 2 * dt, (self.yaw_rate + yaw_rate) / 2 * dt
        chord, along = length * np.sinc(angle / (2 * np.pi)), self.heading + angle / 2
        return Odometry(
            self.x + chord * np.cos(along), self.y + chord * np.sin(along), self.heading + angle, speed, yaw_rate
        )


class Track(NamedTuple):
    """Estimates of the predecessors of n vehicles, each in the odometry frame of its own follower.

    mean  : x, y of the rear axle's middle [m], heading [rad], speed [m/s], acceleration [m/s2], curvature of its path
            to the left [1/m], (n, 6); NaN without a predecessor
    cov   : covariance of the mean, (n, 6, 6)
    width : of the vehicle [m], (n,)
    blind : time since it was last seen [s], (n,); inf without a predecessor
    nis   : normalized innovation squared, chi-squared of 3 degrees of freedom, (n,); NaN if not seen just now
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

    @property
    def speed_is_guessed(self) -> np.ndarray:
        """It began with the last scan, at the own speed: its speed is not measured yet."""
        return self.seen & (self.cov[:, SPEED, SPEED] >= UNKNOWN_SPEED**2)

    def predicted(self, odometry: Odometry, dt: float) -> Track:
        """After dt on the same arc; drivers may change acceleration and curvature.

        odometry: own driven axles after dt
        """
        # Imported here, as below: importing numba takes half a second.
        from platoontraffic.controllers.tracker.prediction_kernel import predict

        mean, cov, nis = self.mean.copy(), self.cov.copy(), np.empty(len(self.mean))
        nis.fill(np.nan)
        predict(mean, cov, odometry, dt)
        return Track(mean, cov, self.width, self.blind + dt, nis)

    def corrected(
        self, scan: ScanBatch, segments: Segments, odometry: Odometry, forward: np.ndarray, route: np.ndarray,
        hiding: Hiding, dt: float,
    ) -> tuple[Track, Sighting]:  # fmt: skip
        """After a scan: corrected by the group of returns that fits best, if one fits.

        Without a predecessor, the nearest rear within a lane of the path ahead becomes one; a vehicle that hides the
        predecessor takes its place. New tracks have no nis.

        forward : of the own driven axle to the laser [m], (n,)
        route   : points of the path ahead in the frames of the own axles [m], (n, k, 2); k = 0: the arc that it drives
        """
        from platoontraffic.controllers.tracker.track_kernel import correct

        track, sighting = Track(*(values.copy() for values in self)), Sighting.none(len(self.mean))
        mount, noise = scan.model.mount, scan.model.noise
        numbers = mount.y, mount.yaw, scan.model.angle_increment, noise.sigma, noise.sigma_per_metre
        laser = Laser(forward, *(float(number) for number in numbers))
        groups = Groups(*columns_of(segments))
        correct(track, sighting, odometry, laser, route, groups, scan.ranges, hiding, dt)
        return track, sighting

    def offset(self, points: np.ndarray, odometry: Odometry) -> np.ndarray:
        """Distance of the predecessors' axles from paths [m], (n,); 0 without a predecessor.

        points : of the paths, as seen from the own driven axles [m], (n, k, 2)
        """
        from platoontraffic.controllers.tracker.track_kernel import offsets

        offset = np.zeros(len(self.mean))
        offsets(points, self.mean[:, :2], odometry, offset)
        return offset

    def forgotten(self, rows: np.ndarray) -> Track:
        """Without the predecessors of some rows, (n,) bool."""
        if not some(rows):
            return self
        track = Track(*(values.copy() for values in self))
        for values in track:
            values[rows] = np.nan
        track.blind[rows] = np.inf
        return track
