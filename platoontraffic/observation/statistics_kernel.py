"""Measured values of every member at one step, and their running statistics over all steps. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.vehicles import bicycle
from platoontraffic.vehicles.bicycle import VALID_LATERAL
from platoontraffic.world import events
from platoontraffic.world.events import ENOUGH_BEAMS, EXPOSED

LEAST_SPEED = 1e-3  # own or closing speed up to which there is no time gap, or no time to collision [m/s]

COUNT, TOTAL, SQUARES, LEAST, MOST = range(5)  # of the values of one quantity so far; NaN does not count

QUANTITIES = (
    "speed", "acceleration", "jerk", "lateral_acceleration", "beyond_valid", "centre_speed", "turning", "gap",
    "gap_error", "time_gap", "closing", "time_to_collision", "shortfall", "needed_braking", "occluded",
    "beams_enough", "cross_track", "clearance", "contact_in", "message_age", "message_lost",
)  # fmt: skip
COLUMNS = len(QUANTITIES)
VALUES = np.dtype([(name, float) for name in QUANTITIES])

compiled = compiler(__file__, bicycle.__file__, events.__file__)


class Seen(NamedTuple):
    """What the values of one step follow from. Arrays (n,) of the members on the road, or (N,) of all by number."""

    number: np.ndarray  # (n,)
    predecessor: np.ndarray  # row, (n,); -1: none
    x: np.ndarray  # centre [m], (n,)
    y: np.ndarray
    turned: np.ndarray  # [rad], (n,)
    speed: np.ndarray  # [m/s], (n,)
    acceleration: np.ndarray  # [m/s2], (n,)
    yaw_rate: np.ndarray  # [rad/s], (n,)
    message_age: np.ndarray  # [s], (n,)
    message_lost: np.ndarray  # 1 or 0, (n,)
    gap: np.ndarray  # [m], (n,)
    desired_gap: np.ndarray  # [m], (n,)
    jerk: np.ndarray  # [m/s3], (N,)
    cross_track: np.ndarray  # [m], (N,)
    beside: np.ndarray  # as of `gaps.Gaps`, (N,)
    beams: np.ndarray  # on the predecessor, (N,)
    occluded: np.ndarray  # share of them, (N,)
    clearance: np.ndarray  # [m], (N,)
    contact_in: np.ndarray  # [s], (N,)


@compiled
def observe(seen, before, dt, values, numbers, tallies):
    """`evaluate`, then `add`; seen: the fields of Seen; numbers: the memory of the values, (n, COLUMNS)"""
    seen = Seen(*seen)
    evaluate(seen, before, dt, values)
    add(seen.number, numbers, tallies)


@compiled
def evaluate(seen, before, dt, values):
    """Fill in the values of one step, records of VALUES (n,); NaN where a member has no such value.

    before : x, y [m] and turned [rad] of all members one step before, (N, 3); NaN: not on the road. Brought up to date
    dt     : since then [s]
    """
    for i in range(len(seen.number)):
        k, ahead, value = seen.number[i], seen.predecessor[i], values[i]
        value.speed, value.acceleration, value.jerk = seen.speed[i], seen.acceleration[i], seen.jerk[k]
        value.lateral_acceleration = seen.speed[i] * seen.yaw_rate[i]
        value.beyond_valid = 1.0 if abs(value.lateral_acceleration) > VALID_LATERAL else 0.0
        value.centre_speed = math.hypot(seen.x[i] - before[k, 0], seen.y[i] - before[k, 1]) / dt
        value.turning = (seen.turned[i] - before[k, 2]) / dt
        before[k, 0], before[k, 1], before[k, 2] = seen.x[i], seen.y[i], seen.turned[i]
        value.clearance, value.contact_in = seen.clearance[k], seen.contact_in[k]
        value.gap, value.gap_error = seen.gap[i], seen.gap[i] - seen.desired_gap[i]
        value.cross_track = seen.cross_track[k]
        value.message_age, value.message_lost = seen.message_age[i], seen.message_lost[i]
        value.time_gap = seen.gap[i] / seen.speed[i] if seen.speed[i] > LEAST_SPEED else math.nan
        value.closing = value.time_to_collision = value.needed_braking = math.nan
        value.occluded = value.beams_enough = math.nan
        if ahead >= 0:
            value.closing = seen.speed[i] - seen.speed[ahead]
            value.occluded = seen.occluded[k]
            if not math.isnan(seen.beams[k]):
                value.beams_enough = 1.0 if seen.beams[k] >= ENOUGH_BEAMS else 0.0
            value.needed_braking = 0.0
        if value.closing > LEAST_SPEED and not seen.beside[k]:
            left = seen.gap[i] if seen.gap[i] > 0 else math.nan
            value.time_to_collision = left / value.closing
            value.needed_braking = value.closing * value.closing / (2 * left)
        exposed = value.time_to_collision < EXPOSED
        value.shortfall = EXPOSED - value.time_to_collision if exposed else math.nan


@compiled
def add(number, values, tallies):
    """Count the values of one step in.

    values  : of the members on the road, (n, COLUMNS)
    tallies : of all members, (N, COLUMNS, 5)
    """
    for i in range(len(number)):
        for quantity in range(values.shape[1]):
            value = values[i, quantity]
            if not math.isnan(value):
                tally = tallies[number[i], quantity]
                tally[COUNT] += 1.0
                tally[TOTAL] += value
                tally[SQUARES] += value * value
                tally[LEAST] = min(tally[LEAST], value)
                tally[MOST] = max(tally[MOST], value)
