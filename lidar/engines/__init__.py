"""Engines measure; what the numbers mean is decided in `lidar.sense`.

An engine is a function (model, scene, boxes, x, y, yaw, owner) -> (ranges, hits):

x, y, yaw, owner : sensor poses, world frame, and the owner whose boxes each does not see, (n,)
ranges           : distance to the first surface on each beam, (n, k) float64, new memory. Exact up to range_max;
                   beyond, the distance to any surface there, or +inf
hits             : owner of that surface, the smallest if several are equally near, (n, k) int32

Sensors that are inside a solid may get anything.
"""

from types import MappingProxyType

from . import numpy_engine


def _pymunk(*args):
    from . import pymunk_engine  # here, so that numpy users need no pymunk

    return pymunk_engine.cast(*args)


def _raster(*args):
    from . import raster_engine  # here, for it costs a second to import numba

    return raster_engine.cast(*args)


ENGINES = MappingProxyType({"numpy": numpy_engine.cast, "pymunk": _pymunk, "raster": _raster})
