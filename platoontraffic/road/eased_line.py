"""A line whose curvature changes gradually, as steering can.

A line of arcs and straights cannot be driven fast: where its curvature jumps, a vehicle must be slow enough to steer.
Drivers begin to steer before a bend, and cut it a little. And they keep the body in the lane, not the axle: in a bend
of radius R the front, at a distance f from the axle on the line, is farther out than that by f^2 / 2R. So the line p is
replaced by the q that minimises

    sum |q - p - d|^2 + w sum |third differences of q|^2

where d leads half as far to the inside of the bend as the front is farther out (E. T. Whittaker, On a new method of
graduation, Proc. Edinburgh Mathematical Society 41, 1922: the third differences are the rate of the curvature). R is
that of the mean curvature about a place. In an S, as where lanes leap aside at a junction, that cancels, and the front
of a long vehicle would reach into the lane beside; there 1/R is the mean without signs. The q is one of those that stay
in a corridor about the line, and nowhere bend more sharply than the vehicle can. Places and second differences of q are
brought within these limits by the alternating direction method of multipliers (S. Boyd et al., Distributed optimization
and statistical learning via the alternating direction method of multipliers, Foundations and Trends in Machine Learning
3, 2011). The result is near the least sum: the rounds are few, and the limit of curvature makes the problem not quite
convex. Where q is still beyond a limit, as in half turns at full lock, the line is not eased.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.geometry.polyline import left_of
from platoontraffic.lidar.compiled import compiler
from platoontraffic.road.drivable_line import LOCK, spread, stations_of
from platoontraffic.road.turning import tight_turns

EASING = 0.28  # greatest displacement [vehicle widths]: 0.5 m for a car
OUTSIDE = 0.7  # share of it to the outer side of a bend, and on straights: oncoming vehicles may be off their lane too
# Share of it beyond d: so the body reaches as far to the inside of a bend as its front to the outside. A vehicle for
# which a lane is too narrow for that has all of it: bodies of SUMO's cut bends, so there is more room on the inside.
BEYOND, LANE = 0.5, 3.2  # [1], [m]
TURNS = 0.05  # least turn of a bend [rad]
WIDTH = 1.2  # in a wide corridor easing is like a moving average over so much [vehicle lengths]: w^(1/6) points
LAP = 8.0  # part of the laps before and after that is eased with a closed line [widths]
ABOVE_LOCK = 1.02  # greatest curvature [of the lock, or of the line before]
TOTAL = 1.6  # greatest distance from the given line beyond the least [tolerances]: 0.8 m for a car; `prove` allows 1 m
PLACES, BENDS = 1e2, 1e6  # penalties of the method for places and second differences beyond their limits
ROUNDS = 100  # of the method: more change the time in which a car drives a route by less than 0.2 %
BESIDE, SHARPER = 0.1, 0.05  # by which q may be beyond its limits [of the corridor's width, of the greatest curvature]

compiled = compiler(__file__)


def corridor_of(width: float) -> tuple[float, float, float]:
    """`tolerance`, `beyond` and `room` of `eased` for a vehicle of a width [m]."""
    tolerance, room = EASING * width, max((LANE - width) / 2, 0.0)
    return tolerance, tolerance * (BEYOND if tolerance <= room else 1.0), room


def eased(
    points: np.ndarray,
    stations: np.ndarray,
    given: np.ndarray,
    lock: float,
    tolerance: float,
    beyond: float,
    room: float,
    width: float,
    spacing: float,
    front: float,
    closed: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """The eased line, as `drivable` returns it.

    points, stations : of the line as `drivable` returns it, (m, 2), (m,) [m]
    given            : points of the lane line that `stations` are along (k, 2) [m]
    lock             : curvature that is not exceeded where the line does not [1/m]
    tolerance        : greatest displacement beside d [m]
    beyond           : greatest displacement beyond d, to the inside of a bend [m]
    room             : beside the body, in the middle of a lane [m]
    width            : of the average [m]
    spacing          : of the points [m]
    front            : distance of the front bumper from the axle on the line [m]
    """
    even = spread(np.column_stack([points, stations]), spacing)
    line, stations = even[:, :2] - even[0, :2], even[:, 2]
    lane = np.column_stack([np.interp(stations, stations_of(given), column) for column in given.T]) - even[0, :2]
    lap = math.ceil(LAP * width / spacing) if closed else 0
    least = _onward(_least_offset(given, stations, lock, closed), lap, closed)
    onward = _onward(line, lap + 1, closed)
    sharpest = ABOVE_LOCK * np.maximum(lock, _curvature(onward))
    left, onward = left_of(onward)[1:-1], onward[1:-1]
    off = ((onward - _onward(lane, lap, closed)) * left).sum(axis=1)  # that the line has left the lane
    farthest = np.maximum(least + TOTAL * tolerance, np.abs(off))
    turn, swerve = _turns_about(onward, round(width / spacing))
    wanted = _lead(turn / (2 * width), swerve / (2 * width), front, room)
    # To the right, and to the left.
    is_inside, lead = np.column_stack([-turn, turn]) > TURNS, np.column_stack([-wanted, wanted])
    aside = np.where(is_inside, np.maximum(tolerance, lead + beyond), np.maximum(OUTSIDE * tolerance, lead))
    corridor = np.column_stack([np.maximum(-aside[:, 0], -farthest - off), np.minimum(aside[:, 1], farthest - off)])
    moved = _gentlest(onward, left, wanted, corridor, tolerance, sharpest, (width / spacing) ** 6) - onward
    share = _share_within(moved, onward, left, corridor, sharpest, round(width / spacing), closed)
    moved = (share[:, None] * moved)[lap : lap + len(line)]
    if closed:
        moved[-1] = moved[0]
    along = (moved * _ahead_of(left[lap : lap + len(line)])).sum(axis=1)
    return line + moved + even[0, :2], stations + along * np.gradient(stations, stations_of(line))


def _turns_about(line: np.ndarray, around: int) -> tuple[np.ndarray, np.ndarray]:
    """By how much a line (m, 2) turns to the left about each point, within so many points before and beyond [rad].

    Second, in an S, where more than half of that cancels, how much it turns to both sides, with the sign of the nearer
    bend; elsewhere 0.
    """
    heading = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
    turns, place = np.concatenate([[0.0], np.diff(heading), [0.0]]), np.arange(len(line))
    turn = heading[(place + around).clip(max=len(heading) - 1)] - heading[(place - around - 1).clip(0)]
    both = _summed(np.abs(turns), around)
    nearer = _summed(_summed(turns, around // 2), around // 2)  # weights fall with the distance
    return turn, np.where(np.abs(turn) < both / 2, np.sign(nearer) * both, 0.0)


def _summed(values: np.ndarray, around: int) -> np.ndarray:
    """The sum of values (m,) from so many before each to as many beyond it, (m,)."""
    place, sums = np.arange(len(values)), np.concatenate([[0.0], np.cumsum(values)])
    return sums[(place + around + 1).clip(max=len(values))] - sums[(place - around).clip(0)]


def _lead(curvature: np.ndarray, swerve: np.ndarray, front: float, room: float) -> np.ndarray:
    """The displacement d to the left [m], (m,): in an S as far as the front would leave the lane, half as far at most.

    curvature, swerve : mean curvature of the line about each point, and that of an S [1/m], (m,)
    front, room       : as of `eased`
    """
    in_bend, out = curvature * front**2 / 4, np.abs(swerve) * front**2 / 2
    in_swerve = np.clip(out - room, 0.0, out / 2)
    return np.where(np.abs(in_bend) >= in_swerve, in_bend, np.copysign(in_swerve, swerve))


def _least_offset(given: np.ndarray, stations: np.ndarray, lock: float, closed: bool) -> np.ndarray:
    """Distance at stations that a vehicle must leave the given line by [m], without the reserve, as `prove` has it."""
    laps = np.vstack([given[:-1], given[:-1], given]) if closed else given
    length = stations_of(given)[-1] if closed else 0.0
    return tight_turns([laps], 1 / (LOCK * lock)).least_offset(stations + length)


def _share_within(
    moved: np.ndarray,
    line: np.ndarray,
    left: np.ndarray,
    corridor: np.ndarray,
    sharpest: np.ndarray,
    around: int,
    closed: bool,
) -> np.ndarray:
    """Shares (m,) of the displacements (m, 2) of a line by which it keeps its limits: less about places beyond a limit.

    The ends of an open line, and its directions there, stay.

    around: number of points, at least, to each side of such a place at which the share is less
    """
    place = np.arange(len(line))
    share = np.ones(len(line)) if closed else _rising(np.minimum(place, place[::-1]) - 2, around)
    for reach in around * 2 ** np.arange(6):
        now = share[:, None] * moved
        aside, slack = (now * left).sum(axis=1), BESIDE * np.ptp(corridor, axis=1)
        beyond = (aside < corridor[:, 0] - slack) | (aside > corridor[:, 1] + slack)
        beyond[1:-1] |= _curvature(line + now) > (1 + SHARPER) * sharpest[1:-1]
        beyond[1:] |= np.diff(stations_of(line) + (now * _ahead_of(left)).sum(axis=1)) <= 0
        if not (beyond & (share > 0)).any():
            return share
        there = np.flatnonzero(beyond)
        nearest = np.abs(place - there[np.searchsorted((there[1:] + there[:-1]) / 2, place)])
        share = np.minimum(share, _rising(nearest - reach, around))
    return np.zeros(len(line))


def _rising(count: np.ndarray, over: int) -> np.ndarray:
    """Rises from 0 to 1 over a number of points, without steps or kinks."""
    share = np.clip(count / over, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2)


def _ahead_of(left: np.ndarray) -> np.ndarray:
    """Unit vectors (m, 2) ahead, by those to the left."""
    return np.column_stack([left[:, 1], -left[:, 0]])


def _onward(values: np.ndarray, count: int, closed: bool) -> np.ndarray:
    """Values (m,) or points (m, 2) with `count` more at each end.

    Those of a closed line are the next lap's; an open one is turned half about its end, so that this stays in place.
    """
    sides = [(count, count)] + [(0, 0)] * (values.ndim - 1)
    if closed:
        return np.pad(values[:-1], [(count, count + 1), *sides[1:]], mode="wrap")
    return np.pad(values, sides, mode="reflect", reflect_type="odd" if values.ndim > 1 else "even")


def _curvature(points: np.ndarray) -> np.ndarray:
    """At the inner ones of points (m, 2), without sign [1/m]."""
    one, two = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    turn = np.arctan2(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0], (one * two).sum(axis=1))
    return np.abs(turn) / np.maximum((np.hypot(*one.T) + np.hypot(*two.T)) / 2, 1e-9)


@compiled
def _gentlest(line, left, wanted, corridor, ahead, sharpest, weight):
    """The q of the sum above, (m, 2), for points p (m, 2).

    left     : unit vectors to the left of the line, (m, 2)
    wanted   : displacement d to the left, (m,) [m]
    corridor : least and greatest displacement to the left, (m, 2) [m]; 0 lies within
    ahead    : greatest displacement ahead, or back [m]: points that crowd in a sharp bend make it look gentle
    sharpest : greatest curvature, (m,) [1/m]; the line has no greater
    """
    n = len(line)
    factors, pivot = _factored(n, 1.0 + PLACES, BENDS, weight)
    # By component, so that several points are computed at a time.
    line_x, line_y, left_x, left_y = line[:, 0].copy(), line[:, 1].copy(), left[:, 0].copy(), left[:, 1].copy()
    least, greatest = corridor[:, 0].copy(), corridor[:, 1].copy()
    aim_x, aim_y = line_x + wanted * left_x, line_y + wanted * left_y
    aside = np.minimum(np.maximum(wanted, least), greatest)
    # Places and second differences within their limits, less what those of q have been beyond them, summed.
    place_x, place_y = line_x + aside * left_x, line_y + aside * left_y
    beyond_place_x, beyond_place_y = np.zeros(n), np.zeros(n)
    beyond_bend_x, beyond_bend_y = np.zeros(n), np.zeros(n)
    bend_x, bend_y = np.zeros(n), np.zeros(n)
    bend_x[1:-1] = line_x[:-2] - 2 * line_x[1:-1] + line_x[2:]
    bend_y[1:-1] = line_y[:-2] - 2 * line_y[1:-1] + line_y[2:]
    q_x, q_y = np.zeros(n + 6), np.zeros(n + 6)  # of these three at each end stay 0
    for _ in range(ROUNDS):
        _pull(q_x, aim_x, place_x, bend_x)
        _pull(q_y, aim_y, place_y, bend_y)
        _solve(q_x, q_y, factors, pivot)
        places = line_x, line_y, left_x, left_y, least, greatest, place_x, place_y, beyond_place_x, beyond_place_y
        _limit_places(q_x[3:-3], q_y[3:-3], ahead, *places)
        _limit_bends(q_x[3:-3], q_y[3:-3], sharpest, bend_x, bend_y, beyond_bend_x, beyond_bend_y)
    return np.column_stack((q_x[3:-3], q_y[3:-3]))


@compiled
def _pull(q, aim, place, bend):
    """Fill in one component of the right side of the equations for q: what draws it to its aim and its limits."""
    n = len(aim)
    for i in range(n):
        q[i + 3] = aim[i] + PLACES * place[i]
    for i in range(1, n - 1):
        q[i + 3] = q[i + 3] + BENDS * bend[i - 1] - 2 * (BENDS * bend[i]) + BENDS * bend[i + 1]
    q[3] += BENDS * bend[1]
    q[n + 2] += BENDS * bend[n - 2]


@compiled
def _limit_places(
    q_x, q_y, ahead, line_x, line_y, left_x, left_y, least, greatest, place_x, place_y, beyond_x, beyond_y
):
    """Renew the places in the corridor less what is beyond, in place."""
    for i in range(len(q_x)):
        x, y = q_x[i] + beyond_x[i] - line_x[i], q_y[i] + beyond_y[i] - line_y[i]
        aside = x * left_x[i] + y * left_y[i]
        along = min(max(x * left_y[i] - y * left_x[i], -ahead), ahead)
        aside = min(max(aside, least[i]), greatest[i])
        there_x = line_x[i] + aside * left_x[i] + along * left_y[i]
        there_y = line_y[i] + aside * left_y[i] - along * left_x[i]
        beyond_x[i] += q_x[i] - there_x
        beyond_y[i] += q_y[i] - there_y
        place_x[i], place_y[i] = there_x - beyond_x[i], there_y - beyond_y[i]


@compiled
def _limit_bends(q_x, q_y, sharpest, bend_x, bend_y, beyond_x, beyond_y):
    """Renew the second differences within the limit of curvature less what is beyond, in place."""
    for i in range(1, len(q_x) - 1):
        x = q_x[i - 1] - 2 * q_x[i] + q_x[i + 1] + beyond_x[i]
        y = q_y[i - 1] - 2 * q_y[i] + q_y[i + 1] + beyond_y[i]
        step = ((q_x[i + 1] - q_x[i - 1]) ** 2 + (q_y[i + 1] - q_y[i - 1]) ** 2) / 4
        share = min(sharpest[i] * step / max(math.sqrt(x * x + y * y), 1e-12), 1.0)
        beyond_x[i], beyond_y[i] = (1 - share) * x, (1 - share) * y
        bend_x[i], bend_y[i] = share * x - beyond_x[i], share * y - beyond_y[i]


@compiled
def _factored(n, places, bends, weight):
    """Factors L d L^T of places + bends D2^T D2 + weight D3^T D3, where D2 and D3 are the second and third differences.

    returns: the three subdiagonals of L, (n + 3, 3), and 1 / d, (n,)
    """
    factors, pivot = np.zeros((n + 3, 3)), np.zeros(n)
    second, third = (1.0, -2.0, 1.0), (-1.0, 3.0, -3.0, 1.0)
    for i in range(n):
        for k in range(min(3, i), -1, -1):  # element (i, i - k)
            element = places if k == 0 else 0.0
            for first in range(max(i - 2, 0), min(i - k, n - 3) + 1):  # differences in which both take part
                element += bends * second[i - first] * second[i - k - first]
            for first in range(max(i - 3, 0), min(i - k, n - 4) + 1):
                element += weight * third[i - first] * third[i - k - first]
            for j in range(max(i - 3, 0), i - k):
                element -= factors[i, i - j - 1] * factors[i - k, i - k - j - 1] / pivot[j]
            if k == 0:
                pivot[i] = 1 / element
            else:
                factors[i, k - 1] = element * pivot[i - k]
    return factors, pivot


@compiled
def _solve(x, y, factors, pivot):
    """Solve for the two components (n + 6,), of which three values at each end are 0, in place."""
    n = len(pivot)
    for i in range(n):
        one, two, three = factors[i]
        x[i + 3] -= one * x[i + 2] + two * x[i + 1] + three * x[i]
        y[i + 3] -= one * y[i + 2] + two * y[i + 1] + three * y[i]
    for i in range(n - 1, -1, -1):
        one, two, three = factors[i + 1, 0], factors[i + 2, 1], factors[i + 3, 2]
        x[i + 3] = x[i + 3] * pivot[i] - one * x[i + 4] - two * x[i + 5] - three * x[i + 6]
        y[i + 3] = y[i + 3] * pivot[i] - one * y[i + 4] - two * y[i + 5] - three * y[i + 6]
