"""The command `string`."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from platoontraffic import scenario as scenarios
from platoontraffic.cli.printing import out, print_json
from platoontraffic.results import provenance
from platoontraffic.scenario import Scenario
from platoontraffic.string_stability import experiment, report
from platoontraffic.string_stability.experiment import Swept


def measure(law: str, changes: Sequence[str], name: str, results: Path, json: bool) -> None:
    """Measure, print and write. raises: InputError"""
    scenario = scenarios.load(name, [f"platoon.follower.law={law}", *changes])
    experiment.check(scenario)
    # Made before the experiment, because its input files may change while it lasts.
    folder = results / re.sub(r"[^A-Za-z0-9_-]", "_", law) / provenance.run_id(scenario)
    facts, began = provenance.before(scenario), time.perf_counter()
    swept = experiment.sweep(scenario)
    found = [experiment.norms(scenario, profile) for profile in experiment.PROFILES]
    facts |= {"status": "finished", "wall_s": round(time.perf_counter() - began, 3)}
    touched, off, scale = report.touched(swept, found), report.deviation(swept), experiment.scale(scenario)
    title = f"{law}: {_vehicles(scenario)}, {scenario.spec.platoon[0].start.speed_mps:g} m/s"
    warned = f"{title}\n{report.touch_line(touched)}" if touched else title
    files = report.write_report(folder, warned, swept, found)
    report.write_origin(folder, scenario, facts)
    if json:
        frequencies, norms = report.frequency_table(swept), report.norm_table(found)
        print_json({"folder": str(folder), "deviation": _number(off), "no_theory": swept.no_theory or None,
                    "scale": scale, "left_out_hz": swept.left_out.tolist(), "touched": touched,
                    "frequency": _rows(frequencies), "norms": _rows(norms)})  # fmt: skip
        return
    out.print(title, soft_wrap=True, highlight=False)
    for line in report.lines(swept, found):
        out.print(line, soft_wrap=True, highlight=False)
    out.print("", soft_wrap=True)
    for line in _remarks(scenario, swept, off):
        out.print(line, soft_wrap=True, highlight=False)
    if touched:
        out.print(report.touch_line(touched), soft_wrap=True, highlight=False)
    for file in files:
        out.print(str(file), soft_wrap=True, highlight=False)


def _vehicles(scenario: Scenario) -> str:
    """The vehicles with their lags, from the leader on; one for all, where they are alike."""
    platoon = scenario.spec.platoon[0]
    tables = platoon.vehicles or [platoon.vehicle] * platoon.size
    named = []
    for place, table in enumerate(tables):
        vehicle = platoon.model(place)
        named.append(f"{table.type}, lag of drive {vehicle.drive_lag:g} s, brakes {vehicle.brake_lag:g} s")
    alike = [(name, len(list(same))) for name, same in groupby(named)]
    return named[0] if len(alike) == 1 else "; ".join(f"{number} x {name}" for name, number in alike)


def _remarks(scenario: Scenario, swept: Swept, off: float | None) -> Iterator[str]:
    """How far the theory holds, and what was measured in another way than usual."""
    platoon = scenario.spec.platoon[0]
    if off is None:
        yield f"there is no theory: {swept.no_theory}"
    else:
        exact = all(experiment.is_linear(platoon.model(place)) for place in range(1, platoon.size))
        where = f", {report.deviation_place(swept)}" if off else ""
        function = "" if exact else "; of a car with unequal lags it is the describing function"
        yield f"greatest deviation of |G| from the theory, where that is above 0.1: {off:.2%}{where}{function}"
    if len(swept.left_out):
        left_out = ", ".join(f"{frequency:g}" for frequency in swept.left_out)
        yield f"left out: {left_out} Hz, at or above half the rate of decisions, {swept.decisions:g} Hz"
    if (scale := experiment.scale(scenario)) < 1:
        yield (f"the leader's accelerations are {scale:.3g} of those for cars, in proportion to the speed below "
               f"{experiment.FULL:g} m/s")  # fmt: skip


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a table; None where a number is not finite, which JSON cannot say."""
    table = table.replace([np.inf, -np.inf], np.nan).astype(object)
    return table.where(table.notna(), None).to_dict("records")


def _number(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None
