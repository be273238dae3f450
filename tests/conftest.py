from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.runs import ONE_CORNER, run

# Shells start what they put into the background with SIGINT ignored, and that is inherited; tests send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


WHOLE_SUITE = 1000  # at least so many tests are collected


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "one_corner" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.sumo)


@pytest.fixture(scope="session", autouse=True)
def kernels(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> None:
    """In the whole suite the first two workers begin with different kernels, rather than both with the same."""
    if request.session.testscollected < WHOLE_SUITE:
        return
    with contextlib.suppress(Exception):  # tests report the faults of what is called here
        from tests.support.kernels import compile_scanning, compile_tracking

        worker = os.environ.get("PYTEST_XDIST_WORKER")
        if worker == "gw0":
            compile_scanning(tmp_path_factory.mktemp("kernels"))
        elif worker == "gw1":
            compile_tracking()


@pytest.fixture(scope="session")
def one_corner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of three robots through one corner."""
    return run(tmp_path_factory.mktemp("results") / "one_corner", "paper_loop", *ONE_CORNER)


@pytest.fixture(scope="session")
def generated_nets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the networks of `support.generated`, which are made once a session."""
    pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo: pip install platoontraffic[gui]")
    return tmp_path_factory.mktemp("nets")


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package built as a wheel, from its source distribution, which is beside it."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-m", "build", "-o", folder, ROOT], check=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture
def scenario_file(tmp_path: Path) -> Callable[..., Path]:
    """Writes the paper's loop as a scenario file, with some text replaced."""

    def write(*replacements: tuple[str, str], name: str = "mine.toml") -> Path:
        from platoontraffic import shipped

        text = shipped.scenarios()["paper_loop"].read_text(encoding="utf-8")
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new, 1)
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        return file

    return write
