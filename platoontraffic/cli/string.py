"""The command `string`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from platoontraffic import scenario as scenarios
from platoontraffic.cli.printing import out, print_json
from platoontraffic.string_stability import experiment, report


def measure(law: str, changes: Sequence[str], name: str, results: Path, json: bool) -> None:
    """Measure, print and write. raises: InputError"""
    scenario = scenarios.load(name, [f"platoon.follower.law={law}", *changes])
    swept = experiment.sweep(scenario)
    found = [experiment.norms(scenario, profile) for profile in experiment.PROFILES]
    platoon = scenario.spec.platoon[0]
    vehicle = platoon.model(1)
    lags = f"drive {vehicle.drive_lag:g} s, brakes {vehicle.brake_lag:g} s"
    title = f"{law}: {platoon.vehicle.type}, lag of {lags}, {platoon.start.speed_mps:g} m/s"
    folder = results / re.sub(r"[^A-Za-z0-9_-]", "_", law)
    files = report.write_report(folder, title, swept, found)
    off = report.deviation(swept)
    if json:
        frequencies, norms = report.frequency_table(swept), report.norm_table(found)
        print_json({"folder": str(folder), "deviation": off, "frequency": frequencies.to_dict("records"),
                    "norms": norms.to_dict("records")})  # fmt: skip
        return
    out.print(title, soft_wrap=True, highlight=False)
    for line in report.lines(swept, found):
        out.print(line, soft_wrap=True, highlight=False)
    if off is None:
        said = "the law declares no linearisation, so there is no theory"
    else:
        exact = "" if experiment.is_linear(vehicle) else "; of a car with unequal lags it is the describing function"
        said = f"greatest deviation of |G| from the theory, where that is above 0.1: {off:.2%}{exact}"
    out.print(f"\n{said}", soft_wrap=True, highlight=False)
    for file in files:
        out.print(str(file), soft_wrap=True, highlight=False)
