"""A SUMO configuration as a scenario: what its file does not say is completed by defaults for cars in traffic."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from platoontraffic.errors import InputError
from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.network import Network
from platoontraffic.road.sumo_configuration import Configuration
from platoontraffic.scenario.base import is_multiple
from platoontraffic.scenario.defaults import usual_step, vehicles_in
from platoontraffic.scenario.equip_tables import A_DAY
from platoontraffic.scenario.overrides import Change

SEEDS = range(2**31)  # that a scenario may have
ROOM_FOR_FIVE = 40.0  # position on a lane that leaves room for a platoon of five behind it [m]


def is_configuration(file: Path) -> bool:
    """Whether a file is XML rather than a scenario in TOML."""
    if file.suffix in (".sumocfg", ".netecfg"):
        return True
    try:
        with file.open("rb") as opened:
            return opened.read(100).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")
    except OSError:  # reported when the file is read as a scenario
        return False


def complete(table: dict[str, Any], config: Configuration, changes: Sequence[Change], file: str = "") -> None:
    """Add the configuration and its defaults to the table of a platoon file, or to an empty one.

    file  : that of the platoons; "": there is none
    raises: InputError if the table names a network of its own, or if no platoon is given
    """
    if not all(isinstance(table.setdefault(key, {}), dict) for key in ("sumo", "run")):
        return  # reported when the table is validated
    sumo = table["sumo"]
    if taken := [key for key in ("net", "config", "traffic") if key in sumo]:
        raise InputError(f"--platoon: sumo.{taken[0]}: must not be given; the configuration {config.path} says it")
    sumo["config"] = os.path.abspath(config.path) if "platoon" in table or "equip" in table else config.path.name
    if any(change.key.startswith("equip.") for change in changes):
        table.setdefault("equip", [{}])
    if "platoon" not in table and "equip" not in table:
        if not any(change.key.startswith("platoon.") for change in changes):
            raise InputError(*_without_platoon(table, config, file))
        table["platoon"] = [{}]
    if isinstance(table.get("platoon"), list):
        table["platoon"] = [{"vehicle": "car"} | p if isinstance(p, dict) else p for p in table["platoon"]]


def _without_platoon(table: dict[str, Any], config: Configuration, file: str) -> list[str]:
    """Faults of a run of a configuration to which no platoon is given."""
    if not file:
        share = "; equip.share=0.2 makes members of a fifth of its demand" if config.routes else ""
        return [f"{config.path}: no platoon is given{share}; a complete command, for example: {_example(config)}"]
    misspelt = {key: get_close_matches(key, ("platoon", "equip"), n=1) for key in table}
    meant = [f"{file}: {key}: unknown key; did you mean {close[0]!r}?" for key, close in misspelt.items() if close]
    return meant or [f"{file}: has no table [[platoon]] or [[equip]]"]


def take_values(table: dict[str, Any], config: Configuration) -> None:
    """Add the configuration's seed, step and end to the table of a scenario, where that says nothing and they fit.

    raises: InputError where the configuration ends before the warm-up does
    """
    if config.seed is not None and config.seed in SEEDS:
        table.setdefault("seed", config.seed)
    run, sumo = table.get("run"), table.get("sumo")
    if not (isinstance(run, dict) and isinstance(sumo, dict)):
        return  # reported when the table is validated
    if config.step and step_fits(config.step, usual_step(vehicles_in(table))):
        run.setdefault("step_s", config.step)
    if config.end is not None:
        warm_up = sumo.get("warm_up_s", 0.0)
        warm_up = warm_up if isinstance(warm_up, int | float) else 0.0
        lasts = config.end - config.begin - warm_up
        if lasts <= 0 and "duration_s" not in run:
            before = f"its <begin>, {config.begin:g}, and sumo.warm_up_s = {warm_up:g}"
            what = f"<end> {config.end:g}: leaves no time after {before}; give run.duration_s"
            raise InputError(f"{config.path}: {what}")
        run.setdefault("duration_s", round(lasts, 3))
    elif "equip" in table:
        run.setdefault("duration_s", A_DAY)  # it ends when its demand has arrived


def step_fits(step: float, usual: float) -> bool:
    """Whether SUMO can have this step: whole milliseconds, of which the usual step is a multiple [s]."""
    return step > 0 and is_multiple(usual, step) and is_multiple(step, 0.001)


def _example(config: Configuration) -> str:
    """A command that runs the configuration with a platoon that fits on one of its roads."""
    lane, position, to = Network.read(config.net).sample_trip()
    edge, index = edge_of(lane), index_of(lane)
    words = ["platoontraffic", "run", str(config.path), *([] if config.end else ["run.duration_s=600"])]
    words += [f"platoon.start.edge={edge}", *([f"platoon.start.lane={index}"] if index else [])]
    size = 5 if position >= ROOM_FOR_FIVE else 1
    words += [f"platoon.start.position_m={position:g}", f"platoon.to={to}", f"platoon.size={size}"]
    return shlex.join(words)
