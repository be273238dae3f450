"""A SUMO configuration as a scenario: what its file does not say is completed by defaults for cars in traffic."""

from __future__ import annotations

import copy
import os
import shlex
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from platoontraffic import shipped
from platoontraffic.errors import InputError
from platoontraffic.road.network import Network
from platoontraffic.road.sumo_configuration import Configuration
from platoontraffic.scenario.base import is_multiple
from platoontraffic.scenario.overrides import Change

USUAL_STEP = 0.1  # step of a run with cars: their lidars scan ten times a second [s]
USUAL_GAINS = "ring_platoon"  # the shipped scenario with the default follower; its gains are tested

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


def complete(table: dict[str, Any], config: Configuration, changes: Sequence[Change]) -> None:
    """Add the configuration and its defaults to the table of a platoon file, or to an empty one.

    raises: InputError if the table names a network of its own, or if no platoon is given
    """
    if not all(isinstance(table.setdefault(key, {}), dict) for key in ("sumo", "scene", "run")):
        return  # reported when the table is validated
    sumo = table["sumo"]
    if taken := [key for key in ("net", "config", "traffic") if key in sumo]:
        raise InputError(f"--platoon: sumo.{taken[0]}: must not be given; the configuration {config.path} says it")
    sumo["config"] = os.path.abspath(config.path) if "platoon" in table else config.path.name
    table["scene"].setdefault("walls", "none")
    table["run"].setdefault("step_s", _step(config))
    if "platoon" not in table:
        if not any(change.key.startswith("platoon.") for change in changes):
            raise InputError(f"{config.path}: no platoon is given; a complete command, for example: {_example(config)}")
        table["platoon"] = [{}]
    if isinstance(table["platoon"], list):
        usual = _usual_platoon()
        table["platoon"] = [copy.deepcopy(usual) | p if isinstance(p, dict) else p for p in table["platoon"]]


def take_duration(table: dict[str, Any], config: Configuration) -> None:
    """Let the run end when the configuration does, unless the table says when. raises: InputError if neither does"""
    run, sumo = table["run"], table["sumo"]
    if not (isinstance(run, dict) and isinstance(sumo, dict)) or "duration_s" in run:
        return
    if config.end is None:
        raise InputError(f"{config.path}: has no <end>; give the duration of the run, for example run.duration_s=600")
    warm_up = sumo.get("warm_up_s", 0.0)
    run["duration_s"] = round(config.end - config.begin - (warm_up if isinstance(warm_up, int | float) else 0), 3)


def _usual_platoon() -> dict[str, Any]:
    text = shipped.scenarios()[USUAL_GAINS].read_text(encoding="utf-8")
    return {"vehicle": "car", "leader": "sumo", "follower": tomllib.loads(text)["platoon"][0]["follower"]}


def _step(config: Configuration) -> float:
    """The configuration's own step, if the interval of a 10 Hz scan is a multiple of it; else that interval [s]."""
    fits = config.step is not None and config.step > 0 and is_multiple(USUAL_STEP, config.step)
    return config.step if fits else USUAL_STEP


def _example(config: Configuration) -> str:
    """A command that runs the configuration with a platoon that fits on one of its roads."""
    lane, position, to = Network.read(config.net).sample_trip()
    edge, _, index = lane.rpartition("_")
    words = ["platoontraffic", "run", str(config.path), *([] if config.end else ["run.duration_s=600"])]
    words += [f"platoon.start.edge={edge}", *([f"platoon.start.lane={index}"] if index != "0" else [])]
    size = 5 if position >= ROOM_FOR_FIVE else 1
    words += [f"platoon.start.position_m={position:g}", f"platoon.to={to}", f"platoon.size={size}"]
    return shlex.join(words)
