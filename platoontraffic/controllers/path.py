"""A leader on a given path, the other leader of the paper ("a leader robot has a predefined path")."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers import creeping
from platoontraffic.controllers.clear_distance import greatest_speed, reach_of, reaction_time
from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.creeping import Creeping
from platoontraffic.controllers.law import BRAKES_FOR, MAX_HEADWAY, Body, BrakingFor, Decision, Law, Sensed
from platoontraffic.controllers.profiles import Trace, braking, chirp, sinusoid, through_lags
from platoontraffic.controllers.tracker.own_motion import Driven, seen_from
from platoontraffic.controllers.tracker.track import Odometry
from platoontraffic.lidar import LidarModel
from platoontraffic.vehicles.motion import Drive, Positive, VehicleModel

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

FILTER = 0.3  # time constant of the filter of the closing speed [s]
STRONGEST = 5.0  # acceleration that a follower may want, which drives by the same bends [m/s2]
LAGS = 2.0  # time for which an engine at most accelerates on after its command [s]
SAME = 0.25  # greatest difference of the free distance from its prediction, for one obstacle [vehicle lengths]
SMOOTH = ("sinusoid", "chirp")  # profiles that are fed forward through the vehicle's lag

PREDECESSOR, OBSTACLE, LINE, LOST, BESIDE = range(1, len(BRAKES_FOR))


class Memory(NamedTuple):
    """Arrays (n,), or records of arrays."""

    time: np.ndarray  # since departure [s]
    free: np.ndarray  # distance to the first obstacle on the route [m]; inf: none
    closing: np.ndarray  # rate at which it shrinks [m/s]; NaN: not known yet
    creeping: Creeping
    braking_for: BrakingFor
    driven: Driven

    @classmethod
    def begin(cls, sensed: Sensed, dt: float) -> Memory:
        n = len(sensed.speed)
        driven = Driven.begin(sensed, dt)
        return cls(np.zeros(n), np.full(n, np.inf), np.full(n, np.nan), Creeping.none(n), nothing(n), driven)


class AlongRoute(NamedTuple):
    """What a vehicle may drive along its route, arrays (n,); inf where nothing limits it."""

    offset: np.ndarray  # of the driven axle from the route, to the left [m]
    bends: np.ndarray  # acceleration for bends and limits, here and ahead [m/s2]
    sight: np.ndarray  # for the reach of the laser [m/s2]
    obstacle: np.ndarray  # for the first obstacle [m/s2]
    acceleration: np.ndarray  # for speed, bends, sight and obstacle [m/s2]
    curvature: np.ndarray  # of the route, and back to it where the vehicle is beside it [1/m]


class Gains(NamedTuple):
    """Gains of a `PathLeader` with the same names; NaN in place of None."""

    speed_factor: float  # inf: it does not drive by speed limits
    catch_up: float
    catch_up_time: float
    stand_off: float
    time_headway: float
    acceleration: float
    braking: float
    hardest_braking: float
    lateral_acceleration: float


@dataclass(frozen=True)
class PathLeader(Law):
    """Drives its route at the speed of a profile, as far as bends, lines and traffic allow.

    Steering  : the curvature of the route, which is rounded so that the vehicle can drive it (`drivable_line`), and
                back to the route from any offset and heading (`steering`). It is limited to `RESERVE` times
                `lateral_acceleration`.
    Bends     : never faster than `lateral_acceleration` allows by the curvature of the route, or the steering rate by
                its change. Astray, it drives at the speed of its tightest turn.
    Sight     : by speed limits it is never faster than it can stop within its laser's reach (`clear_distance`).
    Obstacles : the first return on the strip that it will drive over is followed, or stopped for, by the interaction
                term of the Intelligent Driver Model (`idm`). The closing speed is filtered from successive scans, so it
                is known from the second scan on. It stops if every beam is lost.
    Lines     : stops at a closed line if it can by `hardest_braking`; for yellow, by twice the comfortable braking.
                Without right of way it approaches slowly, and passes when the line is open.

    Each of these is an acceleration, and the least one is driven. To have no more than a speed v0 from a distance s on,
    the speed u = sqrt(v0^2 + 2 braking s) is allowed here. It is approached as a wanted speed is, so braking is the
    comfortable one, and begins as late as that allows; before bends and lower limits it is planned a little less hard.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route", "signals"})

    speed: Annotated[Positive | Literal["road"], Field(alias="speed_mps")] = "road"  # or the speed limits of the route
    speed_factor: Positive = 1.0  # times the speed limits
    profile: Literal["sinusoid", "chirp", "step", "brake"] | None = None  # of the speed, from `begins_s` on
    begins: Annotated[NotNegative, Field(alias="begins_s")] = 0.0  # time from departure to the profile
    amplitude: Annotated[NotNegative, Field(alias="amplitude_mps")] = 0.0  # of a sinusoid or chirp
    frequency: Annotated[Positive, Field(alias="frequency_hz")] = 0.1  # of a sinusoid, or at a chirp's begin
    last_frequency: Annotated[Positive, Field(alias="last_frequency_hz")] = 0.5  # at a chirp's end
    lasts: Annotated[Positive, Field(alias="lasts_s")] = 60.0  # duration of a chirp
    last_speed: Annotated[NotNegative, Field(alias="last_speed_mps")] = 0.0  # after a step or braking
    rate: Annotated[Positive, Field(alias="rate_mps2")] = 4.0  # of the profile `brake`
    trace: Path | None = None  # a CSV file with time_s and speed_mps, or of OpenACC, instead of speed and profile
    catch_up: Annotated[Positive | None, Field(alias="catch_up_m")] = None  # to the route; default: 1 vehicle length
    catch_up_time: Annotated[Positive, Field(alias="catch_up_time_s")] = 0.6  # that the distance above takes at least
    half_width: Annotated[Positive | None, Field(alias="half_width_m")] = (
        None  # of the strip; default: 0.6 vehicle widths
    )
    stand_off: Annotated[NotNegative | None, Field(alias="stand_off_m")] = (
        None  # default: half a length, and blind spot
    )
    time_headway: Annotated[NotNegative, Field(alias="time_headway_s", le=MAX_HEADWAY)] = 1.5  # to a moving obstacle
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 2.5  # comfortable
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 3.0  # comfortable
    hardest_braking: Annotated[Positive, Field(alias="hardest_braking_mps2")] = 8.0
    lateral_acceleration: Annotated[Positive, Field(alias="lateral_acceleration_mps2")] = 3.6  # most in bends

    def __post_init__(self) -> None:
        if self.trace is not None:
            self._trace  # noqa: B018  faults of the file are reported before the run

    @cached_property
    def _trace(self) -> Trace:
        return Trace.read(self.trace)

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        if memory is None:
            memory = Memory.begin(sensed, dt)
        driven = memory.driven
        if sensed.odometry_age:
            driven, own = driven.until_now(sensed, dt)
            sensed = replace(sensed, speed=own.speed, yaw_rate=own.yaw_rate)
        free, bearing = first_return(sensed, self._half_width(sensed.body), memory.driven.command.curvature)
        same = SAME * sensed.body.length
        closing = closing_speed(free, memory.free, memory.closing, sensed.speed, dt, same=same, time_constant=FILTER)
        drive = memory.driven.command.acceleration
        along = self.along_route(sensed, drive, memory.time, free, closing, dt)
        acceleration, creeps, limit = self.acceleration_among_others(
            sensed, along, self.acceleration_for_lines(sensed, drive), (free, bearing, memory.free), memory.creeping, dt
        )
        acceleration = np.maximum(acceleration, -self.hardest_braking)
        acceleration = np.maximum(acceleration, -sensed.speed / dt)  # braking ends at a stand
        command = Drive(acceleration, along.curvature)
        driven = Driven(command, driven.drive_line, driven.past)
        return Decision(command, Memory(memory.time + dt, free, closing, creeps, limit, driven))

    def _half_width(self, body: Body) -> np.ndarray:
        return 0.6 * body.width if self.half_width is None else np.full(len(body.width), float(self.half_width))

    @property
    def drives_by_limits(self) -> bool:
        """Its speed follows the speed limits of its route."""
        return self.speed == "road" and self.trace is None

    def greatest_speed_by_sight(self, lidar: LidarModel, vehicle: VehicleModel) -> float:
        """The greatest speed of a vehicle by what its laser sees [m/s]; inf where its speed is given."""
        if not self.drives_by_limits:
            return math.inf
        reach = reach_of(lidar.range_max, lidar.mount.x, vehicle.length)
        hardest = min(self.hardest_braking, vehicle.hardest_braking)
        return float(greatest_speed(reach, reaction_time(lidar) + vehicle.brake_lag, hardest))

    @cached_property
    def _gains(self) -> Gains:
        gains = (math.nan if (value := getattr(self, name)) is None else float(value) for name in Gains._fields)
        return Gains(*gains)._replace(speed_factor=float(self.speed_factor) if self.drives_by_limits else math.inf)

    def along_route(self, sensed: Sensed, drive, time, free, closing, dt: float) -> AlongRoute:
        """What vehicles may drive on their routes, (n,).

        drive         : acceleration by the engine now, or commanded last [m/s2], (n,)
        time          : since departure [s], (n,)
        free, closing : distance to the first obstacle [m], and the rate at which it shrinks [m/s], (n,)
        """
        # Imported here, as below: importing numba takes half a second.
        from platoontraffic.controllers.path_kernel import drive_along

        route, body, scan = sensed.route, sensed.body, sensed.scan
        model, along = scan.model, AlongRoute(*np.empty((6, len(time))))
        laser = model.range_min, model.range_max, model.mount.x, reaction_time(model)
        profile = self._profiled(time, route.limit[:, 0], body, dt)
        drive_along(route, sensed.speed, drive, body, scan.ranges, laser, free, closing, profile, self._gains, along)
        return along

    def _profiled(self, time: np.ndarray, limit: np.ndarray, body: Body, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Speed of the profile [m/s] and its rate [m/s2], (n,), as `_profile`."""
        wanted = self._profile(time, limit)
        steady = self.profile is None and self.trace is None
        if steady or self.profile == "step":  # a step has no rate: it is driven in comfort
            return wanted, np.zeros(len(time))
        if self.profile in SMOOTH:
            lags = body.drive_lag, body.brake_lag
            return wanted, through_lags(lambda at: self._profile(at, limit), time, dt, lags)
        return wanted, (self._profile(time + dt, limit) - wanted) / dt

    def _profile(self, time: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Wanted speed at times (n,) since departure [m/s].

        limit: speed limit here [m/s], (n,)
        """
        if self.trace is not None:
            return self._trace.at(time)
        base = self.speed_factor * limit if self.speed == "road" else np.full(len(time), float(self.speed))
        if self.profile is None:
            return base
        t = time - self.begins
        more = {
            "sinusoid": lambda: sinusoid(t, self.amplitude, self.frequency),
            "chirp": lambda: chirp(t, self.amplitude, self.frequency, self.last_frequency, self.lasts),
            "step": lambda: self.last_speed - base,
            "brake": lambda: braking(t, self.last_speed - base, self.rate),
        }[self.profile]()
        return np.maximum(base + np.where(t >= 0, more, 0.0), 0.0)

    def braking_for(self, memory: Memory) -> BrakingFor:
        return memory.braking_for

    def acceleration_among_others(
        self,
        sensed: Sensed,
        along: AlongRoute,
        lines: np.ndarray,
        strip: tuple[np.ndarray, np.ndarray, np.ndarray],
        creeps: Creeping,
        dt: float,
    ) -> tuple[np.ndarray, Creeping, BrakingFor]:
        """The acceleration along the route, limited by lines, or that of creeping; and what limits it.

        lines : `acceleration_for_lines`
        strip : distance to the first obstacle on the strip [m], its bearing from the laser [rad], and the distance in
                the last scan, (n,) each
        """
        from platoontraffic.controllers.path_kernel import limits_of  # importing numba takes half a second

        acceleration, obstacle, (free, bearing, _) = along.acceleration, along.obstacle, strip
        creeps = creeps.after(sensed, strip, lines < obstacle, along.curvature, dt)
        active = creeps.active
        if len(rows := active.nonzero()[0]):
            acceleration = acceleration.copy()
            acceleration[rows] = creeping.acceleration(sensed, rows, along.curvature, self.braking)
        (least, toward), reason = np.empty((2, len(free))), np.empty(len(free), dtype=np.intp)
        words = OBSTACLE, LINE
        limits_of(acceleration, lines, obstacle, free, bearing, active, words, least, reason, toward)
        return least, creeps, BrakingFor(reason, toward, active)

    def looks_along(self, speed: float) -> float:
        if self.profile or self.trace:  # its own accelerations may be any
            return math.inf
        # What allows it to be so much faster does not slow it: see `_slowed_to`.
        slack, braking, reaction = self._slowing
        return (speed + slack) ** 2 / (2 * braking) + reaction * (speed + slack)

    @cached_property
    def _slowing(self) -> tuple[float, float, float]:
        """Of `looks_along`: speed [m/s], braking [m/s2], and time until it brakes [s]."""
        from platoontraffic.controllers.path_kernel import PLANNED, REACTION, SETTLING

        slack = SETTLING * (max(self.acceleration, STRONGEST) + self.braking) + LAGS * self.acceleration
        return slack, PLANNED * self.braking, REACTION

    def acceleration_for_lines(self, sensed: Sensed, drive: np.ndarray) -> np.ndarray:
        """For a closed line ahead, (n,) [m/s2]; inf where there is none.

        drive: as of `along_route`
        """
        from platoontraffic.controllers.path_kernel import stop_at_lines

        acceleration = np.empty(len(sensed.speed))
        if sensed.signals is None:
            acceleration.fill(np.inf)
        else:
            stop_at_lines(sensed.signals, sensed.speed, drive, sensed.body, self._gains, acceleration)
        return acceleration


def nothing(n: int) -> BrakingFor:
    """n vehicles that brake for nothing."""
    return BrakingFor(np.zeros(n, dtype=int), np.full(n, np.nan), np.zeros(n, dtype=bool))


def first_return(sensed: Sensed, half_width: np.ndarray, driven: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Along the route from the front bumper to the first return on the strip that the vehicle will drive over.

    half_width : of the strip [m], (n,)
    driven     : curvature that is driven now [1/m], (n,)
    returns    : distance [m], and its bearing from the laser's forward direction [rad], (n,); inf, NaN: no return
    """
    from platoontraffic.controllers.path_kernel import first_on_strip

    scan, body, route = sensed.scan, sensed.body, sensed.route
    model, n = scan.model, len(sensed.speed)
    free, beam, limits = np.empty(n), np.empty(n, dtype=np.intp), (model.range_min, model.range_max)
    beams, laser, front = model.body_directions, model.mount.x - body.axle, body.length / 2 - body.axle
    points = route.points
    if sensed.age:  # as seen from where the scan was taken, so that the distance is that from where the vehicle is now
        then = Odometry.begin(sensed.speed, sensed.yaw_rate)
        points = seen_from(points, then.moved(sensed.speed, sensed.yaw_rate, sensed.age), then)
    strip = points, route.distance, half_width
    first_on_strip(scan.ranges, limits, beams, laser, model.mount.y, strip, body.length, front, free, beam)
    first_touched(sensed, points, driven, *_all_beams(n), free, beam)
    return free, bearing_of(beam, model)


def first_touched(
    sensed: Sensed, points: np.ndarray, driven: np.ndarray, skipped: np.ndarray, until: np.ndarray,
    free: np.ndarray, beam: np.ndarray,
) -> None:  # fmt: skip
    """Lower free distances to those until the body would touch a return in a bend, and fill in the beams of these.

    points : of the routes, as seen from where the scan was taken (n, k, 2) [m]
    others : as of `swept_kernel.first_touched`
    """
    from platoontraffic.controllers import swept_kernel  # importing numba takes half a second

    scan, body, model = sensed.scan, sensed.body, sensed.scan.model
    laser, seen = (model.mount.x - body.axle, model.mount.y), (scan.ranges, model.range_min, model.body_directions)
    swept_kernel.first_touched(
        sensed.route, points, sensed.speed, driven, body, seen, laser, skipped, until, free, beam
    )


@lru_cache
def _all_beams(n: int) -> tuple[np.ndarray, np.ndarray]:
    """`skipped` and `until` of `first_touched` where every return counts."""
    return np.full((n, 2), -1), np.full(n, np.inf)


def bearing_of(beam: np.ndarray, model) -> np.ndarray:
    """Bearing of beams from the laser's forward direction [rad], (n,); NaN for beam -1."""
    return np.where(beam < 0, np.nan, model.angles[beam])
