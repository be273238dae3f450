"""A leader on a given path, the other leader of the paper ("a leader robot has a predefined path")."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from platoontraffic.controllers.closing import closing_speed
from platoontraffic.controllers.law import Decision, Law, Sensed
from platoontraffic.controllers.profiles import Trace, braking, chirp, sinusoid
from platoontraffic.vehicles.motion import Drive, Positive

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

SETTLING = 0.5  # time constant with which the wanted speed is approached [s]
YIELDING = 2.5  # before a line where it has to give way it first slows down, and looks from here on [vehicle lengths]
LINE = 0.2  # it stops so far before a line [vehicle lengths]
TRACKING = 0.3  # time constant of the filter for the speed of what is ahead [s]
JUMP = 0.25  # by which the free way may differ from what the filter expects, of the same thing [vehicle lengths]


class Memory(NamedTuple):
    """Arrays (n,)."""

    time: np.ndarray  # since it set out [s]
    free: np.ndarray  # way to what is ahead [m]; inf: nothing
    closing: np.ndarray  # how fast that becomes less [m/s]


@dataclass(frozen=True)
class PathLeader(Law):
    """Drives its route's lanes by pure pursuit, at the speed of a profile, as far as bends, lights and others allow.

    Steering  : the arc through the point of the path one lookahead away: curvature = 2 y / (x^2 + y^2) (R. C. Coulter,
                Implementation of the pure pursuit path tracking algorithm, CMU-RI-TR-92-01, 1992). On a circle it is
                exact.
    Bends     : never faster than `lateral_acceleration` allows by the curvature of the route.
    Others    : what its laser meets on the strip that it will drive over is followed, or stopped for, by the
                interaction term of the Intelligent Driver Model (Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000)
                1805); how fast it comes nearer is learnt from the change of the distance, from the second look on.
                It stops if every beam is lost.
    Lights    : stops at a closed line if it can by `hardest_braking`; for yellow, by twice the comfortable braking.
                Where it has to give way it comes slowly and passes when it is told that it may.

    All of these are accelerations, and the least one is driven. A speed v0 that must be kept from a point at distance s
    on takes (v^2 - v0^2) / 2 s, which stands for a share q of the comfortable braking; what is left is
    acceleration - (acceleration + braking) q: the full acceleration far away, and the comfortable braking at q = 1.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"route", "signals"})

    speed: Annotated[Positive | Literal["road"], Field(alias="speed_mps")] = "road"  # or the limits of speed
    speed_factor: Positive = 1.0  # of these limits
    profile: Literal["sinusoid", "chirp", "step", "brake"] | None = None
    begins: Annotated[NotNegative, Field(alias="begins_s")] = 0.0  # the profile, after it has set out
    amplitude: Annotated[NotNegative, Field(alias="amplitude_mps")] = 0.0  # of a sinusoid or chirp
    frequency: Annotated[Positive, Field(alias="frequency_hz")] = 0.1  # of a sinusoid, or at a chirp's begin
    last_frequency: Annotated[Positive, Field(alias="last_frequency_hz")] = 0.5  # at a chirp's end
    lasts: Annotated[Positive, Field(alias="lasts_s")] = 60.0  # a chirp
    last_speed: Annotated[NotNegative, Field(alias="last_speed_mps")] = 0.0  # after a step or braking
    rate: Annotated[Positive, Field(alias="rate_mps2")] = 4.0  # of braking
    trace: Path | None = None  # a CSV file with time_s and speed_mps, instead of speed and profile
    lookahead: Annotated[Positive | None, Field(alias="lookahead_m")] = None  # default: 1 vehicle length, or 0.5 s
    half_width: Annotated[Positive | None, Field(alias="half_width_m")] = None  # of the strip; default: 0.6 x its width
    stand_off: Annotated[NotNegative | None, Field(alias="stand_off_m")] = (
        None  # default: half its length and blind spot
    )
    time_headway: Annotated[NotNegative, Field(alias="time_headway_s")] = 1.5
    acceleration: Annotated[Positive, Field(alias="acceleration_mps2")] = 1.5
    braking: Annotated[Positive, Field(alias="braking_mps2")] = 2.0  # comfortable
    hardest_braking: Annotated[Positive, Field(alias="hardest_braking_mps2")] = 8.0
    lateral_acceleration: Annotated[Positive, Field(alias="lateral_acceleration_mps2")] = 2.0

    def __post_init__(self) -> None:
        if self.trace is not None:
            self._trace  # noqa: B018  what is wrong with the file is said before a run begins

    @cached_property
    def _trace(self) -> Trace:
        return Trace.read(self.trace)

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        n = len(sensed.speed)
        if memory is None:
            memory = Memory(np.zeros(n), np.full(n, np.inf), np.full(n, np.nan))
        free = free_way(sensed, _or(self.half_width, 0.6 * sensed.body.width))
        same = JUMP * sensed.body.length
        closing = closing_speed(free, memory.free, memory.closing, sensed.speed, dt, same=same, time_constant=TRACKING)
        acceleration = self.acceleration_on(sensed, memory.time, free, closing, dt)
        if sensed.signals is not None:
            acceleration = np.minimum(acceleration, self.acceleration_for_lines(sensed))
        acceleration = np.maximum(acceleration, -self.hardest_braking)
        acceleration = np.maximum(acceleration, -sensed.speed / dt)  # nobody brakes into driving backwards
        return Decision(Drive(acceleration, self.curvature_on(sensed)), Memory(memory.time + dt, free, closing))

    def acceleration_for_bends(self, sensed: Sensed) -> np.ndarray:
        """For what is slower ahead on the route, (n,) [m/s2]; inf where nothing is."""
        return self._for_bends(sensed, self._fastest(sensed))

    def acceleration_on(self, sensed: Sensed, time, free, closing, dt: float) -> np.ndarray:
        """For speed, bends and others, (n,) [m/s2].

        time          : since it set out [s], (n,)
        free, closing : way to what is in the way [m], and how fast that becomes less [m/s], (n,)
        """
        fastest = self._fastest(sensed)
        wanted = (
            self._for_speed(sensed, time, dt, fastest[:, 0]),
            self._for_bends(sensed, fastest),
            self._for_others(sensed, free, closing),
        )
        return np.min(wanted, axis=0)

    def curvature_on(self, sensed: Sensed, time: float = 0.5) -> np.ndarray:
        """Through the first point of the path at least one lookahead away, or its last.

        time: that it takes to drive there, at the least, where the scenario says nothing of the lookahead [s]
        """
        points = sensed.route.points
        lookahead = _or(self.lookahead, np.maximum(sensed.body.length, time * sensed.speed))
        away = np.hypot(points[..., 0], points[..., 1]) >= np.reshape(lookahead, (-1, 1))
        aim = points[np.arange(len(points)), np.where(away.any(axis=1), away.argmax(axis=1), -1)]
        return 2 * aim[:, 1] / np.maximum((aim**2).sum(axis=1), 1e-6)

    def _fastest(self, sensed: Sensed) -> np.ndarray:
        """That is allowed at each point ahead, (n, k): by bends, and by limits if it drives by them."""
        route = sensed.route
        fastest = np.sqrt(self.lateral_acceleration / np.maximum(np.abs(route.curvature), 1e-9))
        if self.speed == "road" and self.trace is None:
            fastest = np.minimum(fastest, self.speed_factor * route.limit)
        return fastest

    def _for_speed(self, sensed: Sensed, time: np.ndarray, dt: float, fastest: np.ndarray) -> np.ndarray:
        """Acceleration towards the speed of the profile, or what is allowed where it is now."""
        wanted = self._profile(time, sensed.route.limit[:, 0])
        # Of a step at once no rate is asked: it is driven in comfort.
        change = 0.0 if self.profile == "step" else (self._profile(time + dt, sensed.route.limit[:, 0]) - wanted) / dt
        wanted, change = np.minimum(wanted, fastest), np.where(wanted <= fastest, change, 0.0)
        # What a profile asks for is driven; towards a speed that does not change, it goes in comfort.
        least, most = np.minimum(change, -self.braking), np.maximum(change, self.acceleration)
        return np.clip(change + (wanted - sensed.speed) / SETTLING, least, most)

    def _profile(self, time: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Speed at times (n,) since it set out."""
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
        """For what is slower ahead."""
        way = np.maximum(sensed.route.distance, SETTLING * sensed.speed[:, None])
        return self._brought_to(fastest, way, sensed.speed[:, None])[:, 1:].min(axis=1)

    def acceleration_for_lines(self, sensed: Sensed) -> np.ndarray:
        """For what is closed, (n,) [m/s2]; inf where nothing is."""
        speed, length, signals = sensed.speed, sensed.body.length, sensed.signals
        ahead = signals.distance
        way = np.maximum(ahead - LINE * length, 1e-3)
        needed = speed**2 / (2 * np.maximum(ahead, 1e-3))
        unseen = signals.minor & (ahead > YIELDING * length)  # whom it has to give way to, it does not know yet
        too_late = needed > np.where(signals.changing, 2 * self.braking, self.hardest_braking)
        closed = np.where(unseen, True, ~signals.open & ~too_late) & (ahead < np.inf)
        there = np.where(ahead > LINE * length, self._brought_to(0.0, way, speed), -self.braking)
        return np.where(closed, there, np.inf)

    def _brought_to(self, fastest: np.ndarray, way: np.ndarray, speed: np.ndarray) -> np.ndarray:
        share = np.maximum(speed**2 - fastest**2, 0.0) / (2 * np.maximum(way, 1e-6)) / self.braking
        return np.where(share > 0, self.acceleration - (self.acceleration + self.braking) * share, np.inf)

    def _for_others(self, sensed: Sensed, free: np.ndarray, closing: np.ndarray) -> np.ndarray:
        speed, model = sensed.speed, sensed.scan.model
        blind = np.maximum(model.range_min - (sensed.body.length / 2 - model.mount.x), 0.0)  # before the bumper
        stand_off = _or(self.stand_off, blind + 0.5 * sensed.body.length)
        closing = np.nan_to_num(closing)
        dynamic = speed * self.time_headway + speed * closing / (2 * np.sqrt(self.acceleration * self.braking))
        wanted = stand_off + np.maximum(dynamic, 0.0)
        interaction = self.acceleration * (1 - (wanted / np.maximum(free, 1e-3)) ** 2)
        blinded = np.isnan(sensed.scan.ranges).all(axis=1)  # lost, all of them: the laser is broken
        return np.where(blinded, -self.braking, np.where(free < np.inf, interaction, np.inf))


def free_way(sensed: Sensed, half_width: np.ndarray) -> np.ndarray:
    """Way along the route from the front bumper to the first return on the strip that the vehicle will drive over.

    half_width : of the strip [m], a number or (n,)
    returns    : [m], (n,); inf where nothing is met
    """
    from platoontraffic.controllers.path_kernel import meet  # here, for it costs half a second to import numba

    scan, body, route = sensed.scan, sensed.body, sensed.route
    model, n = scan.model, len(sensed.speed)
    free, half_width = np.full(n, np.inf), np.broadcast_to(half_width, n)
    angle = model.angles + model.mount.yaw
    beams = np.stack([np.cos(angle), np.sin(angle)])
    laser, front = model.mount.x - body.axle, body.length / 2 - body.axle
    points = np.searchsorted(route.distance.min(axis=0), model.range_max + 2 * body.length.max()) + 1
    strip = route.points[:, :points], route.distance[:, :points], half_width
    meet(np.maximum(scan.ranges, model.range_min), beams, laser, model.mount.y, strip, front, free)
    return free


def _or(value: float | None, default: np.ndarray) -> float | np.ndarray:
    return default if value is None else value
