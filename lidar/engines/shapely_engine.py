"""Exact: each beam is intersected, as a line, with every wall and outline of a box within reach."""

import weakref

import numpy as np
import shapely

from ..laserscan import NO_HIT
from ..scene import STATIC
from .protocol import NOBODY, engine

LINE = int(shapely.GeometryType.LINESTRING)

_trees = weakref.WeakKeyDictionary()  # scene -> search tree of its walls


@engine
def measure(fan, scene, boxes, x, y, yaw, owner):
    """See `protocol.engine`."""
    walls = _trees.get(scene)
    if walls is None:
        walls = _trees[scene] = shapely.STRtree(shapely.linestrings(scene.segments.reshape(-1, 2, 2)))
    outlines = shapely.STRtree(shapely.linearrings(boxes.corners()) if len(boxes) else [])
    ranges = np.full((len(x), len(fan.angles)), np.inf)
    hits = np.full(ranges.shape, NO_HIT, dtype=np.int32)
    for row in range(len(x)):
        pose, seen = (x[row], y[row], yaw[row]), boxes.owner != owner[row]
        ranges[row], hits[row] = _cast(fan, pose, walls, outlines, boxes.owner, seen)
    return ranges, hits


def _cast(fan, pose, walls, outlines, owners, seen):
    """Range and owner of each beam of one sensor, (k,) each, among walls and the boxes that are seen, (v,) bool."""
    origin = np.array(pose[:2])
    bearing = pose[2] + fan.angles
    ends = origin + fan.reach * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    beams = shapely.linestrings(np.stack([np.broadcast_to(origin, ends.shape), ends], axis=1))
    here = shapely.Point(origin)
    beam, wall = walls.query(beams)
    met = shapely.intersection(beams[beam], walls.geometries[wall])
    edge_on = shapely.get_type_id(met) == LINE  # a single wall has no thickness
    distance = np.where(edge_on, np.nan, shapely.distance(here, met))
    other, box = outlines.query(beams)
    other, box = other[seen[box]], box[seen[box]]
    beam = np.concatenate([beam, other])
    to_box = shapely.distance(here, shapely.intersection(beams[other], outlines.geometries[box]))
    distance = np.concatenate([distance, to_box])
    surface = np.concatenate([np.full(len(wall), STATIC), owners[box]])
    distance[np.isnan(distance)] = np.inf  # nothing met
    ranges, hits = np.full(len(bearing), np.inf), np.full(len(bearing), NOBODY)
    np.minimum.at(ranges, beam, distance)
    nearest = np.flatnonzero(np.isfinite(distance) & (distance == ranges[beam]))
    np.minimum.at(hits, beam[nearest], surface[nearest])
    return ranges, np.where(hits == NOBODY, NO_HIT, hits)
