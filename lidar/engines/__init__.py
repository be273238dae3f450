"""Engines by name; see `protocol`. The meaning of the numbers is stated in `lidar.sense`, and is the same for all.

raster  : compiled; draws nearby surfaces into each sensor's beams. For everything
numpy   : the same idea without numba
pymunk  : one query of the physics engine for each beam; the reference
shapely : exact intersections of lines, beam by beam; the slowest, by which the others are judged
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType


def _late(name, needs):
    """The engine in module `<name>_engine`, imported when it is first used: numba alone takes half a second."""

    @cache
    def engine():
        if find_spec(needs) is None:
            raise ValueError(f"engine = {name!r}: needs the package {needs}, which is not installed; 'numpy' does not")
        return import_module(f".{name}_engine", __name__).measure

    return lambda *arguments: engine()(*arguments)


ENGINES = MappingProxyType(
    {
        "raster": _late("raster", "numba"),
        "numpy": _late("numpy", "numpy"),
        "pymunk": _late("pymunk", "pymunk"),
        "shapely": _late("shapely", "shapely"),
    }
)
