"""The law of each leader and of each platoon's followers, made from the keys of a scenario file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from platoontraffic.controllers import registry
from platoontraffic.controllers.gains import files_in, instance_of, keys_of, law_of, with_files
from platoontraffic.controllers.law import Law
from platoontraffic.lidar import PRESETS
from platoontraffic.plug_ins import find_class, plug_in_file
from platoontraffic.scenario.defaults import usual
from platoontraffic.scenario.driver_tables import Driver
from platoontraffic.scenario.faults import Fault, KeyPath, what_of
from platoontraffic.scenario.tables import Spec
from platoontraffic.scenario.vehicle_tables import Lidar
from platoontraffic.vehicles.catalogue import VehicleModel
from platoontraffic.vehicles.sensor import NamedSensor

SENSORS = "platoontraffic.sensors"  # entry point group
Role = tuple[int, str]  # index in `Spec.groups`, "leader" or "follower"


class FoundSensor(NamedTuple):
    """A sensor that a driver names."""

    sensor: NamedSensor
    plug_in: Path | None  # the file beside the scenario that names it


class Found(NamedTuple):
    """The law and the sensors that a driver names, as far as they could be made."""

    kind: type[Law] | None  # its class
    law: Law | None  # None if a gain is not sound
    plug_in: Path | None  # the file beside the scenario that names it
    sources: frozenset[Path]  # modules, of what is not shipped, and the files that gains name
    faults: tuple[Fault, ...]
    sensors: tuple[FoundSensor, ...] = ()


def drivers_of(spec: Spec) -> Iterator[tuple[Role, Driver]]:
    for i, group in enumerate(spec.groups):
        if group.leader:
            yield (i, "leader"), group.leader
        if group.follower:
            yield (i, "follower"), group.follower


def key_of(spec: Spec, role: Role) -> KeyPath:
    """The key of a driver."""
    return (*spec.key_of(role[0]), role[1])


class Finder:
    """Classes of laws and sensors by name. One class a name, so that members may share a call."""

    def __init__(self, folder: Path) -> None:
        """folder: the scenario file's; plug-ins and files that gains name are relative to it"""
        self.folder = folder
        self.law = cache(lambda name: registry.find_law(name, folder))
        self.sensor = cache(lambda name: find_class(name, folder, SENSORS, "sensor"))


def find_laws(spec: Spec, find: Finder, stale: Collection[KeyPath] = ()) -> dict[Role, Found]:
    """The law of every driver.

    stale: keys that were written for another law; those that this one does not have are left out
    """
    return {role: _find_law(driver, key_of(spec, role), find, stale) for role, driver in drivers_of(spec)}


def default_preset(role: str, law: Law | type[Law], vehicle: VehicleModel) -> str:
    """The lidar of a driver that names none: the one that its law declares, or else that of its vehicle's class.

    law: a law or its class
    """
    return law.lidar or usual(vehicle).lidars[role]


def further_lidars(driver: Driver, preset: str, law: Law | type[Law]) -> dict[str, Lidar]:
    """The tables of a driver's further lasers by name: of those that its law declares, and of those that it names.

    A laser that only the law declares scans when the main one does. preset: of the main laser
    """
    main = driver.lidar
    rate = main.rate_hz or PRESETS[main.preset or preset].rate
    declared = {name: Lidar(preset=one, rate_hz=rate) for name, one in law.further_lidars.items()}
    named = {
        name: table.model_copy(update={"preset": table.preset or law.further_lidars.get(name, preset)})
        for name, table in driver.lidars.items()
    }
    return declared | named


def _find_law(
    driver: Driver,
    at: KeyPath,
    find: Finder,
    stale: Collection[KeyPath],
) -> Found:
    faults: list[Fault] = []
    try:
        kind, sources = find.law(driver.law)
        given = driver.model_extra or {}
        if stale and is_dataclass(kind):
            given = {
                key: gain for key, gain in given.items() if (*at, key) not in stale or key in keys_of(kind).values()
            }
        gains = with_files(kind, given, find.folder)
        fault_of = partial(what_of, beside=Driver.model_fields)
        law = law_of(kind, gains, lambda keys, what: faults.append(Fault((*at, *keys), what)), fault_of, driver.sensors)
    except LookupError as error:
        return Found(None, None, None, frozenset(), (Fault((*at, "law"), str(error)),))
    found, own = _find_sensors(driver, at, find, faults)
    files = frozenset([*sources, *files_in(gains), *own])
    return Found(kind, law, plug_in_file(driver.law, find.folder), files, tuple(faults), found)


def _find_sensors(
    driver: Driver, at: KeyPath, find: Finder, faults: list[Fault]
) -> tuple[tuple[FoundSensor, ...], set[Path]]:
    """The sensors of a driver, and the files that they consist of; faults are added to the list."""
    found: list[FoundSensor] = []
    sources: set[Path] = set()
    for name, table in driver.sensors.items():
        path = (*at, "sensors", name)
        try:
            kind, files = find.sensor(table.sensor)
            parameters = with_files(kind, table.model_extra or {}, find.folder)
            sensor = instance_of(
                kind,
                parameters,
                lambda keys, what, path=path: faults.append(Fault((*path, *keys), what)),
                what_of,
                _check_sensor,
            )
        except LookupError as error:
            faults.append(Fault((*path, "sensor"), str(error)))
            continue
        sources |= {*files, *files_in(parameters)}
        if sensor is not None:
            found.append(FoundSensor(NamedSensor(name, sensor), plug_in_file(table.sensor, find.folder)))
    return tuple(found), sources


def _check_sensor(sensor: Any) -> None:
    """raises: ValueError if it does not declare what `Sensor` says"""
    for ability in ("rate", "reach"):
        value = getattr(sensor, ability, None)
        if not isinstance(value, int | float) or not value > 0:
            name = type(sensor).__qualname__
            raise ValueError(f"{name}: {ability} = {value!r}; must be more than 0, as of a class derived from Sensor")
