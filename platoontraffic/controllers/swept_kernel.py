"""What the body would touch in a bend, or on its way back to its route. Compiled.

In a tight bend, and where it is not along its route, the front of a vehicle swings out of any strip about the path of
its axle, and the body is not where the path is: steering takes time. So the vehicle is driven on from where it is,
steered along its route as far as lock and steering rate allow, and every return is compared with its places.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers import path_kernel, returns_kernel, steering
from platoontraffic.controllers.path_kernel import curvature_at
from platoontraffic.controllers.returns_kernel import some_nearer
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import nearest
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, path_kernel.__file__, returns_kernel.__file__, steering.__file__, polyline.__file__)

SWINGS = 0.1  # the front swings out by more than that in a bend that is looked at [m]
STEP, MOST = 0.3, 40  # spacing of the places of the body [m], and their number
TIME, BRAKING = 0.5, 2.0  # looks as far as it drives in that time [s] and then brakes by that [m/s2] ...
LEAST = 4.0  # ... but so far at least [m]
CLEAR = 0.1  # is kept from every return [m] ...
ALONGSIDE, BESIDE = 0.5, 0.02  # ... but for one close beside the body: from so far ahead on, no nearer than it is [m]
SLOWEST = 1.0  # speed by which the steering rate is taken, at least [m/s]

curvature_back, curvature_along = compiled(steering.curvature_back), compiled(steering.curvature_along)


@compiled
def first_touched(route, points, speed, driven, body, scan, laser, skipped, until, free, first):
    """Lower the free distances (n,) to those until a body would touch a return [m], and fill in the beams of these.

    route   : `RouteAhead`; its points as seen from where the scan was taken (n, k, 2)
    driven  : curvature that is driven now [1/m], (n,)
    scan    : ranges (n, m) and the least one [m], unit vectors of the beams (2, m)
    laser   : x (n,) and y of the laser, from the driven axle [m]
    skipped : first and last of the beams left out, (n, 2)
    until   : distance ahead of the front bumper from which nothing counts [m], (n,)
    """
    (ranges, least, beams), (forward, aside), all_places = scan, laser, np.empty((MOST, 4))
    for i in range(len(free)):
        front, rear = body.length[i] / 2 - body.axle[i], -body.length[i] / 2 - body.axle[i]
        swings = 2 * SWINGS / front**2
        reach = max(LEAST, speed[i] * TIME + speed[i] ** 2 / (2 * BRAKING))
        count = min(int(reach / STEP) + 1, MOST)
        is_off = _is_off(points[i], front)
        if not (is_off or _bends(route, i, driven[i], STEP * count, swings)):
            continue
        half, radius = body.width[i] / 2, math.hypot(max(front, -rear), body.width[i] / 2 + CLEAR)
        if not some_nearer(ranges[i], STEP * count + 2 * radius):
            continue
        places = all_places[:count]
        drive(route, points[i], i, STEP, speed[i], driven[i], body, places)
        for beam in range(ranges.shape[1]):
            r = max(ranges[i, beam], least)
            if skipped[i, 0] <= beam <= skipped[i, 1] or not r < STEP * count + 2 * radius:
                continue
            x, y = forward[i] + r * beams[0, beam], aside + r * beams[1, beam]
            away = abs(y) - half
            clear = CLEAR
            if rear < x < front + ALONGSIDE:
                clear = min(max(away - BESIDE, 0.0), CLEAR)
            for k in range(1, count):
                if (x - places[k, 0]) ** 2 + (y - places[k, 1]) ** 2 > radius * radius:
                    continue
                if _covers(places, float(k), x, y, rear, front, half + clear):
                    distance = STEP * _since(places, k, x, y, rear, front, half + clear)
                    if distance < min(free[i], until[i]):
                        free[i], first[i] = distance, beam
                    break


@compiled
def _covers(places, k, x, y, rear, front, half):
    """Whether the body is over a point at the k-th of its places, or between two of them."""
    before = int(k)
    after, share = min(before + 1, len(places) - 1), k - before
    dx = x - places[before, 0] * (1 - share) - places[after, 0] * share
    dy = y - places[before, 1] * (1 - share) - places[after, 1] * share
    cos = places[before, 2] * (1 - share) + places[after, 2] * share
    sin = places[before, 3] * (1 - share) + places[after, 3] * share
    return rear < dx * cos + dy * sin < front and abs(dy * cos - dx * sin) < half


@compiled
def _since(places, k, x, y, rear, front, half):
    """The place, k - 1 to k, from which the body is over a point that it is over at the k-th; to a 16th."""
    free, over = float(k - 1), float(k)
    for _ in range(4):
        middle = (free + over) / 2
        if _covers(places, middle, x, y, rear, front, half):
            over = middle
        else:
            free = middle
    return free


@compiled
def _is_off(points, front):
    """Whether the axle, or the front, is farther than SWINGS from the route that begins at points (k, 2).

    On its way back to the route, as in a lane change for which it has stopped, the body is not along that.
    """
    x, y = points[0]
    dx, dy = points[1, 0] - x, points[1, 1] - y
    length = max(math.hypot(dx, dy), 1e-9)
    offset = abs(x * dy - y * dx) / length
    return offset > SWINGS or abs(dy) / length * front > SWINGS


@compiled
def _bends(route, i, driven, reach, least):
    """Whether the vehicle, or its route on the way, bends as much as that [1/m]."""
    if abs(driven) > least:
        return True
    for k in range(route.distance.shape[1]):
        if route.distance[i, k] > reach:
            return False
        if abs(route.curvature[i, k]) > least:
            return True
    return False


@compiled
def drive(route, points, i, step, speed, curvature, body, places):
    """Fill in where the axle comes, as x, y [m], and cosine and sine of the heading, (m, 4).

    points    : of the route, as seen from where the axle is (k, 2) [m]
    step      : distance of the places [m]
    curvature : that is driven now [1/m]
    """
    x = y = heading = 0.0
    lock = 1 / max(body.turning_radius[i], body.length[i] / 4)
    change = body.curvature_rate[i] * step / max(speed, SLOWEST)
    catch_up, distance, piece = body.length[i], route.distance[i], 0
    for k in range(len(places)):
        places[k] = x, y, math.cos(heading), math.sin(heading)
        last = min(piece + 8, len(distance) - 1)
        piece, share, _, _ = nearest(points, piece, last, x, y, -math.inf if piece == 0 else 0.0, 1.0)
        along_x, along_y = points[piece + 1, 0] - points[piece, 0], points[piece + 1, 1] - points[piece, 1]
        station = distance[piece] + share * (distance[piece + 1] - distance[piece])
        # The chord to the next point has the direction of the route in the middle of it.
        bend = curvature_at(distance, route.curvature[i], station)
        direction = math.atan2(along_y, along_x) + bend * (station - (distance[piece] + distance[piece + 1]) / 2)
        away_x, away_y = x - points[piece, 0], y - points[piece, 1]
        length = max(math.hypot(along_x, along_y), 1e-9)
        offset = (along_x * away_y - along_y * away_x) / length
        off = heading - direction
        off -= 2 * math.pi * math.ceil((off - math.pi) / (2 * math.pi))
        errors = offset, off
        wanted = curvature_along(errors, bend) + curvature_back(errors, catch_up, lock, steering.STEEPEST)
        wanted = min(max(wanted, -lock), lock)
        curvature += min(max(wanted - curvature, -change), change)
        x += step * math.cos(heading + curvature * step / 2)
        y += step * math.sin(heading + curvature * step / 2)
        heading += curvature * step
