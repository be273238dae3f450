"""Aims of the raster engine, to be read, not enforced: other jobs on the machine affect most of them."""

from __future__ import annotations

import math

from .plan import Plan
from .report import Bar, Growth, Scans, Tick


def bars(plan: Plan, scans: list[Scans], ticks: list[Tick], flat: list[Growth], linear: list[Growth]) -> list[Bar]:
    """Each aim, and the worst measurement of it."""
    times = {(row.scene, row.view, row.engine): row.median_us for row in scans}
    rows = []
    for view, most in {"lead30": 12, "foll30": 12, "lead60": 25}.items():
        ratio = times[plan.large, view, "raster"] / times[plan.large, view, "floor"]
        rows.append(Bar(f"raster at most {most} times the floor", ratio, f"{plan.large} {view}", ratio <= most))
    for engine, least in {"brute force": 2.5, "numpy": 5, "pymunk": 300}.items():
        for size in plan.sizes:
            row = min((r for r in scans if (r.scene, r.engine) == (size.name, engine)), key=lambda r: r.to_raster)
            wanted = f"{engine} at least {least} times raster"
            rows.append(Bar(wanted, row.to_raster, f"{row.scene} {row.view}", row.to_raster >= least))
    tick = max(ticks, key=lambda row: row.median_ms)
    rows.append(Bar("tick of 1000 sensors at most 6 ms", tick.median_ms, tick.scene, tick.median_ms <= 6))
    for kerbs in ("pieces", "merged"):
        far = max((r for r in flat if r.scene.endswith(kerbs)), key=lambda row: abs(math.log(row.ratio)))
        level = 1 / 1.2 <= far.ratio <= 1.2
        rows.append(Bar("a scan within 20 % however large the town", far.ratio, f"{far.scene} {far.view}", level))
    steep = max(linear, key=lambda row: row.ratio)
    twice = "twice the sensors, at most 2.3 times the call"
    rows.append(Bar(twice, steep.ratio, f"{steep.sensors} sensors", steep.ratio <= 2.3))
    return rows
