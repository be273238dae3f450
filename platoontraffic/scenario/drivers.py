"""The law of each leader and of each platoon's followers, made from the keys of a scenario file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from platoontraffic.controllers import registry
from platoontraffic.controllers.gains import files_in, law_of, with_files
from platoontraffic.controllers.law import Law
from platoontraffic.plug_ins import plug_in_file
from platoontraffic.scenario.faults import Fault, KeyPath, what_of
from platoontraffic.scenario.tables import Driver, Spec

Role = tuple[int, str]  # number of the platoon, "leader" or "follower"


class Found(NamedTuple):
    """The law that a driver names, as far as it could be made."""

    kind: type[Law] | None  # its class
    law: Law | None  # None if a gain is not sound
    plug_in: Path | None  # the file beside the scenario that names it
    sources: frozenset[Path]  # its modules, if it is not shipped, and the files that its gains name
    faults: tuple[Fault, ...]


def drivers_of(spec: Spec) -> Iterator[tuple[Role, Driver]]:
    for i, platoon in enumerate(spec.platoon):
        yield (i, "leader"), platoon.leader
        if platoon.follower:
            yield (i, "follower"), platoon.follower


def find_laws(spec: Spec, folder: Path) -> dict[Role, Found]:
    """The law of every driver. folder: the scenario file's; plug-ins and files that gains name are relative to it"""
    find = cache(lambda name: registry.find_law(name, folder))  # one class a name, so that members may share a call
    return {role: _find_law(driver, ("platoon", *role), find, folder) for role, driver in drivers_of(spec)}


def default_preset(role: str, law: Law | type[Law]) -> str:
    """The lidar of a driver that names none: the one that its law declares, or else the paper's for its role.

    law: a law or its class
    """
    return law.lidar or f"paper-{role}"


def _find_law(driver: Driver, at: KeyPath, find: Callable[[str], tuple[type, tuple[Path, ...]]], folder: Path) -> Found:
    faults: list[Fault] = []
    try:
        kind, sources = find(driver.law)
        gains = with_files(kind, driver.model_extra or {}, folder)
        law = law_of(kind, gains, lambda keys, what: faults.append(Fault((*at, *keys), what)), what_of)
    except LookupError as error:
        return Found(None, None, None, frozenset(), (Fault((*at, "law"), str(error)),))
    return Found(kind, law, plug_in_file(driver.law, folder), frozenset([*sources, *files_in(gains)]), tuple(faults))
