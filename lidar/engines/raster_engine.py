"""The fast engine: surfaces near a sensor are drawn into a buffer of inverse ranges, one value a beam.

Along a straight segment the inverse range is linear in the beam's direction d: a point r·d lies on the line n·p = 1
just when 1/r = n·d. A segment thus costs two angles, and one multiply-add for each beam that it covers; the buffer
keeps the largest inverse range, and one division a beam ends the scan. A grid gives the surfaces near a sensor: walls
are sorted into its cells once for a scene, boxes at every call. A box shows at most two faces; their distances and
directions follow from its pose. A row depends neither on the rest of the batch nor on the order of the obstacles.

For each sensor: gather the faces that may be in view, place them among the beams, draw them, and turn the buffer into
what the scanner reports. Loops over arrays have no branches, so that the processor computes several values at a time.
"""

import math

import numpy as np

from ..compiled import compiled
from ..laserscan import NO_HIT
from ..noise import DROPOUT, GAUSS, GOLDEN, PURPOSES, ROUNDING, gauss, mixed, uniform
from ..scene import STATIC
from .protocol import NOBODY, TOUCHING

CELL = 60.0  # side of a cell; walls are cut to it, so that none reaches far beyond its cell. 30 and 120 are slower [m]
MOST_CELLS = 16  # of a grid, for each wall or box; pieces of a wall, on average. Beyond, cells and pieces are larger
TURN = 2 * math.pi
FINE = 4e4  # beams a radian from which approximate angles are not good to half a beam

_mixed, _gauss, _uniform = compiled(mixed), compiled(gauss), compiled(uniform)


def measure(model, beams, scene, boxes, sensors, ranges, hits):
    """See `protocol`."""
    x, y, yaw, owner, *draws = sensors
    around = np.empty(x.size, np.int32)
    around[:] = NOBODY
    if scene.has_solids:
        around[scene.enclosed(x, y)] = STATIC
    if "walls" not in scene.kept:
        scene.kept["walls"] = _wall_grid(scene.segments)
    if "solid" not in boxes.kept:  # several models scan the same world
        boxes.kept["solid"] = _solid(boxes.x, boxes.y, boxes.heading, boxes.length, boxes.width, boxes.owner)
    fans = "fans", beams.start
    if fans not in model.kept:
        model.kept[fans] = _fans(model, beams)
    _scan(x, y, yaw, owner, around, *model.kept[fans], *draws, scene.kept["walls"], boxes.kept["solid"],
          ranges, hits)  # fmt: skip
    return around


def _fans(model, beams):
    """Of these beams: first angle and increment, (rays, 2), directions, (rays, 2, k), limits, errors, first number."""
    fans, noise = [fan.part(beams) for fan in model.fans], model.noise
    errors = (
        not noise.none,
        noise.sigma,
        noise.sigma_per_metre,
        noise.resolution,
        noise.dropout,
        noise.dropout_at_range_max,
        noise.dropout_grazing,
        math.cos(noise.grazing_from) ** 2,
        noise.lost,
        model.angle_increment,
    )
    limits = model.range_min, model.range_max, model.reach, model.merging
    angles = np.array([[fan.angles[0], fan.increment] for fan in fans])
    return angles, np.array([fan.directions for fan in fans]), limits, errors, np.uint64(beams.start)


def _wall_grid(segments):
    """Walls, cut into pieces no longer than a cell: place of the grid, first piece of each cell, pieces, (4, m)."""
    vector = segments[:, 2:] - segments[:, :2]
    length = np.hypot(*vector.T)
    longest = max(CELL, length.sum() / (MOST_CELLS * len(segments) + 1000))  # few walls of many kilometres
    pieces = np.maximum(np.ceil(length / longest), 1).astype(np.intp)
    wall = np.repeat(np.arange(len(segments)), pieces)
    number = np.arange(len(wall)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    last = number + 1 == pieces[wall]
    start = segments[wall, :2] + (number / pieces[wall])[:, None] * vector[wall]
    stop = segments[wall, :2] + ((number + 1) / pieces[wall])[:, None] * vector[wall]
    stop[last] = segments[wall[last], 2:]
    middle = (start + stop) / 2
    extent = (middle.min(axis=0), middle.max(axis=0)) if len(middle) else (np.zeros(2), np.zeros(2))
    cell = _cell(*(extent[1] - extent[0]), len(wall))
    reach = float(np.hypot(*(stop - start).T).max(initial=0.0)) / 2
    columns, rows = (int(n) + 1 for n in (extent[1] - extent[0]) // cell)
    place = (extent[0][0], extent[0][1], cell, columns, rows, reach)
    column, row = ((middle - extent[0]) // cell).astype(np.intp).T
    index = row * columns + column
    order = np.argsort(index, kind="stable")
    first = np.searchsorted(index[order], np.arange(columns * rows + 1))
    return place, first, np.ascontiguousarray(np.hstack([start, stop])[order].T)


@compiled
def _cell(width, height, n):
    """Size of the cells for n things in a rectangle: larger where they are sparse."""
    cell = CELL
    while (width // cell + 1) * (height // cell + 1) > MOST_CELLS * n + 1000:
        cell *= 2
    return cell


@compiled
def _box_grid(box_x, box_y, x, y, reach, radius):
    """Boxes in a grid around the sensors at x, y: its place, first box of each cell, middles and rows."""
    far = reach + radius
    west, east, south, north = (x[0], x[0], y[0], y[0]) if len(x) else (0.0, 0.0, 0.0, 0.0)
    for i in range(1, len(x)):
        west, east, south, north = min(west, x[i]), max(east, x[i]), min(south, y[i]), max(north, y[i])
    cell = _cell(east - west + 2 * far, north - south + 2 * far, len(box_x))
    columns, rows = int((east - west + 2 * far) // cell) + 1, int((north - south + 2 * far) // cell) + 1
    place = (west - far, south - far, cell, columns, rows, radius)
    first, middles, order = _sorted(place, box_x, box_y)
    return place, first, middles, order


@compiled
def _solid(x, y, heading, length, width, owner):
    """Middles x and y, rows cos, sin, half length, half width, (v, 4), largest distance of a corner from its middle,
    owners. Copies, for numba compiles `_scan` once more for arrays that are read-only, as those of boxes may be."""
    own_x, own_y, shapes, own_owner = np.empty(len(x)), np.empty(len(x)), np.empty((len(x), 4)), np.empty_like(owner)
    squared = 0.0
    for i in range(len(x)):
        half_length, half_width = length[i] / 2, width[i] / 2
        own_x[i], own_y[i], own_owner[i] = x[i], y[i], owner[i]
        shapes[i, 0], shapes[i, 1] = math.cos(heading[i]), math.sin(heading[i])
        shapes[i, 2], shapes[i, 3] = half_length, half_width
        squared = max(squared, half_length * half_length + half_width * half_width)
    return own_x, own_y, shapes, math.sqrt(squared), own_owner


@compiled
def _sorted(place, x, y):
    """First box of each cell, and middles and rows of boxes by cell; those outside the grid come last, in no cell."""
    west, south, cell, columns, rows, _ = place
    per_metre = 1.0 / cell
    index = np.empty(len(x), np.intp)
    for i in range(len(x)):
        column, row = math.floor((x[i] - west) * per_metre), math.floor((y[i] - south) * per_metre)
        inside = (column >= 0.0) & (column < columns) & (row >= 0.0) & (row < rows)
        index[i] = np.intp(row * columns + column if inside else columns * rows)
    first = np.zeros(columns * rows + 2, np.intp)  # boxes in each cell, then the beginning of the next cell
    for i in range(len(x)):
        first[index[i]] += 1
    for i in range(1, columns * rows + 2):
        first[i] += first[i - 1]
    middles, order = np.empty((len(x), 2)), np.empty(len(x), np.int32)
    for i in range(len(x) - 1, -1, -1):
        first[index[i]] -= 1
        k = first[index[i]]
        middles[k, 0], middles[k, 1], order[k] = x[i], y[i], i
    return first, middles, order


@compiled
def _scan(x, y, yaw, owner, around, angles, directions, limits, errors, begin, keys, scan, bias, walls, solid, ranges,
          hits):  # fmt: skip
    """Fill a row of ranges and hits for each pose, from the column `begin` on, and the owner around it.

    solid: of the boxes, see `_solid`
    """
    range_min, range_max, reach, merging = limits
    box_x, box_y, shapes, radius, owners_of_boxes = solid
    rays, beams = directions.shape[0], directions.shape[2]
    inverse, met = np.zeros((rays, beams)), np.full((rays, beams), NOBODY, np.int64)
    exact, errant = np.empty(beams), np.empty(beams)
    squared, spare = np.empty(beams), np.empty(beams)
    box_faces = 2 * len(box_x)  # in sight, at most
    room = _room(256 + box_faces)
    place, first, middles, order = _box_grid(box_x, box_y, x, y, reach, radius)
    boxes = place, first, middles, order, shapes, owners_of_boxes
    for i in range(len(x)):
        pose = x[i], y[i], math.cos(yaw[i]), math.sin(yaw[i])
        low, high = np.uint64(beams), np.uint64(0)  # all beams that meet a face are from the one to before the other
        for ray in range(rays):
            fan = _fan(angles[ray], directions[ray], reach)
            wall_cells, box_cells = _cells(pose, fan, walls[0]), _cells(pose, fan, boxes[0])
            most = _count(wall_cells, walls[0], walls[1]) + box_faces
            if most > len(room[2]):
                room = _room(2 * most)
            near, faces, owners = room
            n, touched = _gather_walls(pose, fan, walls, wall_cells, near, faces, owners)
            n, enclosed = _gather_boxes(pose, owner[i], fan, boxes, box_cells, n, faces, owners)
            around[i] = min(around[i], touched, enclosed)
            _place(fan, n, faces)
            drawn = _draw(directions[ray], TURN * fan[1], n, faces, owners, inverse[ray], met[ray])
            low, high = min(low, drawn[0]), max(high, drawn[1])
        if around[i] != NOBODY:
            ranges[i, begin : begin + beams] = -np.inf
            hits[i, begin : begin + beams] = around[i]
        else:
            around[i] = NO_HIT
            ranges[i, begin : begin + beams] = np.inf
            hits[i, begin : begin + beams] = NO_HIT
        if low >= high:
            continue
        if around[i] == NO_HIT:
            if rays > 1:
                _merge(inverse, met, merging, range_max * (1 + ROUNDING), exact, spare, errant)
            _limit(low, high, inverse[0], range_min, range_max, exact)
            for beam in range(low, high):
                hits[i, begin + beam] = NO_HIT if exact[beam] == np.inf else met[0, beam]
            if errors[0]:
                key = _mixed(keys[i] + scan)
                _perturb(low, high, errors, limits, begin, exact, met[0], key, bias[i], squared, spare, errant)
            measured = errant if errors[0] else exact
            for beam in range(low, high):
                ranges[i, begin + beam] = measured[beam]
        for ray in range(rays):
            for beam in range(low, high):
                inverse[ray, beam], met[ray, beam] = 0.0, NOBODY


@compiled
def _room(size):
    """Memory for `size` faces: near, faces and owners."""
    return np.empty((5, size)), np.empty((8, size)), np.empty(size, np.int64)


@compiled
def _limit(low, high, inverse, range_min, range_max, exact):
    """Ranges from inverse ranges of the beams from `low` to before `high`, ±inf beyond the limits."""
    for beam in range(low, high):
        r = 1.0 / inverse[beam]
        value = min(max(r, range_min), range_max)
        value = -np.inf if r < range_min * (1 - ROUNDING) else value
        exact[beam] = np.inf if r > range_max * (1 + ROUNDING) else value


@compiled
def _fan(angles, directions, reach):
    """A fan as drawing needs it: first angle, beams a radian, reach, whether it is convex, its borders."""
    angle_min, increment = angles
    last = directions.shape[1] - 1
    convex = last * increment <= math.pi
    angle_min -= TURN * math.floor((angle_min + math.pi) / TURN)  # into [-pi, pi), as the angles of ends
    return (angle_min, 1.0 / increment, reach, convex,
            directions[0, 0], directions[1, 0], directions[0, last], directions[1, last])  # fmt: skip


@compiled
def _in_view(x, y, fan):
    """Whether a direction in the sensor frame is within the fan or on its border."""
    _, _, _, convex, x0, y0, x1, y1 = fan
    after, before = x0 * y - y0 * x >= 0.0, x1 * y - y1 * x <= 0.0
    return after and before if convex else after or before


@compiled
def _cells(pose, fan, place):
    """First and last column and row of the cells that contain the middle of anything that may be in view."""
    x, y, cos, sin = pose
    west, south, cell, columns, rows, radius = place
    _, _, reach, _, x0, y0, x1, y1 = fan
    # The sector's bounding box: the sensor, both ends of its arc, and where the arc passes an axis.
    ax, ay, bx, by = cos * x0 - sin * y0, sin * x0 + cos * y0, cos * x1 - sin * y1, sin * x1 + cos * y1
    left, right, bottom, top = min(ax, bx, 0.0), max(ax, bx, 0.0), min(ay, by, 0.0), max(ay, by, 0.0)
    if _in_view(-cos, sin, fan):
        left = -1.0
    if _in_view(cos, -sin, fan):
        right = 1.0
    if _in_view(-sin, -cos, fan):
        bottom = -1.0
    if _in_view(sin, cos, fan):
        top = 1.0
    far = radius + 1e-6 * reach  # rounding must not exclude a surface just at the border
    return (
        np.intp(max(math.floor((x + reach * left - far - west) / cell), 0)),
        np.intp(min(math.floor((x + reach * right + far - west) / cell), columns - 1)),
        np.intp(max(math.floor((y + reach * bottom - far - south) / cell), 0)),
        np.intp(min(math.floor((y + reach * top + far - south) / cell), rows - 1)),
    )


@compiled
def _count(cells, place, first):
    """Number of walls in these cells."""
    left, right, bottom, top = cells
    columns = place[3]
    count = 0
    if left <= right:
        for row in range(bottom, top + 1):
            count += first[row * columns + right + 1] - first[row * columns + left]
    return count


@compiled
def _gather_walls(pose, fan, walls, cells, near, faces, owners):
    """Walls that may be in view, into `faces`: their number, and STATIC if the sensor is on one, else NOBODY."""
    place, first, segments = walls
    x, y = pose[0], pose[1]
    left, right, bottom, top = cells
    columns = place[3]
    n, touched = 0, np.int64(NOBODY)
    if left > right:
        return n, touched
    for row in range(bottom, top + 1):
        start, stop = first[row * columns + left], first[row * columns + right + 1]
        xs0, ys0, xs1, ys1 = (segments[0, start:stop], segments[1, start:stop],
                              segments[2, start:stop], segments[3, start:stop])  # fmt: skip
        near_ax, near_ay, near_bx, near_by, keep = near[0], near[1], near[2], near[3], near[4]
        if _turn_walls(pose, fan, xs0, ys0, xs1, ys1, near_ax, near_ay, near_bx, near_by, keep):
            for k in range(stop - start):
                if _touches(xs0[k] - x, ys0[k] - y, xs1[k] - x, ys1[k] - y):
                    touched = np.int64(STATIC)
        for k in range(stop - start):
            faces[0, n], faces[1, n], faces[2, n], faces[3, n] = near_ax[k], near_ay[k], near_bx[k], near_by[k]
            owners[n] = STATIC
            n += np.intp(keep[k])
    for k in range(n):
        ax, ay, bx, by = faces[0, k], faces[1, k], faces[2, k], faces[3, k]
        ex, ey = bx - ax, by - ay
        scale = 1.0 / (ax * ey - ay * ex)
        faces[4, k], faces[5, k] = ey * scale, -ex * scale
    return n, touched


@compiled
def _turn_walls(pose, fan, xs0, ys0, xs1, ys1, near_ax, near_ay, near_bx, near_by, keep):
    """Ends of walls in the sensor frame, counter-clockwise as seen from it; keep is 1 where a wall may be in view.

    returns: whether the sensor is on the line of any wall
    """
    x, y, cos, sin = pose
    _, _, reach, convex, x0, y0, x1, y1 = fan
    on_line = False
    for k in range(len(xs0)):  # vectorised: no branches
        e0, n0, e1, n1 = xs0[k] - x, ys0[k] - y, xs1[k] - x, ys1[k] - y
        ax, ay = cos * e0 + sin * n0, cos * n0 - sin * e0
        bx, by = cos * e1 + sin * n1, cos * n1 - sin * e1
        ex, ey = bx - ax, by - ay
        # Twice the area of the triangle sensor, a, b: its sign tells the turn, its size the distance of the line.
        area, square, far = ax * ey - ay * ex, ex * ex + ey * ey, reach * reach
        out = area * area > far * square
        # The nearest point of the line is not between the ends, and the nearer end is beyond reach.
        out |= (ax * ex + ay * ey > 0.0) & (ax * ax + ay * ay > far)
        out |= (bx * ex + by * ey < 0.0) & (bx * bx + by * by > far)
        before = (x0 * ay - y0 * ax < 0.0) & (x0 * by - y0 * bx < 0.0)
        behind = (x1 * ay - y1 * ax > 0.0) & (x1 * by - y1 * bx > 0.0)
        out |= (before | behind) if convex else (before & behind)
        edge_on = area * area <= TOUCHING * TOUCHING * square
        on_line |= edge_on
        turn = area > 0.0
        near_ax[k], near_ay[k] = ax if turn else bx, ay if turn else by
        near_bx[k], near_by[k] = bx if turn else ax, by if turn else ay
        keep[k] = 0.0 if out | edge_on else 1.0
    return on_line


@compiled
def _touches(ax, ay, bx, by):
    """Whether the sensor is on the segment a-b."""
    ex, ey = bx - ax, by - ay
    along = min(max(-(ax * ex + ay * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    dx, dy = ax + along * ex, ay + along * ey
    return dx * dx + dy * dy <= TOUCHING * TOUCHING


@compiled
def _gather_boxes(pose, own, fan, grid, cells, n, faces, owners):
    """Append faces of boxes that may be in view: how many there are now, and the smallest owner around the sensor."""
    place, first, middles, order, boxes, box_owner = grid
    x, y, cos, sin = pose
    _, _, reach, convex, x0, y0, x1, y1 = fan
    left, right, bottom, top = cells
    columns, radius = place[3], place[5]  # the largest of all boxes
    far = reach + radius
    enclosed = np.int64(NOBODY)
    if left > right:
        return n, enclosed
    for row in range(bottom, top + 1):
        for k in range(first[row * columns + left], first[row * columns + right + 1]):
            east, north = middles[k, 0] - x, middles[k, 1] - y
            if east * east + north * north > far * far:
                continue
            mx, my = cos * east + sin * north, cos * north - sin * east
            if convex and (x0 * my - y0 * mx < -radius or x1 * my - y1 * mx > radius):
                continue
            i = order[k]
            if box_owner[i] == own:
                continue
            # Direction of the box in the sensor frame, and of the sensor from its middle in the frame of the box.
            hx, hy = cos * boxes[i, 0] + sin * boxes[i, 1], cos * boxes[i, 1] - sin * boxes[i, 0]
            along, across = -(hx * mx + hy * my), hy * mx - hx * my
            half, side = boxes[i, 2], boxes[i, 3]
            if abs(along) - half <= TOUCHING and abs(across) - side <= TOUCHING:
                enclosed = min(enclosed, np.int64(box_owner[i]))
                continue
            n = _add_faces(mx, my, hx, hy, half, side, along, across, box_owner[i], n, faces, owners)
    return n, enclosed


@compiled
def _add_faces(mx, my, hx, hy, half, side, along, across, owner, n, faces, owners):
    """Append the faces of a box that are in sight, from left to right as seen from the box: how many there are now.

    mx, my, hx, hy : middle and direction of the box in the sensor frame
    along, across  : the sensor in the frame of the box

    The corner that two faces share is summed in the same order in both: middle, along, across. Were the two results a
    unit in the last place apart, a beam could pass between the faces.
    """
    ahead, aside = abs(along) - half, abs(across) - side
    if ahead > TOUCHING:  # the front or the rear
        s = 1.0 if along > 0.0 else -1.0
        fx, fy, wx, wy = mx + s * half * hx, my + s * half * hy, -s * side * hy, s * side * hx
        faces[0, n], faces[1, n], faces[2, n], faces[3, n] = fx + wx, fy + wy, fx - wx, fy - wy
        faces[4, n], faces[5, n] = -s * hx / ahead, -s * hy / ahead
        owners[n] = owner
        n += 1
    if aside > TOUCHING:  # the left or the right side
        s = 1.0 if across > 0.0 else -1.0
        lx, ly, wx, wy = s * half * hx, s * half * hy, -s * side * hy, s * side * hx
        faces[0, n], faces[1, n] = (mx - lx) + wx, (my - ly) + wy
        faces[2, n], faces[3, n] = (mx + lx) + wx, (my + ly) + wy
        faces[4, n], faces[5, n] = s * hy / aside, -s * hx / aside
        owners[n] = owner
        n += 1
    return n


@compiled
def _place(fan, n, faces):
    """Beginning and end of each face, in beams from the first, to about half a beam: rows 6 and 7."""
    angle_min, per_radian = fan[0], fan[1]
    if per_radian < FINE:
        for k in range(n):
            faces[6, k] = _angle(faces[0, k], faces[1, k])
            faces[7, k] = _angle(faces[2, k], faces[3, k])
    else:
        for k in range(n):
            faces[6, k] = math.atan2(faces[1, k], faces[0, k])
            faces[7, k] = math.atan2(faces[3, k], faces[2, k])
    for k in range(n):
        start, span = faces[6, k] - angle_min, faces[7, k] - faces[6, k]
        span = span + TURN if span < -math.pi else max(span, 0.0)
        start = start + TURN if start < 0.0 else start
        faces[6, k], faces[7, k] = start * per_radian, (start + span) * per_radian


@compiled
def _draw(directions, turn, n, faces, owners, inverse, met):
    """Draw n faces, each counter-clockwise as seen from the sensor; `turn` is a full turn in beams.

    returns: the first beam of all faces, and the last + 1
    """
    last_beam = np.float64(directions.shape[1] - 1)
    low, high = np.uint64(directions.shape[1]), np.uint64(0)
    for k in range(n):
        begin, end = faces[6, k] + 0.5, faces[7, k] + 0.5
        if begin < last_beam + 1.0:
            first, stop = _draw_span(begin, end, last_beam, directions, k, faces, owners[k], inverse, met)
            low, high = min(low, first), max(high, stop)
        if end >= turn:  # it crosses the direction of the first beam, so it meets the fan once more
            first, stop = _draw_span(begin - turn, end - turn, last_beam, directions, k, faces, owners[k], inverse, met)
            low, high = min(low, first), max(high, stop)
    return low, high


@compiled
def _draw_span(begin, end, last_beam, directions, k, faces, owner, inverse, met):
    """Draw face k over the beams between two places that are good to half a beam: the first one, and the last + 1."""
    dx, dy = directions[0], directions[1]
    first, last = np.uint64(max(begin, 0.0)), np.uint64(min(end, last_beam))
    # The first and the last beam are those that pass the ends on the inner side.
    stop = last + np.uint64(faces[2, k] * dy[last] <= faces[3, k] * dx[last])
    first += np.uint64(faces[0, k] * dy[first] < faces[1, k] * dx[first])
    normal_x, normal_y = faces[4, k], faces[5, k]
    # Unsigned indices need no test for negative values, so the loops are vectorised.
    if owner == STATIC:  # walls are drawn first, and theirs is the smallest owner: ties change nothing
        for beam in range(first, stop):
            value, best = normal_x * dx[beam] + normal_y * dy[beam], inverse[beam]
            inverse[beam] = max(value, best)
            met[beam] = owner if value > best else met[beam]
        return first, stop
    for beam in range(first, stop):
        value, best, known = normal_x * dx[beam] + normal_y * dy[beam], inverse[beam], met[beam]
        nearer = (value > best) | ((value == best) & (owner < known))
        inverse[beam] = max(value, best)
        met[beam] = owner if nearer else known
    return first, stop


@compiled
def _angle(x, y):
    """Direction of a point to 3e-6 rad, in a fraction of the time of the exact one."""
    across, along = abs(y), abs(x)
    least, most = min(across, along), max(across, along)
    t = least / max(most, 1e-300)
    s = t * t
    # Interpolates atan(t) / t at the Chebyshev points of s in [0, 1].
    angle = t * (
        0.99999483 + s * (-0.33295711 + s * (0.19534659 + s * (-0.12044859 + s * (0.05658999 - s * 0.01313038))))
    )
    angle = math.pi / 2 - angle if across > along else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@compiled
def _merge(inverse, met, merging, farthest, limit, total, count):
    """As lidar.engines.protocol._merged: inverse range of each beam into inverse[0], its owner into met[0]."""
    rays, beams = inverse.shape[0], np.uint64(inverse.shape[1])
    for ray in range(rays):  # what is beyond the range gives no echo
        for beam in range(beams):
            value = inverse[ray, beam]
            inverse[ray, beam] = 0.0 if 1.0 / value > farthest else value
    for beam in range(beams):  # numba takes two seconds to compile an assignment of the whole row
        limit[beam] = inverse[0, beam]
    for ray in range(1, rays):
        for beam in range(beams):
            best, value, other = limit[beam], inverse[ray, beam], met[ray, beam]
            nearer = (value > best) | ((value == best) & (other < met[0, beam]))
            limit[beam] = max(value, best)
            met[0, beam] = other if nearer else met[0, beam]
    for beam in range(beams):
        limit[beam] = 1.0 / limit[beam] + merging
    total[:], count[:] = 0.0, 0.0
    for ray in range(rays):
        for beam in range(beams):
            r = 1.0 / inverse[ray, beam]
            total[beam] += r if r <= limit[beam] else 0.0
            count[beam] += 1.0 if r <= limit[beam] else 0.0
    for beam in range(beams):
        inverse[0, beam] = count[beam] / total[beam]


@compiled
def _perturb(low, high, errors, limits, begin, exact, met, key, bias, squared, spare, errant):
    """As lidar.noise.perturbed, for the beams of one scan from `low` to before `high`; no other meets anything."""
    range_min, range_max, _, _ = limits
    _, sigma, per_metre, resolution, dropout, dropout_far, dropout_grazing, limit, lost, increment = errors
    for beam in range(low, high):
        r = exact[beam]
        counter = (begin + beam) * np.uint64(PURPOSES) + np.uint64(GAUSS)
        value = (r + bias) + (sigma + per_metre * r) * _gauss(_mixed(key + counter * GOLDEN))
        errant[beam] = value
    if resolution > 0.0:
        for beam in range(low, high):
            errant[beam] = np.rint(errant[beam] / resolution) * resolution
    for beam in range(low, high):
        measured = errant[beam]
        value = min(max(measured, range_min), range_max)
        value = -np.inf if measured < range_min * (1 - ROUNDING) else value
        errant[beam] = np.inf if measured > range_max * (1 + ROUNDING) else value
    if dropout > 0.0 or dropout_far > 0.0 or dropout_grazing > 0.0:
        if dropout_grazing > 0.0:
            _incidence_cosine_squared(low, high, exact, met, increment, squared, spare)
        else:
            for beam in range(low, high):
                squared[beam] = 1.0
        for beam in range(low, high):
            r = exact[beam]
            chance = dropout + dropout_far * ((r / range_max) * (r / range_max))
            chance += dropout_grazing * max(1.0 - squared[beam] / limit, 0.0)
            counter = (begin + beam) * np.uint64(PURPOSES) + np.uint64(DROPOUT)
            draw = _uniform(_mixed(key + counter * GOLDEN))
            errant[beam] = lost if draw < chance else errant[beam]
    for beam in range(low, high):
        errant[beam] = errant[beam] if abs(exact[beam]) < np.inf else exact[beam]


@compiled
def _incidence_cosine_squared(low, high, ranges, met, increment, squared, backward):
    """As lidar.noise.incidence_cosine_squared, for the beams of one scan as in `_perturb`."""
    sine_squared, versine = math.sin(increment) ** 2, 2.0 * math.sin(increment / 2) ** 2
    last = high - np.uint64(1)
    for beam in range(low, last):
        after = beam + np.uint64(1)
        a, b = ranges[beam], ranges[after]
        apart_squared = (a - b) * (a - b) + 2.0 * versine * (a * b)
        same = (abs(a) < np.inf) & (abs(b) < np.inf) & (met[beam] == met[after]) & (apart_squared > 0.0)
        q = sine_squared / (apart_squared if same else 1.0)
        squared[beam] = b * b * q if same else -1.0
        backward[after] = a * a * q if same else -1.0
    squared[last], backward[low] = -1.0, -1.0
    for beam in range(low, high):
        value = max(squared[beam], backward[beam])
        squared[beam] = 1.0 if value < 0.0 else value
