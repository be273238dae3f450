"""The slow second opinion: for each beam, shapely intersects one line with every wall and every side of a box."""

import numpy as np
import shapely

from platoontraffic.lidar import Boxes, Scene

LINE = int(shapely.GeometryType.LINESTRING)


def oracle_scan(model, scene, boxes, x, y, yaw, owner):
    """For one sensor: distance to the nearest surface up to range_max, its owner, and the sine of the angle between
    beam and surface; (k,) each. A side exactly edge-on is not met; another one is, if it belongs to a box."""
    sides = edges(scene, boxes, owner)
    owners = np.concatenate([np.full(len(scene.segments), -1), np.repeat(boxes.owner[boxes.owner != owner], 4)])
    origin = np.array([x, y])
    bearings = yaw + model.angles
    directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    ends = origin + model.range_max * directions
    beams = shapely.linestrings(np.stack([np.broadcast_to(origin, ends.shape), ends], axis=1))
    ranges, hits, sine = np.full(model.samples, np.inf), np.full(model.samples, -2), np.ones(model.samples)
    if len(sides):
        met = shapely.intersection(beams[:, None], shapely.linestrings(sides)[None, :])
        distances = shapely.distance(shapely.Point(x, y), met)
        distances[np.isnan(distances) | (shapely.get_type_id(met) == LINE)] = np.inf
        nearest = distances.argmin(axis=1)
        ranges = distances[np.arange(model.samples), nearest]
        hits = np.where(np.isfinite(ranges), owners[nearest], -2)
        along = np.diff(sides, axis=1)[nearest, 0]
        across = np.abs(directions[:, 0] * along[:, 1] - directions[:, 1] * along[:, 0]) / np.hypot(*along.T)
        sine = np.where(np.isfinite(ranges), across, 1.0)
    return ranges, hits, sine


def edges(scene, boxes, owner):
    """All segments that a sensor of this owner may meet, (s, 2, 2)."""
    corners = boxes.corners()[boxes.owner != owner]
    faces = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    return np.concatenate([scene.segments.reshape(-1, 2, 2), faces])


def endpoint_miss(model, scene, boxes, x, y, yaw, owner):
    """How far each beam passes from the nearest segment end in front of it, (k,) [m]."""
    ends = edges(scene, boxes, owner).reshape(-1, 2) - [x, y]
    bearings = yaw + model.angles
    directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    along = directions @ ends.T
    across = np.abs(directions[:, :1] * ends[:, 1] - directions[:, 1:] * ends[:, 0])
    return np.where(along >= 0, across, np.inf).min(axis=1, initial=np.inf)


def grazing(model, scene, boxes, x, y, yaw, owner):
    """Sine of the flattest angle at which each beam's line meets any segment's line, (k,)."""
    along = np.diff(edges(scene, boxes, owner), axis=1)[:, 0]
    along = along / np.hypot(*along.T)[:, None]
    bearings = yaw + model.angles
    sine = np.abs(np.cos(bearings)[:, None] * along[:, 1] - np.sin(bearings)[:, None] * along[:, 0])
    return sine.min(axis=1, initial=1.0)


def world(segments=(), boxes=()):
    """A scene and boxes from rows: segments x0, y0, x1, y1; boxes x, y, heading, length, width, owner."""
    scene = Scene(np.array(segments, dtype=float).reshape(-1, 4))
    return scene, Boxes(*np.array(boxes, dtype=float).reshape(-1, 6).T)
