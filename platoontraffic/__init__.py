"""Platoons that drive by laser scanner, in SUMO traffic."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from platoontraffic import _checkout

# Of the sources: what pip knows of an editable install is the version at the time of installing.
__version__ = "0.4.18"

_checkout.add_subpackages()

# Imported at first use, so that commands which only list names do not wait for numba.
_HOMES = {
    "Decision": "controllers",
    "Drive": "vehicles.motion",
    "InputError": "errors",
    "Instant": "observation.instant",
    "Law": "controllers",
    "MissingError": "errors",
    "RunError": "errors",
    "Sensed": "controllers",
    "Sensor": "vehicles.sensor",
    "Simulation": "simulation",
    "SimulationProcess": "branches.session",
    "Target": "controllers",
    "Twist": "vehicles.motion",
    "batch": "session",
    "per_vehicle": "controllers",
    "run": "session",
}

__all__ = [
    "Decision",
    "Drive",
    "InputError",
    "Instant",
    "Law",
    "MissingError",
    "RunError",
    "Sensed",
    "Sensor",
    "Simulation",
    "SimulationProcess",
    "Target",
    "Twist",
    "batch",
    "per_vehicle",
    "run",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
