"""The remembered path of `trail`, one vehicle after the other, compiled.

A trail is points (size, 3): x, y and station, which grows along the trail.
"""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers import returns_kernel
from platoontraffic.controllers.returns_kernel import some_nearer
from platoontraffic.geometry import polyline
from platoontraffic.geometry.polyline import beside, nearest
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, returns_kernel.__file__, polyline.__file__)

SPACING = 0.5  # least distance of two points [m]
ROUNDING = 4  # places each way whose mean rounds a route's corner
APART = 0.6  # least distance of places whose curvatures are compared [windows]: between closer ones, errors decide
# Length of trail that is kept behind the own axle [m]: more than any window of a fit, and less than a lap of a small
# roundabout, where the nearest place would otherwise be one of the lap before.
BEHIND = 30.0
CHORD = 3  # points each way that give a direction
HARDLY_OUT, FARTHEST_OUT = 0.1, 1.5  # the front swings out by less than that, and by no more, for all that counts [m]


@compiled
def _remainder(angle, turn):
    return angle - turn * round(angle / turn)


# ---- growth


@compiled
def find_oldest(trail, odometry, replaced, oldest):
    """Fill in the first point of each trail that lies no more than BEHIND behind the own axle, (n,).

    replaced: trails of which no point is kept, bool (n,)
    """
    for i in range(len(oldest)):
        points, size = trail.points[i], trail.size[i]
        if replaced[i]:
            oldest[i] = size
            continue
        piece, _ = _nearest(points, size, odometry.x[i], odometry.y[i])
        oldest[i] = np.searchsorted(points[:size, 2], points[piece, 2] - BEHIND)


@compiled
def copy_points(trail, oldest, points):
    """Fill in the counted points of all trails from the oldest one to be kept on."""
    for i in range(len(oldest)):
        for k in range(oldest[i], trail.size[i]):
            for a in range(3):
                points[i, k - oldest[i], a] = trail.points[i, k, a]


@compiled
def extend(trail, odometry, axle, seen, gap):
    """Append the predecessors' axles (n, 2) [m] where seen, in place; with an arc between where there was a gap."""
    points, size = trail.points, trail.size
    for i in range(len(size)):
        if not seen[i]:
            continue
        x, y = odometry.x[i], odometry.y[i]
        if size[i] == points.shape[1]:
            _forget(points[i], size, i)
        cos, sin = _direction(points[i], size[i])
        last_x, last_y = points[i, size[i] - 1, 0], points[i, size[i] - 1, 1]
        if gap[i] and (x - last_x) * cos + (y - last_y) * sin > 0:  # driven past its end: it leads nowhere
            cos, sin = math.cos(odometry.heading[i]), math.sin(odometry.heading[i])
            points[i, 0] = x - cos, y - sin, -1.0
            points[i, 1] = x, y, 0.0
            size[i] = 2
            last_x, last_y = x, y
        dx, dy = axle[i, 0] - last_x, axle[i, 1] - last_y
        along, aside = dx * cos + dy * sin, dy * cos - dx * sin
        far = math.hypot(along, aside)
        if far < SPACING or along <= 0:
            continue
        if gap[i] and far > 2 * SPACING:
            _append_arc(points[i], size, i, (along, aside), (cos, sin))
        _append(points[i], size, i, axle[i, 0], axle[i, 1])


@compiled
def _append_arc(points, size, i, there, direction):
    """Points on the arc from the end to a place; without that place itself.

    there     : the place, along and across the direction of the arc at the end [m]
    direction : its cosine and sine
    """
    (along, aside), (cos, sin) = there, direction
    last_x, last_y = points[size[i] - 1, 0], points[size[i] - 1, 1]
    far = math.hypot(along, aside)
    half = math.atan2(aside, along)  # direction of the chord; the arc turns by twice that
    length = far if abs(half) < 1e-6 else far * half / math.sin(half)
    count = min(int(length / SPACING), len(points) // 2)
    while size[i] + count >= len(points):
        _forget(points, size, i)
    for k in range(1, count):
        turned = half * k / count  # direction of the chord to this point
        chord = far * k / count if abs(half) < 1e-6 else far * math.sin(turned) / math.sin(half)
        to_x, to_y = chord * math.cos(turned), chord * math.sin(turned)
        _append(points, size, i, last_x + to_x * cos - to_y * sin, last_y + to_x * sin + to_y * cos)


@compiled
def relay(trail, odometry, route):
    """Lay trails along `trail.RouteSection` instead, in place."""
    for i in range(len(trail.size)):
        if not route.rows[i]:
            continue
        cos, sin = math.cos(odometry.heading[i]), math.sin(odometry.heading[i])
        points, distance, n, piece = trail.points[i], route.distance[i], 0, 0
        for k in range(min(len(distance), len(points) // 2)):
            ahead, aside, piece = _rounded(route.points[i], distance, distance[k], route.rounding[i], piece)
            x, y = odometry.x[i] + ahead * cos - aside * sin, odometry.y[i] + ahead * sin + aside * cos
            dx, dy = x - points[n - 1, 0], y - points[n - 1, 1]
            step = math.sqrt(dx * dx + dy * dy)  # math.hypot takes three times as long
            if n == 0 or step > 1e-3:
                points[n, 0], points[n, 1], points[n, 2] = x, y, points[n - 1, 2] + step if n else 0.0
                n += 1
            if n > 1 and distance[k] > route.length[i]:
                break
        if n == 1:  # at the end of the route all its points are one
            points[1, 0], points[1, 1], points[1, 2] = points[0, 0] + cos, points[0, 1] + sin, 1.0
            n = 2
        trail.size[i] = n


@compiled
def _rounded(points, distance, station, window, piece):
    """Mean of a route's places within a window each way of a station, and the piece that the first of them is on.

    Before its first point and beyond its last the route goes straight on.

    piece: the first place is on this one, or on a later one
    """
    x = y = slope_x = slope_y = 0.0
    last, first, before = len(distance) - 2, piece, -1
    for j in range(-ROUNDING, ROUNDING + 1):
        there = station + j * (window / ROUNDING)
        while piece < last and distance[piece + 1] < there:
            piece += 1
        if piece != before:  # divisions take as long as all else
            per_metre, before = 1 / (distance[piece + 1] - distance[piece]), piece
            slope_x = (points[piece + 1, 0] - points[piece, 0]) * per_metre
            slope_y = (points[piece + 1, 1] - points[piece, 1]) * per_metre
        if j == -ROUNDING:
            first = piece
        along = there - distance[piece]
        x += points[piece, 0] + along * slope_x
        y += points[piece, 1] + along * slope_y
    return x / (2 * ROUNDING + 1), y / (2 * ROUNDING + 1), first


@compiled
def _append(points, size, i, x, y):
    last = points[size[i] - 1]
    points[size[i]] = x, y, last[2] + math.hypot(x - last[0], y - last[1])
    size[i] += 1


@compiled
def _forget(points, size, i):
    """Remove the oldest quarter."""
    gone = len(points) // 4
    for k in range(size[i] - gone):
        for axis in range(3):  # one by one: numba takes seconds to compile an assignment of arrays
            points[k, axis] = points[k + gone, axis]
    size[i] -= gone


# ---- geometry


@compiled
def _direction(points, size):
    """Cosine and sine of the heading of the last piece."""
    dx, dy = points[size - 1, 0] - points[size - 2, 0], points[size - 1, 1] - points[size - 2, 1]
    away = math.hypot(dx, dy)
    return dx / away, dy / away


@compiled
def _nearest(points, size, x, y):
    """The piece, by its first point, and the share of it, nearest to a place: a piece at the nearest point."""
    middle, least = 0, math.inf
    for k in range(size):
        away = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
        if away < least:
            middle, least = k, away
    piece, share, _, _ = nearest(points, max(middle - 1, 0), min(middle + 1, size - 1), x, y, 0.0, 1.0)
    return piece, share


@compiled
def _station(points, piece, share):
    return points[piece, 2] + share * (points[piece + 1, 2] - points[piece, 2])


# ---- what to steer by


@compiled
def look_ahead(trail, odometry, axle, on_route, windows, preview, ahead):
    """Fill in `trail.Ahead`.

    axle     : of the predecessors [m], (n, 2); NaN without one
    on_route : bool (n,)
    windows  : of the fits of place and direction, of the curvature that is steered, and of the others [m], (n,) each
    """
    fit = np.empty((3, 2))
    places = ahead.bend.shape[1]
    window, bend_window, plan_window = windows
    for i in range(len(trail.size)):
        points, size = trail.points[i], trail.size[i]
        x, y = odometry.x[i], odometry.y[i]
        here = _station_beside(points, size, x, y)
        end = points[size - 1, 2] - here
        ahead.length[i] = end
        if not math.isnan(axle[i, 0]):
            ahead.length[i] += _past_end(points, size, axle[i, 0], axle[i, 1])
        if on_route[i]:
            ahead.offset[i] = ahead.off_heading[i] = ahead.curvature[i] = math.nan
            ahead.distance[i], ahead.bend[i] = math.nan, math.nan
            continue

        _fit(points, size, here, window[i], 0, fit)
        along = math.atan2(fit[1, 1], fit[1, 0])
        cos, sin = math.cos(along), math.sin(along)
        ahead.offset[i] = (y - fit[0, 1]) * cos - (x - fit[0, 0]) * sin
        ahead.off_heading[i] = _remainder(odometry.heading[i] - along, 2 * math.pi)

        _fit(points, size, here + preview[i], bend_window[i], 0, fit)
        ahead.curvature[i] = _curvature(fit)
        least, first = APART * plan_window[i], 0
        beyond = max(end - least * (places - 1), 0.0)
        for j in range(places):
            ahead.distance[i, j] = min(least * j + beyond * (j / (places - 1)) ** 2, max(end, 0.0))
            first = _fit(points, size, here + ahead.distance[i, j], plan_window[i], first, fit)
            ahead.bend[i, j] = _curvature(fit)


@compiled
def _station_beside(points, size, x, y):
    """Station beside a place, which may be beyond the end."""
    piece, share = _nearest(points, size, x, y)
    station = _station(points, piece, share)
    if piece == size - 2 and share == 1.0:
        station += _past_end(points, size, x, y)
    return station


@compiled
def _past_end(points, size, x, y):
    """Distance of a place from the end, in the last direction."""
    cos, sin = _direction(points, size)
    return (x - points[size - 1, 0]) * cos + (y - points[size - 1, 1]) * sin


@compiled
def _fit(points, size, here, window, begin, fit):
    """The parabola of least squares through the points within a window of a station; beyond the end a straight line.

    With u = (station - middle) / window, x and y each are r0 + r1 u + r2 u^2, where M r = sum of (1, u, u^2) x and
    M_jk = sum of u^(j + k).

    begin   : where the search for the window's first point begins: 0, or what was returned for an earlier station
    fit     : place there, and its first and second derivative by station, (3, 2), filled in
    returns : the window's first point
    """
    end = points[size - 1, 2]
    # Near the end that of the last points; a tangent from one side is too uncertain.
    middle = min(here, max(end - window, end / 2))
    begin, stop = _within(points, size, middle - window, middle + window, begin)
    first, stop = _at_least(4, begin, stop, size)
    if stop - first < 3:
        cos, sin = _direction(points, size)
        fit[0] = points[size - 1, 0] + (here - end) * cos, points[size - 1, 1] + (here - end) * sin
        fit[1] = cos, sin
        fit[2] = 0.0, 0.0
        return begin
    m, x, y = _moments(points, first, stop, middle, window)
    a, b, c, d, e = m
    # Inverse of the symmetric [[a, b, c], [b, c, d], [c, d, e]] by cofactors.
    i00, i01, i02 = c * e - d * d, c * d - b * e, b * d - c * c
    i11, i12, i22 = a * e - c * c, b * c - a * d, a * c - b * b
    scale = 1 / (a * i00 + b * i01 + c * i02)
    on, beyond = min(here, end) - middle, max(here - end, 0.0)
    for axis in range(2):
        r0, r1, r2 = x if axis == 0 else y
        place = scale * (i00 * r0 + i01 * r1 + i02 * r2) + points[first, axis]
        slope = scale * (i01 * r0 + i11 * r1 + i12 * r2) / window
        bent = 2 * scale * (i02 * r0 + i12 * r1 + i22 * r2) / (window * window)
        fit[0, axis] = place + slope * on + bent * on * on / 2 + (slope + bent * on) * beyond
        fit[1, axis] = slope + bent * on
        fit[2, axis] = bent if beyond == 0 else 0.0
    return begin


@compiled
def _within(points, size, low, high, begin):
    """First and last + 1 of the points between two stations; `begin` is none after the first of them."""
    first = begin
    while first < size and points[first, 2] < low:
        first += 1
    stop = first
    while stop < size and points[stop, 2] < high:
        stop += 1
    return first, stop


@compiled
def _at_least(least, first, stop, size):
    """A range of points, widened on both sides to so many at least, as far as there are."""
    while stop - first < least and (first > 0 or stop < size):
        first, stop = max(first - 1, 0), min(stop + 1, size)
    return first, stop


@compiled
def _moments(points, first, stop, middle, window):
    """Sums over points of u^0 to u^4, and of x and y, from the first point, times u^0 to u^2."""
    a = b = c = d = e = 0.0
    x0 = x1 = x2 = y0 = y1 = y2 = 0.0
    per_metre = 1 / window
    for k in range(first, stop):
        u = (points[k, 2] - middle) * per_metre
        dx, dy = points[k, 0] - points[first, 0], points[k, 1] - points[first, 1]
        u2 = u * u
        a, b, c, d, e = a + 1.0, b + u, c + u2, d + u2 * u, e + u2 * u2
        x0, x1, x2 = x0 + dx, x1 + u * dx, x2 + u2 * dx
        y0, y1, y2 = y0 + dy, y1 + u * dy, y2 + u2 * dy
    return (a, b, c, d, e), (x0, x1, x2), (y0, y1, y2)


@compiled
def _curvature(fit):
    """(x' y'' - y' x'') / |r'|^(12/7): that of a circle, but for errors of the order of (window / radius)^4.

    On a circle of radius R the parabola within w each way has |r'| = 1 - w^2 / 10 R^2 and r'' = (1 - w^2 / 14 R^2) / R.
    """
    squared = fit[1, 0] * fit[1, 0] + fit[1, 1] * fit[1, 1]
    return (fit[1, 0] * fit[2, 1] - fit[1, 1] * fit[2, 0]) / squared ** (6 / 7)


# ---- what is in the way


@compiled
def first_return(trail, odometry, strip, front, laser, ranges, directions, skipped, free, first):
    """Fill in the distances from the front bumpers to the first return over the strip [m], (n,); inf: none.

    strip      : `trail.Strip`
    front      : of the own axle to the front bumper [m], (n,)
    laser      : ahead of the own axles (n,), and to the left [m]
    directions : of the beams, x and y as seen from the own axle, (2, k)
    skipped    : first and last of the beams left out, (n, 2)
    ranges     : [m]; inf: no return, -inf: nearer than the laser measures, NaN: lost, (n, k)
    first      : filled in with the beam of that return, (n,); -1: none
    """
    forward, left_of = laser
    for i in range(len(free)):
        free[i], first[i] = math.inf, -1
        points, size = trail.points[i], trail.size[i]
        x, y, reach, half_width = odometry.x[i], odometry.y[i], strip.reach[i], strip.half_width[i]
        if not some_nearer(ranges[i], reach):
            continue
        cos, sin = math.cos(odometry.heading[i]), math.sin(odometry.heading[i])
        begin, share = _nearest(points, size, x, y)
        here = _station(points, begin, share)
        swings = _swings_out(points, begin, size, front[i])
        left, right = _sides(points[begin:size], (x, y, cos, sin), here + reach, half_width + swings)
        for beam in range(ranges.shape[1]):
            r = ranges[i, beam]
            if not r < reach:  # NaN, lost, is not less either
                continue
            if r == -math.inf:  # another body is at the laser, or over it
                if directions[0, beam] > 0:
                    free[i], first[i] = 0.0, beam
                    break
                continue
            if skipped[i, 0] <= beam <= skipped[i, 1]:
                continue
            ahead, aside = forward[i] + r * directions[0, beam], left_of + r * directions[1, beam]
            if ahead <= 0 or aside > left or aside < right:
                continue
            there_x, there_y = x + ahead * cos - aside * sin, y + ahead * sin + aside * cos
            piece, share, away2 = _nearest_within(points, (begin, size), there_x, there_y, half_width + swings)
            distance = _station(points, piece, share) - here
            nearer = min(reach, front[i] + free[i])
            if swings > 0.0 and half_width**2 < away2 < (half_width + swings) ** 2:
                distance = _swept_at(points, (begin, size), (there_x, there_y), front[i], strip.body[i]) - here
            elif away2 >= half_width**2:
                continue
            if front[i] < distance < nearer:
                free[i], first[i] = distance - front[i], beam


@compiled
def _nearest_within(points, pieces, x, y, apart):
    """The piece nearest to a place, the share of it, and the squared distance: inf if none is within a distance.

    Beyond its end the trail goes straight on.

    pieces : the first one, and the number of points
    """
    begin, size = pieces
    piece, share, least = begin, 0.0, math.inf
    for k in range(begin, size - 1):
        dx, dy = x - points[k, 0], y - points[k, 1]
        within = apart + points[k + 1, 2] - points[k, 2] + 1e-6
        if k < size - 2 and dx * dx + dy * dy > within * within:  # most pieces are too far away
            continue
        step_x, step_y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        length2, most = step_x * step_x + step_y * step_y, 1.0 if k < size - 2 else math.inf
        part, away2, _ = beside(points, k, x, y, length2, 0.0, most, 1.0)
        if away2 < least:
            piece, share, least = k, part, away2
    return piece, share, least


@compiled
def _swings_out(points, begin, size, front):
    """How far the front swings out of a strip about the path of the axle, in the sharpest bend [m]; 0: hardly.

    On an arc of curvature k a point on the axis, `front` before the axle, is k front^2 / 2 outside the axle's path.
    """
    most = 0.0
    cos_before, sin_before = _chord(points, begin, size)
    for k in range(begin + CHORD, size - CHORD, CHORD):
        cos, sin = _chord(points, k, size)
        sine = abs(sin * cos_before - cos * sin_before)
        length = max(points[k, 2] - points[k - CHORD, 2], SPACING)
        # The turn is at most pi / 2 times its sine: on a straight no arc sine has to be computed.
        if sine * front * front > max(most, HARDLY_OUT) * length:
            most = max(most, math.asin(min(sine, 1.0)) / length * front * front / 2)
        cos_before, sin_before = cos, sin
    return min(most, FARTHEST_OUT) if most > HARDLY_OUT else 0.0


@compiled
def _swept_at(points, pieces, place, front, half_width):
    """Station of the front bumper, along the trail, when the front half of the body covers a place [m]; inf: never.

    pieces : the first one ahead, and the number of points
    """
    begin, size = pieces
    for k in range(begin + 1, size):
        cos, sin = _chord(points, k, size)
        dx, dy = place[0] - points[k, 0], place[1] - points[k, 1]
        along, aside = dx * cos + dy * sin, dy * cos - dx * sin
        if front / 2 < along < front and abs(aside) < half_width:
            return points[k, 2] + along
    return math.inf


@compiled
def _chord(points, k, size):
    """Direction of the trail about a point, as cosine and sine, over so many points that errors of places even out."""
    first, last = max(k - CHORD, 0), min(k + CHORD, size - 1)
    dx, dy = points[last, 0] - points[first, 0], points[last, 1] - points[first, 1]
    length = max(math.hypot(dx, dy), 1e-9)
    return dx / length, dy / length


@compiled
def _sides(points, axle, until, half_width):
    """Greatest offsets to the left and right of the own axle that a strip along points has.

    axle  : x, y, cosine and sine of the heading
    until : station at which the strip ends; beyond the last point it is straight
    """
    x, y, cos, sin = axle
    left, right, aside = half_width, -half_width, 0.0
    for k in range(len(points)):
        aside = (points[k, 1] - y) * cos - (points[k, 0] - x) * sin
        left, right = max(left, aside + half_width), min(right, aside - half_width)
    along_x, along_y = _direction(points, len(points))
    aside += max(until - points[len(points) - 1, 2], 0.0) * (along_y * cos - along_x * sin)
    return max(left, aside + half_width), min(right, aside - half_width)
