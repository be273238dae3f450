"""There is one import name: what a user's own files or other packages are called disturbs nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support import ROOT

SUBPACKAGES = ("lidar", "analysis")


def python(code: str, folder, *path) -> str:
    environment = {"PYTHONPATH": ":".join(map(str, path))} if path else {}
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("path", [(), (ROOT,)], ids=["as installed", "from a checkout"])
def test_own_files_called_lidar_and_analysis_disturb_nothing(tmp_path, path):
    for name in SUBPACKAGES:
        (tmp_path / f"{name}.py").write_text("mine = True\n")
    code = (
        "import analysis, lidar, platoontraffic.analysis, platoontraffic.lidar, platoontraffic.simulation\n"
        "print(analysis.mine, lidar.mine, platoontraffic.lidar.__name__, platoontraffic.analysis.load.__module__)"
    )
    assert python(code, tmp_path, *path) == "True True platoontraffic.lidar platoontraffic.analysis.results"


@pytest.mark.parametrize("name", SUBPACKAGES)
def test_there_is_no_second_copy_under_another_name(name):
    code = f"try:\n    import {name}\nexcept ImportError as error:\n    print(error)"
    assert python(code, ROOT) == f"import it as platoontraffic.{name}"


def test_subpackages_lie_at_the_top_of_the_repository():
    code = "import platoontraffic.lidar as l, platoontraffic.analysis as a; print(l.__file__, a.__file__)"
    assert python(code, ROOT).split() == [str(ROOT / name / "__init__.py") for name in SUBPACKAGES]
