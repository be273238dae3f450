"""Scenario files: TOML in, checked and resolved before anything starts.

`load` gives a `Scenario`. Keys carry their unit; `model` of a table converts them into SI and radians. Each fault is
one line, `file:line: key: what is wrong; what is allowed`.
"""

from platoontraffic.scenario.base import Identifier, Table
from platoontraffic.scenario.equip_tables import Equip
from platoontraffic.scenario.faults import dotted, fault_of
from platoontraffic.scenario.learn_table import Learn
from platoontraffic.scenario.loading import load
from platoontraffic.scenario.overrides import Change
from platoontraffic.scenario.scenario import Scenario
from platoontraffic.scenario.tables import Breakdown, Channel, Platoon, Run, Spec
from platoontraffic.scenario.toml_lines import read_toml

__all__ = [
    "Breakdown",
    "Change",
    "Channel",
    "Equip",
    "Identifier",
    "Learn",
    "Platoon",
    "Run",
    "Scenario",
    "Spec",
    "Table",
    "dotted",
    "fault_of",
    "load",
    "read_toml",
]
