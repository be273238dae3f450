"""Reference: one Chipmunk segment query for each beam. Slow and plain; a second opinion on the other engines."""

import weakref

import numpy as np
import pymunk

from ..laserscan import NO_HIT
from ..scene import STATIC
from .protocol import engine

_spaces = weakref.WeakKeyDictionary()  # boxes -> their space: several models scan the same world


@engine
def measure(fan, scene, boxes, x, y, yaw, owner):
    """See `protocol.engine`."""
    space, owner_of = _space(scene, boxes)
    ranges = np.full((len(x), len(fan.angles)), np.inf)
    hits = np.full(ranges.shape, NO_HIT, dtype=np.int32)
    for row in range(len(x)):
        # Chipmunk skips shapes of the same group; group 0 is none.
        others = pymunk.ShapeFilter(group=int(owner[row]) + 1)
        origin = (x[row], y[row])
        bearing = yaw[row] + fan.angles
        ends = np.stack([x[row] + fan.reach * np.cos(bearing), y[row] + fan.reach * np.sin(bearing)], axis=1).tolist()
        for beam, end in enumerate(ends):
            found = [(hit.alpha, owner_of[hit.shape]) for hit in space.segment_query(origin, end, 0, others)]
            if found:  # segment_query_first would return any of several that are equally near
                alpha, hits[row, beam] = min(found)
                ranges[row, beam] = alpha * fan.reach
    return ranges, hits


def _space(scene, boxes):
    known = _spaces.get(boxes)
    if known is not None and known[0] is scene:
        return known[1:]
    space = pymunk.Space()
    owner_of = {}
    for x0, y0, x1, y1 in scene.segments.tolist():
        owner_of[pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0)] = STATIC
    for corners, owner in zip(boxes.corners().tolist(), boxes.owner.tolist(), strict=True):
        box = pymunk.Poly(space.static_body, corners)
        box.filter = pymunk.ShapeFilter(group=owner + 1)
        owner_of[box] = owner
    space.add(*owner_of)
    _spaces[boxes] = scene, space, owner_of
    return space, owner_of
