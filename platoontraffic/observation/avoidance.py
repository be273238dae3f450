"""Whether braking avoids contact with something ahead: reaction time, stopping distance, least gap, least braking."""

from __future__ import annotations

import math
from itertools import pairwise

from platoontraffic.world.fleet import Member
from platoontraffic.world.obstacles import SpeedProfile

MOST_BRAKING = 1e6  # stands for unlimited braking [m/s2]
SEARCHED_BRAKING = 1e-3, 1e3  # the least braking is searched in this interval [m/s2]
HALVINGS = 50  # of that interval's logarithm


def reaction(member: Member) -> float:
    """Time from what the laser could see to full braking [s]: one scan, its delay, and that of the vehicle's brakes."""
    return member.model.braking_delay(1 / member.lidar.rate + member.lidar.delay, hardest(member))


def hardest(member: Member) -> float:
    """Hardest braking that the vehicle is capable of and its law uses [m/s2]; inf if it stops at once."""
    return min(member.model.hardest_braking, member.law.hardest_braking)


def stopping_distance(speed: float, member: Member) -> float:
    """v T + v^2 / 2 b [m], with T from `reaction` and b from `hardest`."""
    return speed * reaction(member) + speed * speed / (2 * hardest(member))


def least_gap(gap: float, speed: float, member: Member, ahead: SpeedProfile, braking: float | None = None) -> float:
    """Smallest future gap if the member brakes, T after now, until it stands [m]; negative: they collide.

        least over t of  gap + s_ahead(t) - s(t),   s(t) = v t - b max(t - T, 0)^2 / 2

    Between the instants at which either begins or ends to brake, the difference is a parabola; its least value is at
    such an instant or where both speeds are equal.

    gap    : now [m]
    speed  : v, of the member [m/s]
    ahead  : speed of the vehicle ahead over time
    braking: b [m/s2]; by default the member's hardest
    """
    most = hardest(member) if braking is None else braking
    own = SpeedProfile(speed, reaction(member), min(most, MOST_BRAKING), 0.0)
    stands = own.ends
    times = sorted({0.0, stands, *(t for t in (own.brakes_at, ahead.brakes_at, ahead.ends) if 0 < t < stands)})

    def gap_at(t: float) -> float:
        return gap + ahead.distance(t) - own.distance(t)

    least = min(map(gap_at, times))
    for a, b in pairwise(times):
        opening_a, opening_b = (ahead.at(t) - own.at(t) for t in (a, b))
        if opening_a < 0 < opening_b:
            least = min(least, gap_at(a + (b - a) * opening_a / (opening_a - opening_b)))
    return least


def least_braking(gap: float, speed: float, member: Member, ahead: SpeedProfile) -> float:
    """Braking that just keeps the gap positive, after the member's reaction [m/s2]; inf: no braking does.

    Parameters as of `least_gap`.
    """
    if least_gap(gap, speed, member, ahead, MOST_BRAKING) <= 0:
        return math.inf
    low, high = SEARCHED_BRAKING
    if least_gap(gap, speed, member, ahead, low) > 0:
        return 0.0
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if least_gap(gap, speed, member, ahead, middle) > 0 else (middle, high)
    return high
