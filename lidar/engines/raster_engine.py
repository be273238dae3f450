"""The fast engine: segments drawn one by one into a buffer of inverse ranges, compiled by numba.

The idea is that of the numpy engine: along a straight segment the inverse range is linear in the beam's direction, so
a segment costs two angles, and one multiply-add for each beam it covers. Compiled, it can also look only where
something can be: walls and boxes lie in the cells of a grid, the walls once for a scene, the boxes anew at every call.
"""

import math
import weakref

import numba
import numpy as np

from ..laserscan import NO_HIT
from ..scene import STATIC

SLACK = 1 + 1e-9  # draw a little beyond range_max; the caller decides what is in range
CELL = 30.0  # [m]; walls are cut to it, so that none reaches far beyond its cell
NOBODY = np.iinfo(np.int32).max  # no owner yet; any owner is less
TURN = 2 * math.pi

_walls = weakref.WeakKeyDictionary()  # scene -> Grid


def cast(model, scene, boxes, x, y, yaw, owner):
    """See `lidar.engines`."""
    walls = _walls.get(scene)
    if walls is None:
        walls = _walls[scene] = _wall_grid(scene.segments)
    around = _box_grid(boxes)
    inverse = np.zeros((len(x), model.samples))
    hits = np.full((len(x), model.samples), NOBODY, dtype=np.int32)
    fan = (model.angle_min, model.angle_increment, model.range_max * SLACK)
    sensors = np.column_stack([x, y, np.cos(yaw), np.sin(yaw)])
    _scan(sensors, owner, model.directions, fan, *walls, *around, inverse, hits)
    return inverse, hits


def _wall_grid(segments):
    """Walls, cut into pieces no longer than a cell."""
    vector = segments[:, 2:] - segments[:, :2]
    pieces = np.maximum(np.ceil(np.hypot(*vector.T) / CELL), 1).astype(np.intp)
    wall = np.repeat(np.arange(len(segments)), pieces)
    number = np.arange(len(wall)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    last = number + 1 == pieces[wall]
    start = segments[wall, :2] + (number / pieces[wall])[:, None] * vector[wall]
    stop = segments[wall, :2] + ((number + 1) / pieces[wall])[:, None] * vector[wall]
    stop[last] = segments[wall[last], 2:]
    middle, reach = (start + stop) / 2, np.hypot(*(stop - start).T) / 2
    return _grid(np.hstack([start, stop])[:, None, :], *middle.T, reach, np.full(len(wall), STATIC))


def _box_grid(boxes):
    """Boxes, each of four faces."""
    faces = np.ascontiguousarray(boxes.faces.T).reshape(-1, 4, 4)
    return _grid(faces, boxes.x, boxes.y, np.hypot(boxes.length, boxes.width) / 2, boxes.owner)


def _grid(shapes, x, y, reach, owner):
    """Shapes of one or four segments, (m, 1 or 4, 4), sorted by the cell of their middle.

    returns: (west, south, farthest end from a middle, columns, rows), the first shape of each cell, shapes, owners
    """
    if not len(x):
        return (0.0, 0.0, 0.0, 0, 0), np.zeros(1, dtype=np.intp), shapes, np.zeros(0, dtype=np.int32)
    west, south = float(x.min()), float(y.min())
    column, row = ((x - west) // CELL).astype(np.intp), ((y - south) // CELL).astype(np.intp)
    columns, rows = int(column.max()) + 1, int(row.max()) + 1
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(columns * rows + 1))
    place = (west, south, float(reach.max()), columns, rows)
    return place, first, np.ascontiguousarray(shapes[order]), owner[order].astype(np.int32)


@numba.njit(cache=True, error_model="numpy")
def _scan(sensors, owner, directions, fan, wall_place, wall_first, walls, wall_owner,
          box_place, box_first, boxes, box_owner, inverse, hits):  # fmt: skip
    for i in range(len(sensors)):
        sensor, own, nearest, hit = sensors[i], owner[i], inverse[i], hits[i]
        _draw_grid(sensor, own, directions, fan, wall_place, wall_first, walls, wall_owner, nearest, hit)
        _draw_grid(sensor, own, directions, fan, box_place, box_first, boxes, box_owner, nearest, hit)
        for beam in range(len(nearest)):
            if nearest[beam] == 0.0:
                hit[beam] = NO_HIT
            nearest[beam] = 1.0 / nearest[beam]


@numba.njit(cache=True)
def _draw_grid(sensor, own, directions, fan, place, first, shapes, owners, inverse, hits):
    """Draw what lies in the cells within range."""
    west, south, reach, columns, rows = place
    x, y, cos, sin = sensor
    far = fan[2] + reach
    left = max(math.floor((x - far - west) / CELL), 0)
    right = min(math.floor((x + far - west) / CELL), columns - 1)
    bottom = max(math.floor((y - far - south) / CELL), 0)
    top = min(math.floor((y + far - south) / CELL), rows - 1)
    if left > right:
        return
    solid = shapes.shape[1] == 4
    for row in range(bottom, top + 1):
        for k in range(first[row * columns + left], first[row * columns + right + 1]):
            if owners[k] == own:
                continue
            for face in range(shapes.shape[1]):
                e0, n0 = shapes[k, face, 0] - x, shapes[k, face, 1] - y
                e1, n1 = shapes[k, face, 2] - x, shapes[k, face, 3] - y
                _draw(cos * e0 + sin * n0, cos * n0 - sin * e0, cos * e1 + sin * n1, cos * n1 - sin * e1,
                      solid, owners[k], directions, fan, inverse, hits)  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def _draw(ax, ay, bx, by, solid, owner, directions, fan, inverse, hits):
    """Draw the segment a-b, in the sensor frame, over the beams between its ends."""
    angle_min, increment, reach = fan
    ex, ey = bx - ax, by - ay
    # Twice the area of the triangle sensor, a, b: its sign tells the turn, its size the distance of the line.
    area = ax * ey - ay * ex
    if area == 0.0 or (solid and area > 0.0):  # boxes are counter-clockwise; their far faces are hidden anyway
        return
    if area * area > reach * reach * (ex * ex + ey * ey):
        return
    normal_x, normal_y = ey / area, -ex / area
    if area < 0.0:
        ax, ay, bx, by = bx, by, ax, ay
    dx, dy = directions
    last_beam = len(dx) - 1
    if last_beam * increment <= math.pi:  # both ends beyond one border of a convex view
        if dx[0] * ay < dy[0] * ax and dx[0] * by < dy[0] * bx:
            return
        if dx[last_beam] * ay > dy[last_beam] * ax and dx[last_beam] * by > dy[last_beam] * bx:
            return
    start = math.atan2(ay, ax)
    span = math.atan2(by, bx) - start
    if span < 0.0:
        span += TURN
    if span > 0.75 * TURN:  # seen all but edge-on; rounding turned it the other way round
        span = 0.0
    start -= angle_min + increment
    start += increment - TURN * math.floor(start / TURN)
    # A wedge that crosses the direction of angle_min meets the fan once more, a turn earlier.
    for begin in (start, start - TURN):
        first = max(round(begin / increment), 0)
        last = min(round((begin + span) / increment), last_beam)
        if first > last:
            continue
        # Rounded angles are good to half a beam; the side on which a beam passes an end decides which is the first, the
        # last.
        if ax * dy[first] < ay * dx[first]:
            first += 1
        if bx * dy[last] > by * dx[last]:
            last -= 1
        for beam in range(np.uint64(first), np.uint64(last + 1)):  # unsigned indices need no test for wrapping round
            value = normal_x * dx[beam] + normal_y * dy[beam]
            if value > inverse[beam]:
                inverse[beam] = value
                hits[beam] = owner
            elif value == inverse[beam] and owner < hits[beam]:
                hits[beam] = owner
