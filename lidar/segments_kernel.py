"""The loops of `lidar.segments`, compiled by numba.

Two habits are for speed: unsigned indices need no test for negative values, and rows of a table are taken by index, as
numba does not know that they are contiguous once they are unpacked.
"""

import math

import numpy as np

from .compiled import compiled

BLOCK = 64  # beams that are passed over at once if none has a return


@compiled
def find(ranges, spread, reach, jump, min_beams):
    """Groups of each row, sorted by first beam.

    spread, reach : of `lidar.segments`, (2, b): in the fan, across its seam; NaN joins nothing
    returns       : row, first, last, count, (g,) each; offset, (n + 1,)
    """
    n, k = ranges.shape
    groups = np.empty((4, n * (k // min_beams)), np.intp)
    offset = np.zeros(n + 1, np.intp)
    first, last, count = np.empty(k, np.intp), np.empty(k, np.intp), np.empty(k, np.intp)  # one row's, of any size
    g = 0
    for row in range(n):
        begin, m = 0, _split(ranges[row], spread[0], reach[0], jump, first, last, count)
        if m > 1:
            missing = first[0] + k - 1 - last[m - 1]
            before, after = np.float64(ranges[row, last[m - 1]]), np.float64(ranges[row, first[0]])
            if _joined(before, after, missing, spread[1], reach[1], jump):
                last[m - 1] = last[0]
                count[m - 1] += count[0]
                begin = 1
        for i in range(begin, m):
            if count[i] >= min_beams:
                groups[0, g], groups[1, g], groups[2, g], groups[3, g] = row, first[i], last[i], count[i]
                g += 1
        offset[row + 1] = g
    return groups[:, :g].copy(), offset


@compiled
def _split(ranges, spread, reach, jump, first, last, count):
    """Groups of a row as if it had no seam; their number."""
    m, size, previous, before = 0, 0, 0, math.nan
    for begin in range(0, len(ranges), BLOCK):
        stop = min(begin + BLOCK, len(ranges))
        if not _some_return(ranges, begin, stop):
            continue
        for beam in range(begin, stop):
            r = np.float64(ranges[beam])
            if not math.isfinite(r):
                continue
            if not _joined(before, r, beam - previous - 1, spread, reach, jump):
                if size:
                    last[m], count[m] = previous, size
                    m += 1
                first[m], size = beam, 0
            size += 1
            previous, before = beam, r
    if size:
        last[m], count[m] = previous, size
        m += 1
    return m


@compiled
def _some_return(ranges, begin, stop):
    """Whether a beam from `begin` to before `stop` has a return. Without branches, since most beams have none."""
    found = 0
    for beam in range(np.uint64(begin), np.uint64(stop)):
        found += abs(ranges[beam]) < np.inf
    return found > 0


@compiled
def _joined(a, b, missing, spread, reach, jump):
    if missing >= len(spread):
        return False
    limit = reach[missing] * min(a, b) + jump
    return (b - a) ** 2 + spread[missing] * a * b <= limit * limit


@compiled
def describe(ranges, directions, angles, groups, ends, nearest, line, corner):
    """Fill in the properties of each group; the tuples are fields of Segments, in the order there."""
    k = ranges.shape[1]
    sums, costs, beams = np.empty((5, k)), np.empty(k), np.empty(k, np.intp)
    for g in range(groups.shape[1]):
        row, first, last, n = groups[0, g], groups[1, g], groups[2, g], groups[3, g]
        _sum_up(g, ranges[row], directions, angles, first, last, sums, beams, ends, nearest)
        if n >= 2:
            _fit_line(g, n, sums, ends, line)
        if n >= 4:
            _fit_corner(g, n, sums, costs, beams, ends, corner)


@compiled
def _sum_up(g, ranges, directions, angles, first, last, sums, beams, ends, nearest):
    """Running sums of x, y, xx, xy, yy over the returns, relative to the first one: squares keep more digits so."""
    start, stop, width = ends
    nearest_range, nearest_bearing = nearest
    cos, sin = directions[0], directions[1]
    x0, y0 = ranges[first] * cos[first], ranges[first] * sin[first]
    x = y = sx = sy = sxx = sxy = syy = 0.0
    shortest, at = math.inf, first
    k, n = np.uint64(len(ranges)), np.uint64(0)
    if last < first:
        last += len(ranges)
    for turned in range(np.uint64(first), np.uint64(last + 1)):
        beam = turned if turned < k else turned - k
        r = np.float64(ranges[beam])
        if not math.isfinite(r):
            continue
        if r < shortest:
            shortest, at = r, np.intp(beam)
        x, y = r * cos[beam] - x0, r * sin[beam] - y0
        sx += x
        sy += y
        sxx += x * x
        sxy += x * y
        syy += y * y
        sums[0, n], sums[1, n], sums[2, n], sums[3, n], sums[4, n] = sx, sy, sxx, sxy, syy
        beams[n] = beam
        n += np.uint64(1)
    start[g, 0], start[g, 1] = x0, y0
    stop[g, 0], stop[g, 1] = x0 + x, y0 + y
    width[g] = math.sqrt(x * x + y * y)
    nearest_range[g] = shortest
    nearest_bearing[g] = _wrapped(angles[at])


@compiled
def _fit_line(g, n, sums, ends, line):
    start, stop, _ = ends
    heading, distance, rms = line
    x, y, xx, xy, yy = sums[:, n - 1]
    ux, uy, cost = _principal(xx - x * x / n, xy - x * y / n, yy - y * y / n)
    if ux * (stop[g, 0] - start[g, 0]) + uy * (stop[g, 1] - start[g, 1]) < 0.0:
        ux, uy = -ux, -uy
    heading[g] = _wrapped(math.atan2(uy, ux))
    distance[g] = abs(ux * (start[g, 1] + y / n) - uy * (start[g, 0] + x / n))
    rms[g] = math.sqrt(max(cost, 0.0) / n)


@compiled
def _fit_corner(g, n, sums, costs, beams, ends, corner):
    """The best of all splits; see find_segments for the formula. Split i leaves i + 2 returns on the first leg."""
    start, stop, _ = ends
    point, split, leg_heading, leg_lengths, rms, convex = corner
    splits = n - 3
    x, y, xx, xy, yy = sums[0], sums[1], sums[2], sums[3], sums[4]
    x, y, xx, xy, yy = x[1:], y[1:], xx[1:], xy[1:], yy[1:]
    of_all = x[splits + 1], y[splits + 1], xx[splits + 1], xy[splits + 1], yy[splits + 1]
    for i in range(splits):  # without a branch, so that several are computed at once
        mxx, mxy, myy = _matrix(i, n, x, y, xx, xy, yy, of_all)
        costs[i] = 0.5 * (mxx + myy) - math.sqrt(0.25 * (mxx - myy) ** 2 + mxy * mxy)
    best = 0
    for i in range(1, splits):
        if costs[i] < costs[best]:
            best = i
    ux, uy, cost = _principal(*_matrix(best, n, x, y, xx, xy, yy, of_all))
    # The lines cross at the mean of the first leg, moved along it until level with the mean of the second.
    a, b = best + 2.0, n - best - 2.0
    ax, ay = x[best] / a, y[best] / a
    along = ux * ((of_all[0] - x[best]) / b - ax) + uy * ((of_all[1] - y[best]) / b - ay)
    cx, cy = ax + along * ux, ay + along * uy
    length = ux * cx + uy * cy  # from the first return, which is the origin here
    if length < 0.0:
        ux, uy, length = -ux, -uy, -length
    point[g, 0], point[g, 1] = start[g, 0] + cx, start[g, 1] + cy
    right = uy * (stop[g, 0] - point[g, 0]) - ux * (stop[g, 1] - point[g, 1])  # from the first leg to the last return
    split[g] = beams[best + 2]
    leg_heading[g] = _wrapped(math.atan2(uy, ux))
    leg_lengths[g, 0], leg_lengths[g, 1] = length, abs(right)
    rms[g] = math.sqrt(max(cost, 0.0) / n)
    convex[g] = right > 0.0


@compiled
def _matrix(i, n, x, y, xx, xy, yy, of_all):
    """S1 + J'S2 J of split i, from the running sums: xx, xy, yy."""
    all_x, all_y, all_xx, all_xy, all_yy = of_all
    p, q = 1.0 / (i + 2.0), 1.0 / (n - 2.0 - i)
    ax, ay = x[i], y[i]
    bx, by = all_x - ax, all_y - ay
    return (
        xx[i] - p * ax * ax + (all_yy - yy[i] - q * by * by),
        xy[i] - p * ax * ay - (all_xy - xy[i] - q * bx * by),
        yy[i] - p * ay * ay + (all_xx - xx[i] - q * bx * bx),
    )


@compiled
def _principal(xx, xy, yy):
    """Direction in which a scatter matrix is widest, and its smaller eigenvalue. No direction, NaN, if it has none."""
    half = 0.5 * (xx - yy)
    root = math.sqrt(half * half + xy * xy)
    ux, uy = (half + root, xy) if half >= 0.0 else (xy, root - half)  # of two equal forms, the one that cancels nothing
    length = math.sqrt(ux * ux + uy * uy)
    return ux / length, uy / length, 0.5 * (xx + yy) - root


@compiled
def _wrapped(angle):
    """In (−π, π], from within a turn of it."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    return angle + 2.0 * math.pi if angle <= -math.pi else angle
