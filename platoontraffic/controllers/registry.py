"""Laws by name: entry points of the group `platoontraffic.laws`, or `module:Class` beside a scenario."""

from __future__ import annotations

from pathlib import Path

from platoontraffic.plug_ins import PlugIn as Law
from platoontraffic.plug_ins import find_class, installed_names, plug_in_file

__all__ = ["LAWS", "Law", "find_law", "law_names", "plug_in_file"]

LAWS = "platoontraffic.laws"  # entry point group


def law_names() -> list[str]:
    return installed_names(LAWS)


def find_law(name: str, folder: Path) -> Law:
    """The class of a law; see `find_class`. raises: LookupError"""
    return find_class(name, folder, LAWS, "law")
