"""A planar laser scanner among walls and boxes: see README.md beside this file."""

if __name__ != "platoontraffic.lidar":  # a second copy, under another name, would not know the first one's classes
    raise ImportError("import it as platoontraffic.lidar")

from .carriers import Carriers, Occasion
from .engines import ENGINES
from .laserscan import LaserScan, ScanBatch
from .model import PRESETS, LidarModel, Mount
from .noise import Noise
from .scene import Boxes, Scene
from .segments import Segments, find_segments
from .sense import scan

__all__ = [
    "ENGINES",
    "PRESETS",
    "Boxes",
    "Carriers",
    "LaserScan",
    "LidarModel",
    "Mount",
    "Noise",
    "Occasion",
    "ScanBatch",
    "Scene",
    "Segments",
    "find_segments",
    "scan",
]
