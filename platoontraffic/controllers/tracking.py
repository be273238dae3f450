"""A follower for cars at road speed, by its laser and its own speed and yaw rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers import beside
from platoontraffic.controllers.beside import Beside
from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.creeping import Creeping
from platoontraffic.controllers.law import BrakingFor, Decision, Law, RouteAhead, Sensed, Target
from platoontraffic.controllers.path import (
    BESIDE,
    LINE,
    LOST,
    OBSTACLE,
    PREDECESSOR,
    PathLeader,
    bearing_of,
    errors_on,
    nothing,
)
from platoontraffic.controllers.steering import Errors, curvature_back
from platoontraffic.controllers.tracker.bends import BRAKING, acceleration_along
from platoontraffic.controllers.tracker.drive_line import DriveLine
from platoontraffic.controllers.tracker.fitted import Fitted, fitted
from platoontraffic.controllers.tracker.own_motion import STILL, Past, YawBias, own_motion, seen_from
from platoontraffic.controllers.tracker.records import ACCELERATION, OVERHANG, SPEED, PathAhead, Sighting, X, Y
from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracker.trail import Ahead, RouteSection, Strip, Trail
from platoontraffic.lidar.segments import find_segments
from platoontraffic.vehicles.motion import Drive, Positive

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

LEAST_HEADWAY, HEADWAY_PER_DELAY = 0.5, 1.1  # time headway with which no string of cars amplifies [s], [s/s]
FILTER = 0.2  # time constant of the filter of the closing speed of obstacles [s]
SAME = 1.0  # greatest difference of the free distance from its prediction, for one obstacle [m]
FIRM = 1.0  # deceleration by which a standing car is held [m/s2]
STANDING = 0.05  # speed below which it is held [m/s]
CLOSE_ENOUGH, MOVE_UP = 0.1, 0.4  # excess of distance at which it stops, and at which it moves up again [m]
APPROACH = 1.5  # deceleration of the approach to a standing car [m/s2]
RECOVERY = 2.5  # lateral acceleration of the return to the trail [m/s2]
STEEPEST = 0.35  # sine of the greatest angle of that return
ASTRAY = 0.7  # offset from the trail beyond which its own bend limits its speed [m]
PAST_PREDECESSOR = 0.5  # distance before the predecessor's rear at which the search for obstacles ends [m]
KEPT_FREE = 0.22  # on each side of the vehicle, on its path [m]
SHOWN = 32  # points of the trail that are recorded
AROUND = "around"  # name of the laser that looks beside and behind

ASIDE = 5.0  # distance from the route beyond which a predecessor that was never lost is dropped [m]
ASIDE_ANEW = 2.0  # the same for one that was met on the route [m]
ROUNDED = 0.4  # distance each way over which corners of the route are rounded [vehicle lengths]
RUN_UP = 8.0  # distance before a predecessor at which the trail leaves the route, by an arc [m]


class Predecessor(NamedTuple):
    """As it is estimated now, arrays (n,); NaN: there is none."""

    distance: np.ndarray  # from the laser to its rear, along its path [m]
    speed: np.ndarray  # [m/s]
    acceleration: np.ndarray  # [m/s2]


class Memory(NamedTuple):
    """Arrays (n,), or records of arrays."""

    odometry: Odometry
    yaw_bias: YawBias
    track: Track
    trail: Trail
    acceleration: np.ndarray  # last command [m/s2]
    curvature: np.ndarray  # last command [1/m]
    drive_line: DriveLine
    past: Past
    free: np.ndarray  # distance from the bumper to the first obstacle but the predecessor, in the scan [m]; inf: none
    closing: np.ndarray  # rate at which that shrinks [m/s]; NaN: not known yet
    never_lost: np.ndarray  # it has had the same predecessor from the start, bool
    creeping: Creeping
    braking_for: BrakingFor
    beside: Beside
    predecessor: Predecessor

    @classmethod
    def begin(cls, sensed: Sensed, dt: float) -> Memory:
        n = len(sensed.speed)
        records = Odometry.begin(sensed.speed, sensed.yaw_rate), YawBias.unknown(n), Track.none(n), Trail.begin(n)
        driven = *np.zeros((2, n)), DriveLine.at_rest(n), Past.begin(sensed, dt)
        none = np.full(n, np.inf), np.full(n, np.nan), np.ones(n, bool)
        unseen = Predecessor(*np.full((3, n), np.nan))
        return cls(*records, *driven, *none, Creeping.none(n), nothing(n), Beside.none(n), unseen)


class Now(NamedTuple):
    """Inputs of a decision; what is sensed may be old, the speed in it is that of now."""

    sensed: Sensed
    memory: Memory
    odometry: Odometry
    scanned: Odometry  # at the instant of the scan
    fitted: Fitted
    dt: float
    given: RouteAhead | None  # the route, where `sensed` has the one that is driven: shifted to a lane beside it
    wrong_lane: np.ndarray  # it would come to the next stop line on another lane than its route, bool (n,)

    @property
    def speed(self) -> np.ndarray:
        return self.odometry.speed

    @property
    def leads(self) -> np.ndarray:
        """Ordered to follow nothing, bool (n,)."""
        return np.zeros(len(self.speed), bool) if self.sensed.leads is None else self.sensed.leads

    @property
    def reaction(self) -> np.ndarray:
        """Time from a scan to the effect of the brakes [s], (n,)."""
        return self.sensed.body.brake_lag + self.dt / 2

    @property
    def driven(self) -> np.ndarray:
        """Distance since the scan [m], (n,)."""
        return np.hypot(self.odometry.x - self.scanned.x, self.odometry.y - self.scanned.y)

    @property
    def laser(self) -> np.ndarray:
        """Distance from the own driven axle to the laser [m], (n,)."""
        return self.sensed.scan.model.mount.x - self.sensed.body.axle


class Estimate(NamedTuple):
    """The predecessor, by the laser."""

    predicted: Track  # at the instant of the scan, before it
    track: Track  # after it
    now: Track
    aligned: Track  # `track` where it would be on the own lane, if the own vehicle stays there
    aligned_now: Track  # `now` likewise
    sighting: Sighting
    on_route: np.ndarray  # the path is the given route, not the predecessor's trail, bool (n,)


class Obstacle(NamedTuple):
    """The first return over the strip ahead but the predecessor, arrays (n,)."""

    free: np.ndarray  # distance from the front bumper [m]; inf: none
    closing: np.ndarray  # rate at which that shrinks [m/s]; NaN: not known yet
    bearing: np.ndarray  # of that return from the laser's forward direction [rad]; NaN: none


class Demand(NamedTuple):
    """Accelerations, arrays (n,) [m/s2]."""

    wanted: np.ndarray  # driven within comfort
    needed: np.ndarray  # to avoid a collision, driven if that takes more than comfortable braking; inf: none


@dataclass(frozen=True)
class TrackingFollower(Law):
    """Tracks its predecessor by laser, drives in its trail, and keeps a time headway.

    Its gains follow from the vehicle's length, steering and lags, and from the interval of scans (`tracker.fitted`).

    1. Estimate. The groups of returns in the scan correct an extended Kalman filter of the predecessor's motion, in the
       frame of the own odometry (`tracker.track`). The bias of the measured yaw rate is estimated while the vehicle
       drives straight ahead (`tracker.own_motion`).
    2. Steer. The path of its rear axle is remembered (`tracker.trail`), and steered along: the trail's curvature, as
       far ahead as the steering lags, corrected by offset and direction,

           curvature = trail's - offset / l^2 - 2 sin(off_heading) / l,

       which is critically damped: e'' + 2 e' / l + e / l^2 = 0 along the trail. From a large offset the vehicle returns
       at a fixed angle. Bends ahead, their changes and the curvature that is steered now limit the speed
       (`tracker.bends`), and no curvature is steered that would exceed the lateral acceleration.
    3. Follow. The distance from laser to rear shall be stand_off + time_headway v. With its error e and the gap's rate
       r the acceleration (r + distance_gain e) / time_headway makes the speed follow the predecessor's by a first-order
       lag of time_headway at every frequency, so no disturbance grows (Ioannou & Chien, "Autonomous intelligent cruise
       control", IEEE Trans. Vehicular Technology 42, 1993). The drive line's own lag is compensated by the rate of that
       acceleration (`tracker.drive_line`), which contains the predecessor's acceleration. That is estimated some
       T' = 0.2 s late, so with h = time_headway, k = distance_gain and T the mean lag of drive and brakes, with half a
       scan, a predecessor's speed is followed by

           G(s) = (1 - T T' s^2 / ((1 + T s) (1 + T' s) (1 + k / s))) / (1 + h s),

       for the shipped car 0.99, 0.87, 0.68, 0.54 at 0.02, 0.1, 0.2, 0.3 Hz. Above, the filter is later: 0.40 at 0.5 Hz.

       Scans that are used a delay d late are predicted to the instant of use: own motion by the commands, exactly, the
       predecessor's by its acceleration a, which fades (`tracker.prediction_kernel`) to e(d) a and adds a speed c(d) a
       and a distance g(d) a. With A = s / (1 + T' s), the estimate of a predecessor's speed 1, that is

           G(s) = exp(-d s) ((1 + T k) (1 + c A) + k (1 / s + d + g A) + T e A) / ((1 + T s) (1 + h s) (1 + k / s)),

       0.98, 0.93, 0.82, 0.71 at 0.05, 0.1, 0.2, 0.3 Hz for d = 0.3 s. No frequency grows if
       time_headway >= LEAST_HEADWAY + HEADWAY_PER_DELAY d.
    4. Avoid. It brakes harder than in comfort if that is needed: by the braking that just suffices, if both vehicles go
       on as they do now (constant-acceleration heuristic: Kesting, Treiber, Helbing, Phil. Trans. R. Soc. A 368, 2010),
       for the predecessor and for any obstacle on the strip ahead.
    5. Alone. A predecessor not seen for `patience` is lost: the vehicle then stops, in the trail. With
       on_loss = "drive" it is given its route, and drives on along it as the path law `alone` does, until a vehicle is
       ahead on the route. It follows that one, along the route, since a laser cannot identify it; a predecessor that
       leaves the route is dropped. On the order to lead it drops its predecessor.
    6. Stop lines. With policy = "obey" it is given lights and right of way, and stops at a closed line as `alone` does;
       without a predecessor it always does. After that it follows along its route, if it is given one, since others may
       have come in between.
    """

    lidar: ClassVar[str] = "car-tracker"  # the preset, where a scenario names none

    stand_off: Annotated[Positive, Field(alias="stand_off_m")] = 3.0  # laser to rear at rest
    time_headway: Annotated[Positive, Field(alias="time_headway_s")] = 1.0
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s")] = 0.4
    catching_up: Annotated[Positive, Field(alias="catching_up_mps")] = 3.0  # greatest speed above the predecessor's
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 2.5  # comfortable
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 3.5  # comfortable; ISO 15622 allows it at any speed
    hardest_braking: Annotated[Positive, Field(alias="hardest_braking_mps2")] = 9.0
    jerk: Annotated[Positive, Field(alias="jerk_mps3")] = 5.0  # comfortable; ISO 15622 at low speed
    margin: Annotated[Positive, Field(alias="margin_m")] = 2.7  # laser to rear after hard braking
    lateral_acceleration: Annotated[Positive, Field(alias="lateral_acceleration_mps2")] = 4.0
    patience: Annotated[Positive, Field(alias="patience_s")] = 1.5
    # Of the strip that must be free; default: half of the vehicle's width, and KEPT_FREE.
    half_width: Annotated[Positive | None, Field(alias="half_width_m")] = None
    policy: Literal["convoy", "obey"] = "convoy"  # at closed stop lines behind a predecessor
    on_loss: Literal["stop", "drive"] = "stop"
    alone: PathLeader = field(default_factory=PathLeader)  # drives along the route, and stops at lines

    def __post_init__(self) -> None:
        if self.alone.profile or self.alone.trace:
            raise ValueError("alone: profile and trace are for leaders; must be left out")

    @property
    def needs(self) -> frozenset[str]:
        if self.drives_alone:
            return frozenset({"route", "signals", "leads"})
        return frozenset({"signals"} if self.policy == "obey" else ())

    @property
    def further_lidars(self) -> Mapping[str, str]:
        """To look beside, where its route tells it how the lanes lie."""
        return {AROUND: "car-around"} if self.drives_alone else {}

    @property
    def drives_alone(self) -> bool:
        """It drives on without a predecessor."""
        return self.on_loss == "drive"

    def desired_distance(self, speed):
        """From laser to rear at a steady speed [m]."""
        return self.stand_off + self.time_headway * speed

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        if memory is None:
            memory = Memory.begin(sensed, dt)
        drive_line = memory.drive_line.after(memory.acceleration, sensed.body, dt)
        now, bias, past = self._own_motion(sensed, memory, drive_line, dt)
        sensed = now.sensed
        estimate = self._estimate(now)

        trail = self._remember(now, estimate)
        ahead = self._look_ahead(now, estimate, trail)
        curvature = self._steer(now, estimate, ahead)

        demand = self._follow(now, estimate.now, ahead, drive_line)
        scanned = self._obstacle(now, estimate, trail, ahead)
        obstacle = self._obstacle_now(now, scanned)
        demand = self._avoid(now, ahead, curvature, obstacle, demand)
        blocked = np.isfinite(scanned.free)
        before = memory.free + np.where(blocked, obstacle.free, 0.0) - np.where(blocked, scanned.free, 0.0)
        demand, creeps, limit = self._by_road(now, estimate.now, obstacle, before, demand)
        acceleration = self._comfort(now, demand)
        curvature = self._held(now, curvature)

        limit = limit._replace(
            reason=np.where((limit.reason == PREDECESSOR) & memory.beside.held, BESIDE, limit.reason)
        )
        never_lost = memory.never_lost & ~now.leads & (estimate.predicted.known | ~memory.track.known)
        if sensed.route is not None:  # another vehicle may have come in between, so the next one is found anew
            never_lost &= limit.reason != LINE
        commands = acceleration, curvature, drive_line, past
        distance = np.where(estimate.now.known, ahead.length - OVERHANG - now.laser, np.nan)
        predecessor = Predecessor(distance, estimate.now.mean[:, SPEED], estimate.now.mean[:, ACCELERATION])
        memory = Memory(now.odometry, bias, estimate.track, trail, *commands, scanned.free, scanned.closing,
                        never_lost, creeps, limit, self._look_beside(now, estimate, past), predecessor)  # fmt: skip
        return Decision(Drive(acceleration, curvature), memory, Target(*estimate.sighting.rear.T))

    def remembered_path(self, memory: Memory) -> np.ndarray:
        """Path of the predecessor's rear axle, as seen from the own one, (n, SHOWN, 2) [m]."""
        return memory.trail.seen_from_axle(memory.odometry, SHOWN)

    def braking_for(self, memory: Memory) -> BrakingFor:
        return memory.braking_for

    # ---- 1. estimate

    def _own_motion(
        self, sensed: Sensed, memory: Memory, drive_line: DriveLine, dt: float
    ) -> tuple[Now, YawBias, Past]:
        late, past, driven, last = sensed.odometry_age, memory.past, memory.curvature, memory.odometry
        if past.x.shape[1]:
            gained = (memory.drive_line.acceleration + drive_line.acceleration) / 2 * dt
            past = past.driven(gained, memory.curvature, sensed.body, dt)
            driven, last = past.curvature_at(late, dt) if late else driven, past.at_reading()
        bias = memory.yaw_bias.after(sensed, driven, dt)
        odometry = last.moved(*own_motion(sensed, bias, driven, memory.acceleration), dt)
        scanned = odometry
        if past.x.shape[1]:
            past = past.read(odometry)
            odometry, scanned = past.at(0.0, late, dt), past.at(sensed.age, late, dt)
            sensed = replace(sensed, speed=odometry.speed)
        given, wrong_lane = sensed.route, np.zeros(len(sensed.speed), bool)
        if given is not None and memory.beside.active.any():
            wrong_lane = memory.beside.closes(given, sensed.signals.distance)
            signals = sensed.signals._replace(open=sensed.signals.open & ~wrong_lane)
            sensed = replace(sensed, route=memory.beside.drives(given), signals=signals)
        fit = fitted(sensed.body, odometry.speed, dt, RECOVERY)
        return Now(sensed, memory, odometry, scanned, fit, dt, given, wrong_lane), bias, past

    def _estimate(self, now: Now) -> Estimate:
        sensed, route, scanned = now.sensed, now.sensed.route, now.scanned
        predicted = self._predict(now)
        turning = np.where(scanned.speed > 1.0, scanned.yaw_rate / np.maximum(scanned.speed, 1.0), 0.0)
        points = np.empty((len(turning), 0, 2)) if route is None else route.points
        if sensed.age and route is not None:
            points = seen_from(points, now.odometry, scanned)
        path, segments = PathAhead(turning, points), find_segments(sensed.scan, jump=0.3, bridge=5)
        track, sighting = predicted.corrected(sensed.scan, segments, scanned, now.laser, path, now.dt)
        if now.leads.any():
            track, sighting = track.forgotten(now.leads), sighting.without(now.leads)
        # A predecessor that was met on the route is followed along the route.
        on_route = (~predicted.known | ~now.memory.never_lost | now.memory.beside.active) & (route is not None)
        at_use = track.predicted(now.odometry, sensed.age) if sensed.age else track
        aligned, aligned_now = track, at_use
        if now.given is not None and now.memory.beside.active.any():
            aligned, aligned_now = (now.memory.beside.aligned(one, now.given, now.odometry) for one in (track, at_use))
        return Estimate(predicted, track, at_use, aligned, aligned_now, sighting, on_route)

    def _predict(self, now: Now) -> Track:
        """The track at the time of this scan, without predecessors that are lost, off the route, or not wanted."""
        track = now.memory.track.predicted(now.scanned, now.dt)
        track = track.forgotten(track.blind > self.patience)
        if now.sensed.route is not None:
            limit = np.where(now.memory.never_lost, ASIDE, ASIDE_ANEW)
            track = track.forgotten(track.offset(now.sensed.route.points, now.odometry) > limit)
        return track.forgotten(now.leads)

    # ---- 2. steer

    def _remember(self, now: Now, estimate: Estimate) -> Trail:
        track, odometry, route = estimate.aligned, now.odometry, now.sensed.route
        gap, section = estimate.predicted.blind > 1.5 * now.dt, None
        if route is not None:
            near = np.hypot(track.mean[:, 0] - odometry.x, track.mean[:, 1] - odometry.y) - RUN_UP
            length = np.where(track.known, near, now.sensed.scan.model.range_max)
            rounding = ROUNDED * now.sensed.body.length
            section = RouteSection(estimate.on_route, route.points, route.distance, length, rounding)
        return now.memory.trail.extended(track, odometry, gap | estimate.on_route, section)

    def _look_beside(self, now: Now, estimate: Estimate, past: Past) -> Beside:
        if now.given is None:
            return now.memory.beside
        scan = now.sensed.scans.get(AROUND)
        follows = estimate.track.known & now.memory.never_lost
        age, scanned = now.sensed.ages.get(AROUND, 0.0), now.odometry
        if age:
            scanned = past.at(age, now.sensed.odometry_age, now.dt)
        scene = beside.Scene(now.given, now.odometry, estimate.now, follows, now.sensed, scan, age, scanned, now.dt)
        return beside.look(now.memory.beside, scene)

    def _look_ahead(self, now: Now, estimate: Estimate, trail: Trail) -> Ahead:
        fit = now.fitted
        ahead = estimate.aligned_now
        return trail.ahead(now.odometry, ahead, (fit.window, fit.bend_window), fit.steering_lag * now.speed)

    def _steer(self, now: Now, estimate: Estimate, ahead: Ahead) -> np.ndarray:
        """Curvature to drive [1/m], (n,)."""
        errors = Errors(ahead.offset, ahead.off_heading)
        back = curvature_back(errors, now.fitted.catch_up, now.fitted.gentle, STEEPEST)
        curvature = ahead.curvature + back
        if now.sensed.route is None:
            return curvature
        return np.where(estimate.on_route, self.alone.curvature_on(now.sensed), curvature)

    # ---- 3. follow

    def _follow(self, now: Now, track: Track, ahead: Ahead, drive_line: DriveLine) -> Demand:
        """To keep the headway; without a predecessor, to stop."""
        distance = ahead.length - OVERHANG - now.laser
        speed_ahead, acceleration_ahead = track.mean[:, SPEED], track.mean[:, ACCELERATION]
        wanted = self._headway(now, distance, track, drive_line)
        error = distance - self.desired_distance(now.speed)
        length, age = now.sensed.body.length, now.sensed.ages.get(AROUND, 0.0)
        wanted = beside.slowed(now.memory.beside, length, now.speed, speed_ahead, error, age, wanted)
        stop = np.where(now.speed < STANDING, -FIRM, -self.braking / 2)
        needed = self._brake_for(now, distance, speed_ahead, np.minimum(acceleration_ahead, 0.0))
        return Demand(np.where(track.known, wanted, stop), np.where(track.known, needed, np.inf))

    def _headway(self, now: Now, distance: np.ndarray, track: Track, drive_line: DriveLine) -> np.ndarray:
        speed, speed_ahead, acceleration_ahead = now.speed, track.mean[:, SPEED], track.mean[:, ACCELERATION]
        error, rate = distance - self.desired_distance(speed), speed_ahead - speed
        fast = np.sqrt(2 * APPROACH * np.maximum(error, 0.0)) - speed_ahead  # to a vehicle that nearly stands
        wanted = rate + np.minimum(self.distance_gain * error, np.maximum(self.catching_up, fast))
        wanted = wanted / self.time_headway
        achieved = drive_line.acceleration
        closing = rate - self.time_headway * achieved
        change = (acceleration_ahead - achieved + self.distance_gain * closing) / self.time_headway
        wanted = drive_line.command(wanted, change, now.sensed.body, now.dt)
        near = error < np.where(now.memory.acceleration <= -FIRM, MOVE_UP, CLOSE_ENOUGH)
        stands = (speed < STANDING) & (speed_ahead < 2 * STANDING) & near
        return np.where(stands, -FIRM, wanted)

    # ---- 4. avoid

    def _obstacle(self, now: Now, estimate: Estimate, trail: Trail, ahead: Ahead) -> Obstacle:
        """In the scan."""
        sensed, memory = now.sensed, now.memory
        beyond_end = np.maximum(ahead.length, 0) + sensed.scan.model.range_max / 2
        reach = np.where(estimate.track.known, ahead.length - OVERHANG - PAST_PREDECESSOR, beyond_end)
        if sensed.age:
            there, then = estimate.now.mean, estimate.track.mean
            driven = np.nan_to_num(np.hypot(there[:, X] - then[:, X], there[:, Y] - then[:, Y]))
            reach = reach + now.driven - driven
        half_width = sensed.body.width / 2 + KEPT_FREE if self.half_width is None else self.half_width
        strip = Strip(np.broadcast_to(half_width, len(reach)), reach)
        free, beam = trail.free_distance(now.scanned, sensed.scan, sensed.body, strip, estimate.sighting.beams)
        closing = closing_speed(
            free, memory.free, memory.closing, now.scanned.speed, now.dt, same=SAME, time_constant=FILTER
        )  # fmt: skip
        return Obstacle(free, closing, bearing_of(beam, sensed.scan.model))

    def _obstacle_now(self, now: Now, scanned: Obstacle) -> Obstacle:
        """It goes on as in the scan; it stands, if its speed is not known yet."""
        if not now.sensed.age:
            return scanned
        moved = np.nan_to_num(now.scanned.speed - scanned.closing) * now.sensed.age
        closing = scanned.closing + now.speed - now.scanned.speed
        return scanned._replace(free=np.maximum(scanned.free - now.driven + moved, 0.0), closing=closing)

    def _avoid(self, now: Now, ahead: Ahead, curvature: np.ndarray, obstacle: Obstacle, demand: Demand) -> Demand:
        """Limited by bends of the trail and by the obstacle."""
        blind_spot = now.sensed.body.length / 2 - now.sensed.scan.model.mount.x  # from laser to front bumper
        brake = self._brake_for(now, obstacle.free + blind_spot, now.speed - obstacle.closing, 0.0)
        reaction = now.reaction + BRAKING * self.braking / (2 * self.jerk)
        limits = self.lateral_acceleration, self.braking, reaction, now.fitted.steepest_bend
        bends = acceleration_along(ahead, curvature, now.speed, limits)
        return Demand(np.minimum(demand.wanted, bends), np.minimum(demand.needed, brake))

    def _brake_for(self, now: Now, distance, speed_ahead, acceleration_ahead) -> np.ndarray:
        """Acceleration that just keeps the margin to what is ahead [m/s2], (n,); inf where that is not known."""
        speed = now.speed
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.maximum(speed - speed_ahead, 0.0)
            left = np.maximum(distance - self.margin - rate * now.reaction, 0.01)
            stops_first = speed_ahead * rate <= -2 * left * acceleration_ahead
            until_both_stand = speed**2 * acceleration_ahead / (speed_ahead**2 - 2 * left * acceleration_ahead)
            while_both_drive = acceleration_ahead - rate**2 / (2 * left)
            needed = np.where(stops_first & (speed_ahead > 0), until_both_stand, while_both_drive)
        return np.where(np.isnan(needed) | (distance == np.inf), np.inf, needed)

    # ---- 5. and 6. alone, stop lines

    def _by_road(
        self, now: Now, track: Track, obstacle: Obstacle, before: np.ndarray, demand: Demand
    ) -> tuple[Demand, Creeping, BrakingFor]:
        """Limited by route and stop lines, where they are given; without a predecessor, as `alone` drives.

        Where it drives alone it creeps as `alone` does. Also: what limits it.

        before: distance to the obstacle at the last decision [m], (n,)
        """
        sensed, (wanted, needed), memory = now.sensed, demand, now.memory
        free, closing, bearing = obstacle
        n = len(now.speed)
        stop = np.full(n, np.inf) if sensed.signals is None else self.alone.acceleration_for_lines(sensed)
        stop = np.where(track.known & (self.policy == "convoy") & ~now.wrong_lane, np.inf, stop)
        creeps, limit = memory.creeping, nothing(n)
        if sensed.route is not None:
            alone = self.alone.acceleration_on(sensed, np.zeros(n), free, closing, now.dt)
            # A vehicle that was met on the route may go straight on where the route turns; a predecessor that is
            # through a turn accelerates.
            bends = self.alone.acceleration_for_bends(sensed)
            alone, creeps, limit = self.alone.acceleration_among_others(
                sensed, alone, free, bearing, closing, before, creeps, now.dt
            )
            wanted = np.where(track.known & ~creeps.active, wanted, alone)
            strays = np.abs(errors_on(sensed.route).offset) > ASTRAY
            wanted = np.where(memory.never_lost & strays, wanted, np.minimum(wanted, bends))
            needed = np.where(creeps.active & (needed < 0), np.maximum(needed, alone), needed)
        by_obstacle = np.isfinite(free) & (now.speed < STILL) & (needed < 0) & track.known
        reason = np.where(track.known, np.where(by_obstacle, OBSTACLE, PREDECESSOR), limit.reason)
        reason = np.where(stop < np.minimum(wanted, needed), LINE, reason)
        if sensed.route is None:
            reason = np.where(track.known | (reason == LINE), reason, LOST)
        limit = BrakingFor(reason, np.where(reason == OBSTACLE, bearing, np.nan), creeps.active)
        return Demand(np.minimum(wanted, stop), np.minimum(needed, stop)), creeps, limit

    # ---- limits

    def _held(self, now: Now, curvature: np.ndarray) -> np.ndarray:
        """The part of a curvature that keeps to the lateral acceleration [1/m], (n,)."""
        most = self.lateral_acceleration / np.maximum(now.speed, 1e-3) ** 2
        return np.clip(curvature, -most, most)

    def _comfort(self, now: Now, demand: Demand) -> np.ndarray:
        """The wanted acceleration within comfort; the needed one where it is harder braking [m/s2], (n,)."""
        last = now.memory.acceleration
        last = np.where(now.speed < STANDING, np.maximum(last, -FIRM), last)
        wanted, last = np.clip(demand.wanted, -self.braking, self.acceleration), np.maximum(last, -self.braking)
        wanted = np.clip(wanted, last - self.jerk * now.dt, last + self.jerk * now.dt)
        acceleration = np.where(demand.needed < -self.braking, np.minimum(wanted, demand.needed), wanted)
        return np.maximum(acceleration, -self.hardest_braking)
