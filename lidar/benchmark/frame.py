"""Parts of every benchmark: facts of the machine, peak of memory, JSON and tables."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path


def machine(*packages: str) -> dict[str, str]:
    """Processor, cores, system, versions of Python and of these packages, and the load now."""
    processor = platform.processor() or platform.machine()
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        processor = info.partition("model name")[2].partition(":")[2].partition("\n")[0].strip() or processor
    except OSError:
        pass
    return {
        "processor": processor,
        "cores": str(os.cpu_count()),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "load_before": load(),
    }


def load() -> str:
    """Load averages over 1, 5 and 15 minutes."""
    return " ".join(f"{load:.2f}" for load in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown"


def peak_memory() -> float | None:
    """Peak memory of this process [MB], or None where the system does not tell.

    On Linux, ru_maxrss may be the peak of the process that started this one; VmHWM is of this process.
    """
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / 1e6
    except (OSError, IndexError):
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6


def as_json(report: object) -> str:
    """JSON of a report, an object with dicts and lists of named tuples as its attributes."""

    def plain(value):
        return [row._asdict() for row in value] if isinstance(value, list) else value

    return json.dumps({name: plain(value) for name, value in vars(report).items()}, indent=1, allow_nan=False)


def facts(machine: dict[str, str]) -> str:
    """One line for each fact of the machine."""
    return "\n".join(f"{name:12} {value}" for name, value in machine.items())


def table(rows: Iterable[Iterable[str]], words: Iterable[bool]) -> str:
    """Cells in columns: those with words begin on the left, numbers end on the right."""
    cells = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    aligned = [str.ljust if word else str.rjust for word in words]
    return "\n".join(
        "  ".join(align(cell, width) for align, cell, width in zip(aligned, row, widths, strict=True)).rstrip()
        for row in cells
    )
