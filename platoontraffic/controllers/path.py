"""A leader on a given path, the other leader of the paper ("a leader robot has a predefined path")."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers import creeping, idm
from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.creeping import Creeping
from platoontraffic.controllers.law import BRAKES_FOR, BrakingFor, Decision, Law, RouteAhead, Sensed
from platoontraffic.controllers.profiles import Trace, braking, chirp, sinusoid, through_lags
from platoontraffic.controllers.steering import Errors, curvature_along, curvature_back
from platoontraffic.lidar.pose import wrap
from platoontraffic.vehicles.motion import Drive, Positive

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

SETTLING = 0.5  # time constant with which the wanted speed is approached [s]
REACTION = 0.4  # of the drive line to a command [s]
LOOK = 2.5  # distance before a line without right of way at which cross traffic is first looked at [vehicle lengths]
STOP_BEFORE = 0.2  # distance before a line at which it stops [vehicle lengths]
FILTER = 0.3  # time constant of the filter of the closing speed [s]
SAME = 0.25  # greatest difference of the free distance from its prediction, for one obstacle [vehicle lengths]
STEERING_LAG = 0.15  # from a command to the curvature driven, by which the curvature of the route is fed forward [s]
SMOOTH = ("sinusoid", "chirp")  # profiles that are fed forward through the vehicle's lag
SHARPEST = 0.1  # least radius of a turn, for a vehicle that turns on the spot [vehicle lengths]
STEERED = 0.95  # share of its steering rate that the changes of curvature may take
RESERVE = 1.15  # lateral acceleration that steering may use, above that of the planned speed
ASTRAY, ASKEW = 0.5, 0.5  # offset [vehicle widths] and off-heading [rad] beyond which it returns to its route slowly


PREDECESSOR, OBSTACLE, LINE, LOST, BESIDE = range(1, len(BRAKES_FOR))


class Memory(NamedTuple):
    """Arrays (n,), or records of arrays."""

    time: np.ndarray  # since departure [s]
    free: np.ndarray  # distance to the first obstacle on the route [m]; inf: none
    closing: np.ndarray  # rate at which it shrinks [m/s]; NaN: not known yet
    creeping: Creeping
    braking_for: BrakingFor


@dataclass(frozen=True)
class PathLeader(Law):
    """Drives its route at the speed of a profile, as far as bends, lines and traffic allow.

    Steering  : the curvature of the route, which is rounded so that the vehicle can drive it (`drivable_line`), and
                back to the route from any offset and heading (`steering`). It is limited to `RESERVE` times
                `lateral_acceleration`.
    Bends     : never faster than `lateral_acceleration` allows by the curvature of the route, or the steering rate by
                its change. Astray, it drives at the speed of its tightest turn.
    Obstacles : the first return on the strip that it will drive over is followed, or stopped for, by the interaction
                term of the Intelligent Driver Model (`idm`). The closing speed is filtered from successive scans, so it
                is known from the second scan on. It stops if every beam is lost.
    Lines     : stops at a closed line if it can by `hardest_braking`; for yellow, by twice the comfortable braking.
                Without right of way it approaches slowly, and passes when the line is open.

    Each of these is an acceleration, and the least one is driven. To have no more than a speed v0 from a distance s on,
    (v^2 - v0^2) / 2 s must be braked, which is a share q of the comfortable braking; the acceleration is then
    acceleration - (acceleration + braking) q: the full one far away, and the comfortable braking at q = 1.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route", "signals"})

    speed: Annotated[Positive | Literal["road"], Field(alias="speed_mps")] = "road"  # or the speed limits of the route
    speed_factor: Positive = 1.0  # times the speed limits
    profile: Literal["sinusoid", "chirp", "step", "brake"] | None = None
    begins: Annotated[NotNegative, Field(alias="begins_s")] = 0.0  # time from departure to the profile
    amplitude: Annotated[NotNegative, Field(alias="amplitude_mps")] = 0.0  # of a sinusoid or chirp
    frequency: Annotated[Positive, Field(alias="frequency_hz")] = 0.1  # of a sinusoid, or at a chirp's begin
    last_frequency: Annotated[Positive, Field(alias="last_frequency_hz")] = 0.5  # at a chirp's end
    lasts: Annotated[Positive, Field(alias="lasts_s")] = 60.0  # duration of a chirp
    last_speed: Annotated[NotNegative, Field(alias="last_speed_mps")] = 0.0  # after a step or braking
    rate: Annotated[Positive, Field(alias="rate_mps2")] = 4.0  # of the profile `brake`
    trace: Path | None = None  # a CSV file with time_s and speed_mps, instead of speed and profile
    catch_up: Annotated[Positive | None, Field(alias="catch_up_m")] = None  # to the route; default: 1 vehicle length
    catch_up_time: Annotated[Positive, Field(alias="catch_up_time_s")] = 0.6  # that the distance above takes at least
    half_width: Annotated[Positive | None, Field(alias="half_width_m")] = (
        None  # of the strip; default: 0.6 vehicle widths
    )
    stand_off: Annotated[NotNegative | None, Field(alias="stand_off_m")] = (
        None  # default: half a length, and blind spot
    )
    time_headway: Annotated[NotNegative, Field(alias="time_headway_s")] = 1.5
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 2.5
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 3.0  # comfortable
    hardest_braking: Annotated[Positive, Field(alias="hardest_braking_mps2")] = 8.0
    lateral_acceleration: Annotated[Positive, Field(alias="lateral_acceleration_mps2")] = 3.6

    def __post_init__(self) -> None:
        if self.trace is not None:
            self._trace  # noqa: B018  faults of the file are reported before the run

    @cached_property
    def _trace(self) -> Trace:
        return Trace.read(self.trace)

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        n = len(sensed.speed)
        if memory is None:
            memory = Memory(np.zeros(n), np.full(n, np.inf), np.full(n, np.nan), Creeping.none(n), nothing(n))
        free, bearing = first_return(sensed, _or(self.half_width, 0.6 * sensed.body.width))
        same = SAME * sensed.body.length
        closing = closing_speed(free, memory.free, memory.closing, sensed.speed, dt, same=same, time_constant=FILTER)
        acceleration = self.acceleration_on(sensed, memory.time, free, closing, dt)
        acceleration, creeps, limit = self.acceleration_among_others(
            sensed, acceleration, free, bearing, closing, memory.free, memory.creeping, dt
        )
        acceleration = np.maximum(acceleration, -self.hardest_braking)
        acceleration = np.maximum(acceleration, -sensed.speed / dt)  # braking ends at a stand
        return Decision(
            Drive(acceleration, self.curvature_on(sensed)), Memory(memory.time + dt, free, closing, creeps, limit)
        )

    def acceleration_for_bends(self, sensed: Sensed) -> np.ndarray:
        """For bends and lower limits ahead on the route, (n,) [m/s2]; inf where there are none."""
        return self._for_bends(sensed, self._fastest(sensed))

    def acceleration_on(self, sensed: Sensed, time, free, closing, dt: float) -> np.ndarray:
        """For speed, bends and obstacles, (n,) [m/s2].

        time          : since departure [s], (n,)
        free, closing : distance to the first obstacle [m], and the rate at which it shrinks [m/s], (n,)
        """
        fastest = self._fastest(sensed)
        wanted = (
            self._for_speed(sensed, time, dt, fastest[:, 0]),
            self._for_bends(sensed, fastest),
            self._for_obstacles(sensed, free, closing),
        )
        return np.min(wanted, axis=0)

    def curvature_on(self, sensed: Sensed) -> np.ndarray:
        """Of the route, and back to it where the vehicle is beside it, (n,) [1/m]."""
        speed, body, route = sensed.speed, sensed.body, sensed.route
        errors = errors_on(route)
        catch_up = np.maximum(_or(self.catch_up, body.length), self.catch_up_time * speed)
        lock = 1 / np.maximum(body.turning_radius, SHARPEST * body.length)
        bend = self.lateral_acceleration / np.maximum(speed, 1e-3) ** 2
        back = curvature_back(errors, catch_up, np.minimum(lock, bend))
        greatest = np.minimum(lock, RESERVE * bend)
        return np.clip(curvature_along(errors, curvature_at(route, STEERING_LAG * speed)) + back, -greatest, greatest)

    def _fastest(self, sensed: Sensed) -> np.ndarray:
        """Allowed speed at each point ahead, (n, k) [m/s]: by bends, and by limits if it drives by them."""
        route, body = sensed.route, sensed.body
        fastest = np.sqrt(self.lateral_acceleration / np.maximum(np.abs(route.curvature), 1e-9))
        change = np.abs(np.diff(route.curvature)) / np.diff(route.distance)  # of the curvature, by distance [1/m2]
        steered = STEERED * body.curvature_rate[:, None] / np.maximum(change, 1e-9)
        fastest[:, :-1] = np.minimum(fastest[:, :-1], steered)
        if self.speed == "road" and self.trace is None:
            fastest = np.minimum(fastest, self.speed_factor * route.limit)
        errors = errors_on(route)
        astray = (np.abs(errors.offset) > ASTRAY * body.width) | (np.abs(errors.off_heading) > ASKEW)
        turning = np.sqrt(self.lateral_acceleration * np.maximum(body.turning_radius, body.length / 2))
        return np.where(astray[:, None], np.minimum(fastest, turning[:, None]), fastest)

    def _for_speed(self, sensed: Sensed, time: np.ndarray, dt: float, fastest: np.ndarray) -> np.ndarray:
        """Acceleration towards the speed of the profile, or towards the one allowed here, (n,)."""
        wanted = self._profile(time, sensed.route.limit[:, 0])
        # A step has no rate: it is driven in comfort.
        change = 0.0 if self.profile == "step" else (self._profile(time + dt, sensed.route.limit[:, 0]) - wanted) / dt
        if self.profile in SMOOTH:
            lags = sensed.body.drive_lag, sensed.body.brake_lag
            change = through_lags(lambda at: self._profile(at, sensed.route.limit[:, 0]), time, dt, lags)
        wanted, change = np.minimum(wanted, fastest), np.where(wanted <= fastest, change, 0.0)
        # The rate of a profile is driven; a constant speed is approached in comfort.
        least, most = np.minimum(change, -self.braking), np.maximum(change, self.acceleration)
        return np.clip(change + (wanted - sensed.speed) / SETTLING, least, most)

    def _profile(self, time: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Wanted speed at times (n,) since departure [m/s].

        limit: speed limit here [m/s], (n,)
        """
        if self.trace is not None:
            return self._trace.at(time)
        base = self.speed_factor * limit if self.speed == "road" else np.full(len(time), self.speed)
        t = time - self.begins
        more = {
            None: lambda: 0 * t,
            "sinusoid": lambda: sinusoid(t, self.amplitude, self.frequency),
            "chirp": lambda: chirp(t, self.amplitude, self.frequency, self.last_frequency, self.lasts),
            "step": lambda: self.last_speed - base,
            "brake": lambda: braking(t, self.last_speed - base, self.rate),
        }[self.profile]()
        return np.maximum(base + np.where(t >= 0, more, 0.0), 0.0)

    def _for_bends(self, sensed: Sensed, fastest: np.ndarray) -> np.ndarray:
        """For lower speeds ahead; one that is about to hold is approached as a wanted speed is."""
        speed = sensed.speed[:, None]
        distance = sensed.route.distance - REACTION * speed
        near = distance < SETTLING / 2 * speed
        soon = np.where(near, (fastest - speed) / SETTLING, np.inf)
        ahead = self._slowed_to(fastest, np.maximum(distance, SETTLING / 2 * speed), speed)
        return np.minimum(soon, ahead)[:, 1:].min(axis=1)

    def braking_for(self, memory: Memory) -> BrakingFor:
        return memory.braking_for

    def acceleration_among_others(
        self,
        sensed: Sensed,
        acceleration: np.ndarray,
        free: np.ndarray,
        bearing: np.ndarray,
        closing: np.ndarray,
        before: np.ndarray,
        creeps: Creeping,
        dt: float,
    ) -> tuple[np.ndarray, Creeping, BrakingFor]:
        """An acceleration that heeds obstacles, limited by lines, or that of creeping; and what limits it.

        free, bearing : distance to the first obstacle on the strip [m], its bearing from the laser [rad], (n,)
        closing       : rate at which that distance shrinks [m/s], (n,)
        before        : that distance in the last scan [m], (n,)
        """
        lines = np.full(len(free), np.inf) if sensed.signals is None else self.acceleration_for_lines(sensed)
        obstacle = self._for_obstacles(sensed, free, closing)
        creeps = creeps.after(sensed, free, before, lines < obstacle, dt)
        if len(rows := np.flatnonzero(creeps.active)):
            acceleration = acceleration.copy()
            acceleration[rows] = creeping.acceleration(sensed, rows, self.braking)
        by_obstacle = (obstacle <= np.minimum(acceleration, lines)) & np.isfinite(free)
        reason = np.where(by_obstacle, OBSTACLE, np.where(lines < acceleration, LINE, 0))
        reason = np.where(creeps.active & (reason == 0), OBSTACLE, reason)
        limit = BrakingFor(reason, np.where(reason == OBSTACLE, bearing, np.nan), creeps.active)
        return np.minimum(acceleration, lines), creeps, limit

    def acceleration_for_lines(self, sensed: Sensed) -> np.ndarray:
        """For a closed line ahead, (n,) [m/s2]; inf where there is none."""
        speed, length, signals = sensed.speed, sensed.body.length, sensed.signals
        ahead = signals.distance
        left = np.maximum(ahead - STOP_BEFORE * length, 1e-3)
        needed = speed**2 / (2 * np.maximum(ahead, 1e-3))
        unseen = signals.minor & (ahead > LOOK * length)  # cross traffic is not known from there
        too_late = needed > np.where(signals.changing, 2 * self.braking, self.hardest_braking)
        closed = np.where(unseen, True, ~signals.open & ~too_late) & (ahead < np.inf)
        stop = np.where(ahead > STOP_BEFORE * length, self._slowed_to(0.0, left, speed), -self.braking)
        return np.where(closed, stop, np.inf)

    def _slowed_to(self, fastest: np.ndarray, distance: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """To have no more than a speed from a distance on; inf where it is not exceeded."""
        share = np.maximum(speed**2 - fastest**2, 0.0) / (2 * np.maximum(distance, 1e-6)) / self.braking
        return np.where(share > 0, self.acceleration - (self.acceleration + self.braking) * share, np.inf)

    def _for_obstacles(self, sensed: Sensed, free: np.ndarray, closing: np.ndarray) -> np.ndarray:
        speed, model = sensed.speed, sensed.scan.model
        blind = np.maximum(model.range_min - (sensed.body.length / 2 - model.mount.x), 0.0)  # ahead of the bumper
        stand_off = _or(self.stand_off, blind + 0.5 * sensed.body.length)
        closing = np.nan_to_num(closing)
        gap = idm.desired_gap(speed, closing, stand_off, self.time_headway, self.acceleration, self.braking)
        interaction = idm.acceleration(gap, np.maximum(free, 1e-3), self.acceleration)
        blinded = np.isnan(sensed.scan.ranges).all(axis=1)  # every beam is lost: the laser is broken
        return np.where(blinded, -self.braking, np.where(free < np.inf, interaction, np.inf))


def errors_on(route: RouteAhead) -> Errors:
    """Offset and off-heading of vehicles on their routes."""
    foot, onward, distance = route.points[:, 0], route.points[:, 1], route.distance[:, 1]
    # The chord to the next point turns by half of what the route does on the way.
    turn = route.curvature[:, :2].mean(axis=1) * distance / 2
    heading = np.arctan2(onward[:, 1] - foot[:, 1], onward[:, 0] - foot[:, 0]) - turn
    return Errors(foot[:, 0] * np.sin(heading) - foot[:, 1] * np.cos(heading), wrap(-heading))


def curvature_at(route: RouteAhead, distance: np.ndarray) -> np.ndarray:
    """Curvature of routes at distances (n,) ahead [1/m], (n,)."""
    rows = np.arange(len(distance))
    after = np.clip((route.distance <= distance[:, None]).sum(axis=1), 1, route.distance.shape[1] - 1)
    near, far = route.distance[rows, after - 1], route.distance[rows, after]
    share = np.clip((distance - near) / np.maximum(far - near, 1e-9), 0.0, 1.0)
    return route.curvature[rows, after - 1] * (1 - share) + route.curvature[rows, after] * share


def nothing(n: int) -> BrakingFor:
    """n vehicles that brake for nothing."""
    return BrakingFor(np.zeros(n, dtype=int), np.full(n, np.nan), np.zeros(n, dtype=bool))


def first_return(sensed: Sensed, half_width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Along the route from the front bumper to the first return on the strip that the vehicle will drive over.

    half_width : of the strip [m], a number or (n,)
    returns    : distance [m], and its bearing from the laser's forward direction [rad], (n,); inf, NaN: no return
    """
    # Imported here: importing numba takes half a second.
    from platoontraffic.controllers.path_kernel import first_on_strip

    scan, body, route = sensed.scan, sensed.body, sensed.route
    model, n = scan.model, len(sensed.speed)
    free, beam, half_width = np.full(n, np.inf), np.full(n, -1), np.broadcast_to(half_width, n)
    angle = model.angles + model.mount.yaw
    beams = np.stack([np.cos(angle), np.sin(angle)])
    laser, front = model.mount.x - body.axle, body.length / 2 - body.axle
    points = np.searchsorted(route.distance.min(axis=0), model.range_max + 2 * body.length.max()) + 1
    strip = route.points[:, :points], route.distance[:, :points], half_width
    first_on_strip(np.maximum(scan.ranges, model.range_min), beams, laser, model.mount.y, strip, front, free, beam)
    return free, bearing_of(beam, model)


def bearing_of(beam: np.ndarray, model) -> np.ndarray:
    """Bearing of beams from the laser's forward direction [rad], (n,); NaN for beam -1."""
    return np.where(beam < 0, np.nan, model.angles[beam])


def _or(value: float | None, default: np.ndarray) -> float | np.ndarray:
    return default if value is None else value
