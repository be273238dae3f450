"""A follower for cars at the speed of traffic, that is given its laser and its own speed and yaw rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.law import Decision, Law, Sensed, Target
from platoontraffic.controllers.path import PathLeader
from platoontraffic.controllers.tracker.track import ACCELERATION, OVERHANG, SPEED, Odometry, Track
from platoontraffic.controllers.tracker.trail import Ahead, Trail
from platoontraffic.lidar.segments import find_segments
from platoontraffic.vehicles.motion import Drive, Positive

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

OTHERS_FILTER = 0.2  # time constant of the filter for the speed of what is in the way [s]
SAME = 1.0  # by which the free way may differ from what that filter expects, of the same thing [m]
FIRM = 1.0  # deceleration by which a standing car is held [m/s2]
STANDING = 0.05  # [m/s]
STILL = 0.1  # slower and not accelerating, it stands still [m/s]
CLOSE_ENOUGH, MOVE_UP = 0.1, 0.4  # to the wanted distance: it stops, and standing it moves up [m]
CREEPING = 0.5  # slower, its yaw rate is rather what its steering makes of its speed than what is measured [m/s]
SHOWN = 32  # points of the trail that are recorded
RECOVERY = 2.5  # lateral acceleration to come back with [m/s2]
APPROACH = 1.5  # deceleration with which a standing car is come up to [m/s2]
STEEPEST = 0.35  # sine of the greatest angle to come back to the trail at
ASTRAY = 0.7  # farther off the trail it drives no faster than its own bend allows [m]

ALONE = PathLeader()  # how one drives that has nobody to follow
LOOKAHEAD = 1.0  # then [s]: it may come to its route from aside
ASIDE = 5.0  # of the route [m]: there a predecessor is followed no more that was never lost, and may change lanes
ASIDE_ANEW = 2.0  # the same of whoever was met on the way [m]
ROUNDED = 0.4  # vehicle lengths each way over which the route's corners are rounded
RUN_UP = 8.0  # so far before somebody met the route ends, and an arc leads on into its trail [m]


class Memory(NamedTuple):
    """Arrays (n,), but for the records of such."""

    odometry: Odometry
    track: Track
    trail: Trail
    acceleration: np.ndarray  # that was asked for last [m/s2]
    curvature: np.ndarray  # the same [1/m]
    own: np.ndarray  # that the car has by now, for its lag [m/s2]
    free: np.ndarray  # way to what is in the way, not the predecessor [m]; inf: nothing
    closing: np.ndarray  # how fast that becomes less [m/s]; NaN: not known yet
    never_lost: np.ndarray  # bool


@dataclass(frozen=True)
class TrackingFollower(Law):
    """Tracks its predecessor by laser, drives in its trail, and keeps a time headway.

    1. The groups of returns in the scan correct an extended Kalman filter of the predecessor's motion, in the frame of
       the own odometry (`tracker.track`).
    2. Where its rear axle has been is remembered (`tracker.trail`), and steered along: the trail's curvature,
       as far ahead as the steering lags, corrected by offset and direction,

           curvature = trail's - offset / l^2 - 2 sin(off_heading) / l,      l = max(catch_up, catch_up_time v)

       that is critically damped: e'' + 2 e' / l + e / l^2 = 0 along the way. From far off it comes back at a fixed
       angle, and slowly enough for the bend that it drives.
    3. The distance from laser to rear shall be stand_off + time_headway v. With its error e and the gap's rate r the
       acceleration (r + distance_gain e) / time_headway makes the speed follow the predecessor's by a first-order lag
       of time_headway, whatever its frequency: no disturbance grows (Ioannou & Chien, "Autonomous intelligent cruise
       control", IEEE Trans. Vehicular Technology 42, 1993). The drive line's own lag is led by the rate of that wish,
       into which the predecessor's estimated acceleration goes.
    4. It brakes harder than in comfort for what needs it: the braking that just does, if both go on as they do now
       (constant-acceleration heuristic: Kesting, Treiber, Helbing, Phil. Trans. R. Soc. A 368, 2010), for the
       predecessor and for whatever else is met on the strip that it will drive over.
    5. It does not know where its predecessor is when it has not seen it for `patience`: then it stops, in the trail.
       With on_loss = "drive" it is given its route, and drives on along it as a `PathLeader` would, until somebody is
       before it on that route: whom it follows then, along the route, for a laser does not tell who that is. Who leaves
       the route is followed no farther.
       Told to lead, it follows nobody.
    6. With policy = "obey" it is given lights and right of way, and stops at a closed line; alone it always does.
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
    policy: Literal["convoy", "obey"] = "convoy"  # where lights or right of way are against it
    on_loss: Literal["stop", "drive"] = "stop"

    @property
    def needs(self) -> frozenset[str]:
        if self.on_loss == "drive":
            return frozenset({"route", "signals", "leads"})
        return frozenset({"signals"} if self.policy == "obey" else ())

    @property
    def drives_alone(self) -> bool:
        return self.on_loss == "drive"

    def desired_distance(self, speed):
        """From laser to rear at a steady speed [m]."""
        return self.stand_off + self.time_headway * speed

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        scan, body = sensed.scan, sensed.body
        if memory is None:
            memory = self._begin(sensed.speed, sensed.yaw_rate)
        speed, yaw_rate = self._own_motion(sensed, memory)
        odometry = memory.odometry.moved(speed, yaw_rate, dt)

        before = memory.track.predicted(odometry, dt)
        before = before.forgotten(before.blind > self.patience)
        ways = np.empty((len(speed), 0, 2))  # nobody is told a route
        if sensed.route is not None:
            ways = sensed.route.points
            limit = np.where(memory.never_lost, ASIDE, ASIDE_ANEW)
            before = before.forgotten(before.aside(ways, odometry) > limit)
        leads = np.zeros(len(speed), bool) if sensed.leads is None else sensed.leads
        before = before.forgotten(leads)
        ahead_of_axle = scan.model.mount.x - body.axle
        turning = np.where(speed > 1.0, yaw_rate / np.maximum(speed, 1.0), 0.0)
        segments = find_segments(scan, jump=0.3, bridge=5)
        track, seen, beams = before.corrected(scan, segments, odometry, ahead_of_axle, turning, ways, dt)
        if leads.any():
            track, seen[leads], beams[leads] = track.forgotten(leads), np.nan, -1

        trail, anew = memory.trail, before.blind > 1.5 * dt
        if sensed.route is not None:
            strange = ~before.known | ~memory.never_lost  # whoever was met on the way is followed along the route
            met = np.hypot(track.mean[:, 0] - odometry.x, track.mean[:, 1] - odometry.y) - RUN_UP
            until = np.where(track.known, met, scan.model.range_max)
            trail.lay(strange, odometry, sensed.route.points, sensed.route.distance, until, ROUNDED * body.length)
            anew |= strange
        trail.lengthen(track, odometry, anew)
        catch_up = np.maximum(self.catch_up, self.catch_up_time * speed)
        window = np.maximum(self.window, self.window_time * speed)
        ahead = trail.ahead(odometry, track, window, self.steering_lag * speed)
        curvature = self._steer(ahead, catch_up, speed)
        if sensed.route is not None:
            curvature = np.where(strange, ALONE.curvature_on(sensed, LOOKAHEAD), curvature)

        distance = ahead.way - OVERHANG - ahead_of_axle
        reach = np.where(track.known, ahead.way - OVERHANG - 0.5, np.maximum(ahead.way, 0) + scan.model.range_max / 2)
        free = trail.free_way(odometry, scan, beams, body, np.full(len(speed), self.half_width), reach)
        closing = closing_speed(free, memory.free, memory.closing, speed, dt, same=SAME, time_constant=OTHERS_FILTER)
        own = memory.own + (memory.acceleration - memory.own) * -np.expm1(-dt / max(self.drive_lag, 1e-9))
        wanted, needed = self._follow(distance, speed, own, track, memory.acceleration)
        wanted = np.minimum(wanted, self._bends(ahead, speed))
        blind_spot = body.length / 2 - scan.model.mount.x  # from laser to front bumper
        needed = np.minimum(needed, self._brake_for(free + blind_spot, speed, speed - closing, 0.0))
        astray = (np.abs(ahead.offset) > ASTRAY) | (np.abs(ahead.off_heading) > STEEPEST)
        too_fast = speed**2 * np.abs(curvature) > self.lateral_acceleration
        wanted, needed = self._by_road(sensed, memory, track, (free, closing), wanted, needed, dt)
        wanted = np.where(astray & too_fast, np.minimum(wanted, -self.braking), wanted)
        last = np.where(speed < STANDING, np.maximum(memory.acceleration, -FIRM), memory.acceleration)
        acceleration = self._comfort(wanted, needed, last, dt)
        acceleration = np.maximum(acceleration, -self.hardest_braking)

        never_lost = memory.never_lost & ~leads & (before.known | ~memory.track.known)
        memory = Memory(odometry, track, trail, acceleration, curvature, own, free, closing, never_lost)
        return Decision(Drive(acceleration, curvature), memory, Target(*seen.T))

    def remembered_path(self, memory: Memory) -> np.ndarray:
        """Where the predecessor's rear axle has been, as seen from the own one, (n, SHOWN, 2) [m]."""
        return memory.trail.seen_from_axle(memory.odometry, SHOWN)

    def _begin(self, speed: np.ndarray, yaw_rate: np.ndarray) -> Memory:
        n = len(speed)
        nothing, unknown = np.full(n, np.inf), np.full(n, np.nan)
        begun = Odometry.begin(speed, yaw_rate), Track.none(n), Trail.begin(n)
        return Memory(*begun, *np.zeros((3, n)), nothing, unknown, np.ones(n, bool))

    def _own_motion(self, sensed: Sensed, memory: Memory) -> tuple[np.ndarray, np.ndarray]:
        """Speed and yaw rate, (n,): as measured, but for who stands or creeps, when errors are most of what is."""
        still = (np.abs(sensed.speed) < STILL) & (memory.acceleration <= 0)
        speed = np.where(still, 0.0, sensed.speed)
        lock = 1 / sensed.body.length  # about
        steered = np.clip(memory.curvature, -lock, lock)
        return speed, np.where(speed < CREEPING, speed * steered, sensed.yaw_rate)

    def _steer(self, ahead: Ahead, catch_up: np.ndarray, speed: np.ndarray) -> np.ndarray:
        towards = -np.clip(ahead.offset / (2 * catch_up), -STEEPEST, STEEPEST)  # sine of the angle to come back at
        back = 2 * (np.sin(ahead.off_heading) - towards) / catch_up
        gentle = RECOVERY / np.maximum(speed, 2.0) ** 2  # steering is too slow for more, and would swing
        return ahead.curvature - np.clip(back, -gentle, gentle)

    def _follow(self, distance, speed, own, track: Track, last) -> tuple[np.ndarray, np.ndarray]:
        """The acceleration that keeps the headway, and the braking that is needed."""
        speed_ahead, acceleration_ahead = track.mean[:, SPEED], track.mean[:, ACCELERATION]
        error, rate = distance - self.desired_distance(speed), speed_ahead - speed
        fast = np.sqrt(2 * APPROACH * np.maximum(error, 0.0)) - speed_ahead  # towards who stands or nearly so
        wanted = rate + np.minimum(self.distance_gain * error, np.maximum(self.catching_up, fast))
        wanted = wanted / self.time_headway
        change = (acceleration_ahead - own + self.distance_gain * (rate - self.time_headway * own)) / self.time_headway
        wanted = wanted + self.drive_lag * change
        near = error < np.where(last <= -FIRM, MOVE_UP, CLOSE_ENOUGH)
        stands = (speed < STANDING) & (speed_ahead < 2 * STANDING) & near
        wanted = np.where(stands, -FIRM, wanted)
        wanted = np.where(track.known, wanted, np.where(speed < STANDING, -FIRM, -self.braking / 2))
        needed = self._brake_for(distance, speed, speed_ahead, np.minimum(acceleration_ahead, 0.0))
        return wanted, np.where(track.known, needed, np.inf)

    def _by_road(self, sensed: Sensed, memory: Memory, track: Track, others, wanted, needed, dt: float):
        """Both accelerations, with what the route and the lines on it ask for of those who are told of them."""
        if sensed.route is not None:
            alone = ALONE.acceleration_on(sensed, np.zeros(len(sensed.speed)), *others, dt)
            wanted = np.where(track.known, wanted, alone)
            # Who was met on the way may drive on straight where the route turns.
            bends = ALONE.acceleration_for_bends(sensed)
            wanted = np.where(memory.never_lost, wanted, np.minimum(wanted, bends))
        if sensed.signals is not None:
            stop = ALONE.acceleration_for_lines(sensed)
            stop = np.where(track.known & (self.policy == "convoy"), np.inf, stop)
            wanted, needed = np.minimum(wanted, stop), np.minimum(needed, stop)
        return wanted, needed

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
        """What is wanted, within comfort; what is needed, whatever it takes, and no longer than it is."""
        wanted, last = np.clip(wanted, -self.braking, self.acceleration), np.maximum(last, -self.braking)
        wanted = np.clip(wanted, last - self.jerk * dt, last + self.jerk * dt)
        return np.where(needed < -self.braking, np.minimum(wanted, needed), wanted)
