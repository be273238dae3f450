"""An installed package finds its networks and scenarios; a checkout's own come first."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from platoontraffic import shipped
from tests.support import ROOT


def test_a_checkout_uses_its_own_folders():
    assert shipped.folder("sumo_nets") == ROOT / "sumo_nets"
    assert shipped.folder("scenarios") == ROOT / "scenarios"


@pytest.mark.install
def test_the_wheel_installed_elsewhere_finds_its_scenarios_and_nets(tmp_path, wheel):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment["PIP_NO_COMPILE"] = "1"  # of what it installs, the commands import a part
    environment["HOME"] = str(tmp_path / "home")
    (tmp_path / "home").mkdir()
    venv.create(tmp_path / "venv", with_pip=True)
    programs = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    subprocess.run([programs / "python", "-m", "pip", "install", "-q", wheel], check=True, env=environment)

    def call(*arguments: str) -> str:
        done = subprocess.run(
            [programs / "platoontraffic", *arguments], cwd=tmp_path, env=environment, text=True, capture_output=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert [line.split()[0] for line in call("list").splitlines()] == list(shipped.scenarios())
    assert all(str(tmp_path) in line for line in call("list", "nets").splitlines())
    call("check", *shipped.scenarios())
    folder = tmp_path / call("run", "paper_loop", "run.duration_s=5", "-q").strip()
    assert Path(call("plot", str(folder)).strip()).is_file()


@pytest.mark.install
def test_wheel_and_source_distribution_are_small(wheel):
    (source,) = wheel.parent.glob("*.tar.gz")
    assert max(wheel.stat().st_size, source.stat().st_size) < 5e6


def test_a_library_that_sumo_lacks_is_named_with_its_package(tmp_path):
    (tmp_path / "libsumo.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}
    command = [sys.executable, "-m", "platoontraffic", "run", "paper_loop", "--dry-run"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 3
    assert done.stderr.startswith("SUMO's library does not load: libGL.so.1: cannot open shared object file; on Debian")
    assert "libgl1" in done.stderr
