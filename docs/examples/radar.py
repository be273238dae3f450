"""A sensor of one's own, a radar, and a law that follows by it. See scenario `radar.toml` beside this file."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic import Decision, Drive, Law, Sensor, Target


class Echo(NamedTuple):
    """The nearest vehicle ahead, (n,); NaN where there is none."""

    distance: np.ndarray  # from the front bumper [m]
    bearing: np.ndarray  # of its middle, to the left of straight ahead [rad]
    closing: np.ndarray  # how fast the distance decreases [m/s]


@dataclass(frozen=True)
class Radar(Sensor):
    """Sees the nearest vehicle in a narrow beam straight ahead, with its closing speed."""

    rate: Annotated[float, Field(alias="rate_hz")] = 20.0
    reach: Annotated[float, Field(alias="range_m")] = 100.0
    beam: Annotated[float, Field(alias="half_beam_rad")] = 0.1
    sigma: Annotated[float, Field(alias="sigma_m")] = 0.1

    def __call__(self, surroundings, rows):
        traffic, fleet = surroundings.traffic, surroundings.fleet
        distance, bearing, closing = np.full((3, len(rows)), np.nan)
        noise = surroundings.normal(rows)[:, 0]
        for k, i in enumerate(rows):
            cos, sin = np.cos(traffic.heading[i]), np.sin(traffic.heading[i])
            dx, dy = traffic.x - traffic.x[i], traffic.y - traffic.y[i]
            forward, left = dx * cos + dy * sin - traffic.length[i] / 2, dy * cos - dx * sin  # from the front bumper
            ahead = forward - traffic.length / 2
            aside = np.abs(left) - traffic.width / 2
            seen = (ahead > 0) & (ahead < self.reach) & (aside < self.beam * ahead)
            if seen.any():
                j = np.flatnonzero(seen)[np.argmin(ahead[seen])]
                relative = traffic.speed[j] * np.cos(traffic.heading[j] - traffic.heading[i])
                distance[k] = ahead[j] + self.sigma * noise[k]
                bearing[k] = np.arctan2(left[j], forward[j])
                closing[k] = fleet.motion.speed[i] - relative
        return Echo(distance, bearing, closing)


@dataclass(frozen=True)
class RadarCruise(Law):
    """Keeps a time headway by the radar named `radar`, on the route that it is given."""

    needs = frozenset({"route", "radar"})

    time_headway: Annotated[float, Field(alias="time_headway_s")] = 1.5
    stand_off: Annotated[float, Field(alias="stand_off_m")] = 4.0
    look_ahead: Annotated[float, Field(alias="look_ahead_m")] = 8.0

    def desired_distance(self, speed):
        return self.stand_off + self.time_headway * speed

    def __call__(self, sensed, memory, dt):
        echo, speed = sensed.readings["radar"], sensed.speed
        error = echo.distance - self.stand_off - self.time_headway * speed
        follow = (0.3 * error - echo.closing) / self.time_headway
        cruise = 0.5 * (sensed.route.limit[:, 0] - speed)
        acceleration = np.clip(np.fmin(follow, cruise), -6.0, 2.0)
        away = np.hypot(sensed.route.points[..., 0], sensed.route.points[..., 1])
        aim = sensed.route.points[np.arange(len(speed)), (away >= self.look_ahead).argmax(axis=1)]
        curvature = 2 * aim[:, 1] / (aim**2).sum(axis=1)
        return Decision(Drive(acceleration, curvature), target=Target(echo.distance, echo.bearing))
