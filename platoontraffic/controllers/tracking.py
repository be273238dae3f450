"""A follower for cars at road speed, by its laser and its own speed and yaw rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers import beside
from platoontraffic.controllers.beside import Beside
from platoontraffic.controllers.creeping import Creeping
from platoontraffic.controllers.law import MAX_HEADWAY, BrakingFor, Decision, Law, RouteAhead, Sensed, Target
from platoontraffic.controllers.path import LINE, AlongRoute, PathLeader, bearing_of, first_touched, nothing
from platoontraffic.controllers.tracker.drive_line import DriveLine
from platoontraffic.controllers.tracker.fitted import Fitted, fitted
from platoontraffic.controllers.tracker.own_motion import Moved, Past, YawBias, seen_from
from platoontraffic.controllers.tracker.records import (
    ACCELERATION,
    OVERHANG,
    SPEED,
    Hiding,
    Sighting,
    X,
    Y,
)
from platoontraffic.controllers.tracker.track import Odometry, Track
from platoontraffic.controllers.tracker.trail import Ahead, RouteSection, Strip, Trail
from platoontraffic.lidar.segments import find_segments
from platoontraffic.vehicles.motion import Drive, Positive
from platoontraffic.vehicles.records import some

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

LEAST_HEADWAY, HEADWAY_PER_DELAY = 0.5, 1.1  # time headway with which no string of cars amplifies [s], [s/s]
RECOVERY = 2.5  # lateral acceleration of the return to the trail [m/s2]
PAST_PREDECESSOR = 0.5  # distance before the predecessor's rear at which the search for obstacles ends [m]
KEPT_FREE = 0.22  # on each side of the vehicle, on its path [m]
SWINGS_CLEAR = 0.1  # on each side, where its front swings out in a bend [m]
# Returns of one surface: it is met at no flatter angle [rad], and so many beams between them may be lost.
GRAZING, BRIDGED = math.radians(10), 5
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


class Obstacle(NamedTuple):
    """The first return over the strip ahead but the predecessor, arrays (n,)."""

    free: np.ndarray  # distance from the front bumper [m]; inf: none
    speed: np.ndarray  # along the strip [m/s]; NaN: not known yet
    acceleration: np.ndarray  # likewise [m/s2]
    bearing: np.ndarray  # of that return from the laser's forward direction [rad]; NaN: none

    @classmethod
    def none(cls, n: int) -> Obstacle:
        return cls(np.full(n, np.inf), *np.full((3, n), np.nan))


class Memory(NamedTuple):
    """Arrays (n,), or records of arrays."""

    odometry: Odometry
    yaw_bias: YawBias
    track: Track
    trail: Trail
    acceleration: np.ndarray  # last command [m/s2]
    curvature: np.ndarray  # last command [1/m]
    driven_curvature: np.ndarray  # modelled, by the commands before [1/m]
    drive_line: DriveLine
    past: Past
    obstacle: Obstacle  # in the scan
    scanned_speed: np.ndarray  # own speed in the scan [m/s]
    never_lost: np.ndarray  # it drives in the trail of its first predecessor, bool
    creeping: Creeping
    braking_for: BrakingFor
    for_lines: np.ndarray  # acceleration for a closed line [m/s2]; inf: none
    beside: Beside
    predecessor: Predecessor

    @classmethod
    def begin(cls, sensed: Sensed, dt: float, by_trail: bool) -> Memory:
        n = len(sensed.speed)
        records = Odometry.begin(sensed.speed, sensed.yaw_rate), YawBias.unknown(n), Track.none(n), Trail.begin(n)
        driven = *np.zeros((3, n)), DriveLine.at_rest(n), Past.begin(sensed, dt)
        none = Obstacle.none(n), sensed.speed, np.full(n, by_trail)
        unseen = Predecessor(*np.full((3, n), np.nan))
        return cls(*records, *driven, *none, Creeping.none(n), nothing(n), np.full(n, np.inf), Beside.none(n), unseen)


class Now(NamedTuple):
    """Inputs of a decision; what is sensed may be old, the speed in it is that of now."""

    sensed: Sensed
    memory: Memory
    odometry: Odometry
    driven_curvature: np.ndarray  # modelled by the commands [1/m], (n,)
    scanned: Odometry  # at the instant of the scan
    fitted: Fitted
    dt: float
    given: RouteAhead | None  # the route, where `sensed` has the one that is driven: shifted to a lane beside it
    leads: np.ndarray  # ordered to follow nothing, bool (n,)
    wrong_lane: np.ndarray  # it would come to the next stop line on another lane than its route, bool (n,)

    @property
    def speed(self) -> np.ndarray:
        return self.odometry.speed

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


class Pursuit(NamedTuple):
    """Stages 2 to 4 of the law, arrays (n,)."""

    curvature: np.ndarray  # that is steered, not limited [1/m]
    wanted: np.ndarray  # acceleration within comfort [m/s2]
    needed: np.ndarray  # to avoid a collision, driven if that takes more than comfortable braking [m/s2]; inf: none
    bends: np.ndarray  # greatest acceleration in bends of the trail [m/s2]


class Gains(NamedTuple):
    """Gains of a `TrackingFollower` with the same names."""

    stand_off: float
    time_headway: float
    distance_gain: float
    catching_up: float
    acceleration: float
    braking: float
    hardest_braking: float
    jerk: float
    margin: float
    lateral_acceleration: float


@dataclass(frozen=True)
class TrackingFollower(Law):
    """Tracks its predecessor by laser, drives in its trail, and keeps a time headway.

    Its gains follow from the vehicle's length, steering and lags, and from the interval of scans (`tracker.fitted`).

    1. Estimate. The groups of returns in the scan correct an extended Kalman filter of the predecessor's motion, in the
       frame of the own odometry (`tracker.track`). The bias of the measured yaw rate is estimated while the vehicle
       drives straight ahead (`tracker.own_motion_kernel`).
    2. Steer. The path of its rear axle is remembered (`tracker.trail`), and steered along: the trail's curvature, as
       far ahead as the steering lags and the fit of its direction wants (`tracker.fitted_kernel`), corrected by offset
       and direction,

           curvature = trail's - offset / l^2 - 2 sin(off_heading) / l,

       which is critically damped: e'' + 2 e' / l + e / l^2 = 0 along the trail. From a large offset the vehicle returns
       at a fixed angle. Bends ahead, their changes and the curvature that is steered now limit the speed
       (`tracker.bends_kernel`), and no curvature is steered that would exceed the lateral acceleration. Where it is
       given its route and drives on it, the bends of the route count, as those of the trail have errors.
    3. Follow. The distance from laser to rear shall be stand_off + time_headway v. With its error e and the gap's rate
       r the acceleration (r + distance_gain e) / time_headway makes the speed follow the predecessor's by a first-order
       lag of time_headway at every frequency, so no disturbance grows (Ioannou & Chien, "Autonomous intelligent cruise
       control", IEEE Trans. Vehicular Technology 42, 1993). The drive line's own lag is compensated by the rate of that
       acceleration (`tracking_kernel`), which contains the predecessor's acceleration. That is estimated some
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
       for the predecessor and for any obstacle on the strip ahead, whose speed and acceleration follow from its free
       distances (`tracker.obstacle_kernel`). As estimates of braking are late, the hardest braking is used from
       EMERGENCY of it on. An obstacle that drives there, a vehicle that has cut in, is also followed, and becomes the
       predecessor after HIDDEN of hiding it. If a gap is shorter than the one in which it could stop behind a vehicle
       that brakes as hard as it can itself, it is opened (`_open_gap`). A predecessor that is found anew in scan after
       scan is an obstacle too, since its speed is a guess.
    5. Alone. A predecessor not seen for `patience` is lost: the vehicle then stops, in the trail. With
       on_loss = "drive" it is given its route, and drives on along it as the path law `alone` does, until a vehicle is
       ahead on the route. It follows that one, along the route, since a laser cannot identify it; a predecessor that
       leaves the route is dropped. On the order to lead it drops its predecessor. With keeps_to = "route" it
       follows along its route from the start: the vehicle ahead is not of its platoon, and may change lanes where there
       is no room for a second one.
    6. Stop lines. With policy = "obey" it is given lights and right of way, and stops at a closed line as `alone` does;
       without a predecessor it always does. After that it follows along its route, if it is given one, since others may
       have come in between.
    """

    lidar: ClassVar[str] = "car-tracker"  # the preset, where a scenario names none
    coarsest: ClassVar[float] = GRAZING / (BRIDGED + 1)

    stand_off: Annotated[Positive, Field(alias="stand_off_m")] = 3.0  # laser to rear at rest
    time_headway: Annotated[Positive, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 1.0  # beyond the stand-off
    distance_gain: Annotated[Positive, Field(alias="distance_gain_per_s")] = 0.4  # closing speed by distance
    catching_up: Annotated[Positive, Field(alias="catching_up_mps")] = 3.0  # closing speed that is always allowed
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 2.5  # comfortable
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 3.5  # comfortable; ISO 15622 allows it at any speed
    hardest_braking: Annotated[Positive, Field(alias="hardest_braking_mps2")] = 9.0
    jerk: Annotated[Positive, Field(alias="jerk_mps3")] = 5.0  # comfortable; ISO 15622 at low speed
    margin: Annotated[Positive, Field(alias="margin_m")] = 2.7  # laser to rear after hard braking
    lateral_acceleration: Annotated[Positive, Field(alias="lateral_acceleration_mps2")] = 4.0  # greatest, in bends
    patience: Annotated[Positive, Field(alias="patience_s")] = 1.5  # until an unseen predecessor is lost
    # Of the strip that must be free; default: half of the vehicle's width, and KEPT_FREE.
    half_width: Annotated[Positive | None, Field(alias="half_width_m")] = None
    policy: Literal["convoy", "obey"] = "convoy"  # at closed stop lines behind a predecessor
    on_loss: Literal["stop", "drive"] = "stop"  # without a predecessor: stops, or drives along its route
    keeps_to: Literal["trail", "route"] = "trail"  # path that it follows along from the start
    alone: PathLeader = field(default_factory=PathLeader)  # drives along the route, and stops at lines

    def __post_init__(self) -> None:
        if self.alone.profile or self.alone.trace:
            raise ValueError("alone: profile and trace are for leaders; must be left out")
        if self.keeps_to == "route" and self.on_loss != "drive":
            raise ValueError('on_loss: must be "drive" with keeps_to = "route"')

    @property
    def needs(self) -> frozenset[str]:
        if self.drives_alone:
            return frozenset({"route", "signals", "leads"})
        return frozenset({"signals"} if self.policy == "obey" else ())

    @property
    def heeds_lines(self) -> bool:
        """In a convoy it follows its predecessor over a closed line."""
        return self.policy == "obey"

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

    def looks_along(self, speed: float) -> float:
        return self.alone.looks_along(speed)

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        # Imported here, as below: importing numba takes half a second.
        from platoontraffic.controllers.tracking_kernel import decide

        if memory is None:
            memory = Memory.begin(sensed, dt, by_trail=self.keeps_to == "trail")
        now, drive_line, bias, past = self._own_motion(sensed, memory, dt)
        sensed = now.sensed
        estimate = self._estimate(now)

        trail = self._remember(now, estimate)
        ahead = self._look_ahead(now, estimate, trail)
        scanned = self._obstacle(now, estimate, trail, ahead)
        obstacle = self._obstacle_now(now, scanned)
        along = None
        if sensed.route is not None:
            closing = now.speed - obstacle.speed
            along = self.alone.along_route(
                sensed, drive_line.drive, np.zeros(len(now.speed)), obstacle.free, closing, dt
            )
        pursuit = self._pursue(now, estimate, ahead, drive_line, obstacle, along)

        known, held = estimate.now.known, memory.beside.held
        stop = self.alone.acceleration_for_lines(sensed, drive_line.drive)
        road, creeps, limit = self._by_road(now, scanned, obstacle, along, stop)
        if self.policy == "convoy":
            stop = np.where(known & ~now.wrong_lane, np.inf, stop)
        command = Drive(*np.empty((2, len(known))))
        decide(now.speed, memory.acceleration, sensed.body.drive_lag, known, memory.never_lost, pursuit, obstacle,
               stop, held, along is not None, road, limit, self._gains, dt, command)  # fmt: skip

        lost = memory.track.known & ~estimate.predicted.known
        replaced = estimate.predicted.known & estimate.track.seen & np.isnan(estimate.track.nis)
        never_lost = memory.never_lost & ~(now.leads | lost | replaced)
        if along is not None:  # another vehicle may have come in between, so the next one is found anew
            never_lost &= limit.reason != LINE
        distance = np.where(known, ahead.length - OVERHANG - now.laser, np.nan)
        predecessor = Predecessor(distance, estimate.now.mean[:, SPEED], estimate.now.mean[:, ACCELERATION])
        memory = Memory(now.odometry, bias, estimate.track, trail, *command, now.driven_curvature, drive_line, past,
                        scanned, now.scanned.speed, never_lost, creeps, limit, stop,
                        self._look_beside(now, estimate, trail, past), predecessor)  # fmt: skip
        return Decision(command, memory, Target(*estimate.sighting.rear.T))

    def remembered_path(self, memory: Memory) -> np.ndarray:
        """Path of the predecessor's rear axle, as seen from the own one, (n, SHOWN, 2) [m]."""
        return memory.trail.seen_from_axle(memory.odometry, SHOWN)

    def braking_for(self, memory: Memory) -> BrakingFor:
        return memory.braking_for

    def off_trail(self, memory: Memory, rows: np.ndarray) -> Memory:
        never_lost = memory.never_lost.copy()
        never_lost[rows] = False
        return memory._replace(never_lost=never_lost)

    # ---- 1. estimate

    def _own_motion(self, sensed: Sensed, memory: Memory, dt: float) -> tuple[Now, DriveLine, YawBias, Past]:
        from platoontraffic.controllers.tracker.own_motion_kernel import move_on, steer

        late, past, body, last = sensed.odometry_age, memory.past, sensed.body, memory.odometry
        before = memory.driven_curvature
        driven, mean = np.empty((2, len(before)))
        steer(before, memory.curvature, body.steering_lag, body.curvature_rate, dt, driven, mean)
        then, more = driven, mean - (before + driven) / 2
        if past.x.shape[1]:
            drive_line = memory.drive_line.after(memory.acceleration, sensed.body, dt)
            gained = (memory.drive_line.acceleration + drive_line.acceleration) / 2 * dt
            past = past.driven(gained, memory.curvature, sensed.body, dt)
            last = past.at_reading()
            if late:
                then, more = past.curvature_at(late, dt), np.zeros_like(more)
        moved, known = Moved(*np.empty((9, len(driven)))), (memory.drive_line, memory.yaw_bias, last)
        commands = memory.acceleration, memory.curvature
        move_on(sensed.speed, sensed.yaw_rate, *commands, (then, more), known, body, dt, moved)
        drive_line, bias, odometry = DriveLine(*moved[:2]), YawBias(*moved[2:4]), Odometry(*moved[4:])
        scanned = odometry
        if past.x.shape[1]:
            past = past.read(odometry)
            odometry, scanned = past.at(0.0, late, dt), past.at(sensed.age, late, dt)
            sensed = replace(sensed, speed=odometry.speed)
        given, (leads, wrong_lane) = sensed.route, np.zeros((2, len(sensed.speed)), bool)
        if sensed.leads is not None:
            leads = sensed.leads
        if given is not None and some(memory.beside.active):
            wrong_lane = memory.beside.closes(given, sensed.signals.distance)
            signals = sensed.signals._replace(open=sensed.signals.open & ~wrong_lane)
            sensed = replace(sensed, route=memory.beside.drives(given), signals=signals)
        fit = fitted(sensed.body, odometry.speed, dt, RECOVERY)
        return Now(sensed, memory, odometry, driven, scanned, fit, dt, given, leads, wrong_lane), drive_line, bias, past

    def _estimate(self, now: Now) -> Estimate:
        sensed, route, scanned = now.sensed, now.sensed.route, now.scanned
        predicted = self._predict(now)
        points = np.empty((len(scanned.x), 0, 2)) if route is None else route.points
        if sensed.age and route is not None:
            points = seen_from(points, now.odometry, scanned)
        segments, obstacle = find_segments(sensed.scan, jump=0.3, grazing=GRAZING, bridge=BRIDGED), now.memory.obstacle
        distance = obstacle.free + sensed.body.length / 2 - sensed.scan.model.mount.x
        hiding = Hiding(distance, obstacle.speed, obstacle.acceleration)
        track, sighting = predicted.corrected(sensed.scan, segments, scanned, now.laser, points, hiding, now.dt)
        if some(now.leads):
            track, sighting = track.forgotten(now.leads), sighting.without(now.leads)
        # A predecessor that was met on the route is followed along the route.
        on_route = (~predicted.known | ~now.memory.never_lost | now.memory.beside.active) & (route is not None)
        at_use = track.predicted(now.odometry, sensed.age) if sensed.age else track
        aligned, aligned_now = track, at_use
        if now.given is not None and some(now.memory.beside.active):
            aligned, aligned_now = (now.memory.beside.aligned(one, now.given, now.odometry) for one in (track, at_use))
        return Estimate(predicted, track, at_use, aligned, aligned_now, sighting, on_route)

    def _predict(self, now: Now) -> Track:
        """The track at the time of this scan, without predecessors that are lost, off the route, or not wanted."""
        track = now.memory.track.predicted(now.scanned, now.dt)
        track = track.forgotten(track.blind > self.patience)
        if now.sensed.route is not None:
            limit = np.where(now.memory.never_lost, ASIDE, ASIDE_ANEW)
            limit[now.memory.track.speed_is_guessed] = np.inf  # where it is now is a guess
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

    def _look_beside(self, now: Now, estimate: Estimate, trail: Trail, past: Past) -> Beside:
        if now.given is None:
            return now.memory.beside
        scan = now.sensed.scans.get(AROUND)
        follows = estimate.track.known & now.memory.never_lost
        age, scanned = now.sensed.ages.get(AROUND, 0.0), now.odometry
        if age:
            scanned = past.at(age, now.sensed.odometry_age, now.dt)
        scene = beside.Scene(
            now.given, now.odometry, estimate.now, trail, follows, now.sensed, scan, age, scanned, now.dt
        )
        return beside.look(now.memory.beside, scene)

    def _look_ahead(self, now: Now, estimate: Estimate, trail: Trail) -> Ahead:
        fit = now.fitted
        windows = fit.window, fit.bend_window, fit.plan_window
        return trail.ahead(now.odometry, estimate.aligned_now, estimate.on_route, windows, fit.preview)

    # ---- 2. to 4. steer, follow, avoid

    def _pursue(
        self, now: Now, estimate: Estimate, ahead: Ahead, drive_line: DriveLine, obstacle: Obstacle,
        along: AlongRoute | None,
    ) -> Pursuit:  # fmt: skip
        from platoontraffic.controllers.tracking_kernel import pursue

        body, mount, track, beside_it = now.sensed.body, now.sensed.scan.model.mount.x, estimate.now, now.memory.beside
        pursuit = Pursuit(*np.empty((4, len(now.speed))))
        route = np.full(len(now.speed), np.inf), ahead.curvature, ahead.bend, ahead.distance
        if along is not None:
            route = along.offset, along.curvature, now.sensed.route.curvature, now.sensed.route.distance
        pursue(now.speed, now.memory.acceleration, body, mount, now.fitted, drive_line, track, ahead, obstacle,
               estimate.on_route, route, self._gains, now.dt, pursuit)  # fmt: skip
        if not some(beside_it.held):
            return pursuit
        error = ahead.length - OVERHANG - now.laser - self.desired_distance(now.speed)
        age, speed_ahead = now.sensed.ages.get(AROUND, 0.0), track.mean[:, SPEED]
        slower = beside.slowed(beside_it, body.length, now.speed, speed_ahead, error, age, pursuit.wanted)
        return pursuit._replace(wanted=slower)

    def _obstacle(self, now: Now, estimate: Estimate, trail: Trail, ahead: Ahead) -> Obstacle:
        """In the scan. A predecessor that is found anew in scan after scan is an obstacle too: its speed is a guess."""
        from platoontraffic.controllers.tracker.obstacle_kernel import follow_obstacle

        sensed, memory, beams = now.sensed, now.memory, estimate.sighting.beams
        followed = estimate.track.known
        if some(anew := estimate.track.speed_is_guessed & memory.track.speed_is_guessed):
            followed, beams = followed & ~anew, np.where(anew[:, None], -1, beams)
        beyond_end = np.maximum(ahead.length, 0) + sensed.scan.model.range_max / 2
        reach = np.where(followed, ahead.length - OVERHANG - PAST_PREDECESSOR, beyond_end)
        if sensed.age:
            there, then = estimate.now.mean, estimate.track.mean
            driven = np.nan_to_num(np.hypot(there[:, X] - then[:, X], there[:, Y] - then[:, Y]))
            reach = reach + now.driven - driven
        given = self.half_width
        half_width = sensed.body.width / 2 + KEPT_FREE if given is None else np.full(len(reach), given)
        strip = Strip(half_width, reach, sensed.body.width / 2 + SWINGS_CLEAR)
        free, beam = trail.free_distance(now.scanned, sensed.scan, sensed.body, strip, beams)
        if sensed.route is not None and some(estimate.on_route):
            points = (
                sensed.route.points if not sensed.age else seen_from(sensed.route.points, now.odometry, now.scanned)
            )
            until = np.where(estimate.on_route, reach - sensed.body.length / 2 + sensed.body.axle, 0.0)
            first_touched(sensed, points, now.driven_curvature, beams, until, free, beam)
        speed, acceleration = np.empty((2, len(free)))
        follow_obstacle(free, now.scanned.speed, memory.obstacle, memory.scanned_speed, now.dt, speed, acceleration)
        return Obstacle(free, speed, acceleration, bearing_of(beam, sensed.scan.model))

    def _obstacle_now(self, now: Now, scanned: Obstacle) -> Obstacle:
        """It goes on as in the scan; it stands, if its speed is not known yet."""
        if not now.sensed.age:
            return scanned
        moved = np.nan_to_num(scanned.speed) * now.sensed.age
        return scanned._replace(free=np.maximum(scanned.free - now.driven + moved, 0.0))

    # ---- 5. and 6. alone, stop lines

    def _by_road(
        self, now: Now, scanned: Obstacle, obstacle: Obstacle, along: AlongRoute | None, lines: np.ndarray
    ) -> tuple[tuple[np.ndarray, ...], Creeping, BrakingFor]:
        """How `alone` drives: its acceleration, those for bends and for its sight, and the offset from the route, (n,).

        Where it drives alone it creeps as `alone` does. Also: what limits it.
        """
        memory, n = now.memory, len(now.speed)
        if along is None:
            return (np.zeros(n),) * 4, memory.creeping, nothing(n)
        blocked = np.isfinite(scanned.free)
        before = memory.obstacle.free + np.where(blocked, obstacle.free, 0.0) - np.where(blocked, scanned.free, 0.0)
        alone, creeps, limit = self.alone.acceleration_among_others(
            now.sensed, along, lines, (obstacle.free, obstacle.bearing, before), memory.creeping, now.dt
        )
        return (alone, along.bends, along.sight, along.offset), creeps, limit

    @cached_property
    def _gains(self) -> Gains:
        return Gains(*(float(getattr(self, name)) for name in Gains._fields))
