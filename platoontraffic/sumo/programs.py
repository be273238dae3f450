"""Programs of eclipse-sumo, the extra `gui`."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

from platoontraffic.errors import MissingError


def program(name: str) -> Path:
    """raises: MissingError (eclipse-sumo is not installed)"""
    if importlib.util.find_spec("sumo") is None:
        raise MissingError(f"{name} comes with eclipse-sumo, which is not installed: pip install platoontraffic[gui]")
    import sumo

    return Path(sumo.SUMO_HOME, "bin", name)


def home_of(program: Path) -> dict[str, str]:
    """The environment to run a program in: with its own data, not those of another SUMO."""
    return {**os.environ, "SUMO_HOME": str(program.parents[1])}


def need_display(name: str) -> None:
    """raises: MissingError (no display is set)"""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise no_display(name)


def no_display(name: str) -> MissingError:
    """The error for a program that cannot open a display: none is set, or the one that is set does not exist."""
    where = os.environ.get("DISPLAY")
    there = f" (there is none at {where})" if where else ""
    return MissingError(f"{name} needs a display; set DISPLAY, or log in with ssh -X{there}")
