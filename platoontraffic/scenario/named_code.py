"""Code that a scenario runs: what it names by `module:Class` is imported when it is checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from platoontraffic.plug_ins import plug_in_file
from platoontraffic.scenario.drivers import drivers_of, key_of
from platoontraffic.scenario.faults import KeyPath
from platoontraffic.scenario.tables import Spec


class NamedCode(NamedTuple):
    path: KeyPath  # of the key that names it
    name: str  # module:Class
    file: Path | None  # beside the scenario; None: a module that Python finds

    @property
    def where(self) -> str:
        return str(self.file) if self.file else f"the module {self.name.rsplit(':', 1)[0]}"


# Called with the scenario's name and its code before any of it is imported; raises InputError to refuse it. Each
# code comes with the place of its key, `file:line: key`.
BeforeCode = Callable[[str, list[tuple[str, NamedCode]]], None]


def named_code(spec: Spec, folder: Path) -> list[NamedCode]:
    """All that a scenario in `folder` names by `module:Class`; installed plug-ins, named by a word, are not in it."""
    return [NamedCode(path, name, plug_in_file(name, folder)) for path, name in _names(spec) if ":" in name]


def _names(spec: Spec) -> Iterator[tuple[KeyPath, str]]:
    for role, driver in drivers_of(spec):
        yield (*key_of(spec, role), "law"), driver.law
        for name, sensor in driver.sensors.items():
            yield (*key_of(spec, role), "sensors", name), sensor.sensor
    for i, name in enumerate(spec.record.metrics):
        yield ("record", "metrics", i), name
