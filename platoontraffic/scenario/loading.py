"""From a scenario file, or a SUMO configuration, to a checked scenario. Every fault is found before anything starts."""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from numbers import Integral
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from platoontraffic import shipped
from platoontraffic.errors import InputError, did_you_mean, no_file
from platoontraffic.road.sumo_configuration import Configuration, read_configuration
from platoontraffic.scenario import configurations, metric_plug_ins, overrides, toml_lines
from platoontraffic.scenario.checks import faults_of, faults_of_branch
from platoontraffic.scenario.drivers import Finder, Found, Role, find_laws
from platoontraffic.scenario.faults import Fault, KeyPath, dotted, fault_path, what_of
from platoontraffic.scenario.files import find_files
from platoontraffic.scenario.named_code import BeforeCode, named_code
from platoontraffic.scenario.overrides import Change
from platoontraffic.scenario.scenario import Scenario, placed
from platoontraffic.scenario.tables import Spec

ROADS = ("sumo.net", "sumo.config")
OF_NOTHING = ("run", "sumo", "osm", "config", "simulation")  # names of configurations that say nothing of the road
ANY_DURATION = 86400.0  # with which further faults are looked for where a duration is missing [s]


@dataclass(frozen=True)
class _Places:
    """The place of a key: `file:line`, or the argument that set it; of a table both, if one set a part of it.

    Where several arguments set parts of a table, it is the one whose key its fault names first.
    """

    source: Path
    lines: Mapping[KeyPath, int]
    arguments: Mapping[KeyPath, str]  # by the keys that they set

    def __call__(self, path: KeyPath, what: str = "") -> str:
        for n in range(len(path), 0, -1):
            if path[:n] in self.arguments:
                return self.arguments[path[:n]]
        line = toml_lines.line_of(self.lines, path)
        parts = {key[-1]: place for key, place in self.arguments.items() if key[: len(path)] == path}
        named = [parts[word] for word in re.findall(r"\w+", what) if word in parts]
        inside = (*named, *parts.values(), "")[0]
        if inside and line:
            return f"{inside} or {self.source}:{line}"
        return inside or (f"{self.source}:{line}" if line else str(self.source))


def load(
    name_or_file: str | Path,
    arguments: Sequence[str | Change] = (),
    seed: int | None = None,
    platoons: str | Path | None = None,
    before_code: BeforeCode | None = None,
    to_branch: bool = False,
) -> Scenario:
    """The scenario of a file, or a shipped one by name, changed by `key=value` arguments.

    A SUMO configuration is a scenario too, with platoons from the file `platoons`, or from arguments alone.

    before_code: called before plug-ins that the scenario names by `module:Class` are imported, if there are any
    to_branch: it will have branches; a channel without receivers is left out, since they may have some

    raises: InputError with one line for every fault found
    """
    if not isinstance(name_or_file, str | Path):
        raise InputError(f"scenario: {name_or_file!r}: must be a file, or the name of a shipped one")
    if not all(isinstance(a, str | Change) for a in arguments):
        raise InputError(f"changes: {arguments}: must be texts such as 'platoon.size=3'")
    changes = [a if isinstance(a, Change) else Change.parse(a, number) for number, a in enumerate(arguments, start=1)]
    given = [change for change, argument in zip(changes, arguments, strict=True) if isinstance(argument, str)]
    overrides.check_once(given)
    if seed is not None and (twice := [change for change in given if change.key == "seed"]):
        raise twice[0].fault(f"the seed is given as {seed} as well; must be given once")
    source = _find(name_or_file)
    config = read_configuration(source) if configurations.is_configuration(source) else None
    if config is None and platoons is not None:
        raise InputError(f"--platoon: goes with a SUMO configuration (.sumocfg, .netecfg); {source} is a scenario")
    table, lines = ({}, {}) if config and platoons is None else toml_lines.read_toml(platoons or source)
    if "base" in table and not config:
        raise InputError(f"{source}: is a study; `platoontraffic batch {source}` runs it")
    table.setdefault("name", _name(source))
    if config:
        for change in (change for change in changes if change.key in ROADS):
            raise change.fault(f"must not be given; the configuration {config.path} says the road")
        configurations.complete(table, config, changes, str(platoons or ""))
        source = Path(platoons or source)
    set_by, stale = _change(table, changes, seed)
    if used := config or _configuration_in(table, source.parent):
        configurations.take_values(table, used)
    places = _Places(source, lines, set_by)
    varied = {change.key: change.value for change in changes}
    loaded = _Loaded(table, source, varied, places, stale, Finder(source.parent), before_code, to_branch)
    if not config or "duration_s" in table["run"]:
        return loaded.scenario()
    faults = [f"{config.path}: has no <end>; give the duration of the run, for example run.duration_s=600"]
    table["run"]["duration_s"] = ANY_DURATION
    try:
        loaded.scenario()
    except InputError as error:  # such as a duration whose key is misspelt
        faults += error.faults
    raise InputError(*faults)


@dataclass(frozen=True)
class _Loaded:
    """Tables of a scenario after all changes, and where they are from."""

    table: dict[str, Any]
    source: Path
    varied: dict[str, Any]
    places: _Places
    stale: frozenset[KeyPath]  # as of `_change`
    find: Finder
    before_code: BeforeCode | None
    to_branch: bool  # as of `load`

    def scenario(self) -> Scenario:
        """raises: InputError if a table, a file, a law, or the tables together are not sound"""
        scenario = replace(_checked(self), branched=self._branched)
        return _with_then(scenario, self) if scenario.spec.branch else scenario

    def _branched(self, changes: Sequence[Change]) -> Scenario:
        """The scenario with these changes of its key `branch`, in place of those that it has."""
        table = {key: value for key, value in copy.deepcopy(self.table).items() if key != "branch"}
        set_by, _ = _change(table, changes, None)
        places = replace(self.places, arguments={**self.places.arguments, **set_by})
        varied = self.varied | {change.key: change.value for change in changes}
        return replace(self, table=table, varied=varied, places=places, to_branch=False).scenario()


def _with_then(scenario: Scenario, loaded: _Loaded) -> Scenario:
    """The scenario with `then`, the one that it is after its branch."""
    table, branch, places = copy.deepcopy(loaded.table), scenario.spec.branch, loaded.places
    del table["branch"]
    named = overrides.leaves(branch.then, ("branch", "then"))
    changes = [Change(key, value, places(path), key) for key, path, value in named]
    set_by, further = _change(table, changes, None)
    places = replace(places, arguments={**places.arguments, **set_by})
    faults = [
        Fault(path, "does not change at a branch; must be a key of a leader, of a follower or of breakdowns")
        for path in set_by
        if not (path[0] == "breakdown" or (path[0] == "platoon" and path[2:3] in (("leader",), ("follower",))))
    ]
    if faults:
        raise InputError(*(placed(fault, places) for fault in faults))
    stale = (loaded.stale | further).difference(set_by)
    then = replace(loaded, table=table, places=places, stale=stale).scenario()
    if faults := faults_of_branch(branch.at_s, scenario.spec, scenario.laws, then.spec, then.laws):
        raise InputError(*(placed(fault, places) for fault in faults))
    laws = (*scenario.laws.values(), *then.laws.values())
    if scenario.spec.channel and not any("messages" in law.needs for law in laws):
        what = "no law needs messages, before the branch or after it, so nobody receives them; must be left out"
        raise InputError(placed(Fault(("channel",), what), places))
    # Messages are there from the begin, also if only the law after the branch needs them.
    spec = scenario.spec.model_copy(update={"channel": scenario.spec.channel or then.spec.channel})
    sources = tuple(sorted({*scenario.sources, *then.sources}))
    return replace(scenario, spec=spec, then=then, sources=sources)


def _find(name_or_file: str | Path) -> Path:
    known = shipped.scenarios()
    if str(name_or_file) in known:
        return known[str(name_or_file)]
    file = Path(name_or_file)
    absent = no_file(file)
    if not absent:
        return file
    if not no_file(file / "config.toml"):
        raise InputError(f"{file}: is the folder of a run; its scenario is {file / 'config.toml'}")
    if not no_file(file / "study.toml"):
        raise InputError(f"{file}: is the folder of a batch; its study is {file / 'study.toml'}")
    if absent == "is a folder":
        raise InputError(f"{file}: is a folder; must be a scenario file, or the name of a shipped scenario")
    if str(name_or_file) in shipped.studies():
        raise InputError(f"{name_or_file}: is a shipped study; `platoontraffic batch {name_or_file}` runs it")
    hint = did_you_mean(str(name_or_file), known)
    if absent != "no such file":
        raise InputError(f"{name_or_file}: {absent}")
    raise InputError(f"{name_or_file}: no such scenario file or shipped scenario{hint}")


def _configuration_in(table: Mapping[str, Any], folder: Path) -> Configuration | None:
    """The configuration that a scenario's table names; None if it names none, or one that is not sound."""
    sumo = table.get("sumo")
    name = sumo.get("config") if isinstance(sumo, dict) else None
    try:
        return read_configuration(folder / name) if isinstance(name, str) and name else None
    except InputError:  # reported when the scenario is checked
        return None


def _name(file: Path) -> str:
    folder = Path(os.path.abspath(file)).parent.name
    # Many configurations have the same name, and their results would be in one folder.
    named = folder if folder and file.suffix == ".sumocfg" and file.stem.lower() in OF_NOTHING else file.stem
    return re.sub(r"[^A-Za-z0-9_-]", "_", named)


def _change(
    table: dict[str, Any], changes: Sequence[Change], seed: int | None
) -> tuple[dict[KeyPath, str], frozenset[KeyPath]]:
    """Make the changes in the table.

    returns: the place of each key that they set; keys of the file beside a law that they replaced by another one
    """
    set_by: dict[KeyPath, str] = {}
    stale: set[KeyPath] = set()
    for change in changes:
        before = copy.deepcopy(table) if change.key.endswith(".law") else {}
        if change.key in ROADS and isinstance(table.get("sumo"), dict):
            change = _on_another_road(change, table)
        paths = overrides.apply(change, table)
        set_by |= dict.fromkeys(paths, change.place)
        for *driver, _ in paths:
            was = _at(before, driver)
            if isinstance(was, dict) and was.get("law", change.value) != change.value:
                stale |= {(driver[0], driver[1] if len(driver) == 3 else 0, driver[-1], key) for key in was}
    if seed is not None:
        table["seed"] = int(seed) if isinstance(seed, Integral) else seed  # from numpy, too
        set_by["seed",] = "argument"
    return set_by, frozenset(stale.difference(set_by))


def _on_another_road(change: Change, table: dict[str, Any]) -> Change:
    """The change of `sumo.net` or `sumo.config`, which takes the place of the file's road and traffic.

    Edges of the file's road are not counted on another.

    The path of an argument is one from the working directory, if there is such a file.
    """
    for key in ("net", "config", "routes", "additional", "traffic"):
        table["sumo"].pop(key, None)
    if isinstance(table.get("record"), dict):
        table["record"].pop("passages", None)
    if change.place.startswith("argument") and isinstance(change.value, str) and os.path.isfile(change.value):
        return change._replace(value=os.path.abspath(change.value))
    return change


def _at(node: Any, path: Sequence[str | int]) -> Any:
    """What stands at a path in tables and arrays; None if nothing does."""
    try:
        return reduce(lambda inner, key: inner[key], path, node)
    except (KeyError, IndexError, TypeError):
        return None


def _validated(table: dict[str, Any], places: _Places) -> Spec:
    try:
        return Spec.model_validate(table)
    except ValidationError as error:
        faults = (Fault(fault_path(one), what_of(one, Spec)) for one in error.errors())
        raise InputError(*(placed(fault, places) for fault in faults)) from None


def _deaf(laws: Mapping[Role, Found], arguments: Mapping[KeyPath, str]) -> bool:
    """Whether a change of the laws has left the file's channel without receivers."""
    changed = {path[0] if path[0] == "channel" else path[-1] for path in arguments}
    laws_change = not changed.isdisjoint({"law", "feed", "leader", "follower"})
    return "channel" not in changed and laws_change and not _receivers(laws)


def _receivers(laws: Mapping[Role, Found]) -> bool:
    """Whether a law needs messages, or is not known."""
    return any(found.law is None or "messages" in found.law.needs for found in laws.values())


def _checked(loaded: _Loaded) -> Scenario:
    source, places = loaded.source, loaded.places
    folder = source.parent
    spec = _validated(loaded.table, places)
    if loaded.before_code and (codes := named_code(spec, folder)):
        loaded.before_code(spec.name, [(f"{places(code.path)}: {dotted(code.path)}", code) for code in codes])
    try:
        files = find_files(spec.sumo, folder)
    except InputError as error:
        faults = (Fault(("sumo", "config"), one) for one in error.faults)
        raise InputError(*(placed(fault, places) for fault in faults)) from error
    laws = find_laws(spec, loaded.find, loaded.stale)
    metrics, unsound = metric_plug_ins.find(spec.record.metrics, folder)
    if (loaded.to_branch and not _receivers(laws)) or _deaf(laws, places.arguments):
        spec = spec.model_copy(update={"channel": None})
    if faults := [*faults_of(spec, files, laws, folder), *unsound]:
        raise InputError(*(placed(fault, places) for fault in faults))
    return Scenario(
        spec=spec,
        source=source,
        net=files.net,
        route_files=files.routes,
        additional=files.additional,
        configuration=files.configuration,
        laws={role: found.law for role, found in laws.items()},
        plug_ins={role: found.plug_in for role, found in laws.items() if found.plug_in},
        sources=tuple(sorted(set().union(*(found.sources for found in laws.values())))),
        metrics=metrics,
        sensors={role: found.sensors for role, found in laws.items()},
        varied=loaded.varied,
        place=places,
    )
