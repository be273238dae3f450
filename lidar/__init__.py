"""A planar laser scanner among walls and boxes. Needs numpy and shapely, and pymunk or numba for one engine each."""

from .engines import ENGINES
from .laserscan import LaserScan, ScanBatch
from .model import PRESETS, LidarModel, Mount
from .scene import Boxes, Scene
from .sense import scan

__all__ = ["ENGINES", "PRESETS", "Boxes", "LaserScan", "LidarModel", "Mount", "ScanBatch", "Scene", "scan"]
