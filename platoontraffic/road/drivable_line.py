"""The lane line of a route, rounded so that a vehicle can drive it.

Lanes of real networks have corners, kinks and spikes that no vehicle can drive, and that no driver would. A line is
rounded by curvature flow: points where it bends too sharply move towards the middle of their neighbours, and the others
stay. The flow ends where no place bends too sharply: a corner has then become an arc of the greatest curvature, tangent
to its legs, and a spike has gone. It acts on curves as in M. Gage, R. S. Hamilton, The heat equation shrinking convex
plane curves, J. Differential Geometry 23 (1986), here only on the part of the curvature that is too much.

A place is too sharp if its curvature is above that at full steering lock. For comfort the line is eased afterwards
(`eased_line`). A half turn that is too tight has no such arc between its legs, and would shrink for ever. There the
flow keeps the area (M. Gage, On an area-preserving evolution equation for plane curves, Contemporary Mathematics 51,
1986): what sharp places take away is added outside, and the half turn becomes a bulb. More is added towards the leg
that the line has left less: a bulb that swings out on one side alone is farther off the lane than it must be.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.geometry.polyline import left_of
from platoontraffic.lidar.compiled import compiler

LOCK = 1.08  # least radius of the line [turning radii]: steering keeps a reserve to correct errors
SPACING = 0.1  # distance of points [vehicle lengths]
ROUNDS, BATCHES = 50, 200  # of the flow between two times that points are spread evenly; at the most
FARTHEST = 3.0  # greatest displacement [radii of greatest curvature]: a loop too tight to drive is not shrunk away
TURNS_BACK = 2.7  # turn within a half circle at full lock from which a line turns back [rad]
STRAIGHT = 1e-4  # change of heading at a point that may be left out again [rad]

compiled = compiler(__file__)


def drivable(points: np.ndarray, lock: float, spacing: float, closed: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A line rounded to no more than a curvature of `lock`, within 1 %.

    points  : (k, 2) [m]; a closed line ends where it begins
    lock    : greatest curvature [1/m]
    spacing : of the points in between [m]
    returns : points (m, 2) [m]; the station of each along the given line (m,) [m]. Ends of an open line stay
    """
    stations = stations_of(points)
    line = np.column_stack([points, stations, np.zeros(len(points))])  # x, y, station, half turn
    line = spread(_without_spikes(line, 2 / lock), spacing)
    line[:, 3] = _half_turns(line[:, :2], np.pi / 2 / lock, closed)
    turns_back = line[:, 3].any()
    for _ in range(BATCHES):
        there = np.column_stack([np.interp(line[:, 2], stations, column) for column in points.T])
        held = np.hypot(*(line[:, :2] - there).T) > FARTHEST / lock
        weights = _balanced(line, there) if turns_back else line[:, 3]
        moved = _flow(line, weights, lock, held, closed, ROUNDS)
        if not moved:
            break
        line = spread(line, spacing)  # not at the end: it changes the curvature a little
    return line[:, :2], line[:, 2]


def stations_of(points: np.ndarray) -> np.ndarray:
    """Distance of each point (k, 2) along their line [m], (k,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))])


def spread(line: np.ndarray, spacing: float) -> np.ndarray:
    """The line with points at equal distances."""
    along = stations_of(line)
    even = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / spacing), 2) + 1)
    return np.column_stack([np.interp(even, along, column) for column in line.T])


def turns(points: np.ndarray) -> np.ndarray:
    """Points at which a line turns, those beside them, and its ends, bool (m,)."""
    heading = np.arctan2(*np.diff(points, axis=0).T[::-1])
    turning = np.concatenate([[True], np.abs(np.sin(np.diff(heading) / 2)) > STRAIGHT / 2, [True]])
    return turning | np.append(turning[1:], True) | np.append(True, turning[:-1])


def _without_spikes(line: np.ndarray, longest: float) -> np.ndarray:
    """The line without points from which it goes back by less than `longest` [m], as faults of maps do."""
    while len(line) > 2:
        steps = np.diff(line[:, :2], axis=0)
        size = np.hypot(*steps.T)
        heading = np.arctan2(steps[:, 1], steps[:, 0])
        back = np.abs(_wrapped(np.diff(heading))) > TURNS_BACK
        spikes = np.flatnonzero(back & (np.minimum(size[:-1], size[1:]) < longest)) + 1
        if not len(spikes):
            break
        line = np.delete(line, spikes[0], axis=0)
    return line


def _half_turns(points: np.ndarray, window: float, closed: bool) -> np.ndarray:
    """Where a line of even points turns back within a window each way [m]: weights (m,), elsewhere 0.

    Positive for turns to the left. They fall to 0 at the ends of a half turn, so it is widened smoothly.
    """
    steps = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    n, reach = len(heading), max(round(window / max(np.hypot(*steps[0]), 1e-9)), 1)
    ends = np.arange(n + 1)[:, None] + (-reach - 1, reach)
    if closed:
        laps, ends = np.divmod(ends, n)
        turn = heading[ends] + laps * (heading[-1] - heading[0] + _wrapped(heading[0] - heading[-1]))
    else:
        turn = heading[np.clip(ends, 0, n - 1)]
    turn = turn[:, 1] - turn[:, 0]
    weights = np.zeros(n + 1)
    for sign in (1, -1):
        inside = np.concatenate([np.zeros(reach), sign * turn > TURNS_BACK, np.zeros(reach)])
        near = np.convolve(inside, np.ones(2 * reach + 1), mode="valid") / (2 * reach + 1)
        weights += sign * near
    return weights


def _balanced(line: np.ndarray, there: np.ndarray) -> np.ndarray:
    """The weights (m,) of half turns, less towards the leg on which points (m, 4) are farther outside of their places
    `there` (m, 2) on the given line."""
    weights = line[:, 3].copy()
    outside = -np.sign(weights) * ((line[:, :2] - there) * left_of(line[:, :2])).sum(axis=1)
    for half_turn in np.split(np.arange(len(line)), np.flatnonzero(np.diff(np.sign(weights))) + 1):
        middle = len(half_turn) // 2
        before, beyond = (outside[leg].max(initial=0.0) for leg in (half_turn[:middle], half_turn[middle:]))
        shift = (before - beyond) / max(before + beyond, 1e-9)
        weights[half_turn] *= 1 + shift * np.linspace(-1, 1, len(half_turn))
    return weights


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + math.pi) % math.tau - math.pi


@compiled
def _flow(line, weights, lock, held, closed, rounds):
    """Move points (m, 4) of `drivable` in place, but those held; whether any still moved in the last round.

    weights: of the points by which half turns are widened, (m,)
    """
    first, last = 0 if closed else 1, len(line) - 1
    awake, count = np.arange(first, last), last - first  # the points that may be too sharp, the first `count` of these
    wakes = np.zeros(last + 1, np.bool_)
    step = np.zeros((last + 1, 2))
    turns_back = False
    for i in range(last + 1):
        turns_back |= weights[i] != 0.0
    for _ in range(rounds):
        any_moved = False
        for k in range(count):
            i = awake[k]
            before, behind = (i - 1 if i > 0 else last - 1), i + 1
            from_x, from_y = line[i, 0] - line[before, 0], line[i, 1] - line[before, 1]
            to_x, to_y = line[behind, 0] - line[i, 0], line[behind, 1] - line[i, 1]
            turn = abs(math.atan2(from_x * to_y - from_y * to_x, from_x * to_x + from_y * to_y))
            size = 0.5 * (math.sqrt(from_x * from_x + from_y * from_y) + math.sqrt(to_x * to_x + to_y * to_y))
            curvature = turn / max(size, 1e-9)
            if curvature > lock and not held[i]:
                share = 0.25 * (1.0 - 0.98 * lock / curvature)
                step[i, 0], step[i, 1] = share * (to_x - from_x), share * (to_y - from_y)
                wakes[before], wakes[i], wakes[behind] = True, True, True
                any_moved = True
        if not any_moved:
            return False
        if turns_back:
            _widen(line, weights, step, wakes)
        if closed:
            wakes[0] |= wakes[last]
        count = 0
        for i in range(first, last):
            if wakes[i]:
                line[i, 0] += step[i, 0]
                line[i, 1] += step[i, 1]
                awake[count] = i
                count += 1
                wakes[i], step[i, 0], step[i, 1] = False, 0.0, 0.0
        if closed:
            line[last, 0], line[last, 1], wakes[last] = line[0, 0], line[0, 1], False
    return True


@compiled
def _widen(line, weights, step, wakes):
    """Move the points of each half turn outwards by as much area as the steps of its points take, in place."""
    i = 1
    while i < len(line) - 1:
        if weights[i] == 0.0:
            i += 1
            continue
        first, moved, weight = i, 0.0, 0.0
        sign = math.copysign(1.0, weights[first])  # the product of two weights may be too small to be above 0
        while i < len(line) - 1 and sign * weights[i] > 0.0:
            moved += math.sqrt(step[i, 0] ** 2 + step[i, 1] ** 2)
            weight += abs(weights[i])
            i += 1
        if moved == 0.0:
            continue
        for k in range(first, i):
            along_x, along_y = line[k + 1, 0] - line[k - 1, 0], line[k + 1, 1] - line[k - 1, 1]
            outwards = moved / weight * weights[k] / max(math.sqrt(along_x * along_x + along_y * along_y), 1e-9)
            step[k, 0] += along_y * outwards
            step[k, 1] -= along_x * outwards
            wakes[k] = True
