"""What a wheel holds beside the package's own folder: its subpackages and its data, from the top of the repository.

An editable install finds them there itself, so it gets no copies.
"""

from __future__ import annotations

from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDERS = {
    "lidar": "platoontraffic/lidar",
    "analysis": "platoontraffic/analysis",
    "sumo_nets": "platoontraffic/_data/sumo_nets",
    "scenarios": "platoontraffic/_data/scenarios",
}


class FoldersOfTheWheel(BuildHookInterface):
    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "standard":
            build_data["force_include"] |= FOLDERS
