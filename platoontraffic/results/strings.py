"""String stability by norms of acceleration, in windows in which the predecessor disturbs a follower that is locked on.

Acceleration is zero before and after every manoeuvre. The deviation of a speed from its mean is not: a change from rest
to 30 m/s outweighs all else in it, and grows along any string, as later members spend more of the time at rest. The L2
norm of the response of a linear system, from equilibrium, is at most its greatest gain over frequency times that of the
disturbance (Ploeg, van de Wouw, Nijmeijer, "Lp string stability of cascaded systems", IEEE Trans. Control Systems
Technology 22, 2014).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.analysis.following import NOBODY, Stretch

FILTER = 1.0  # accelerations are means over this time [s]: a laser's noise has most of its power above its inverse
EXCITED = 0.05  # mean acceleration from which a predecessor disturbs: ten times a follower's own by noise [m/s2]
RESPONSE = 5.0  # time for which a follower's response to it lasts [s] ...
RESPONSE_EACH = 2.0  # ... and how much longer for each further follower
SETTLING = 20.0  # time that a gap takes to settle after the two have come together at speed [s]
AT_REST = 0.05  # speed up to which they come together at rest, so that nothing has to settle [m/s]
ENOUGH = 10.0  # a window that is cut off counts if it is this many responses long [1]
ROUNDING = 5e-4  # recorded times are rounded to a millisecond [s]

Period = tuple[float, float]  # begin, end [s]

MEANING = (
    "root of the sum of squares of its acceleration, divided by that of its predecessor, over all windows of the two; "
    f"empty if there is none. Acceleration: mean over the last {FILTER:g} s, from speed_mps (over the recording "
    "interval if that is longer). A window lasts from an instant at which the predecessor's is "
    f"{EXCITED:g} m/s2 or more to {RESPONSE:g} s after the last of the instants that follow each other within "
    f"{RESPONSE:g} s. It lies in a period in which the member follows that predecessor, has once been locked on it and "
    f"is not split off (brief lock losses are inside), or, where SUMO drives it, in which it has a gap, without the "
    f"first {SETTLING:g} s of the period unless both are at rest at its begin. A window that the ends of the period "
    f"cut off counts if {ENOUGH * RESPONSE:g} s or more "
    "remain. Up to 1: the member damps what its predecessor does; what slows it alone in a window, as a bend may, "
    "counts too. A laser's usual noise makes a follower accelerate by some 0.005 m/s2: behind a predecessor with less "
    "than ten times that, or with a swing below some 1e-3 m/s, a ratio is noise"
)
MEANING_HEAD_TO_TAIL = (
    "accel_gain_l2 of the last member of a platoon over the first, in periods in which every member follows the one at "
    f"the place ahead; each further follower adds {RESPONSE_EACH:g} s to the response of {RESPONSE:g} s, and a window "
    f"that is cut off counts from {ENOUGH:g} responses on. Where the leader hardly exceeds {EXCITED:g} m/s2, a value "
    "below 0.1 is the last member's noise. Run: the largest over the platoons"
)


class Gains(NamedTuple):
    """Norms of a follower's acceleration, divided by those of the acceleration ahead; NaN: not defined."""

    l2: float
    linf: float


class Motion(NamedTuple):
    """One member's recorded motion, arrays (k,)."""

    time: np.ndarray  # [s]
    speed: np.ndarray  # [m/s]
    acceleration: np.ndarray  # mean over the last FILTER [m/s2]

    @classmethod
    def of(cls, rows: pd.DataFrame) -> Motion:
        """rows: the member's of trajectories.csv. Before the first of them its speed is taken as constant."""
        time, speed = rows.time_s.to_numpy(), rows.speed_mps.to_numpy()
        every = np.diff(time).min() if len(time) > 1 else FILTER
        span = max(1, round(FILTER / every))
        before = np.concatenate([np.repeat(speed[:1], min(span, len(speed))), speed[:-span]])
        return cls(time, speed, (speed - before) / (span * every))


def together(own: pd.DataFrame, follows: Sequence[Stretch], off: Sequence[Period]) -> list[Stretch]:
    """Periods in which a member follows a predecessor, has once been locked on it, and is not split off.

    own     : the member's events
    follows : its periods as a follower
    off     : its periods split off
    """
    locks = own[own.kind == "locked"]
    found = []
    for begin, end, ahead in follows:
        locked = locks.time_s[(locks.other_id == ahead) & (locks.time_s < end)]
        if ahead != NOBODY and len(locked):
            found += [Stretch(*period, ahead) for period in without((max(begin, locked.min()), end), off)]
    return found


def without(period: Period, off: Iterable[Period]) -> list[Period]:
    """What is left of a period outside of those in `off`."""
    begin, end = period
    left = []
    for a, b in sorted(off):
        if a > begin:
            left.append((begin, min(a, end)))
        begin = max(begin, b)
    return [(a, b) for a, b in [*left, (begin, end)] if a < b]


def overlaps(some: Iterable[Period], others: Iterable[Period]) -> list[Period]:
    """Periods that are in both."""
    others = list(others)
    both = [(max(a, c), min(b, d)) for a, b in some for c, d in others]
    return sorted((a, b) for a, b in both if a < b)


def gains_behind(motion: Motion, ahead: Mapping[str, Motion], periods: Iterable[Stretch]) -> Gains:
    """Gains of a member over its predecessors; periods: by `together`."""
    parts = []
    for begin, end, name in periods:
        if name in ahead:
            parts += _in_windows([ahead[name], motion], [(begin, end)], RESPONSE)
    return _gains(parts)


def head_to_tail(string: Sequence[Motion], periods: Sequence[Period]) -> Gains:
    """Gains of the last member of a string over the first; periods: in which all of them are together."""
    if len(string) < 2:
        return Gains(math.nan, math.nan)
    return _gains(_in_windows(string, periods, RESPONSE + RESPONSE_EACH * (len(string) - 2)))


def _in_windows(
    string: Sequence[Motion], periods: Iterable[Period], response: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Accelerations of the first and the last member in each window that counts, arrays (w,)."""
    (time, head), (other, tail) = ((m.time, m.acceleration) for m in (string[0], string[-1]))
    _, here, there = np.intersect1d(time, other, assume_unique=True, return_indices=True)
    time, head, tail = time[here], head[here], tail[there]
    found = []
    for period in _settled(string, periods):
        for begin, end in windows(time, np.abs(head) >= EXCITED, period, response):
            inside = (time > begin - ROUNDING) & (time < end + ROUNDING)
            found.append((head[inside], tail[inside]))
    return found


def windows(time: np.ndarray, excited: np.ndarray, period: Period, response: float) -> list[Period]:
    """Windows from excited instants to a response after the last of those that follow each other within a response.

    A window that begins before the period or ends after it is cut off there: a response to what is cut off would be
    counted, or one that is cut off would not. Such a window counts only where it is ENOUGH responses long.

    time, excited : (k,), [s] and bool
    """
    at = time[excited]
    if not len(at):
        return []
    breaks = np.flatnonzero(np.diff(at) > response + ROUNDING)
    begins, ends = at[np.r_[0, breaks + 1]], at[np.r_[breaks, len(at) - 1]] + response
    found = []
    for begin, end in zip(begins, ends, strict=True):
        a, b = max(begin, period[0]), min(end, period[1])
        whole = (a, b) == (begin, end)
        if b > a and (whole or b - a > ENOUGH * response - ROUNDING):
            found.append((a, b))
    return found


def _settled(string: Sequence[Motion], periods: Iterable[Period]) -> list[Period]:
    """The periods, without the time that gaps take to settle unless all neighbours are at rest at the begin."""
    settled = []
    for begin, end in periods:
        rests = all(_rests(one, begin) for one in string)
        settled.append((begin if rests else begin + SETTLING, end))
    return [(begin, end) for begin, end in settled if begin < end]


def _rests(motion: Motion, time: float) -> bool:
    """Whether it is at rest at the first recorded instant from this time on."""
    i = np.searchsorted(motion.time, time)
    return bool(i < len(motion.time) and motion.speed[i] <= AT_REST)


def _gains(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> Gains:
    if not parts:
        return Gains(math.nan, math.nan)
    head, tail = (np.concatenate(one) for one in zip(*parts, strict=True))
    return Gains(float(np.linalg.norm(tail) / np.linalg.norm(head)), float(np.abs(tail).max() / np.abs(head).max()))
