"""The remembered path of `trail`, one vehicle after the other, compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

SPACING = 0.5  # of points, or more [m]
ROUNDING = 4  # of a route's corners: a mean over so many places each way
BEHIND = 15.0  # so much of the trail is kept behind the own axle [m]


@compiled
def _remainder(angle, turn):
    return angle - turn * round(angle / turn)


@compiled
def lengthen(points, size, axle, seen, anew, x, y, heading):
    for i in range(len(size)):
        if not seen[i]:
            continue
        if size[i] == points.shape[1]:
            _forget(points[i], size, i, x[i], y[i])
        last_x, last_y, _ = points[i, size[i] - 1]
        cos, sin = _direction(points[i], size[i])
        ahead = (x[i] - last_x) * cos + (y[i] - last_y) * sin
        if anew[i] and ahead > 0:  # it has driven beyond its end: what was remembered leads nowhere
            cos, sin = math.cos(heading[i]), math.sin(heading[i])
            points[i, 0] = x[i] - cos, y[i] - sin, -1.0
            points[i, 1] = x[i], y[i], 0.0
            size[i] = 2
            last_x, last_y = x[i], y[i]
        dx, dy = axle[i, 0] - last_x, axle[i, 1] - last_y
        along, aside = dx * cos + dy * sin, dy * cos - dx * sin
        far = math.hypot(along, aside)
        if far < SPACING or along <= 0:
            continue
        if anew[i] and far > 2 * SPACING:  # the arc that goes on in the last direction
            half = math.atan2(aside, along)  # the chord's direction; the arc turns twice as far
            arc = far if abs(half) < 1e-6 else far * half / math.sin(half)
            count = min(int(arc / SPACING), points.shape[1] // 2)
            while size[i] + count >= points.shape[1]:
                _forget(points[i], size, i, x[i], y[i])
            for k in range(1, count):
                turned = half * k / count  # of the chord to this point
                chord = far * k / count if abs(half) < 1e-6 else far * math.sin(turned) / math.sin(half)
                to_x, to_y = chord * math.cos(turned), chord * math.sin(turned)
                _append(points[i], size, i, last_x + to_x * cos - to_y * sin, last_y + to_x * sin + to_y * cos)
        _append(points[i], size, i, axle[i, 0], axle[i, 1])


@compiled
def lay(points, size, rows, x, y, heading, ways, distance, until, half):
    for i in range(len(size)):
        if not rows[i]:
            continue
        cos, sin = math.cos(heading[i]), math.sin(heading[i])
        size[i] = 0
        for k in range(min(distance.shape[1], points.shape[1] // 2)):
            ahead = aside = 0.0
            for j in range(-ROUNDING, ROUNDING + 1):
                along, across = _on(ways[i], distance[i], distance[i, k] + j * half[i] / ROUNDING)
                ahead += along / (2 * ROUNDING + 1)
                aside += across / (2 * ROUNDING + 1)
            to_x, to_y = x[i] + ahead * cos - aside * sin, y[i] + ahead * sin + aside * cos
            if k == 0:
                points[i, 0] = to_x, to_y, 0.0
                size[i] = 1
            elif math.hypot(to_x - points[i, size[i] - 1, 0], to_y - points[i, size[i] - 1, 1]) > 1e-3:
                _append(points[i], size, i, to_x, to_y)
            if size[i] > 1 and distance[i, k] > until[i]:
                break


@compiled
def _on(way, distance, there):
    """The place on a way; before its first point and beyond its last it goes straight on."""
    k = min(max(np.searchsorted(distance, there) - 1, 0), len(distance) - 2)
    share = (there - distance[k]) / (distance[k + 1] - distance[k])
    along = way[k, 0] + share * (way[k + 1, 0] - way[k, 0])
    return along, way[k, 1] + share * (way[k + 1, 1] - way[k, 1])


@compiled
def _append(points, size, i, x, y):
    last = points[size[i] - 1]
    points[size[i]] = x, y, last[2] + math.hypot(x - last[0], y - last[1])
    size[i] += 1


@compiled
def _forget(points, size, i, x, y):
    """What lies far behind; or, if nothing does, the oldest quarter."""
    nearest, _ = _nearest(points, size[i], x, y)
    gone = np.searchsorted(points[: size[i], 2], points[nearest, 2] - BEHIND)
    gone = gone if gone > 0 else len(points) // 4
    for k in range(size[i] - gone):
        points[k] = points[k + gone]
    size[i] -= gone


@compiled
def _direction(points, size):
    dx, dy = points[size - 1, 0] - points[size - 2, 0], points[size - 1, 1] - points[size - 2, 1]
    away = math.hypot(dx, dy)
    return dx / away, dy / away


@compiled
def _nearest(points, size, x, y):
    """The piece of the trail, by its first point, and the share of it, that is nearest to a point."""
    nearest, least = 0, math.inf
    for k in range(size):
        away = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
        if away < least:
            nearest, least = k, away
    best, least, share = 0, math.inf, 0.0
    for k in range(max(nearest - 1, 0), min(nearest + 1, size - 1)):
        part = _beside(points, k, x, y)
        part = min(max(part, 0.0), 1.0)
        away = math.hypot(
            x - points[k, 0] - part * (points[k + 1, 0] - points[k, 0]),
            y - points[k, 1] - part * (points[k + 1, 1] - points[k, 1]),
        )
        if away < least:
            best, least, share = k, away, part
    return best, share


@compiled
def look_ahead(points, size, axle, x, y, heading, window, preview, offset, off_heading, curvature, way, distance, bend):
    fit = np.empty((3, 2))
    for i in range(len(size)):
        last = size[i]
        k, share = _nearest(points[i], last, x[i], y[i])
        here = points[i, k, 2] + share * (points[i, k + 1, 2] - points[i, k, 2])
        if k == last - 2 and share == 1.0:  # beyond its end
            cos, sin = _direction(points[i], last)
            here += (x[i] - points[i, last - 1, 0]) * cos + (y[i] - points[i, last - 1, 1]) * sin
        end = points[i, last - 1, 2] - here
        way[i] = end
        if not math.isnan(axle[i, 0]):  # in the last direction
            cos, sin = _direction(points[i], last)
            way[i] += (axle[i, 0] - points[i, last - 1, 0]) * cos + (axle[i, 1] - points[i, last - 1, 1]) * sin

        _fit(points[i], last, here, window[i], fit)
        bend[i, 0] = _curvature(fit)
        along = math.atan2(fit[1, 1], fit[1, 0])
        cos, sin = math.cos(along), math.sin(along)
        offset[i] = (y[i] - fit[0, 1]) * cos - (x[i] - fit[0, 0]) * sin
        off_heading[i] = _remainder(heading[i] - along, 2 * math.pi)

        there = here + preview[i]
        _fit(points[i], last, there, window[i], fit)
        curvature[i] = _curvature(fit)
        distance[i, 0] = 0.0
        for j in range(1, bend.shape[1]):
            distance[i, j] = max(end, 0.0) * j / (bend.shape[1] - 1)
            _fit(points[i], last, here + distance[i, j], window[i], fit)
            bend[i, j] = _curvature(fit)


@compiled
def _fit(points, size, here, window, fit):
    """The parabola of least squares through the points within a window of a station; beyond the end a straight line.

    fit : place there, and its first and second derivative by station, (3, 2), filled in
    """
    station = points[:size, 2]
    end = station[size - 1]
    # Near the end that of the last points; a tangent from one side is too uncertain.
    middle = min(here, max(end - window, end / 2))
    first, stop = np.searchsorted(station, middle - window), np.searchsorted(station, middle + window)
    while stop - first < 4 and (first > 0 or stop < size):
        first, stop = max(first - 1, 0), min(stop + 1, size)
    if stop - first < 3:
        cos, sin = _direction(points, size)
        fit[0] = points[size - 1, 0] + (here - end) * cos, points[size - 1, 1] + (here - end) * sin
        fit[1] = cos, sin
        fit[2] = 0.0, 0.0
        return
    a = b = c = d = e = 0.0  # sums of the powers of u, from 0 to 4
    x0 = x1 = x2 = y0 = y1 = y2 = 0.0  # and of x and y times those
    for k in range(first, stop):
        u = (station[k] - middle) / window
        dx, dy = points[k, 0] - points[first, 0], points[k, 1] - points[first, 1]
        u2 = u * u
        a, b, c, d, e = a + 1.0, b + u, c + u2, d + u2 * u, e + u2 * u2
        x0, x1, x2 = x0 + dx, x1 + u * dx, x2 + u2 * dx
        y0, y1, y2 = y0 + dy, y1 + u * dy, y2 + u2 * dy
    # Inverse of the symmetric [[a, b, c], [b, c, d], [c, d, e]] by cofactors.
    i00, i01, i02 = c * e - d * d, c * d - b * e, b * d - c * c
    i11, i12, i22 = a * e - c * c, b * c - a * d, a * c - b * b
    scale = 1 / (a * i00 + b * i01 + c * i02)
    on, beyond = min(here, end) - middle, max(here - end, 0.0)
    for axis in range(2):
        r0, r1, r2 = (x0, x1, x2) if axis == 0 else (y0, y1, y2)
        place = scale * (i00 * r0 + i01 * r1 + i02 * r2) + points[first, axis]
        slope = scale * (i01 * r0 + i11 * r1 + i12 * r2) / window
        bent = 2 * scale * (i02 * r0 + i12 * r1 + i22 * r2) / (window * window)
        fit[0, axis] = place + slope * on + bent * on * on / 2 + (slope + bent * on) * beyond
        fit[1, axis] = slope + bent * on
        fit[2, axis] = bent if beyond == 0 else 0.0


@compiled
def _curvature(fit):
    speed = math.hypot(fit[1, 0], fit[1, 1])
    return (fit[1, 0] * fit[2, 1] - fit[1, 1] * fit[2, 0]) / (speed * speed * speed)


@compiled
def free_way(points, size, x, y, heading, reach, half_width, front, laser, ranges, skipped, directions, free):
    for i in range(len(size)):
        free[i] = math.inf
        cos, sin = math.cos(heading[i]), math.sin(heading[i])
        last = size[i]
        begin, share = _nearest(points[i], last, x[i], y[i])
        here = points[i, begin, 2] + share * (points[i, begin + 1, 2] - points[i, begin, 2])
        # The box about the strip, as seen from the own axle.
        left, right, aside = half_width[i], -half_width[i], 0.0
        for k in range(begin, last):
            aside = (points[i, k, 1] - y[i]) * cos - (points[i, k, 0] - x[i]) * sin
            left, right = max(left, aside + half_width[i]), min(right, aside - half_width[i])
        along_x, along_y = _direction(points[i], last)
        aside += max(here + reach[i] - points[i, last - 1, 2], 0.0) * (along_y * cos - along_x * sin)
        left, right = max(left, aside + half_width[i]), min(right, aside - half_width[i])
        for beam in range(ranges.shape[1]):
            r = max(ranges[i, beam], 0.0)
            if skipped[i, 0] <= beam <= skipped[i, 1] or not r < reach[i]:  # nothing, nothing known, or far away
                continue
            ahead, aside = laser[i, 0] + r * directions[0, beam], laser[i, 1] + r * directions[1, beam]
            if ahead <= 0 or aside > left or aside < right:
                continue
            px, py = x[i] + ahead * cos - aside * sin, y[i] + ahead * sin + aside * cos
            least, there = math.inf, 0.0
            for k in range(begin, last - 1):
                part = _beside(points[i], k, px, py)
                part = max(part, 0.0) if k == last - 2 else min(max(part, 0.0), 1.0)
                away = (px - points[i, k, 0] - part * (points[i, k + 1, 0] - points[i, k, 0])) ** 2
                away += (py - points[i, k, 1] - part * (points[i, k + 1, 1] - points[i, k, 1])) ** 2
                if away < least:
                    least = away
                    there = points[i, k, 2] + part * (points[i, k + 1, 2] - points[i, k, 2]) - here
            if least < half_width[i] ** 2 and front[i] < there < reach[i]:
                free[i] = min(free[i], there - front[i])


@compiled
def _beside(points, k, x, y):
    """Which share of a piece of the trail, straight on before and behind it, lies beside a point."""
    dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
    return ((x - points[k, 0]) * dx + (y - points[k, 1]) * dy) / (dx * dx + dy * dy)
