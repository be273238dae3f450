"""Creeping past what has not moved for long, in a deadlock: slowly, through a swath as wide as the body itself.

A law keeps a strip free that is wider than its vehicle. Two vehicles whose strips overlap while their bodies would pass
each other wait for each other for ever. So a vehicle that has stood for `AFTER` before an obstacle that has not moved
either, and that would pass it, is given the swath that its body really sweeps (`swept_kernel`), `CLEARANCE` wider on
each side, at walking pace, until it has driven one length beyond the obstacle. It stops before whatever the laser meets
in that swath, and as soon as the obstacle moves. What is no wider than a person it does not pass so: a person waits for
the vehicle to stop, and then walks.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Sensed
from platoontraffic.lidar import find_segments
from platoontraffic.vehicles.motion import FULL_SIZE

AFTER = 10.0  # time that a vehicle and what it stands for must have stood [s] ...
EVERY = 1.0  # ... and period after which one that could not pass tries again [s]
SPEED = 0.25  # greatest while it creeps [vehicle lengths a second]: 1.2 m/s
GAIN = 0.8  # by which it approaches that speed; the drive line lags behind its command by half a second [1/s]
CLEARANCE = 0.05  # on each side of the body [vehicle widths]: 9 cm
STOP = 0.1  # distance before a return in the swath at which it stops [vehicle lengths]
PLACES = 0.02  # distance of the poses at which the swath is compared with the returns [vehicle lengths]
CLOSEST = 0.03  # the same where it goes on along a body that is close beside it already [vehicle widths]
ON_LINE = 0.15  # offset from the path up to which it may [vehicle widths]
ALONGSIDE, BESIDE = 0.1, 0.02  # a return so far before the front bumper [vehicle lengths] may be as near as it is [m]
REACH = 3.0  # length of the swath [vehicle lengths]
PERSON = 0.8  # greatest width of a person, with arms and bags [m]
AT_EDGE = 3  # a body seen within so many beams of the end of the view may reach beyond it


class Creeping(NamedTuple):
    """Arrays (n,)."""

    stood: np.ndarray  # how long the vehicle, and what it stands for, have stood [s]
    left: np.ndarray  # distance that it still creeps [m]; 0: it does not creep

    @classmethod
    def none(cls, n: int) -> Creeping:
        return cls(np.zeros(n), np.zeros(n))

    @property
    def active(self) -> np.ndarray:
        return self.left > 0

    def after(
        self,
        sensed: Sensed,
        strip: tuple[np.ndarray, np.ndarray, np.ndarray],
        held: np.ndarray,
        curvature: np.ndarray,
        dt: float,
    ) -> Creeping:
        """The state after dt.

        strip        : distance to the first obstacle on the strip [m], its bearing from the laser [rad], and the
                       distance in the last scan, (n,) each
        held         : the vehicle stands, or would, for something else: a line, a predecessor; bool (n,)
        curvature    : that is steered [1/m], (n,)
        """
        # Imported here: importing numba takes half a second.
        from platoontraffic.controllers.creeping_kernel import wait

        free, bearing, before = strip
        length, after = sensed.body.length, Creeping(*np.empty((2, len(free))))
        if wait(self, sensed.speed, length, free, before, held, AFTER, dt, after):
            tries, tried = (np.ceil((state.stood - AFTER) / EVERY) for state in (after, self))
            for i in np.flatnonzero((after.stood > AFTER) & (tries > tried) & ~self.active):
                if length[i] >= FULL_SIZE and is_narrow(sensed, int(i), bearing[i]):
                    continue
                if swept(sensed, int(i), curvature[i]) >= min(free[i] + length[i], (REACH - PLACES) * length[i]):
                    after.left[i] = length[i]
        return after


def acceleration(sensed: Sensed, rows: np.ndarray, curvature: np.ndarray, braking: float) -> np.ndarray:
    """Of vehicles that creep along their routes, for some rows (m,) [m/s2], (m,); curvature: as of `Creeping.after`."""
    length, speed = sensed.body.length[rows], sensed.speed[rows]
    free = np.array([swept(sensed, int(i), curvature[i]) for i in rows]) - sensed.speed[rows] * sensed.age
    allowed = np.sqrt(braking * np.maximum(free - STOP * length, 0.0))  # half of the braking: it stops early
    faster = (speed > allowed) | (allowed == 0)  # one that stands where it must stop stays: no step of it is too small
    return np.where(faster, -braking, np.minimum(GAIN * (SPEED * length - speed), braking / 2))


def is_narrow(sensed: Sensed, i: int, bearing: float) -> bool:
    """Whether what vehicle i sees at a bearing [rad] is all in view, and no wider than a person."""
    scan, row = sensed.scan, slice(i, i + 1)
    one = replace(scan, ids=scan.ids[row], ranges=scan.ranges[row], hits=None, inside=scan.inside[row])
    segments, beam = find_segments(one), int(np.abs(scan.model.angles - bearing).argmin())
    around = (segments.first <= beam) & (beam <= segments.last)
    whole = (segments.first > AT_EDGE) & (segments.last < len(scan.model.angles) - 1 - AT_EDGE)
    return bool((around & whole & (segments.width < PERSON)).any())


def swept(sensed: Sensed, i: int, curvature: float) -> float:
    """Distance until the body of vehicle i is `CLEARANCE` from a return [m]; at most REACH lengths.

    curvature: that is steered [1/m]
    """
    from platoontraffic.controllers.swept_kernel import drive  # importing numba takes half a second

    body, route, model = sensed.body, sensed.route, sensed.scan.model
    length, width, axle = float(body.length[i]), float(body.width[i]), float(body.axle[i])
    angle = model.angles + model.mount.yaw
    ranges = np.maximum(sensed.scan.ranges[i], model.range_min)
    met = ranges < (REACH + 1) * length  # lost returns, NaN, are not
    if (ranges <= model.range_min).any():
        return 0.0  # something is too near for the laser to say where
    x = model.mount.x - axle + ranges[met] * np.cos(angle[met])
    y = model.mount.y + ranges[met] * np.sin(angle[met])
    there = np.arange(0.0, REACH, PLACES) * length
    places = np.empty((len(there), 4))
    drive(route, route.points[i], i, PLACES * length, float(sensed.speed[i]), float(curvature), body, places)
    at_x, at_y, cos, sin = places.T[:, :, None]
    away_x, away_y = x - at_x, y - at_y
    ahead, aside = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    side = width / 2 + _kept(ahead[0] + axle, aside[0], length, width, float(route.points[i, 0, 1]))
    inside = (np.abs(aside) < side) & (ahead > -length / 2 - axle) & (ahead < length / 2 - axle)
    first = inside.any(axis=1)
    return max(float(there[first.argmax()]) - PLACES * length, 0.0) if first.any() else REACH * length


def _kept(ahead: np.ndarray, aside: np.ndarray, length: float, width: float, offset: float) -> np.ndarray:
    """Distance that is kept from returns on each side of the body (k,) [m].

    That is less for what is close beside it already; and, down to `CLOSEST`, for what goes on beyond that and comes no
    nearer, such as the rest of a long vehicle.

    ahead, aside : of the centre, forward and to the left (k,) [m]
    offset       : of the route, to the left [m]
    """
    usual, away = CLEARANCE * width, np.abs(aside) - width / 2
    beside = (away > BESIDE) & (np.abs(ahead) < length / 2 + ALONGSIDE * length)
    kept = np.where(beside, np.minimum(usual, away - BESIDE), usual)
    for there in (aside > 0, aside < 0) if abs(offset) < ON_LINE * width else ():
        least = away[beside & there].min(initial=np.inf)
        beyond = there & ~beside & (away > least - BESIDE)
        kept[beyond] = np.clip(least - BESIDE, CLOSEST * width, usual)
    return kept
