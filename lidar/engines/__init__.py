"""Engines by name; see `protocol`. The meaning of the numbers is stated in `lidar.sense`, and is the same for all.

raster  : compiled; draws nearby surfaces into each sensor's beams. For everything
numpy   : the same idea without numba
pymunk  : one query of the physics engine for each beam; the reference
shapely : exact intersections of lines, beam by beam; the slowest, by which the others are judged
"""

from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType
from typing import NamedTuple


class _Late(NamedTuple):
    """The engine in module `<name>_engine`, imported when it is first used: numba alone takes half a second."""

    name: str
    needs: str  # package

    def measure(self):
        """The engine's function, see `protocol`. raises: ValueError if its package is not installed"""
        if find_spec(self.needs) is None:
            what = f"needs the package {self.needs}, which is not installed; 'numpy' does not"
            raise ValueError(f"engine = {self.name!r}: {what}")
        return import_module(f".{self.name}_engine", __name__).measure


ENGINES = MappingProxyType(
    {
        "raster": _Late("raster", "numba"),
        "numpy": _Late("numpy", "numpy"),
        "pymunk": _Late("pymunk", "pymunk"),
        "shapely": _Late("shapely", "shapely"),
    }
)
