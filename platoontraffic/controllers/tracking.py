"""A follower for cars at the speed of traffic, that is given its laser and its own speed and yaw rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from lidar.segments import find_segments
from platoontraffic.controllers.base import Decision, Sensed, Target
from platoontraffic.controllers.closing import closing_speed
from platoontraffic.tracking import ACCELERATION, OVERHANG, SPEED, Odometry, Track
from platoontraffic.trail import Ahead, Trail
from platoontraffic.vehicle import Drive, Positive

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

OTHERS_FILTER = 0.2  # time constant of the filter for the speed of what is in the way [s]
SAME = 1.0  # by which the free way may differ from what that filter expects, of the same thing [m]
FIRM = 1.0  # deceleration by which a standing car is held [m/s2]
STANDING = 0.05  # [m/s]
CLOSE_ENOUGH = 0.1  # to the wanted distance, not to move up [m]


class Memory(NamedTuple):
    """Arrays (n,), but for the records of such."""

    odometry: Odometry
    track: Track
    trail: Trail
    acceleration: np.ndarray  # that was asked for last [m/s2]
    own: np.ndarray  # that the car has by now, for its lag [m/s2]
    free: np.ndarray  # way to what is in the way, not the predecessor [m]; inf: nothing
    closing: np.ndarray  # how fast that becomes less [m/s]; NaN: not known yet


@dataclass(frozen=True)
class TrackingFollower:
    """Tracks its predecessor by laser, drives in its trail, and keeps a time headway.

    1. The groups of returns in the scan correct an extended Kalman filter of the predecessor's motion, in the frame of
       the own odometry (`platoontraffic.tracking`).
    2. Where its rear axle has been is remembered (`platoontraffic.trail`), and steered along: the trail's curvature,
       as far ahead as the steering lags, corrected by offset and direction,

           curvature = trail's - offset / l^2 - 2 sin(off_heading) / l,      l = max(catch_up, catch_up_time v)

       that is critically damped: e'' + 2 e' / l + e / l^2 = 0 along the way.
    3. The distance from laser to rear shall be stand_off + time_headway v. With its error e and the gap's rate r the
       acceleration (r + distance_gain e) / time_headway makes the speed follow the predecessor's by a first-order lag
       of time_headway, whatever its frequency: no disturbance grows (Ioannou & Chien, "Autonomous intelligent cruise
       control", IEEE Trans. Vehicular Technology 42, 1993). The drive line's own lag is led by the rate of that wish,
       into which the predecessor's estimated acceleration goes.
    4. It brakes harder than in comfort for what needs it: the braking that just does, if both go on as they do now
       (constant-acceleration heuristic: Kesting, Treiber, Helbing, Phil. Trans. R. Soc. A 368, 2010), for the
       predecessor and for whatever else is met on the strip that it will drive over.
    5. It does not know where its predecessor is when it has not seen it for `patience`: then it stops, in the trail.
    """

    lidar: ClassVar[str] = "car-tracker"  # the preset, where a scenario names none

    stand_off: Annotated[Positive, Field(alias="stand_off_m")] = 3.0  # laser to rear at rest
    time_headway: Annotated[Positive, Field(alias="time_headway_s")] = 1.0
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s")] = 0.4
    catching_up: Annotated[Positive, Field(alias="catching_up_mps")] = 3.0  # faster than the predecessor, no more
    drive_lag: Annotated[NotNegative, Field(alias="drive_lag_s")] = 0.2  # of the own drive line, with half a scan
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 2.5  # comfortable
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 3.5  # comfortable; ISO 15622 allows it at any speed
    hardest_braking: Annotated[Positive, Field(alias="hardest_braking_mps2")] = 9.0
    jerk: Annotated[Positive, Field(alias="jerk_mps3")] = 5.0  # comfortable; ISO 15622 at low speed
    margin: Annotated[Positive, Field(alias="margin_m")] = 2.7  # laser to rear that hard braking leaves
    lateral_acceleration: Annotated[Positive, Field(alias="lateral_acceleration_mps2")] = 4.0
    # Steering: about three times its lag and half a scan. Shorter ways swing, longer ones cut corners.
    catch_up: Annotated[Positive, Field(alias="catch_up_m")] = 2.5
    catch_up_time: Annotated[Positive, Field(alias="catch_up_time_s")] = 0.6
    # The trail is smoothed over so much each way: 8 points at any speed.
    window: Annotated[Positive, Field(alias="window_m")] = 1.5
    window_time: Annotated[Positive, Field(alias="window_time_s")] = 0.4
    steering_lag: Annotated[NotNegative, Field(alias="steering_lag_s")] = 0.15  # of the own car, with half a scan
    patience: Annotated[Positive, Field(alias="patience_s")] = 1.5
    half_width: Annotated[Positive, Field(alias="half_width_m")] = 1.1  # of the strip that is to be free

    def desired_distance(self, speed):
        """From laser to rear at a steady speed [m]."""
        return self.stand_off + self.time_headway * speed

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        scan, body, speed, yaw_rate = sensed.scan, sensed.body, sensed.speed, sensed.yaw_rate
        if memory is None:
            memory = self._begin(speed, yaw_rate)
        odometry = memory.odometry.moved(speed, yaw_rate, dt)

        before = memory.track.predicted(dt)
        before = before.forgotten(before.blind > self.patience)
        ahead_of_axle = scan.model.mount.x - body.axle
        turning = np.where(speed > 1.0, yaw_rate / np.maximum(speed, 1.0), 0.0)
        segments = find_segments(scan, jump=0.3, bridge=5)
        track, seen, beams = before.corrected(scan, segments, odometry, ahead_of_axle, turning, dt)

        trail = memory.trail
        trail.lengthen(track, odometry, before.blind > 1.5 * dt)
        catch_up = np.maximum(self.catch_up, self.catch_up_time * speed)
        window = np.maximum(self.window, self.window_time * speed)
        ahead = trail.ahead(odometry, track, window, self.steering_lag * speed)
        curvature = self._steer(ahead, catch_up)

        distance = ahead.way - OVERHANG - ahead_of_axle
        reach = np.where(track.known, ahead.way - OVERHANG - 0.5, np.maximum(ahead.way, 0) + scan.model.range_max / 2)
        free = trail.free_way(odometry, scan, beams, body, np.full(len(speed), self.half_width), reach)
        closing = closing_speed(free, memory.free, memory.closing, speed, dt, same=SAME, time_constant=OTHERS_FILTER)
        own = memory.own + (memory.acceleration - memory.own) * -np.expm1(-dt / max(self.drive_lag, 1e-9))
        wanted, needed = self._follow(distance, speed, own, track)
        wanted = np.minimum(wanted, self._bends(ahead, speed))
        blind_spot = body.length / 2 - scan.model.mount.x  # from laser to front bumper
        needed = np.minimum(needed, self._brake_for(free + blind_spot, speed, speed - closing, 0.0))
        last = np.where(speed < STANDING, np.maximum(memory.acceleration, -FIRM), memory.acceleration)
        acceleration = self._comfort(wanted, needed, last, dt)
        acceleration = np.maximum(acceleration, -self.hardest_braking)

        memory = Memory(odometry, track, trail, acceleration, own, free, closing)
        return Decision(Drive(acceleration, curvature), memory, Target(*seen.T))

    def _begin(self, speed: np.ndarray, yaw_rate: np.ndarray) -> Memory:
        n = len(speed)
        nothing, unknown = np.full(n, np.inf), np.full(n, np.nan)
        return Memory(
            Odometry.begin(speed, yaw_rate), Track.none(n), Trail.begin(n), np.zeros(n), np.zeros(n), nothing, unknown
        )

    def _steer(self, ahead: Ahead, catch_up: np.ndarray) -> np.ndarray:
        back = ahead.offset / catch_up**2 + 2 * np.sin(ahead.off_heading) / catch_up
        return ahead.curvature - back

    def _follow(self, distance, speed, own, track: Track) -> tuple[np.ndarray, np.ndarray]:
        """The acceleration that keeps the headway, and the braking that is needed."""
        speed_ahead, acceleration_ahead = track.mean[:, SPEED], track.mean[:, ACCELERATION]
        error, rate = distance - self.desired_distance(speed), speed_ahead - speed
        wanted = (rate + np.minimum(self.distance_gain * error, self.catching_up)) / self.time_headway
        change = (acceleration_ahead - own + self.distance_gain * (rate - self.time_headway * own)) / self.time_headway
        wanted = wanted + self.drive_lag * change
        stands = (speed < STANDING) & (speed_ahead < 2 * STANDING) & (error < CLOSE_ENOUGH)
        wanted = np.where(stands, -FIRM, wanted)
        wanted = np.where(track.known, wanted, np.where(speed < STANDING, -FIRM, -self.braking / 2))
        needed = self._brake_for(distance, speed, speed_ahead, np.minimum(acceleration_ahead, 0.0))
        return wanted, np.where(track.known, needed, np.inf)

    def _brake_for(self, distance, speed, speed_ahead, acceleration_ahead) -> np.ndarray:
        """Acceleration that just does not come nearer than the margin; inf where it is not known."""
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.maximum(speed - speed_ahead, 0.0)
            left = np.maximum(distance - self.margin - rate * self.drive_lag, 0.01)
            stops_first = speed_ahead * rate <= -2 * left * acceleration_ahead
            until_both_stand = speed**2 * acceleration_ahead / (speed_ahead**2 - 2 * left * acceleration_ahead)
            while_both_drive = acceleration_ahead - rate**2 / (2 * left)
            needed = np.where(stops_first & (speed_ahead > 0), until_both_stand, while_both_drive)
        return np.where(np.isnan(needed) | (distance == np.inf), np.inf, needed)

    def _bends(self, ahead: Ahead, speed: np.ndarray) -> np.ndarray:
        """The greatest acceleration with which bends ahead are driven at no more than the lateral acceleration."""
        fastest2 = self.lateral_acceleration / np.maximum(np.abs(ahead.bend), 1e-6)
        way = np.maximum(ahead.distance, self.drive_lag * speed[:, None] + 0.5)
        share = np.maximum(speed[:, None] ** 2 - fastest2, 0.0) / (2 * way) / self.braking
        return (self.acceleration - (self.acceleration + self.braking) * share).min(axis=1)

    def _comfort(self, wanted, needed, last, dt: float) -> np.ndarray:
        """What is wanted, within comfort; what is needed, whatever it takes."""
        wanted = np.clip(wanted, -self.braking, self.acceleration)
        wanted = np.clip(wanted, last - self.jerk * dt, last + self.jerk * dt)
        return np.where(needed < -self.braking, np.minimum(wanted, needed), wanted)
