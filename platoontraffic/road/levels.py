"""Roads that cross without a junction: one passes over the other on a bridge, also where the network has no heights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely

FROM_ENDS = 5.0  # a crossing nearer to the end of one of the roads is taken for a part of its junction [m]


def crossings(
    lines: Mapping[str, Sequence[np.ndarray]], some: Sequence[str]
) -> dict[str, list[tuple[str, float, float]]]:
    """The roads that cross some of the roads away from their ends.

    lines   : points (k, 2) of every lane, by its road [m]
    some    : roads for which they are looked for
    returns : by these: each other road, and x and y of the middle of the place where lanes of the two cross [m]
    """
    roads = {name: shapely.MultiLineString([lane[:, :2] for lane in lanes]) for name, lanes in lines.items()}
    names = list(roads)
    tree, found = shapely.STRtree(list(roads.values())), {}
    for name in dict.fromkeys(some):
        found[name] = []
        for other in sorted(names[i] for i in tree.query(roads[name], predicate="crosses")):
            met = shapely.intersection(roads[name], roads[other])
            ends = shapely.union(roads[name].boundary, roads[other].boundary)
            if met.geom_type in ("Point", "MultiPoint") and shapely.distance(met, ends) > FROM_ENDS:
                found[name].append((other, met.centroid.x, met.centroid.y))
    return found
