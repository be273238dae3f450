"""The lane line of a route, rounded so that a vehicle can drive it.

Lanes of real networks have corners, kinks and spikes that no vehicle can drive, and that no driver would. A line is
rounded by curvature flow: points where it bends too sharply move towards the middle of their neighbours, and the others
stay. The flow ends where no place bends too sharply: a corner has then become an arc of the greatest curvature, tangent
to its legs, and a spike has gone. It acts on curves as in M. Gage, R. S. Hamilton, The heat equation shrinking convex
plane curves, J. Differential Geometry 23 (1986), here only on the part of the curvature that is too much.

A place is too sharp for a vehicle if its curvature is above that at full steering lock. It is too sharp for comfort if
it cannot be driven at the speed limit; for comfort points move by no more than a tolerance, so they stay in their lane.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

COMFORT = 2.0  # lateral acceleration at the speed limit up to which a line needs no rounding [m/s2]
LOCK = 1.08  # least radius of the line [turning radii]: steering keeps a reserve to correct errors
TOLERANCE = 0.15  # greatest displacement for comfort [vehicle widths]: 0.26 m for a car
SPACING = 0.1  # distance of points [vehicle lengths]
ROUNDS, BATCHES = 50, 200  # of the flow between two times that points are spread evenly; at the most
STRAIGHT = 1e-4  # change of heading at a point that may be left out again [rad]

compiled = compiler(__file__)


def drivable(
    points: np.ndarray, comfort: np.ndarray, lock: float, tolerance: float, spacing: float, closed: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """A line rounded to no more than a curvature of `lock`, and where possible of `comfort`.

    points    : (k, 2) [m]; a closed line ends where it begins
    comfort   : wanted curvature from each point on (k,) [1/m]
    lock      : greatest curvature [1/m]
    tolerance : greatest displacement for comfort [m]
    spacing   : of the points in between [m]
    returns   : points (m, 2) [m]; the station of each along the given line (m,) [m]. Ends of an open line stay
    """
    stations = _stations(points)
    line = np.column_stack([points, stations, np.zeros(len(points))])  # x, y, station, displacement
    line = _spread(line, spacing)
    for _ in range(BATCHES):
        here = comfort[np.clip(np.searchsorted(stations, line[:, 2], side="right") - 1, 0, len(comfort) - 1)]
        moved = _flow(line, np.minimum(here, lock), lock, tolerance, closed, ROUNDS)
        line = _spread(line, spacing)
        if not moved:
            break
    return line[:, :2], line[:, 2]


def _stations(points: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))])


def _spread(line: np.ndarray, spacing: float) -> np.ndarray:
    """The line with points at equal distances."""
    along = _stations(line)
    even = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / spacing), 2) + 1)
    return np.column_stack([np.interp(even, along, column) for column in line.T])


def turns(points: np.ndarray) -> np.ndarray:
    """Points at which a line turns, those beside them, and its ends, bool (m,)."""
    heading = np.arctan2(*np.diff(points, axis=0).T[::-1])
    turning = np.concatenate([[True], np.abs(np.sin(np.diff(heading) / 2)) > STRAIGHT / 2, [True]])
    return turning | np.append(turning[1:], True) | np.append(True, turning[:-1])


@compiled
def _flow(line, comfort, lock, tolerance, closed, rounds):
    """Move points (m, 4) of `drivable` in place; whether any still moved in the last round.

    The wanted curvature rises with the displacement, from comfort to lock at the tolerance, so the tip of a corner
    is no sharper than the places beside it.
    """
    n = len(line)
    last = n - 1
    awake, busy = np.ones(n, np.bool_), np.ones(n, np.bool_)
    after = line[:, :2].copy()
    for _ in range(rounds):
        any_moved = False
        busy[:] = False
        for i in range(0 if closed else 1, last):
            if not awake[i]:
                continue
            before, behind = (i - 1 if i > 0 else last - 1), i + 1
            from_x, from_y = line[i, 0] - line[before, 0], line[i, 1] - line[before, 1]
            to_x, to_y = line[behind, 0] - line[i, 0], line[behind, 1] - line[i, 1]
            turn = abs(math.atan2(from_x * to_y - from_y * to_x, from_x * to_x + from_y * to_y))
            size = 0.5 * (math.sqrt(from_x * from_x + from_y * from_y) + math.sqrt(to_x * to_x + to_y * to_y))
            curvature = turn / max(size, 1e-9)
            used = min(line[i, 3] / tolerance, 1.0)
            most = comfort[i] * (lock / comfort[i]) ** used
            if curvature > most:
                share = 0.25 * (1.0 - 0.98 * most / curvature)
                step_x, step_y = share * (to_x - from_x), share * (to_y - from_y)
                after[i, 0], after[i, 1] = line[i, 0] + step_x, line[i, 1] + step_y
                line[i, 3] += math.sqrt(step_x * step_x + step_y * step_y)
                busy[before], busy[i], busy[behind] = True, True, True
                any_moved = True
        if closed:
            after[last], line[last, 3] = after[0], line[0, 3]
            busy[0] |= busy[last]
        line[:, :2] = after
        if not any_moved:
            return False
        awake[:] = busy
    return True
