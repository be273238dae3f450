"""Origin of a result: hashes, versions, machine, times."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import platoontraffic
from platoontraffic import lidar
from platoontraffic.scenario import Scenario, dotted

P = ParamSpec("P")
T = TypeVar("T")

_SOURCES = Path(platoontraffic.__file__).parent
_PACKAGES = ("libsumo", "numpy", "numba", "shapely", "pymunk", "pandas")


def sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def run_id(scenario: Scenario) -> str:
    """Name of a run: equal for equal input, independent of the names and folders of its files."""
    return f"{point_id(scenario)}-s{scenario.seed}"


def point_id(scenario: Scenario) -> str:
    """Hash of the resolved scenario without its seed, of every input file and plug-in, and of this tool's sources."""
    resolved = scenario.resolved()
    for key in ("seed", "name"):
        resolved.pop(key)
    parts = [
        json.dumps(resolved, sort_keys=True),
        *(sha256(file) for file in scenario.files().values()),
        _own_sources(),
    ]
    return hashlib.sha256(chr(10).join(parts).encode()).hexdigest()[:10]


def warm_up_id(scenario: Scenario) -> str:
    """Hash of all but the seed that traffic depends on until the platoons are placed; "" without a warm-up."""
    spec = scenario.spec
    if not spec.sumo.warm_up_s:
        return ""
    resolved, record = scenario.resolved(), spec.record
    parts = {
        "sumo": resolved["sumo"],
        "step": spec.run.step_s,
        "record": (record.sumo, record.sumo_every_s),
        "native": any(law.native for law in scenario.laws.values()),  # lane changes take their time then
        # Vehicles that wait for others of their platoons have other departures.
        "equip": ["single" if one["mode"] == "single" else one for one in resolved.get("equip", [])],
        "types": sorted({json.dumps(dict(law.vehicle_type), sort_keys=True) for law in scenario.laws.values()}),
        "files": [str(file.resolve()) for file in scenario.files_of_sumo()],
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:10]


def before(scenario: Scenario) -> dict[str, Any]:
    """provenance.json as it is before the run; see `finished`."""
    config = scenario.configuration
    return {
        "status": "unfinished",
        "tool": "platoontraffic",
        "version": platoontraffic.__version__,
        "git": commit(),
        "command_line": ["platoontraffic", *sys.argv[1:]],
        "seed": scenario.seed,
        "input_sha256": {name: sha256(file) for name, file in scenario.files().items()},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: version(name) for name in _PACKAGES},
        "given_to_laws": {
            dotted((*scenario.spec.key_of(i), role)): [
                "scan",
                *(f"scan {name}" for name in lidars),
                "own motion",
                *sorted(law.needs),
            ]
            for (i, role), law in scenario.laws.items()
            for lidars in [scenario.further_lidars((i, role))]
        },
        "sumo_options_ignored": list(config.ignored) if config else [],
        "sumo_options_replaced": scenario.replaced(),
    }


def finished(
    facts: dict[str, Any], simulated: float, wall: float, stages: dict[str, float], sumo_words: Sequence[str]
) -> dict[str, Any]:
    """provenance.json of a finished run.

    facts      : of `before`
    simulated  : [s]
    wall       : time of the loop [s]
    stages     : wall time by stage [s], of a `Stopwatch`
    sumo_words : first lines of run.log
    """
    return facts | {
        "status": "finished",
        "simulated_s": simulated,
        "wall_s": round(wall, 3),
        "real_time_factor": round(simulated / wall, 2),
        "stage_s": {stage: round(seconds, 3) for stage, seconds in stages.items()},
        "sumo_words": list(sumo_words),
    }


class Stopwatch:
    """Time by stage: `watch("scan", function)` is the function, timed; by default wall time.

    Time in a stage that is called inside another counts for the inner one only.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock  # [s]
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner = 0.0  # time in stages inside the present one [s]

    def __call__(self, stage: str, function: Callable[P, T]) -> Callable[P, T]:
        self.seconds[stage] = 0.0

        return partial(self.call, stage, function)

    def call(self, stage: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """The result of a function, timed."""
        outer, self._inner = self._inner, 0.0
        began = self._clock()
        try:
            return function(*args, **kwargs)
        finally:
            took = self._clock() - began
            self.seconds[stage] += took - self._inner
            self._inner = outer + took

    def wrap(self, component: T, **stages: str) -> T:
        """The component itself, its methods timed; method=stage."""
        for method, stage in stages.items():
            setattr(component, method, self(stage, getattr(component, method)))
        return component


class Untimed:
    """Stands in for a `Stopwatch` where nobody asks for times."""

    def call(self, stage: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        return function(*args, **kwargs)

    def wrap(self, component: T, **stages: str) -> T:
        return component


def _own_sources() -> str:
    folders = _SOURCES, Path(lidar.__file__).parent
    return _hash_of(folders, tuple(_changes(folder) for folder in folders))


def _changes(package: Path) -> frozenset[tuple[str, int, int]]:
    """Path, time of the last change and size of each source file."""
    files = [os.path.join(folder, name) for folder, _, names in os.walk(package) for name in names]
    stats = [(file, os.stat(file)) for file in files if file.endswith(".py")]
    return frozenset((file, stat.st_mtime_ns, stat.st_size) for file, stat in stats)


@lru_cache(maxsize=1)  # a batch names thousands of runs
def _hash_of(packages: tuple[Path, ...], changes: tuple[frozenset[tuple[str, int, int]], ...]) -> str:
    """changes: those of the packages, by which the hash is known again"""
    digest = hashlib.sha256()
    for package in packages:
        for file in sorted(package.rglob("*.py")):
            digest.update(file.relative_to(package).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)  # the code in the process stays that of its start
def commit() -> str | None:
    """Commit of the checkout that this runs from, with `+changes` if files differ from it; None if installed."""
    if not (_SOURCES.parent / ".git").exists():
        return None
    try:
        ask = ["git", "-C", str(_SOURCES.parent), "describe", "--always", "--dirty=+changes", "--abbrev=12"]
        return subprocess.run(ask, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
