"""The only import name is `platoontraffic`, from a checkout, from an editable install and from a wheel."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support import ROOT

SUBPACKAGES = ("lidar", "analysis")
LEFTOVERS = (*SUBPACKAGES, "tests", "scenarios", "sumo_nets", "hatch_build")  # folders and files of a checkout
INSTALLED = [pytest.param(how, marks=pytest.mark.install) for how in ("wheel", "editable")]

# Imports every module of the package; prints the name and the file of each one that comes from its folders.
ALL_MODULES = """
import importlib, pkgutil, sys
import platoontraffic, platoontraffic.analysis, platoontraffic.lidar
packages = platoontraffic, platoontraffic.analysis, platoontraffic.lidar
for package in packages:
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not found.name.endswith("__main__"):
            try:
                importlib.import_module(found.name)
            except ModuleNotFoundError as error:  # of an extra
                assert not error.name.startswith("platoontraffic")
folders = tuple(path for package in packages for path in package.__path__)
for name, module in list(sys.modules.items()):
    if (getattr(module, "__file__", None) or "").startswith(folders):
        print(name, module.__file__)
"""

Python = Callable[[str, Path], str]


def caller(python: str | Path, *path: Path) -> Python:
    """A function that runs code in a folder with an interpreter, and returns its output; path: PYTHONPATH."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    if path:
        environment["PYTHONPATH"] = os.pathsep.join(map(str, path))

    def says(code: str, folder: Path) -> str:
        done = subprocess.run([python, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    return says


@functools.cache
def installed(how: str, wheel: Path, folder: Path) -> Python:
    """The interpreter of a fresh environment in a folder, with the package from a wheel or editable."""
    venv.create(folder, with_pip=True)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    what = [wheel] if how == "wheel" else ["-e", ROOT]
    subprocess.run([programs / "python", "-m", "pip", "install", "-q", "--no-deps", *what], check=True, cwd=folder)
    # Dependencies are those of this interpreter; a folder named in a .pth does not bring its own .pth files.
    site = sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)})
    Path(site, "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return caller(programs / "python")


@pytest.fixture(scope="module")
def python(request, tmp_path_factory) -> Python:
    if request.param == "checkout":
        return caller(sys.executable, ROOT)
    return installed(request.param, request.getfixturevalue("wheel"), tmp_path_factory.getbasetemp() / request.param)


everywhere = pytest.mark.parametrize("python", ["checkout", *INSTALLED], indirect=True)


@everywhere
def test_own_files_called_lidar_and_analysis_disturb_nothing(tmp_path, python):
    for name in SUBPACKAGES:
        (tmp_path / f"{name}.py").write_text("mine = True\n")
    code = (
        "import analysis, lidar, platoontraffic.analysis, platoontraffic.lidar, platoontraffic.simulation\n"
        "print(analysis.mine, lidar.mine, platoontraffic.lidar.__name__, platoontraffic.analysis.load.__module__)"
    )
    assert python(code, tmp_path) == "True True platoontraffic.lidar platoontraffic.analysis.results"


@everywhere
def test_no_process_holds_two_copies_of_a_module(tmp_path, python):
    names, files = zip(*(line.split(" ", 1) for line in python(ALL_MODULES, tmp_path).splitlines()), strict=True)
    assert all(name.split(".")[0] == "platoontraffic" for name in names)
    assert len(names) == len(set(files)) > 150


@pytest.mark.parametrize("python", INSTALLED, indirect=True)
def test_nothing_else_of_a_checkout_can_be_imported_once_installed(tmp_path, python):
    code = f"from importlib.util import find_spec; print([n for n in {LEFTOVERS} if find_spec(n)])"
    assert python(code, tmp_path) == "[]"


@pytest.mark.parametrize("name", SUBPACKAGES)
def test_at_the_top_of_a_checkout_a_subpackage_cannot_be_imported_by_its_folder_name(name):
    code = f"try:\n    import {name}\nexcept ImportError as error:\n    print(error)"
    assert caller(sys.executable)(code, ROOT) == f"import it as platoontraffic.{name}"


def test_subpackages_lie_at_the_top_of_the_repository():
    code = "import platoontraffic.lidar as l, platoontraffic.analysis as a; print(l.__file__, a.__file__)"
    assert caller(sys.executable)(code, ROOT).split() == [str(ROOT / n / "__init__.py") for n in SUBPACKAGES]
