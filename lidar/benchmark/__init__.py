"""What scans cost on this machine: `platoontraffic bench lidar`."""

from .measurements import FULL, QUICK, VIEWS, YARDSTICKS, Memory, Report, Scans, child, run, text, town

__all__ = ["FULL", "QUICK", "VIEWS", "YARDSTICKS", "Memory", "Report", "Scans", "child", "run", "text", "town"]
