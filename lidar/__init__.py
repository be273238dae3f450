"""A planar laser scanner among walls and boxes. Needs numpy, shapely and, for one engine, pymunk; nothing else."""

from .engines import ENGINES
from .laserscan import LaserScan, ScanBatch
from .model import PRESETS, LidarModel, Mount
from .scene import Boxes, Scene
from .sense import scan

__all__ = ["ENGINES", "PRESETS", "Boxes", "LaserScan", "LidarModel", "Mount", "ScanBatch", "Scene", "scan"]
