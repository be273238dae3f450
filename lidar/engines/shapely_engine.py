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
        origin = np.array([x[row], y[row]])
        bearing = yaw[row] + fan.angles
        ends = origin + fan.reach * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        beams = shapely.linestrings(np.stack([np.broadcast_to(origin, ends.shape), ends], axis=1))
        here = shapely.Point(origin)
        beam, wall = walls.query(beams)
        met = shapely.intersection(beams[beam], walls.geometries[wall])
        edge_on = shapely.get_type_id(met) == LINE  # a lone wall has no thickness
        distance = np.where(edge_on, np.nan, shapely.distance(here, met))
        other, box = outlines.query(beams)
        seen = boxes.owner[box] != owner[row]
        other, box = other[seen], box[seen]
        beam = np.concatenate([beam, other])
        distance = np.concatenate(
            [distance, shapely.distance(here, shapely.intersection(beams[other], outlines.geometries[box]))]
        )
        surface = np.concatenate([np.full(len(wall), STATIC), boxes.owner[box]])
        distance[np.isnan(distance)] = np.inf  # nothing met
        np.minimum.at(ranges[row], beam, distance)
        nearest = np.flatnonzero(np.isfinite(distance) & (distance == ranges[row, beam]))
        hit = np.full(len(bearing), NOBODY)
        np.minimum.at(hit, beam[nearest], surface[nearest])
        hits[row] = np.where(hit == NOBODY, NO_HIT, hit)
    return ranges, hits
