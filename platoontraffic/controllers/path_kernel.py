"""The law `path`, compiled: what it may drive along its route, and the first laser return on the strip that it drives.

Rows (n,) of vehicles, frames of their driven axles. As of numpy's, least and greatest values of NaN are NaN.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers import clear_distance, idm, steering
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import nearest
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, polyline.__file__, clear_distance.__file__, idm.__file__, steering.__file__)

SETTLING = 0.5  # time constant with which the wanted speed is approached [s]
REACTION = 0.4  # of the drive line to a command [s]
LOOK = 2.5  # distance before a line without right of way at which cross traffic is first looked at [vehicle lengths]
STOP_BEFORE = 0.2  # distance before a line at which it stops [vehicle lengths]
STEERING_LAG = 0.15  # from a command to the curvature driven, by which the curvature of the route is fed forward [s]
SHARPEST = 0.1  # least radius of a turn, for a vehicle that turns on the spot [vehicle lengths]
PLANNED = 0.75  # share of the comfortable braking that is planned before bends and lower limits, as brakes lag
STEERED = 0.95  # share of its steering rate that the changes of curvature may take
SURELY = 1 - 1e-9  # factor on limits with which no rounding decides
RESERVE = 1.15  # lateral acceleration that steering may use, above that of the planned speed
ASTRAY, ASKEW = 0.5, 0.5  # offset [vehicle widths] and off-heading [rad] beyond which it returns to its route slowly

desired_gap, interaction = compiled(idm.desired_gap), compiled(idm.acceleration)
curvature_back, curvature_along = compiled(steering.curvature_back), compiled(steering.curvature_along)
reach_of, speed_by_sight = compiled(clear_distance.reach_of), compiled(clear_distance.greatest_speed)


@compiled
def drive_along(route, speed, drive, body, ranges, laser, free, closing, profile, gains, along):
    """Fill in `path.AlongRoute`.

    drive         : acceleration by the engines now [m/s2], (n,)
    ranges        : [m], (n, m); NaN: lost
    laser         : its range_min and range_max, its distance ahead of the bodies' centres [m], its `reaction_time` [s]
    free, closing : distance to the first obstacle [m], and the rate at which it shrinks [m/s], (n,)
    profile       : wanted speeds [m/s] and their rates [m/s2], (n,) each
    gains         : `path.Gains`
    """
    range_min, range_max, mount, reaction_time = laser
    for i in range(len(speed)):
        v, length, lateral = speed[i], body.length[i], gains.lateral_acceleration
        offset, off_heading = _errors_on(route.points[i], route.distance[i], route.curvature[i])
        astray = abs(offset) > ASTRAY * body.width[i] or abs(off_heading) > ASKEW
        slow = math.sqrt(lateral * np.maximum(body.turning_radius[i], length / 2)) if astray else math.inf
        along.offset[i] = offset
        reached = v + _run_out(drive[i], body.drive_lag[i])
        here, bends = _bends(route, i, (v, reached), body.curvature_rate[i], slow, gains)
        along.bends[i] = np.minimum(bends, np.maximum((here - v) / SETTLING, -gains.braking))

        along.sight[i] = math.inf
        if gains.speed_factor < math.inf:
            reach, reaction = reach_of(range_max, mount, length), reaction_time + body.brake_lag[i]
            hardest = np.minimum(gains.hardest_braking, body.hardest_braking[i])
            along.sight[i] = np.maximum((speed_by_sight(reach, reaction, hardest) - v) / SETTLING, -gains.braking)

        catch_up = np.maximum(length if math.isnan(gains.catch_up) else gains.catch_up, gains.catch_up_time * v)
        lock, bend = 1 / np.maximum(body.turning_radius[i], SHARPEST * length), lateral / np.maximum(v, 1e-3) ** 2
        back = curvature_back((offset, off_heading), catch_up, np.minimum(lock, bend))
        ahead = curvature_at(route.distance[i], route.curvature[i], STEERING_LAG * v)
        greatest = np.minimum(lock, RESERVE * bend)
        curvature = curvature_along((offset, off_heading), ahead) + back
        along.curvature[i] = np.minimum(np.maximum(curvature, -greatest), greatest)

        along.obstacle[i] = math.inf
        if _all_lost(ranges[i]):
            along.obstacle[i] = -gains.braking
        elif free[i] < math.inf:
            stand_off = gains.stand_off
            if math.isnan(stand_off):  # half a length, and what the laser cannot see ahead of the bumper
                stand_off = np.maximum(range_min - (length / 2 - mount), 0.0) + 0.5 * length
            rate = 0.0 if math.isnan(closing[i]) else closing[i]
            gap = desired_gap(v, rate, stand_off, gains.time_headway, gains.acceleration, gains.braking)
            along.obstacle[i] = interaction(gap, np.maximum(free[i], 1e-3), gains.acceleration, 1.0)

        # The rate of a profile is driven; a constant speed is approached in comfort.
        wanted, change = profile
        rate = change[i] if wanted[i] <= here else 0.0
        least, most = np.minimum(rate, -gains.braking), np.maximum(rate, gains.acceleration)
        towards = rate + (np.minimum(wanted[i], here) - v) / SETTLING
        towards = np.minimum(np.maximum(towards, least), most)
        along.acceleration[i] = np.minimum(np.minimum(towards, bends), np.minimum(along.sight[i], along.obstacle[i]))


@compiled
def _errors_on(points, distance, curvature):
    """Offset and off-heading of a vehicle on its route, as `steering.Errors`."""
    # The chord to the next point turns by half of what the route does on the way.
    turn = (curvature[0] + curvature[1]) / 2 * distance[1] / 2
    x, y = points[0, 0], points[0, 1]
    heading = math.atan2(points[1, 1] - y, points[1, 0] - x) - turn
    off = -heading - 2 * math.pi * math.ceil((-heading - math.pi) / (2 * math.pi))
    return x * math.sin(heading) - y * math.cos(heading), off


@compiled
def _bends(route, i, speeds, steering_rate, slow, gains):
    """Speed that is allowed here [m/s]; acceleration for bends and lower limits ahead [m/s2], inf: any.

    Allowed are speeds by the curvature of the route, by its change, and by limits. One that is about to hold is
    approached as a wanted speed is.

    speeds : now, and the one that it reaches while the engine's acceleration ends [m/s]
    slow   : greatest speed everywhere [m/s]
    """
    v, reached = speeds
    distance, curvature, lateral = route.distance[i], route.curvature[i], gains.lateral_acceleration
    here, acceleration, braking, least = math.inf, math.inf, PLANNED * gains.braking, math.inf
    for k in range(len(distance)):
        bend, limit, change, step = abs(curvature[k]), slow, 0.0, 1.0
        if k + 1 < len(distance):
            change, step = abs(curvature[k + 1] - curvature[k]), distance[k + 1] - distance[k]
        if gains.speed_factor < math.inf:
            limit = np.minimum(gains.speed_factor * route.limit[i, k], slow)
        # Where it may drive as fast as nearer by, or faster, nothing more follows, as on most of a road.
        turns_little = change * least < SURELY * STEERED * steering_rate * step
        if bend * least * least < SURELY * lateral and turns_little and limit >= least:
            continue
        fastest = np.minimum(fastest_at(bend, change / step, lateral, steering_rate), limit)
        if k == 0:
            here = fastest
            continue
        least = np.minimum(least, fastest)
        slowing = _slowed_to(fastest, np.maximum(distance[k] - REACTION * v, 0.0), reached, braking)
        acceleration = np.minimum(acceleration, np.maximum(slowing, (fastest - v) / SETTLING))
    return here, acceleration


@compiled
def fastest_at(curvature, change, lateral, steering_rate):
    """Greatest speed in a bend [m/s].

    curvature, change      : of the route [1/m], and its change by distance [1/m2]
    lateral, steering_rate : greatest acceleration [m/s2], and greatest change of the curvature by time [1/m/s]
    """
    by_curvature = math.sqrt(lateral / np.maximum(abs(curvature), 1e-9))
    return np.minimum(by_curvature, STEERED * steering_rate / np.maximum(change, 1e-9))


@compiled
def _run_out(drive, lag):
    """Speed that is gained while the engine's acceleration ends [m/s]."""
    return np.maximum(drive, 0.0) * lag


@compiled
def _slowed_to(fastest, distance, v, braking):
    """Acceleration to have no more than a speed v0 from a distance on, by a braking b that begins as late as it can.

    At a distance s before, the speed u = sqrt(v0^2 + 2 b s) is allowed. It falls at b v / u, and is approached with the
    time constant SETTLING.
    """
    allowed = math.sqrt(fastest**2 + 2 * braking * distance)
    return (allowed - v) / SETTLING - braking * np.minimum(v / np.maximum(allowed, 1e-3), 1.0)


@compiled
def curvature_at(distance, curvature, ahead):
    """Curvature of a route at a distance ahead [1/m]."""
    after = 1
    while after < len(distance) - 1 and distance[after] <= ahead:
        after += 1
    near, far = distance[after - 1], distance[after]
    share = np.minimum(np.maximum((ahead - near) / np.maximum(far - near, 1e-9), 0.0), 1.0)
    return curvature[after - 1] * (1 - share) + curvature[after] * share


@compiled
def _all_lost(ranges):
    """The laser is broken."""
    k = 0
    while k < len(ranges) and math.isnan(ranges[k]):
        k += 1
    return k == len(ranges)


@compiled
def stop_at_lines(signals, speed, drive, body, gains, acceleration):
    """Fill in the acceleration for a closed line ahead [m/s2], (n,); inf where there is none.

    drive: acceleration by the engines now [m/s2], (n,)
    """
    for i in range(len(speed)):
        length, v, ahead = body.length[i], speed[i], signals.distance[i]
        before, reached = STOP_BEFORE * length, v + _run_out(drive[i], body.drive_lag[i])
        needed = v**2 / (2 * np.maximum(ahead, 1e-3))
        unseen = signals.minor[i] and ahead > LOOK * length  # cross traffic is not known from there
        too_late = needed > (2 * gains.braking if signals.changing[i] else gains.hardest_braking)
        acceleration[i] = math.inf
        if (unseen or not (signals.open[i] or too_late)) and ahead < math.inf:
            if ahead > before:
                acceleration[i] = _slowed_to(0.0, np.maximum(ahead - before, 1e-3), reached, gains.braking)
            else:  # it stops at once; harder if it has just set out, and could not stop before the line
                acceleration[i] = -np.maximum(gains.braking, reached**2 / (2 * np.maximum(ahead, 1e-3)))


@compiled
def first_on_strip(ranges, limits, beams, laser, aside, strip, length, front, free, beam):
    """Fill in the distance along the route from each front bumper to the first return on the strip [m], (n,).

    ranges       : inf or NaN for no return, -inf for one nearer than the least range [m], (n, k)
    limits       : least and greatest range [m]
    beams        : unit vectors, x and y, (2, k)
    laser, aside : position of the laser, x (n,) and y [m]
    strip        : points of the routes (n, m, 2), their distances along them (n, m), half the width (n,) [m]
    length       : of the bodies [m], (n,)
    front        : x of the front bumpers [m], (n,)
    free         : filled in; inf: no return
    beam         : filled in: the beam of that return, (n,); -1: none
    """
    points, distance, half_width = strip
    points = points[:, : _in_view(distance, limits[1], length)]
    for i in range(len(free)):
        free[i], beam[i] = np.inf, -1
        low, high = points[i, 0, 1], points[i, 0, 1]
        for k in range(1, points.shape[1]):
            low, high = min(low, points[i, k, 1]), max(high, points[i, k, 1])
        low, high = low - half_width[i], high + half_width[i]
        for k in range(ranges.shape[1]):
            if not ranges[i, k] < np.inf:
                continue
            r = max(ranges[i, k], limits[0])
            x, y = laser[i] + r * beams[0, k], aside + r * beams[1, k]
            if low < y < high and x > 0:
                piece, share, squared, _ = nearest(points[i], 0, points.shape[1] - 1, x, y, 0.0, 1.0)
                station = distance[i, piece] + share * (distance[i, piece + 1] - distance[i, piece])
                if np.sqrt(squared) < half_width[i] and front[i] < station < front[i] + free[i]:
                    free[i], beam[i] = station - front[i], k


@compiled
def _in_view(distance, range_max, length):
    """Number of the points of all routes, (n, m), between which a return may be."""
    longest = 0.0
    for i in range(len(length)):
        longest = max(longest, length[i])
    for k in range(distance.shape[1]):
        nearest_one = np.inf
        for i in range(len(distance)):
            nearest_one = min(nearest_one, distance[i, k])
        if nearest_one >= range_max + 2 * longest:
            return k + 1
    return distance.shape[1]


@compiled
def limits_of(acceleration, lines, obstacle, free, bearing, creeps, words, least, reason, toward):
    """Fill in the least acceleration, what it is for, and the bearing of an obstacle that it is for, (n,) each.

    acceleration, lines, obstacle : along the route, for lines, and of the first, for the obstacle [m/s2], (n,)
    free, bearing                 : of the obstacle [m], [rad], (n,)
    creeps                        : bool, (n,)
    words                         : numbers of `OBSTACLE` and `LINE` among the reasons
    """
    by_obstacle, by_line = words
    for i in range(len(least)):
        least[i] = np.minimum(acceleration[i], lines[i])
        reason[i], toward[i] = 0, np.nan
        if obstacle[i] <= least[i] and np.isfinite(free[i]):
            reason[i] = by_obstacle
        elif lines[i] < acceleration[i]:
            reason[i] = by_line
        elif creeps[i]:
            reason[i] = by_obstacle
        if reason[i] == by_obstacle:
            toward[i] = bearing[i]
