"""Imports point one way: between rooms, and between the files of a room; those inside functions count."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.support import ROOT

# Each room may import those above it, not those beside or below it. A file of the package's own folder is a room.
LAYERS = [
    {"errors", "shipped", "lidar", "analysis", "_checkout"},
    {"vehicles", "geometry", "plug_ins", "report", "replay"},
    {"controllers"},
    {"road"},
    {"scenario"},
    {"world"},
    {"observation", "sumo"},
    {"results", "export"},
    {"simulation"},
    {"recording"},
    {"branches"},
    {"study", "episodes"},
    {"prove", "string_stability"},
    {"session", "environments"},
    {"cli"},
    {"__main__"},
]
RANK = {room: rank for rank, rooms in enumerate(LAYERS) for room in rooms}


def files() -> Iterator[tuple[str, Path]]:
    """Every module of the package by its dotted name, without the package's."""
    for folder, prefix in (("platoontraffic", ()), ("lidar", ("lidar",)), ("analysis", ("analysis",))):
        for file in sorted((ROOT / folder).rglob("*.py")):
            parts = (*prefix, *file.relative_to(ROOT / folder).with_suffix("").parts)
            yield ".".join(parts).removesuffix(".__init__"), file


MODULES = {name: file for name, file in files() if name != "__init__"}


def imported(module: str) -> set[str]:
    """Dotted names that a module imports, anywhere in it; relative ones in full."""
    names: set[str] = set()
    package = ["platoontraffic", *module.split(".")]
    if MODULES[module].name != "__init__.py":
        package.pop()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = [*above, *([node.module] if node.module else [])]
            names |= {".".join([*base, alias.name]) for alias in node.names}
    return names


def needs(module: str) -> set[str]:
    """Modules of the package that a module imports."""
    found = set()
    for name in imported(module):
        if not name.startswith("platoontraffic."):
            continue
        name = name.removeprefix("platoontraffic.")
        while name and name not in MODULES:
            name = name.rpartition(".")[0]
        found |= {name} - {"", module}
    return found


def room(module: str) -> str:
    return module.partition(".")[0]


@pytest.mark.parametrize("module", MODULES)
def test_rooms_import_those_above_them(module):
    for other in needs(module):
        assert room(other) == room(module) or RANK[room(other)] < RANK[room(module)], f"{module} imports {other}"


def test_no_files_import_each_other_in_a_ring():
    try:
        TopologicalSorter({module: needs(module) for module in MODULES}).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


@pytest.mark.parametrize(
    ("library", "only"), [("libsumo", "sumo.client"), ("traci", "sumo.remote"), ("sumolib", "road.network")]
)
def test_one_module_talks_to_each_part_of_sumo(library, only):
    assert {m for m in MODULES if any(name.split(".")[0] == library for name in imported(m))} == {only}


def test_a_batch_never_imports_sumo():
    """Its processes do; beside a batch Parquet may be written, and dask's own libraries live."""
    code = "import sys; import platoontraffic.study.batch, platoontraffic.analysis; sys.exit('libsumo' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.mark.parametrize("package", ["lidar", "analysis"])
def test_a_package_stands_alone(package):
    for module in (m for m in MODULES if room(m) == package):
        foreign = {name for name in imported(module) if name.split(".")[0] in ("libsumo", "traci", "sumolib")}
        assert not foreign, module
        assert {room(other) for other in needs(module)} <= {package}, module
