"""Cost of scans on this machine: `platoontraffic bench lidar`."""

from .measurements import run
from .plan import FULL, QUICK
from .processes import child
from .report import Memory, Report, Scans, text
from .towns import VIEWS, town
from .yardsticks import YARDSTICKS

__all__ = ["FULL", "QUICK", "VIEWS", "YARDSTICKS", "Memory", "Report", "Scans", "child", "run", "text", "town"]
