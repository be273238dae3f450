"""Study files: one scenario at many points, each run with the same seeds.

TOML in, a list of runs out. All faults of all runs are reported before the first run starts, one line per fault.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tomli_w
from pydantic import Field, ValidationError, field_validator

from platoontraffic import scenario, shipped
from platoontraffic.errors import InputError, did_you_mean, no_file
from platoontraffic.results import provenance
from platoontraffic.road.network import Network
from platoontraffic.scenario import Change, Identifier, Scenario, Table, dotted, fault_of, toml_lines
from platoontraffic.scenario.named_code import BeforeCode
from platoontraffic.scenario.overrides import check_once, leaves
from platoontraffic.scenario.scenario import relative_to
from platoontraffic.study.conditions import Condition, condition
from platoontraffic.study.folder_lock import SHARES

ENOUGH_FAULTS = 20  # number of faults at which the search for more ends
EQUIPPED = 100  # vehicles of the traffic on the road at a time, for the estimate of a run's time
MOST = len(SHARES)  # greatest number of runs of a study, and of values of a key

RANGE = "a range: { from = 1, to = 5, step = 1 }, or with `count`"

Keys = dict[str, Any]  # scenario keys, dotted or as tables inside one another
Place = Callable[[tuple], str]  # path of a key -> its place in the study: `file:line`

ROADS = ("sumo.net", "sumo.config")  # keys that name a file of the road


class StudyFile(Table):
    """A study file: a scenario at many points, each run with the same seeds."""

    name: Identifier = "study"
    """Name of the study, and of the folder of its results. If not given: the file's name."""
    title: str = ""
    """One line that says what is varied."""
    base: Annotated[str, Field(min_length=1)]
    """The scenario: name of a shipped one, or a file, relative to this one."""
    seeds: list[Any] | dict[str, Any] | None = None
    """Seeds of every point, a list or a range such as { from = 1, to = 5 }. Default: the seed of the scenario."""
    replications: Annotated[int, Field(ge=1, le=MOST)] | None = None
    """Number of seeds 1, 2 and so on, in place of `seeds`."""
    set: Keys = Field(default_factory=dict)
    """Keys of the scenario that differ from the base in every run."""
    grid: Keys = Field(default_factory=dict)
    """Keys with lists or ranges of values: the points are all combinations."""
    zip: Keys | list[Keys] = Field(default_factory=dict)
    """Keys with equally long lists or ranges of values: all first values make a point, then all second ones, and so on.
    A list of such tables combines them as the grid does."""
    leave_out: list[str] = Field(default_factory=list)
    """Conditions such as "platoon.size > 5 and platoon.gap_m < 0.4": points at which one of them holds are left out."""

    @field_validator("seeds", mode="before")
    @classmethod
    def list_or_range(cls, seeds: Any) -> Any:
        if not isinstance(seeds, list | dict):
            raise ValueError("must be a list of whole numbers, or a range: { from = 1, to = 5 }")
        return seeds


@dataclass(frozen=True)
class Run:
    """One run of a study."""

    id: str  # `provenance.run_id`; name of its folder
    base: str  # for `scenario.load`, valid in any folder
    seed: int
    values: Mapping[str, Any]  # varied key -> value; one object per point
    changes: tuple[Change, ...]  # of the base, these values included
    steps: int
    members: int
    laws: tuple[str, ...]  # their names
    warm_up: str  # equal for runs with the same warm-up; "" without one
    warm_up_s: float
    random: bool  # whether anything in it may depend on the seed

    @property
    def point(self) -> str:
        """Equal for runs that differ in the seed alone."""
        return self.id.removesuffix(f"-s{self.seed}")


@dataclass(frozen=True)
class Study:
    """A checked study: none of its runs has a fault in its input."""

    name: str
    source: Path
    base: str  # for `scenario.load`, valid in any folder
    keys: tuple[str, ...]  # varied ones
    runs: tuple[Run, ...]
    table: dict[str, Any]  # the study as TOML, with all values written out

    def text(self, folder: Path) -> str:
        """The study as a file in `folder`."""
        base = self.base
        if base not in shipped.scenarios():
            base = relative_to(Path(base), folder)
        return tomli_w.dumps(self.table | {"base": base})

    def block(self, shard: int, shards: int) -> range:
        """The part of `shuffled` that belongs to a shard, counted from 1; every run is in exactly one shard."""
        n = len(self.runs)
        return range(n * (shard - 1) // shards, n * shard // shards)

    def shuffled(self) -> list[Run]:
        """All runs in an order that does not depend on their values, so that shards take about the same time."""
        return sorted(self.runs, key=lambda run: hashlib.sha256(run.id.encode()).digest())


class Axis(NamedTuple):
    """Values that vary together: of one key of the grid, or of all keys of a zip."""

    table: str  # "grid" or "zip"
    keys: tuple[str, ...]
    rows: tuple[tuple[Change, ...], ...]


def load(name_or_file: str | Path, arguments: Sequence[str] = (), before_code: BeforeCode | None = None) -> Study:
    """The study of a file, or a shipped one by name; `key=value` arguments are set in every run.

    before_code: as for `scenario.load`

    raises: InputError with one line for every fault found
    """
    if not isinstance(name_or_file, str | Path):
        raise InputError(f"study: {name_or_file!r}: must be a file, or the name of a shipped one")
    if not all(isinstance(argument, str) for argument in arguments):
        raise InputError(f"changes: {arguments}: must be texts such as 'platoon.size=3'")
    source = _find(name_or_file)
    file, place = _read(source)
    base = _base(file.base, source, place)
    located = partial(_located, beside=(source.parent, shipped.scenarios().get(base, Path(base)).parent))
    fixed = [located(Change(key, value, place(path), key)) for key, path, value in leaves(file.set, ("set",))]
    given = [Change.parse(argument, number) for number, argument in enumerate(arguments, start=1)]
    check_once(given)
    fixed += given
    axes = [axis._replace(rows=tuple(tuple(map(located, row)) for row in axis.rows)) for axis in _axes(file, place)]
    keys = tuple(key for axis in axes for key in axis.keys)
    first = [change for axis in axes for change in axis.rows[0]]
    _check_keys(first, fixed)
    seeds = _seeds(file, place)
    checked = partial(scenario.load, base, seed=seeds[0] if seeds else None, before_code=before_code)
    try:
        left_out = _left_out(file, keys, place)
    except InputError as error:  # a key may be wrong in the grid, and right in the condition
        raise InputError(*_faults(checked, [*fixed, *first]), *error.faults) from None
    runs = tuple(_runs(_points(file, axes, left_out, place), base, checked, fixed, seeds, source))
    written_out = {
        "name": file.name,
        "title": file.title,
        "base": base,
        "seeds": seeds or [runs[0].seed],
        "set": {change.key: change.value for change in fixed},
        "grid": {axis.keys[0]: [change.value for (change,) in axis.rows] for axis in axes if axis.table == "grid"},
        "zip": [
            {key: [row[i].value for row in axis.rows] for i, key in enumerate(axis.keys)}
            for axis in axes
            if axis.table == "zip"
        ],
        "leave_out": file.leave_out,
    }
    return Study(file.name, source, base, keys, runs, written_out)


def is_study(name_or_file: str | Path) -> bool:
    """Whether this names a study and not a scenario; False if it cannot be read."""
    if str(name_or_file) in shipped.studies():
        return True
    try:
        return "base" in scenario.read_toml(name_or_file)[0]
    except InputError:  # reported later, when it is read as a scenario
        return False


def _find(name_or_file: str | Path) -> Path:
    known = shipped.studies()
    if str(name_or_file) in known:
        return known[str(name_or_file)]
    file = Path(name_or_file)
    absent = no_file(file)
    if not absent:
        return file
    if not no_file(file / "study.toml"):
        raise InputError(f"{file}: is the folder of a batch; its study is {file / 'study.toml'}")
    if str(name_or_file) in shipped.scenarios():
        raise InputError(f"{name_or_file}: is a scenario, not a study; `platoontraffic run` runs it")
    if absent == "is a folder":
        raise InputError(f"{file}: is a folder; must be a study file, or the name of a shipped study")
    if absent != "no such file":
        raise InputError(f"{name_or_file}: {absent}")
    raise InputError(f"{name_or_file}: no such study file, nor a shipped study{did_you_mean(str(name_or_file), known)}")


def _read(source: Path) -> tuple[StudyFile, Place]:
    table, lines = scenario.read_toml(source)

    def place(path: tuple) -> str:
        line = toml_lines.line_of(lines, path)
        return f"{source}:{line}" if line else str(source)

    if "platoon" in table and "base" not in table:
        raise InputError(f"{source}: is a scenario, not a study: it has no base; `platoontraffic run` runs it")
    table.setdefault("name", re.sub(r"[^A-Za-z0-9_-]", "_", source.stem))
    try:
        return StudyFile.model_validate(table), place
    except ValidationError as error:
        raise InputError(*(f"{place(f['loc'])}: {fault_of(f, StudyFile)}" for f in error.errors())) from None


def _base(base: str, source: Path, place: Place) -> str:
    known = shipped.scenarios()
    if base in known:
        return base
    file = source.parent / base
    if absent := no_file(file):
        what = absent.replace(
            "no such file", f"no such scenario file, nor a shipped scenario{did_you_mean(base, known)}"
        )
        what = what.replace("is a folder", "is a folder; must be a scenario file, or the name of a shipped scenario")
        raise InputError(f"{place(('base',))}: base: {base!r}: {what}")
    return str(file.resolve())


def _located(change: Change, beside: tuple[Path, Path]) -> Change:
    """The change; it names a road's file that lies beside the study, and not beside the base, by its whole path.

    beside: folders of the study and of the base, from which a scenario's names of files start
    """
    if change.key not in ROADS or not isinstance(change.value, str):
        return change
    of_study, of_base = (folder / change.value for folder in beside)
    return change._replace(value=str(of_study.resolve())) if of_study.is_file() and not of_base.is_file() else change


def _axes(file: StudyFile, place: Place) -> list[Axis]:
    axes = []
    for key, path, value in leaves(file.grid, ("grid",)):
        at = place(path)
        values = _values(value, f"{at}: {dotted(path)}")
        axes.append(Axis("grid", (key,), tuple((Change(key, value, at, key),) for value in values)))
    tables = [(("zip",), file.zip)] if isinstance(file.zip, dict) else [(("zip", i), t) for i, t in enumerate(file.zip)]
    for at, table in tables:
        columns = []
        for key, path, value in leaves(table, at):
            values = _values(value, f"{place(path)}: {dotted(path)}", repeat=True)
            columns.append([Change(key, value, place(path), key) for value in values])
        if len({len(column) for column in columns}) > 1:
            lengths = ", ".join(f"{column[0].key} {len(column)}" for column in columns)
            raise InputError(f"{place(at)}: {dotted(at)}: must have equally many values of every key; has of {lengths}")
        if columns:
            rows = tuple(zip(*columns, strict=True))
            axes.append(Axis("zip", tuple(change.key for change in rows[0]), rows))
    return axes


def _values(value: Any, key: str, repeat: bool = False) -> list[Any]:
    """The values of a list or a range.

    key    : with its place, for faults
    repeat : whether a value may come twice
    """
    if isinstance(value, dict):
        value = _range(value, key)
    if not isinstance(value, list):
        raise InputError(f"{key}: {value!r}: must be a list of values, or {RANGE}")
    if not value:
        raise InputError(f"{key}: is empty; must have one value or more")
    if len(value) > MOST:
        raise InputError(f"{key}: {len(value)} values; must be at most {MOST}")
    if not repeat:
        for i, one in enumerate(value):
            if one in value[:i]:
                raise InputError(f"{key}: has {one!r} twice")
    return value


def _range(table: dict[str, Any], key: str) -> list[float]:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in table.values())
    if set(table) not in ({"from", "to", "step"}, {"from", "to", "count"}) or not numbers:
        raise InputError(f"{key}: {table}: must be a list of values, or {RANGE}")
    first, last = table["from"], table["to"]
    if not math.isfinite(last - first):
        raise InputError(f"{key}: {table}: must be a shorter range")
    if "count" in table:
        count = table["count"]
        if not (isinstance(count, int) and 2 <= count <= MOST):
            raise InputError(f"{key}: count = {count}: must be a whole number from 2 to {MOST}")
        step = (last - first) / (count - 1)
    else:
        step = table["step"]
        if step <= 0 or last < first or (last - first) / step > MOST:
            raise InputError(f"{key}: {table}: must go up from `from` to `to`, by a positive `step`, {MOST} at most")
        count = math.floor((last - first) / step + 1e-9) + 1
    if all(isinstance(v, int) for v in table.values()) and float(step).is_integer():
        return [first + i * int(step) for i in range(count)]
    return [float(f"{first + i * step:.12g}") for i in range(count)]  # 0.3, not 0.30000000000000004


def _check_keys(varied: Sequence[Change], fixed: Sequence[Change]) -> None:
    given = {change.key: change for change in fixed}
    seen: set[str] = set()
    for change in varied:
        if change.key == "seed":
            raise InputError(f"{change.place}: seed: is not a parameter; must be given by the key `seeds`")
        if change.key in seen:
            raise InputError(f"{change.place}: {change.key}: is varied twice")
        if change.key in given:
            raise given[change.key].fault(f"is varied by the study, {change.place}")
        seen.add(change.key)
    for change in fixed:
        if change.key == "seed":
            raise change.fault("must be given by the key `seeds` of the study")


def _seeds(file: StudyFile, place: Place) -> list[int]:
    """The seeds; an empty list if none are given."""
    if file.seeds is not None and file.replications is not None:
        raise InputError(f"{place(('replications',))}: replications: must not be given beside seeds")
    if file.replications:
        return list(range(1, file.replications + 1))
    if file.seeds is None:
        return []
    key = f"{place(('seeds',))}: seeds"
    given = file.seeds
    if isinstance(given, dict) and given.keys() == {"from", "to"}:
        given = {**given, "step": 1}
    seeds = _values(given, key)
    for seed in seeds:
        if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**31:
            raise InputError(f"{key}: {seed!r}: must be whole numbers from 0 to {2**31 - 1}")
    return seeds


def _left_out(file: StudyFile, keys: Sequence[str], place: Place) -> list[Condition]:
    return [condition(text, keys, f"{place(('leave_out',))}: leave_out") for text in file.leave_out]


def _faults(load_base: Callable[[Sequence[Change]], Scenario], changes: Sequence[Change]) -> Sequence[str]:
    """What is wrong with one point."""
    try:
        load_base(changes)
    except InputError as error:
        return error.faults
    return ()


def _points(
    file: StudyFile, axes: Sequence[Axis], left_out: Sequence[Condition], place: Place
) -> Iterator[tuple[Change, ...]]:
    """All combinations that are not left out; the last key changes fastest."""
    combinations = math.prod(len(axis.rows) for axis in axes)
    if combinations > MOST:
        raise InputError(f"{place(('grid',))}: grid: {combinations} combinations; must be at most {MOST}")
    left = 0
    for rows in itertools.product(*(axis.rows for axis in axes)):
        point = tuple(change for row in rows for change in row)
        values = [change.value for change in point]
        if not any(holds(values) for holds in left_out):
            left += 1
            yield point
    if not left:
        raise InputError(f"{place(('leave_out',))}: leave_out: leaves out all runs")


def _runs(
    points: Iterable[tuple[Change, ...]],
    base: str,
    load_base: Callable[[Sequence[Change]], Scenario],
    fixed: Sequence[Change],
    seeds: Sequence[int],
    source: Path,
) -> Iterator[Run]:
    """The runs of all points. raises: InputError with the faults of all points"""
    networks: dict[Path, Network] = {}
    faults: dict[str, str] = {}  # fault -> its text with the first point that has it
    taken: dict[str, str] = {}  # id -> point
    for point in points:
        at = ", ".join(f"{change.key} = {change.value!r}" for change in point)
        changes = (*fixed, *point)
        try:
            checked = load_base(changes)
            _deploy(checked, networks)
        except InputError as error:
            for fault in error.faults:
                known = not point or fault.startswith((f"{source}:", "argument "))
                faults.setdefault(fault, fault if known else f"{fault}; at {at}")
            if len(faults) >= ENOUGH_FAULTS:
                break
            continue
        point_id = provenance.point_id(checked)
        if point_id in taken:
            faults[point_id] = f"{point[0].place}: {at}: makes the same run as {taken[point_id]}"
        taken[point_id] = at
        if faults:
            continue
        spec, values = checked.spec, {change.key: change.value for change in point}
        steps, members = round(spec.run.duration_s / spec.run.step_s), sum(p.size for p in spec.platoon)
        members += round(sum(EQUIPPED * one.share for one in spec.equip))
        laws = tuple(dict.fromkeys(getattr(spec.groups[i], role).law for i, role in checked.laws))
        warm_up_id, warm_up_s, random = provenance.warm_up_id(checked), spec.sumo.warm_up_s, checked.random
        for seed in seeds or [checked.seed]:
            run_id, warm_up = f"{point_id}-s{seed}", warm_up_id and f"{warm_up_id}-s{seed}"
            yield Run(run_id, base, seed, values, changes, steps, members, laws, warm_up, warm_up_s, random)
    if faults:
        raise InputError(*faults.values())


def _deploy(checked: Scenario, networks: dict[Path, Network]) -> None:
    """Place the members, to find the faults of their start poses. raises: InputError"""
    from platoontraffic.world.deployment import deploy, static_scene  # compiled code, slow to import

    if checked.net not in networks:
        networks[checked.net] = Network.read(checked.net)
    network = networks[checked.net]
    deploy(checked, network, static_scene(checked, network))
