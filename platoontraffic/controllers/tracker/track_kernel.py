"""The extended Kalman filter of `tracking`, one vehicle after the other, compiled.

State of a predecessor: x, y of its rear axle's middle, heading, speed, acceleration, curvature (`tracking.Track`).
Measured: centre and heading of its rear.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers.tracker import track
from platoontraffic.controllers.tracker.track import OVERHANG
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, track.__file__)

# How drivers change their motion, as standard deviations after one second of a random walk.
JERK = 2.0  # of acceleration [m/s2]
EASING = 2.0  # time constant with which acceleration is expected to fade [s]
TURNING = 0.08  # of curvature [1/m]: steering of 0.2 rad in a second, at a wheelbase of 2.7 m
SIDEWAYS = 5.0  # of lateral acceleration [m/s2]; so at speed the curvature changes less
DRIFT, SLIDING = 0.001, 0.01  # of the own odometry, in a second [rad, m]: 0.1 degrees, and noise of the speed
SLIP = 0.02  # of the axle, sideways, for each metre driven [m]

FLOOR = 0.005  # of a measured distance, whatever the data sheet says [m]
BENT = 0.003  # rms distance of returns from a line that a corner explains better, beside noise [m]
FLOOR_HEADING = 0.004  # of a measured heading [rad]
WIDTH, WIDTH_SPREAD = 1.8, 0.15  # of a vehicle not seen whole [m]
NARROWEST, WIDEST = 1.3, 2.7  # that is taken for a rear [m]
SURPRISE = 11.3  # nis of one of a hundred
BRAKE_STEP = 5.0  # of acceleration, where a manoeuvre begins, standard deviation [m/s2]
BEND_STEP = 0.05  # of curvature, same [1/m]
HARD, FAST = 5.0, 10.0  # braking is that above it [m/s2]; and matters at once above that speed [m/s]
HARDEST, STRONGEST = 12.0, 6.0  # braking and acceleration that there are [m/s2]
GATE = 30.0  # greatest nis of what is taken for the predecessor; 16 has one of a thousand
NEAR = 6.0  # groups farther from where it should be are not looked at [m]
LANE = 1.5  # half the width in which a predecessor is looked for [m]
ASKEW = math.radians(50)  # a face that would turn the heading by more is no rear
OBLIQUE = math.radians(35)  # who drives so across the way ahead is not ahead on it


@compiled
def _remainder(angle, turn):
    return angle - turn * round(angle / turn)


@compiled
def predict(mean, cov, own_x, own_y, dt):
    """All rows, (n, 6) and (n, 6, 6), in place, as seen from own places (n,).

    The noise is that of random walks of acceleration and curvature, and of the own odometry, whose frame turns and
    slides under what is tracked in it.
    """
    forward, noise, half = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for i in range(len(mean)):
        state = mean[i]
        if math.isnan(state[0]):
            continue
        heading, speed, curvature = state[2], state[3], state[5]
        ease = math.exp(-dt / EASING)
        change = EASING * (1 - ease)  # of speed, by acceleration
        gain = EASING * (dt - change)  # of way
        way = speed * dt + gain * state[4]
        if speed + change * state[4] < 0:  # no car rolls back
            way = max(speed, 0.0) * dt / 2
        middle = heading + curvature * way / 2
        cos, sin = math.cos(middle), math.sin(middle)

        forward[:] = 0.0
        for a in range(6):
            forward[a, a] = 1.0
        forward[0, 2], forward[1, 2] = -way * sin, way * cos
        along_x, along_y = cos - curvature * way / 2 * sin, sin + curvature * way / 2 * cos
        forward[0, 3], forward[1, 3], forward[2, 3] = dt * along_x, dt * along_y, dt * curvature
        forward[0, 4], forward[1, 4], forward[2, 4] = gain * along_x, gain * along_y, gain * curvature
        forward[3, 4], forward[4, 4] = change, ease
        forward[0, 5], forward[1, 5], forward[2, 5] = -way * way / 2 * sin, way * way / 2 * cos, way

        # Acceleration walks: way, speed, acceleration by dt^3/6, dt^2/2, dt of the same steps, each a white noise.
        jerk = JERK * JERK
        noise[:] = 0
        powers = (dt**5 / 20, dt**4 / 8, dt**3 / 6, dt**3 / 3, dt**2 / 2, dt)
        noise[0, 0], noise[0, 1], noise[1, 1] = cos * cos * powers[0], cos * sin * powers[0], sin * sin * powers[0]
        noise[0, 3], noise[1, 3], noise[0, 4], noise[1, 4] = (
            cos * powers[1],
            sin * powers[1],
            cos * powers[2],
            sin * powers[2],
        )
        noise[3, 3], noise[3, 4], noise[4, 4] = powers[3], powers[4], powers[5]
        noise *= jerk
        # Curvature walks: sideways way, heading, curvature, by the same powers of the way's time.
        fast = max(abs(speed), 1.0)
        turning = min(TURNING, SIDEWAYS / (fast * fast)) ** 2
        v = max(abs(way) / dt, 0.0)
        noise[0, 0] += sin * sin * (powers[0] * v**4 * turning + (SLIP * SLIP) * abs(way))
        noise[0, 1] -= cos * sin * (powers[0] * v**4 * turning + (SLIP * SLIP) * abs(way))
        noise[1, 1] += cos * cos * (powers[0] * v**4 * turning + (SLIP * SLIP) * abs(way))
        noise[0, 2] -= sin * powers[1] * v**3 * turning
        noise[1, 2] += cos * powers[1] * v**3 * turning
        noise[0, 5] -= sin * powers[2] * v**2 * turning
        noise[1, 5] += cos * powers[2] * v**2 * turning
        noise[2, 2] += powers[3] * v * v * turning
        noise[2, 5] += powers[4] * v * turning
        noise[5, 5] += powers[5] * turning
        away_x, away_y = state[0] - own_x[i], state[1] - own_y[i]
        slides, turns = SLIDING * SLIDING * dt, DRIFT * DRIFT * dt
        noise[0, 0] += slides + turns * away_y * away_y
        noise[0, 1] -= turns * away_x * away_y
        noise[1, 1] += slides + turns * away_x * away_x
        noise[0, 2] -= turns * away_y
        noise[1, 2] += turns * away_x
        noise[2, 2] += turns

        state[0] += way * cos
        state[1] += way * sin
        state[2] += curvature * way
        state[3] = max(speed + change * state[4], 0.0)
        state[4] *= ease
        if state[3] == 0.0 and state[4] < 0:
            state[4] = 0.0
        # forward cov forward' + noise, of which the upper half is filled in
        for a in range(6):
            for b in range(6):
                half[a, b] = 0.0
                for c in range(6):
                    half[a, b] += forward[a, c] * cov[i, c, b]
        for a in range(6):
            for b in range(a, 6):
                total = noise[a, b]
                for c in range(6):
                    total += half[a, c] * forward[b, c]
                cov[i, a, b] = cov[i, b, a] = total


@compiled
def _edge(ranges, beam, step, here):
    """Beyond an end of a group: whether its surface ends there, unhidden, and over how many beams that is not known."""
    unknown = 1
    beam += step
    while 0 <= beam < len(ranges) and math.isnan(ranges[beam]):
        beam += step
        unknown += 1
    if not 0 <= beam < len(ranges):
        return False, unknown
    return ranges[beam] > here, unknown


@compiled
def _rear(k, expected, width, ranges, increment, sigma, segments, rear, var):
    """Rear centre and heading [sensor frame] by group k of a scan, if the heading may be as expected, else False.

    rear : x, y, heading, filled in
    var  : of the centre along the heading and across it, and of the heading, filled in
    returns : found, width of the rear if it is seen whole, else NaN
    """
    (
        firsts,
        lasts,
        counts,
        starts,
        stops,
        line_headings,
        line_distances,
        line_rms,
        corners,
        leg_headings,
        leg_lengths,
        corner_rms,
        convex,
    ) = segments
    x1, y1, x2, y2 = starts[k, 0], starts[k, 1], stops[k, 0], stops[k, 1]
    error = sigma[0] + sigma[1] * math.hypot(x1, y1)
    count = counts[k]
    # A corner, if a line is not all that there is to see; noise alone bends one so far once in a hundred.
    bent = line_rms[k] > max(error * (1 + 2.5 / math.sqrt(count)) + BENT, 2 * corner_rms[k])
    angular = count >= 6 and convex[k] and bent
    error2 = max(error, corner_rms[k] if angular else line_rms[k]) ** 2

    # Faces are walked along from right to left; there is the rear at heading - pi/2, a left side at heading, a right
    # side at heading - pi.
    face = leg_headings[k] if angular else line_headings[k]
    best, kind = ASKEW, -1
    for one in range(3 if not angular else 2):
        # With a corner: the first leg is the rear and the second one the left side, or the right side and the rear.
        turn = (0.5, 0.0, 1.0)[one] if not angular else (0.5, 1.0)[one]
        off = abs(_remainder(face - turn * math.pi - expected, 2 * math.pi))
        if off < best:
            best, kind = off, one
    if kind < 0:
        return False, math.nan
    length = math.hypot(x2 - x1, y2 - y1)
    if not angular:
        heading = face - (0.5, 0.0, 1.0)[kind] * math.pi
        # The ends on the line, which is better known than any return.
        away_x, away_y = math.sin(face), -math.cos(face)
        off1 = line_distances[k] - away_x * x1 - away_y * y1
        off2 = line_distances[k] - away_x * x2 - away_y * y2
        x1, y1, x2, y2 = x1 + off1 * away_x, y1 + off1 * away_y, x2 + off2 * away_x, y2 + off2 * away_y
        # What is measured of the edges lies short of them by half a beam, more or less.
        far1, far2 = math.hypot(x1, y1), math.hypot(x2, y2)
        cos, sin = math.cos(face), math.sin(face)
        free1, unknown1 = _edge(ranges, firsts[k], -1, far1)
        free2, unknown2 = _edge(ranges, lasts[k], 1, far2)
        # One beam moves along the face by its distance over the cosine of the incidence.
        across1 = max(abs(x1 * sin - y1 * cos), 0.1 * far1) / far1
        across2 = max(abs(x2 * sin - y2 * cos), 0.1 * far2) / far2
        gap1, gap2 = unknown1 * increment * far1 / across1, unknown2 * increment * far2 / across2
        x1, y1 = x1 - gap1 / 2 * cos, y1 - gap1 / 2 * sin
        x2, y2 = x2 + gap2 / 2 * cos, y2 + gap2 / 2 * sin
        var1, var2 = gap1 * gap1 / 12 + FLOOR**2, gap2 * gap2 / 12 + FLOOR**2
        depth = error2 / count + FLOOR**2
        var[2] = 12 * error2 / (count * max(length, 0.3) ** 2) + FLOOR_HEADING**2
        if kind == 0:
            whole = length + gap1 / 2 + gap2 / 2
            if length > WIDEST or (free1 and free2 and whole < NARROWEST):
                return False, math.nan
            seen = math.nan
            if free1 and free2:
                rear[0], rear[1], var[1] = (x1 + x2) / 2, (y1 + y2) / 2, (var1 + var2) / 4
                seen = whole
            elif free1:
                rear[0], rear[1] = x1 + width / 2 * cos, y1 + width / 2 * sin
                var[1] = var1 + WIDTH_SPREAD**2 / 4
            elif free2:
                rear[0], rear[1] = x2 - width / 2 * cos, y2 - width / 2 * sin
                var[1] = var2 + WIDTH_SPREAD**2 / 4
            else:
                rear[0], rear[1], var[1] = (x1 + x2) / 2, (y1 + y2) / 2, max(width - length, 0.3) ** 2 / 12
            rear[2], var[0] = heading, depth
            return True, seen
        # A side alone: the corner is its near end, the centre half a width aside.
        cos_h, sin_h = math.cos(heading), math.sin(heading)
        if kind == 1:
            if not free1:
                return False, math.nan
            rear[0], rear[1], var[0] = x1 + width / 2 * sin_h, y1 - width / 2 * cos_h, var1
        else:
            if not free2:
                return False, math.nan
            rear[0], rear[1], var[0] = x2 - width / 2 * sin_h, y2 + width / 2 * cos_h, var2
        rear[2], var[1] = heading, depth + WIDTH_SPREAD**2 / 4
        return True, math.nan

    # A corner: at it the rear ends, the other end is an edge of the rear.
    leg = 0 if kind == 0 else 1
    heading = face - (0.5 if kind == 0 else 1.0) * math.pi
    along = face if kind == 0 else face - math.pi / 2  # of the rear, from right to left
    cos, sin = math.cos(along), math.sin(along)
    end_x, end_y, beam, step = (x1, y1, firsts[k], -1) if kind == 0 else (x2, y2, lasts[k], 1)
    far = math.hypot(end_x, end_y)
    free, unknown = _edge(ranges, beam, step, far)
    across = max(abs(end_x * sin - end_y * cos), 0.1 * far) / far
    gap = unknown * increment * far / across
    seen = leg_lengths[k, leg] + gap / 2
    if free:
        if seen < NARROWEST or seen > WIDEST:
            return False, math.nan
        half, spread = seen / 2, gap * gap / 48
    else:
        if seen > WIDEST:
            return False, math.nan
        half, spread, seen = width / 2, WIDTH_SPREAD**2 / 4, math.nan
    side = -1.0 if kind == 0 else 1.0
    rear[0], rear[1], rear[2] = corners[k, 0] + side * half * cos, corners[k, 1] + side * half * sin, heading
    share = leg_lengths[k, leg] / (leg_lengths[k, 0] + leg_lengths[k, 1])
    on_rear, on_side = max(count * share, 1.0), max(count * (1 - share), 1.0)
    var[0] = error2 / on_rear + FLOOR**2
    var[1] = error2 / on_side + FLOOR**2 + spread
    inertia = on_rear * leg_lengths[k, leg] ** 2 + on_side * leg_lengths[k, 1 - leg] ** 2
    var[2] = 12 * error2 / max(inertia, 0.1) + FLOOR_HEADING**2
    return True, seen


@compiled
def beside(way, x, y):
    """Station of the nearest place on a polyline (k, 2), how far left of it a point is, and its heading there.

    Before its beginning stations are negative; beyond its end, offsets are those from its last piece.
    """
    nearest, station, aside, along = math.inf, 0.0, 0.0, 0.0
    driven = 0.0
    for k in range(len(way) - 1):
        dx, dy = way[k + 1, 0] - way[k, 0], way[k + 1, 1] - way[k, 1]
        size = math.hypot(dx, dy)
        if size == 0.0:
            continue
        cos, sin = dx / size, dy / size
        from_x, from_y = x - way[k, 0], y - way[k, 1]
        there = from_x * cos + from_y * sin
        part = there if k == 0 and there < 0 else max(there, 0.0) if k == len(way) - 2 else min(max(there, 0.0), size)
        away = (from_x - part * cos) ** 2 + (from_y - part * sin) ** 2
        if away < nearest:
            nearest, station, along = away, driven + part, math.atan2(sin, cos)
            aside = math.copysign(math.sqrt(away), from_y * cos - from_x * sin)
        driven += size
    return station, aside, along


@compiled
def aside(ways, axle, x, y, heading, off):
    for i in range(len(off)):
        if math.isnan(axle[i, 0]):
            continue
        cos, sin = math.cos(heading[i]), math.sin(heading[i])
        dx, dy = axle[i, 0] - x[i], axle[i, 1] - y[i]
        off[i] = abs(beside(ways[i], dx * cos + dy * sin, dy * cos - dx * sin)[1])


@compiled
def correct(
    mean,
    cov,
    widths,
    blind,
    nis,
    targets,
    groups,
    own,
    sensor,
    expected,
    ways,
    dt,
    ranges,
    increment,
    sigma,
    offset,
    first,
    last,
    count,
    start,
    stop,
    line_heading,
    line_distance,
    line_rms,
    corner,
    leg_heading,
    leg_lengths,
    corner_rms,
    convex,
):
    """All rows, in place, by the groups offset[i] to offset[i + 1] - 1 of its scan."""
    segments = (
        first,
        last,
        count,
        start,
        stop,
        line_heading,
        line_distance,
        line_rms,
        corner,
        leg_heading,
        leg_lengths,
        corner_rms,
        convex,
    )
    rear, var, best_rear, best_var = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    state, spread = np.empty(6), np.empty((6, 6))
    for i in range(len(mean)):
        cos, sin = math.cos(own[i, 2]), math.sin(own[i, 2])
        # The sensor in the odometry frame.
        laser_x = own[i, 0] + sensor[i, 0] * cos - sensor[i, 1] * sin
        laser_y = own[i, 1] + sensor[i, 0] * sin + sensor[i, 1] * cos
        yaw = own[i, 2] + sensor[i, 2]
        cos, sin = math.cos(yaw), math.sin(yaw)
        known = not math.isnan(mean[i, 0])
        width = widths[i] if known else WIDTH
        facing = mean[i, 2] - yaw if known else 0.0
        back_x, back_y = math.nan, math.nan
        if known:
            back_x, back_y = mean[i, 0] - OVERHANG * math.cos(mean[i, 2]), mean[i, 1] - OVERHANG * math.sin(mean[i, 2])
        least, found, best_seen = (GATE if known else math.inf), -1, math.nan
        for k in range(offset[i], offset[i + 1]):
            if known:
                # In the odometry frame; near to where it should be?
                middle_x, middle_y = (start[k, 0] + stop[k, 0]) / 2, (start[k, 1] + stop[k, 1]) / 2
                dx = laser_x + middle_x * cos - middle_y * sin - back_x
                dy = laser_y + middle_x * sin + middle_y * cos - back_y
                if dx * dx + dy * dy > NEAR * NEAR:
                    continue
            elif len(ways[i]):
                middle_x, middle_y = (start[k, 0] + stop[k, 0]) / 2, (start[k, 1] + stop[k, 1]) / 2
                facing = beside(ways[i], middle_x + sensor[i, 0], middle_y + sensor[i, 1])[2]
            else:
                facing = 2 * math.atan(expected[i] * (start[k, 0] + stop[k, 0]) / 2)  # tangent to the arc there
            ok, seen = _rear(k, facing, width, ranges[i], increment, sigma, segments, rear, var)
            if not ok:
                continue
            if known:
                off = _fitted(mean[i], cov[i], rear, var, laser_x, laser_y, yaw, dt, state, spread)
            elif len(ways[i]):
                station, aside, along = beside(ways[i], rear[0] + sensor[i, 0], rear[1] + sensor[i, 1])
                if station <= 0 or abs(aside) > LANE or math.isnan(seen):
                    continue
                if abs(_remainder(rear[2] - along, 2 * math.pi)) > OBLIQUE:  # it crosses the way
                    continue
                off = station
            else:
                x, y = rear[0] + sensor[i, 0], rear[1] + sensor[i, 1]  # as seen from the own axle
                aside = y - expected[i] * (x * x + y * y) / 2
                if x <= 0 or abs(aside) > LANE + 0.05 * x or math.isnan(seen):
                    continue
                off = x
            if off < least:
                least, found, best_seen = off, k, seen
                best_rear[:], best_var[:] = rear, var
        if found < 0:
            continue
        targets[i, 0], targets[i, 1] = math.hypot(best_rear[0], best_rear[1]), math.atan2(best_rear[1], best_rear[0])
        if known:
            nis[i] = _fitted(mean[i], cov[i], best_rear, best_var, laser_x, laser_y, yaw, dt, state, spread)
            mean[i], cov[i] = state, spread
            mean[i, 3] = max(mean[i, 3], 0.0)
        else:
            heading = best_rear[2] + yaw
            x = laser_x + best_rear[0] * cos - best_rear[1] * sin + OVERHANG * math.cos(heading)
            y = laser_y + best_rear[0] * sin + best_rear[1] * cos + OVERHANG * math.sin(heading)
            mean[i] = (x, y, heading, own[i, 3], 0.0, expected[i])
            cov[i] = 0.0
            for a, sigma_a in enumerate((0.1, 0.1, 0.05, 5.0 + own[i, 3] / 2, 2.0, 0.05)):
                cov[i, a, a] = sigma_a * sigma_a
            widths[i] = best_seen
        if not math.isnan(best_seen):
            widths[i] += 0.1 * (min(max(best_seen, NARROWEST), WIDEST) - widths[i])
        blind[i] = 0.0
        groups[i, 0], groups[i, 1] = first[found], last[found]


@compiled
def _fitted(mean, cov, rear, var, laser_x, laser_y, yaw, dt, state, spread):
    """State and covariance corrected by a rear seen, filled in; returns the squared innovation.

    One too great for chance is taken for a manoeuvre that has just begun: a step of acceleration and of curvature
    (adjustable process noise: Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation",
    2001, section 11.2). One that asks for more than there is began a scan earlier, when it was taken for chance, if it
    is hard braking, the only one that matters at once.
    """
    state[:], spread[:] = mean, cov
    off = _corrected(state, spread, rear, var, laser_x, laser_y, yaw)
    if off < SURPRISE:
        return off
    cos, sin = math.cos(mean[2]), math.sin(mean[2])
    turned = min(BEND_STEP, SIDEWAYS / max(mean[3], 1.0) ** 2)
    for scans in range(1, 3 if mean[3] > FAST else 2):
        state[:], spread[:] = mean, cov
        since = scans * dt
        way = mean[3] * since
        for a, by_step in enumerate((cos * since * since / 2, sin * since * since / 2, 0.0, since, 1.0, 0.0)):
            for b, and_by in enumerate((cos * since * since / 2, sin * since * since / 2, 0.0, since, 1.0, 0.0)):
                spread[a, b] += by_step * and_by * BRAKE_STEP**2
        for a, by_step in enumerate((-sin * way * way / 2, cos * way * way / 2, way, 0.0, 0.0, 1.0)):
            for b, and_by in enumerate((-sin * way * way / 2, cos * way * way / 2, way, 0.0, 0.0, 1.0)):
                spread[a, b] += by_step * and_by * turned**2
        off = _corrected(state, spread, rear, var, laser_x, laser_y, yaw)
        if -HARDEST < state[4] < (STRONGEST if scans == 1 else -HARD):
            return off
    return math.inf


@compiled
def _corrected(state, cov, rear, var, laser_x, laser_y, yaw):
    """Correct a state (6,) and its covariance in place by a rear seen; returns the squared innovation.

    Along and across the heading seen, and in heading, errors have nothing to do with each other: one by one.
    """
    heading = rear[2] + yaw
    cos, sin = math.cos(heading), math.sin(heading)
    cos_y, sin_y = math.cos(yaw), math.sin(yaw)
    x = laser_x + rear[0] * cos_y - rear[1] * sin_y
    y = laser_y + rear[0] * sin_y + rear[1] * cos_y
    cos_s, sin_s = math.cos(state[2]), math.sin(state[2])
    dx, dy = x - (state[0] - OVERHANG * cos_s), y - (state[1] - OVERHANG * sin_s)
    off = (dx * cos + dy * sin, dy * cos - dx * sin, _remainder(heading - state[2], 2 * math.pi))
    by = (
        (cos, sin, OVERHANG * (sin_s * cos - cos_s * sin)),
        (-sin, cos, -OVERHANG * (sin_s * sin + cos_s * cos)),
        (0.0, 0.0, 1.0),
    )  # change of each of these with x, y, heading; the rest of the state does not show
    change, gain, total = np.zeros(6), np.empty(6), 0.0
    for j in range(3):
        for a in range(6):
            gain[a] = cov[a, 0] * by[j][0] + cov[a, 1] * by[j][1] + cov[a, 2] * by[j][2]
        spread = by[j][0] * gain[0] + by[j][1] * gain[1] + by[j][2] * gain[2] + var[j]
        left = off[j] - by[j][0] * change[0] - by[j][1] * change[1] - by[j][2] * change[2]
        total += left * left / spread
        for a in range(6):
            change[a] += gain[a] / spread * left
            for b in range(6):
                cov[a, b] -= gain[a] * gain[b] / spread
    state += change
    return total
