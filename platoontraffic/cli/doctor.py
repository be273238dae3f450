"""Installed packages and extras, and whether SUMO starts."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

import platoontraffic

FINE, MISSING, TROUBLE = "fine", "missing", "trouble"  # verdicts; an extra is missing, never trouble

PACKAGES = ("platoontraffic", "libsumo", "numpy", "numba", "shapely", "pymunk", "pandas", "pydantic")
EXTRAS = {
    "gui": "eclipse-sumo", "cluster": "distributed", "parquet": "pyarrow", "ros": "rosbags", "learn": "gymnasium",
    "notebooks": "nbclient", "video": "imageio-ffmpeg",
}  # fmt: skip

# Ten steps in the smallest network, in a process of its own, which a broken libsumo may kill.
START = """
from platoontraffic import shipped
import libsumo
libsumo.start(["sumo", "-n", str(shipped.networks()["lab_loop"]), "--no-step-log", "--step-length", "0.1"])
for _ in range(10):
    libsumo.simulationStep()
assert abs(libsumo.simulation.getTime() - 1.0) < 1e-9
print(libsumo.getVersion()[1])
libsumo.close()
"""


class Finding(NamedTuple):
    verdict: str
    what: str
    text: str


def examine() -> list[Finding]:
    return [*_versions(), _sumo(), *_extras(), *_arrow()]


def _versions() -> list[Finding]:
    python = Finding(FINE, "python", f"{platform.python_version()} on {platform.platform()}, {sys.executable}")
    return [python, *(Finding(FINE, name, v) if (v := _version(name)) else _not_there(name) for name in PACKAGES)]


def _not_there(name: str) -> Finding:
    return Finding(TROUBLE, name, "not installed; pip install platoontraffic brings it")


def _sumo() -> Finding:
    code = f"import sys; sys.path[:] = {sys.path!r}\n{START}"
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding(TROUBLE, "SUMO", f"does not start: {error}")
    if done.returncode:
        last = done.stderr.strip().rpartition("\n")[2]
        return Finding(TROUBLE, "SUMO", f"does not start and stop: {last or f'exit code {done.returncode}'}")
    return Finding(FINE, "SUMO", f"{done.stdout.split()[-1]} starts, steps and stops")


def _extras() -> list[Finding]:
    findings = []
    for extra, package in EXTRAS.items():
        if installed := _version(package):
            findings.append(Finding(FINE, f"extra {extra}", f"{package} {installed}"))
        elif extra == "video" and (ffmpeg := shutil.which("ffmpeg")):
            findings.append(Finding(FINE, "extra video", f"not needed: the system has {ffmpeg}"))
        else:
            findings.append(Finding(MISSING, f"extra {extra}", f'pip install "platoontraffic[{extra}]"'))
    gui, ours = _version("eclipse-sumo"), _version("libsumo")
    if gui and ours and gui.split(".")[:2] != ours.split(".")[:2]:
        what = f"eclipse-sumo is {gui}, libsumo {ours}; networks built by one may not suit the other"
        findings.append(Finding(TROUBLE, "extra gui", f"{what}: pip install eclipse-sumo=={ours}"))
    return findings


def _arrow() -> list[Finding]:
    """libsumo prints a warning if pyarrow is of another release than the one it was built with."""
    if not (installed := _version("pyarrow")):
        return []
    what = f"libsumo may warn of pyarrow {installed} when it starts; export to Parquet runs without libsumo"
    return [Finding(FINE, "pyarrow", what)]


def _version(package: str) -> str | None:
    if package == "platoontraffic":
        return platoontraffic.__version__
    try:
        return version(package)
    except PackageNotFoundError:
        return None
