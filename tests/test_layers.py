"""Imports point one way."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Each module may import those in rows above its own, not those beside or below it.
LAYERS = [
    {"errors", "vehicle", "tomlkeys", "polyline", "rightofway", "driven", "tracking", "lock", "events"},
    {"data", "traffic", "network", "registry", "bicycle", "commands", "trail", "odometry", "obstaclekeys", "programs"},
    {"controllers", "models"},
    {"route", "scenario"},
    {"fleet"},
    {"contact", "sensing", "stoplines", "provenance", "scans", "drawing", "splits", "breakdowns"},
    {"sumo"},
    {"window"},
    {"deployment", "observation", "obstacles", "manoeuvres"},
    {"encounters"},
    {"membership"},
    {"recording", "metrics"},
    {"outputs"},
    {"simulation"},
    {"starter", "nets", "replay", "study", "worker", "doctor", "export"},
    {"benchmark", "report", "batch"},
    {"cli"},
    {"__main__"},
]
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
ALIASES = {"__init__", "lidar", "analysis"}  # names for users, with no code of their own


def imports(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            names |= {f"{module}.{alias.name}" if module == "platoontraffic" else module for alias in node.names}
    return names


def modules(package: str) -> dict[str, Path]:
    """First part of the dotted name inside the package -> its files; a sub-package counts as one."""
    return {f.relative_to(ROOT / package).with_suffix("").as_posix(): f for f in sorted((ROOT / package).rglob("*.py"))}


@pytest.mark.parametrize("module", [m for m in modules("platoontraffic") if m not in ALIASES])
def test_imports_come_from_the_layers_above(module):
    own = module.split("/")[0].removesuffix("_kernel")
    for name in imports(modules("platoontraffic")[module]):
        parts = name.split(".")
        if parts[0] != "platoontraffic" or parts[1].removesuffix("_kernel") == own:
            continue
        assert RANK[parts[1]] < RANK[own], f"{module} imports {name}"


@pytest.mark.parametrize(("library", "only"), [("libsumo", "sumo"), ("traci", "window"), ("sumolib", "network")])
def test_one_module_talks_to_each_part_of_sumo(library, only):
    users = {
        m for m, file in modules("platoontraffic").items() if any(n.split(".")[0] == library for n in imports(file))
    }
    assert users - {"benchmark"} <= {only}  # it times libsumo by itself


def test_a_batch_never_imports_sumo():
    """Its processes do; beside a batch Parquet may be written, and dask's own libraries live."""
    code = "import sys; import platoontraffic.batch, platoontraffic.study, analysis; sys.exit('libsumo' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.mark.parametrize("package", ["lidar", "analysis"])
def test_a_package_stands_alone(package):
    for file in modules(package).values():
        foreign = {name.split(".")[0] for name in imports(file)} & {"platoontraffic", "libsumo", "traci", "sumolib"}
        assert not foreign, f"{file} imports {foreign}"
