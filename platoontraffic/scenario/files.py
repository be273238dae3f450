"""Files that a scenario names: the network, routes and additional files, and the SUMO configuration."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from platoontraffic import shipped
from platoontraffic.road.sumo_configuration import Configuration, read_configuration
from platoontraffic.scenario.faults import KeyPath
from platoontraffic.scenario.tables import Sumo


class Files(NamedTuple):
    """Whole paths. What the network or the configuration brings comes before what the scenario adds."""

    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    configuration: Configuration | None

    def of_traffic(self, sumo: Sumo) -> Iterator[tuple[KeyPath, Path]]:
        """Files that may make vehicles, each with the key that names it or brings it."""
        source = ("sumo", "config" if self.configuration else "net")
        for key, files, added in (
            ("routes", self.routes, sumo.routes),
            ("additional", self.additional, sumo.additional),
        ):
            brought = len(files) - len(added)
            for i, file in enumerate(files):
                yield (source if i < brought else ("sumo", key, i - brought)), file


def find_files(sumo: Sumo, folder: Path) -> Files:
    """folder: the scenario file's, which names are relative to. raises: InputError if a configuration is not sound"""
    nets = shipped.networks()
    routes = tuple(folder / name for name in sumo.routes)
    additional = tuple(folder / name for name in sumo.additional)
    if sumo.config is not None:
        config = read_configuration(folder / sumo.config)
        return Files(config.net, (*config.routes, *routes), (*config.additional, *additional), config)
    if sumo.net not in nets:
        return Files(folder / sumo.net, routes, additional, None)
    net = nets[sumo.net]
    kinds = ("poly", "add") if sumo.traffic else ("poly",)
    return Files(
        net,
        (*_beside(net, ("rou",) if sumo.traffic else ()), *routes),
        (*_beside(net, kinds), *additional),
        None,
    )


def _beside(net: Path, kinds: tuple[str, ...]) -> list[Path]:
    """Files of a shipped network, by the kind in their names: ring.rou.xml beside ring.net.xml."""
    name = net.name.removesuffix(".net.xml")
    files = [net.with_name(f"{name}.{kind}.xml") for kind in kinds]
    return [file for file in files if file.is_file()]
