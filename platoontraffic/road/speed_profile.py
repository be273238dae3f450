"""When a vehicle that drives its route will be where: its speed by bends, limits, and how it accelerates and brakes."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import path_kernel
from platoontraffic.controllers.path_kernel import PLANNED, fastest_at
from platoontraffic.lidar.compiled import compiler
from platoontraffic.road import route as route_kernels
from platoontraffic.road.route import Route, between_even

REACH, STEP = 12.0, 0.25  # distance of the last point, and of one from the next [vehicle lengths]
AROUND = 0.6  # for so long before and after a bend, a vehicle is as slow as in it: it slows early, speeds up late [s]
STILL = 1e-6  # speed below which it counts as standing [m/s]
SLOWEST = 0.3  # speed that it has in the sharpest bend [m/s]

compiled = compiler(__file__, path_kernel.__file__, route_kernels.__file__)


class Driving(NamedTuple):
    """How a vehicle drives its route by the law `path`."""

    route: Route
    station: float  # of its driven axle [m]
    speed: float  # [m/s]
    starts_within: float  # time until it begins to accelerate [s]
    acceleration: float  # comfortable [m/s2]
    braking: float  # comfortable [m/s2]
    lateral: float  # greatest lateral acceleration in bends [m/s2]
    steering_rate: float  # greatest change of its curvature by time [1/m/s]
    length: float  # [m]
    top: float = math.inf  # that it drives anywhere [m/s]


class SpeedProfile:
    """Speed and time along a route, from where a vehicle is now. Between two points its acceleration is constant.

    acceleration : comfortable [m/s2]
    """

    def __init__(self, driving: Driving) -> None:
        self._driving, route, length = driving, driving.route, driving.length
        line = *route.curvature(length), route.line.stations, route.limit, route.length if route.closed else math.inf
        limits = route.speed_factor, min(route.top_speed, driving.top), driving.lateral, driving.steering_rate
        begin = driving.station, driving.speed, driving.starts_within
        self._points = _profile(line, limits, begin, (driving.acceleration, PLANNED * driving.braking), length)
        self.acceleration = driving.acceleration

    @cached_property
    def at_once(self) -> SpeedProfile:
        """The profile if the vehicle begins to accelerate now."""
        return SpeedProfile(self._driving._replace(starts_within=0.0)) if self._driving.starts_within else self

    def time_for(self, distance: float) -> float:
        """Time to drive a distance [m]; beyond the last point at the speed there [s]."""
        return _time_for(self._points, distance)

    def speed_after(self, time: float) -> float:
        """[m/s]"""
        return _speed_after(self._points, time)


def load() -> None:
    """Load what is compiled here."""
    route = Route.along((), np.array([[0.0, 0.0], [1.0, 0.0]]), np.ones(2))
    profile = SpeedProfile(Driving(route, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0))
    profile.speed_after(profile.time_for(1.0))


@compiled
def _time_for(points, distance):
    """`SpeedProfile.time_for` by points as of `_profile`."""
    if distance <= 0:
        return 0.0
    distances, times, speeds = points
    k = np.searchsorted(distances, distance, side="right")
    speed, driven = speeds[k - 1], distance - distances[k - 1]
    if k == len(distances):
        return times[k - 1] + driven / speed
    share = driven / (distances[k] - distances[k - 1])
    return times[k - 1] + 2 * driven / (speed + math.sqrt(speed**2 + share * (speeds[k] ** 2 - speed**2)))


@compiled
def _speed_after(points, time):
    """`SpeedProfile.speed_after` by points as of `_profile`."""
    _, times, speeds = points
    k = np.searchsorted(times, time, side="right")
    if k == 0:
        return speeds[0]
    if k == len(times):
        return speeds[-1]
    share = (time - times[k - 1]) / (times[k] - times[k - 1])
    return speeds[k - 1] + share * (speeds[k] - speeds[k - 1])


@compiled
def _profile(line, limits, begin, rates, length):
    """Distance, time and speed at points ahead, (3, k).

    line   : even stations and curvature there, stations and speed limit from there on, length if closed or else inf
    limits : factor of the speed limits, top speed, lateral acceleration, steering rate
    begin  : station, speed, and time until it accelerates
    rates  : acceleration, braking
    length : of the vehicle
    """
    stations, curvature, limit_stations, limit, lap = line
    factor, top, lateral, steering_rate = limits
    (station, v, starts_within), (acceleration, braking) = begin, rates
    v = v if v > STILL else 0.0
    count = round(REACH / STEP) + 2
    found = np.empty((3, count))
    distance, time, speed = found
    distance[0], distance[1] = 0.0, v * starts_within
    for k in range(2, count):
        distance[k] = distance[1] + (k - 1) * STEP * length
    # Greatest speeds: those of the law, also shortly before and after, and slow enough for those farther on.
    bend, fastest = np.empty(count + 1), np.empty(count)
    spacing = stations[-1] / (len(stations) - 1)
    for k in range(count + 1):
        there = station + (distance[k] if k < count else distance[count - 1] + STEP * length)
        bend[k] = between_even(curvature, spacing, there % lap if lap < math.inf else there)
    for k in range(count):
        there = station + distance[k]
        there = there % lap if lap < math.inf else there
        i = max(np.searchsorted(limit_stations, there, side="right") - 1, 0)
        change = abs(bend[k + 1] - bend[k]) / (STEP * length)
        limited = min(factor * limit[min(i, len(limit) - 1)], top)
        fastest[k] = min(max(fastest_at(bend[k], change, lateral, steering_rate), SLOWEST), limited)
    speed[:] = fastest
    for k in range(count):
        over = AROUND * fastest[k]
        for step in (-1, 1):
            j = k + step
            while 0 <= j < count and abs(distance[j] - distance[k]) <= over:
                speed[j] = min(speed[j], fastest[k])
                j += step
    for k in range(count - 2, 0, -1):
        ahead = speed[k + 1] ** 2 + 2 * braking * (distance[k + 1] - distance[k])
        speed[k] = min(speed[k], math.sqrt(ahead))
    time[0], speed[0] = 0.0, v
    for k in range(1, count):
        step, before = distance[k] - distance[k - 1], speed[k - 1]
        rate = acceleration if k > 1 else 0.0
        slowest = math.sqrt(max(before**2 - 2 * braking * step, 0.0))
        speed[k] = max(min(speed[k], math.sqrt(before**2 + 2 * rate * step)), slowest)
        if k > 1:
            time[k] = time[k - 1] + 2 * step / (before + speed[k])
        else:
            time[k] = 2 * step / (before + speed[k]) if step > 0 else starts_within
    return found
