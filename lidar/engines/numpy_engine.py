"""Rasterise segments in angle, with a buffer of inverse ranges.

Along a straight segment the inverse range is linear in the beam's direction d: a point r·d lies on the line n·p = 1
just when 1/r = n·d. So each segment is drawn over the beams between its ends, the buffer keeps the largest inverse
range, and one division per beam ends the scan. All sensors are drawn at once; no sensor's arithmetic touches
another's, so a row does not depend on what else is in the batch, nor on the order of the obstacles.
"""

import numpy as np

from ..laserscan import NO_HIT
from ..scene import STATIC, blocks, bounds, pairs_near
from .protocol import NOBODY, TOUCHING, engine


@engine
def measure(fan, scene, boxes, x, y, yaw, owner):
    """See `protocol.engine`."""
    edges, edge_bounds, edge_owner = _edges(scene, boxes)
    inverse = np.zeros((len(x), len(fan.angles)))
    hits = np.full(inverse.shape, NOBODY, dtype=np.int32)
    for rows in blocks(len(x), edges.shape[1] + len(fan.angles)):
        sensor, edge = pairs_near(edge_bounds, x[rows], y[rows], fan.reach)
        _draw(
            fan,
            edges[:, edge],
            edge_owner[edge],
            sensor,
            (x[rows], y[rows], yaw[rows], owner[rows]),
            inverse[rows].reshape(-1),
            hits[rows].reshape(-1),
        )
    hits[inverse == 0] = NO_HIT
    with np.errstate(divide="ignore"):
        return np.divide(1.0, inverse, out=inverse), hits


def _edges(scene, boxes):
    """Walls and box faces: ends as rows x0, y0, x1, y1, (4, s); their bounding boxes, (4, s); owners, (s,)."""
    return (
        np.concatenate([scene.columns, boxes.faces], axis=1),
        np.concatenate([scene.bounds, bounds(boxes.faces)], axis=1),
        np.concatenate([np.full(len(scene.segments), STATIC, dtype=np.int32), np.repeat(boxes.owner, 4)]),
    )


def _draw(fan, edges, edge_owner, sensor, poses, inverse, hits):
    """Draw edge i, (4, p), into the beams of sensor i, an index into poses; inverse and hits (n·k,) are updated."""
    edge, px, py, ex, ey, area = _in_reach(fan, edges, edge_owner, sensor, poses)
    sensor, edge_owner = sensor[edge], edge_owner[edge]
    normal_x, normal_y = ey / area, -ex / area
    run, first, count = _spans(fan, px, py, np.sign(area))

    # One entry for each edge and beam.
    begin = np.cumsum(count) - count
    entry = np.repeat(run, count)
    beam = np.arange(len(entry)) + np.repeat(first - begin, count)
    cell = np.repeat(sensor[run] * len(fan.angles), count) + beam
    dx, dy = fan.directions
    value = normal_x[entry] * dx[beam] + normal_y[entry] * dy[beam]
    np.maximum.at(inverse, cell, value)
    nearest = np.flatnonzero(value == inverse[cell])
    np.minimum.at(hits, cell[nearest], edge_owner[entry[nearest]])


def _in_reach(fan, edges, edge_owner, sensor, poses):
    """Edges that face their sensor within its reach, in the sensor frame.

    returns: number of the edge, (q,); x and y of its ends, rows first and second, (2, q) each; x and y of the vector
             from first to second, (q,); twice the area of the triangle sensor, first, second, (q,): its sign tells the
             turn, its size the distance of the line
    """
    x, y, yaw, owner = (values[sensor] for values in poses)
    east, north = edges[0::2] - x, edges[1::2] - y
    cos, sin = np.cos(yaw), np.sin(yaw)
    px, py = cos * east + sin * north, cos * north - sin * east
    ex, ey = px[1] - px[0], py[1] - py[0]
    area = px[0] * ey - py[0] * ex
    length = np.hypot(ex, ey)
    facing = (edge_owner == STATIC) | (area < 0)  # boxes are counter-clockwise; their far faces are hidden anyway
    facing &= edge_owner != owner
    facing &= (np.abs(area) > TOUCHING * length) & (np.abs(area) <= fan.reach * length)  # neither edge-on nor too far
    keep = np.flatnonzero(facing)
    return keep, px[:, keep], py[:, keep], ex[keep], ey[keep], area[keep]


def _spans(fan, px, py, turn):
    """Runs of beams that meet edges: number of the edge, first beam, number of beams, (s,) each."""
    # First and last beam of the wedge, seen counter-clockwise.
    angle = np.arctan2(py, px)
    start = np.where(turn > 0, angle[0], angle[1])
    span = np.mod(turn * (angle[1] - angle[0]), 2 * np.pi)
    span[span > 1.5 * np.pi] = 0.0  # seen all but edge-on; rounding reversed the turn
    increment, last_beam = fan.increment, len(fan.angles) - 1
    start = np.mod(start - fan.angles[0], 2 * np.pi)
    # A wedge that crosses the direction of angle_min meets the fan once more, a turn earlier.
    start = np.concatenate([start, start - 2 * np.pi])
    stop = start + np.concatenate([span, span])
    first = np.clip(np.rint(start / increment), 0, last_beam + 1).astype(np.intp)
    last = np.clip(np.rint(stop / increment), -1, last_beam).astype(np.intp)
    run = np.flatnonzero(first <= last)
    first, last, edge = first[run], last[run], run % len(turn)

    # Rounded angles are good to half a beam; which beam is the first and last is decided by the side it passes an end.
    dx, dy = fan.directions
    swap = (turn[edge] < 0).astype(np.intp)
    first += px[swap, edge] * dy[first] < py[swap, edge] * dx[first]
    last -= px[1 - swap, edge] * dy[last] > py[1 - swap, edge] * dx[last]
    return edge, first, np.maximum(last - first + 1, 0)
