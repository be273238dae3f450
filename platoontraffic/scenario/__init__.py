"""Scenario files: TOML in, checked and resolved, before anything starts."""

from platoontraffic.scenario.tables import (
    Breakdown,
    Change,
    Identifier,
    Platoon,
    Run,
    Scenario,
    Spec,
    Table,
    default_preset,
    dotted,
    fault_of,
    load,
    read_toml,
)

__all__ = [
    "Breakdown",
    "Change",
    "Identifier",
    "Platoon",
    "Run",
    "Scenario",
    "Spec",
    "Table",
    "default_preset",
    "dotted",
    "fault_of",
    "load",
    "read_toml",
]
