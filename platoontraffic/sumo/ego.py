"""The member that a stop line is judged for."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import Law
from platoontraffic.controllers.path_kernel import SETTLING, STOP_BEFORE
from platoontraffic.road.gap_acceptance import Pace
from platoontraffic.road.route import Route
from platoontraffic.road.speed_profile import Driving, SpeedProfile
from platoontraffic.sumo.conflicts import KINDS, SUMO_CAR, SUMO_LENGTH
from platoontraffic.vehicles.motion import scale
from platoontraffic.world.fleet import Member

LONGEST = sorted((SUMO_LENGTH if kind == SUMO_CAR else model.length, kind) for kind, model in KINDS.items())
EARLY_BRAKING = 2.0  # deceleration that sets how early the adjacent lane and the space beyond are checked [m/s2]
AT_ONCE = 0.9  # distance of a closed line, for a car, that a slow vehicle stops before at once [m]
OVERRUN = 1.0  # distance beyond a stop line, for a car, up to which a vehicle may still stop there [m]
GATHERS_SPEED = 8.0  # at which its engine is asked for its acceleration: a truck has less than its law wants [m/s]
QUEUE_ROOM = 4.0  # that a car whose law names no distance at rest needs behind one that stands [m]
FALLS_SHORT = 0.25  # by which a vehicle may stop farther from one that stands than its law names, for a car [m]
STARTING = 0.4  # from the decision to set out until the vehicle accelerates: a scan and the lag of the drive [s]


class Ego(NamedTuple):
    """The vehicle that a stop line is judged for."""

    id: str
    lane: str  # "" off the road
    speed: float  # [m/s]
    length: float  # [m]
    acceleration: float = 1.5  # of its law in comfort, as far as its engine has it [m/s2]
    lateral: float = 2.0  # greatest lateral acceleration of its law [m/s2]
    braking: float = 3.0  # of its law before lines, comfortable [m/s2]
    kind: str = "car"  # the shortest of `KINDS` that is as long
    steering_rate: float = math.inf  # greatest change of its curvature by time [1/m/s]
    top: float = math.inf  # greatest speed beside a body that it drives round [m/s]
    drive: float = 0.0  # acceleration now [m/s2]
    route: Route | None = None  # None: its law is given none, or SUMO drives it
    axle: float = 0.0  # station of its driven axle on its route [m]
    keeps: float = QUEUE_ROOM  # distance within which it surely stops behind one that stands [m]

    @classmethod
    def of(cls, member: Member) -> Ego:
        """A member at rest, off the road.

        raises: nothing; a law that does not name its gains counts as a timid one
        """
        law = member.law
        gains = [_gain(one, "acceleration", cls._field_defaults["acceleration"]) for one in _drivers(law)]
        lateral = [_gain(one, "lateral_acceleration", cls._field_defaults["lateral"]) for one in _drivers(law)]
        length = float(member.model.length)
        kind = next((kind for longest, kind in LONGEST if length <= longest), LONGEST[-1][1])
        braking = _gain(_drivers(law)[-1], "braking", cls._field_defaults["braking"])
        strongest = float(member.model.strongest_acceleration(np.array(GATHERS_SPEED)))
        steering_rate = float(member.model.curvature_rate)
        return cls(
            member.id, "", 0.0, length, min(*gains, strongest), min(lateral), braking, kind, steering_rate,
            keeps=max(_keeps(member, one) for one in _drivers(law)),
        )  # fmt: skip

    def driving(self, lane: str, speed: float, drive: float, route: Route | None, axle: float) -> Ego:
        """The same vehicle as it drives now. (`_replace` takes three times as long, for hundreds in every step.)"""
        return Ego(
            self.id, lane, speed, self.length, self.acceleration, self.lateral, self.braking, self.kind,
            self.steering_rate, self.top, drive, route, axle, self.keeps,
        )  # fmt: skip

    @property
    def size(self) -> float:
        """Factor for distances."""
        return scale(self.length)

    @property
    def checks_from(self) -> float:
        """Distance before a line at which it must know whether the line is open [m]."""
        return checks_from(self.speed, self.length)

    @property
    def stops_within(self) -> float:
        """Distance of a line before which it stops at once, in comfort [m]."""
        return self.speed**2 / (2 * EARLY_BRAKING) + AT_ONCE * self.size

    def line_at_speed(self, speed: float) -> float:
        """Distance of a closed line before which it drives at a speed, if the line keeps that distance from it [m].

        The law `path` brakes by b v / A - (A - v) / T with A^2 = 2 b distance, and stops a little before the line.
        """
        speed = max(speed, 0.0)
        allowed = (speed + math.sqrt(speed**2 + 4 * self.braking * SETTLING * speed)) / 2
        return allowed**2 / (2 * self.braking) + STOP_BEFORE * self.length

    def line_to_follow(self, speed: float, distance: float, braking: float) -> float:
        """Distance of a closed line before which it comes to follow, at a distance, a place that moves at a speed [m].

        It brakes by no more than about `braking` [m/s2].
        """
        return max(distance + self.line_at_speed(speed), self.line_at_speed(self.speed - braking * SETTLING))

    def pace(self, limit: float) -> Pace:
        """How it drives on without a route, up to a speed limit [m/s]."""
        return Pace(self.speed, self.acceleration, limit, STARTING)

    def profile(self) -> SpeedProfile:
        """How it drives on along its route."""
        starts_within = STARTING * (1 - min(max(self.drive / self.acceleration, 0.0), 1.0))
        return SpeedProfile(
            Driving(
                self.route, self.axle, self.speed, starts_within, self.acceleration, self.braking, self.lateral,
                self.steering_rate, self.length, self.top,
            )
        )  # fmt: skip


def checks_from(speed: float, length: float) -> float:
    """`Ego.checks_from` of a vehicle."""
    return speed**2 / (2 * EARLY_BRAKING) + length


def _drivers(law: Law) -> list[object]:
    """A law, and the one that drives in its place where it has no predecessor."""
    return [law, *([law.alone] if hasattr(law, "alone") else [])]


def _gain(law: object, name: str, default: float) -> float:
    value = getattr(law, name, default)
    return float(value) if isinstance(value, (int, float)) and value > 0 else default


def _keeps(member: Member, law: object) -> float:
    """`Ego.keeps` of a member that a law drives. The law `path` keeps half a length if it is given no `stand_off`."""
    length, size = float(member.model.length), scale(float(member.model.length))
    if not hasattr(law, "stand_off"):
        return QUEUE_ROOM * size
    seen = member.seen_ahead_of_gap if getattr(law, "distance_from", "") == "laser" else 0.0
    return _gain(law, "stand_off", length / 2) - seen + FALLS_SHORT * size
