"""Sphinx extension: the parts of the manual that the code says itself.

A line `<!-- from the code: NAME -->` of a page is replaced by the Markdown that `PARTS[NAME]` makes, when the manual is
built. Docstrings in the pages of the Python interface are shown as they are written.
"""

from __future__ import annotations

import inspect
import json
import math
import re
import textwrap
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from sphinx.application import Sphinx
from typer.models import ArgumentInfo

from platoontraffic import shipped
from platoontraffic.cli.main import app as command_line
from platoontraffic.cli.printing import title
from platoontraffic.controllers.described import schema_of
from platoontraffic.controllers.gains import keys_of
from platoontraffic.controllers.law import Law
from platoontraffic.controllers.registry import find_law, law_names
from platoontraffic.lidar import PRESETS
from platoontraffic.observation.instant import Instant
from platoontraffic.observation.observer import Measures
from platoontraffic.results import columns, metrics
from platoontraffic.results.data_package import SUMMARY
from platoontraffic.results.scans import FIELDS
from platoontraffic.results.statistics import QUANTITIES
from platoontraffic.results.sumo_tables import TABLES
from platoontraffic.scenario import Spec
from platoontraffic.study.study import StudyFile
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Motion
from platoontraffic.vehicles.odometry import ODOMETRY
from platoontraffic.world.events import EVENT_KINDS, Event
from platoontraffic.world.traffic import TrafficSnapshot

MARK = re.compile(r"^<!-- from the code: (.+) -->$", re.MULTILINE)
FAR = 1e9  # limits beyond this are not worth a word
WORDS = {"string": "text", "boolean": "true or false", "integer": "whole number", "object": "table"}

Schema = Mapping[str, Any]


# ---- scenario and study files


def keys_of_files(file: type[BaseModel], top: str) -> str:
    """Every table of a file, with its keys; a table that occurs at several places is described at the first one."""
    schema = file.model_json_schema()
    known, places = schema.get("$defs", {}), {}
    for name, place in _tables_in(schema, known, ""):
        places.setdefault(name, [])
        if place not in places[name]:
            places[name].append(place)
    text = [_table_of_keys(f"Keys of the {top} itself", schema, known)]
    for name, (place, *also) in places.items():
        text.append(_table_of_keys(_heading(place, known[name]), known[name], known, also))
    return "\n\n".join(text)


def _heading(place: str, table: Schema) -> str:
    kind = _object(table)["properties"].get("kind", {}).get("const")
    return f"`{place}`" + (f" of kind `{kind}`" if kind else "")


def _object(schema: Schema) -> Schema:
    """The table among the alternatives of a schema, of which a name is another."""
    return schema if "properties" in schema else next(one for one in schema["anyOf"] if "properties" in one)


def _tables_in(table: Schema, known: Mapping[str, Schema], place: str) -> Iterator[tuple[str, str]]:
    """(definition, place) of each table below one, each with those inside it."""
    for key, value in _object(table)["properties"].items():
        for name, listed in _definitions(value):
            where = f"{place}.{key}" if place else key
            where += ".NAME" if "patternProperties" in value else ""
            yield name, f"[[{where}]]" if listed else f"[{where}]"
            yield from _tables_in(known[name], known, where)


def _definitions(schema: Schema, listed: bool = False) -> Iterator[tuple[str, bool]]:
    if "$ref" in schema:
        yield schema["$ref"].rpartition("/")[2], listed
    for one in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("patternProperties", {}).values()):
        yield from _definitions(one, listed)
    if "items" in schema:
        yield from _definitions(schema["items"], True)


def _table_of_keys(heading: str, table: Schema, known: Mapping[str, Schema], also: Iterable[str] = ()) -> str:
    described = _object(table)
    text = [f"## {heading}", _prose(described.get("description") or table.get("description", ""))]
    if also:
        text.append("The same keys are in " + ", ".join(f"`{place}`" for place in also) + ".")
    required = described.get("required", ())
    for key, value in described["properties"].items():
        facts = [_kind(value), "required" if key in required else _default(value)]
        text.append(_entry(key, facts, value.get("description") or next(_described(value, known), "")))
    return "\n\n".join(filter(None, text))


def _described(value: Schema, known: Mapping[str, Schema]) -> Iterator[str]:
    return (_object(known[name]).get("description", "") for name, _ in _definitions(value))


def _entry(key: str, facts: Iterable[str], meaning: str) -> str:
    return f"`{key}` — {', '.join(filter(None, facts))}\n: {_prose(meaning)}"


def _prose(text: str) -> str:
    """Text of the code as Markdown of one line a paragraph: what looks like markup is none."""
    paragraphs = (" ".join(part.split()) for part in text.split("\n\n"))
    return "\n\n".join(re.sub(r"(?<!\\)([\[\]*_<>|])(?=(?:[^`]*`[^`]*`)*[^`]*$)", r"\\\1", part) for part in paragraphs)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _kind(schema: Schema) -> str:
    """What a key may hold: its type and limits."""
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(one)}`" for one in schema["enum"])
    for several in ("anyOf", "oneOf"):
        if several in schema:
            kinds = [_kind(one) for one in schema[several] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if "$ref" in schema:
        return "table"
    if schema.get("type") == "array":
        return f"list of {_kind(schema['items'])}" if schema.get("items") else "list"
    if schema.get("type") == "object" and "patternProperties" in schema:
        return "tables by name"
    if schema.get("format") == "path":
        return "file"
    return " ".join(filter(None, (WORDS.get(schema.get("type", ""), schema.get("type", "")), _limits(schema))))


def _limits(schema: Schema) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    limits = [
        f"≥ {low:,}" if low is not None and low > -FAR else "",
        f"> {above:,}" if above is not None else "",
        f"≤ {high:,}" if high is not None and high < FAR else "",
        f"< {below:,}" if below is not None and below < FAR else "",
    ]
    return ", ".join(filter(None, limits))


def _default(schema: Schema) -> str:
    """The default as TOML has it; keys whose default is a table or none say it in their meaning."""
    default = schema.get("default")
    if default is None or isinstance(default, dict) or "$ref" in schema:
        return ""
    return f"default `{_number(default)}`"


def _number(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)


# ---- laws, sensors, vehicles


def laws() -> str:
    """The shipped ones; those of other packages that are installed are left out."""
    kinds = {name: find_law(name, Path()).kind for name in law_names()}
    return "\n\n".join(
        _law(name, kind) for name, kind in kinds.items() if kind.__module__.startswith("platoontraffic.")
    )


def _law(name: str, kind: type) -> str:
    module = inspect.getmodule(kind)
    where = module.__name__.replace(".", "/") + ".py"
    bases = [one for one in kind.__mro__[1:-1] if one is not Law and issubclass(one, Law)]
    text = [f"## `{name}`", _block(kind.__doc__), *(_block(one.__doc__) for one in bases)]
    if (module.__doc__ or "").count("\n"):
        text.append(f"From the head of `{where}`:\n\n{_block(module.__doc__)}")
    else:
        text.append(f"File: `{where}`.")
    needs = ", ".join(f"`{need}`" for need in sorted(_needs(kind)))
    text.append(f"It is given, beside its scan and own motion: {needs}." if needs else "")
    return "\n\n".join(filter(None, (*text, *_gains(kind))))


def _needs(kind: type) -> Iterable[str]:
    try:
        return kind().needs
    except TypeError:  # a gain without a default
        return ()


def _gains(kind: type) -> Iterator[str]:
    schema = schema_of(kind)
    of_field = {key: name for name, key in keys_of(kind).items()}
    for key, value in schema["properties"].items():
        nested = next((find for find, _ in _definitions(value)), None)
        if nested:
            law = next(f.type for f in fields(kind) if f.name == of_field[key])
            facts = [f"table of gains, those of `{law}`"]
        else:
            facts = [_kind(value), "required" if key in schema.get("required", ()) else _default(value)]
        yield _entry(key, facts, value["description"])


def _block(text: str | None) -> str:
    return f"```text\n{inspect.cleandoc(text or '')}\n```"


def lidars() -> str:
    rows = [
        (
            f"`{name}`",
            str(model.samples),
            f"{math.degrees(model.angle_max - model.angle_min):.4g}",
            f"{model.range_min:g} to {model.range_max:g}",
            f"{model.rate:g}",
            _errors(asdict(model.noise)),
        )
        for name, model in PRESETS.items()
    ]
    return _table(("preset", "beams", "field of view [deg]", "range [m]", "scans a second", "errors"), rows)


def _errors(noise: Mapping[str, float]) -> str:
    shown = {key: value for key, value in noise.items() if isinstance(value, float) and value}
    if "dropout_grazing" not in shown:
        shown.pop("grazing_from", None)
    return ", ".join(f"`{key}` {value:.4g}" for key, value in shown.items()) or "none"


def odometry() -> str:
    names = list(asdict(next(iter(ODOMETRY.values()))))
    rows = [(f"`{name}`", *(f"{value:.4g}" for value in asdict(errors).values())) for name, errors in ODOMETRY.items()]
    return _table(("preset", *(name.replace("_", " ") for name in names)), rows)


def vehicles() -> str:
    """A table for each class of vehicles: a row a quantity, in SI and radians."""
    of_class: dict[type, list[str]] = {}
    for name, vehicle in VEHICLES.items():
        of_class.setdefault(type(vehicle), []).append(name)
    tables = []
    for kind, names in of_class.items():
        rows = [
            (f.name.replace("_", " "), *(_number(getattr(VEHICLES[name], f.name)) for name in names))
            for f in fields(kind)
        ]
        tables.append(_table(("[SI, rad]", *(f"`{name}`" for name in names)), rows))
    return "\n\n".join(tables)


# ---- results


def tables_of_results() -> str:
    files = {
        "trajectories.csv": columns.TRAJECTORIES,
        "events.csv": columns.EVENTS,
        "encounters.csv": columns.ENCOUNTERS,
        "trips.csv": columns.TRIPS,
        "passages.csv": columns.PASSAGES,
        "traffic.csv": columns.TRAFFIC,
        "metrics.csv": columns.METRICS,
        "statistics.csv": columns.STATISTICS,
        "vehicles.csv": columns.VEHICLES,
        **{f"sumo_{name}.csv": table.written for name, table in TABLES.items()},
    }
    text = [f"## `{file}`\n\n" + "\n\n".join(map(_column, rows)) for file, rows in files.items()]
    quantities = ((f"`{one.name}`", one.unit, _prose(one.meaning) or "as in trajectories.csv") for one in QUANTITIES)
    text.append("## Quantities of `statistics.csv`\n\n" + _table(("quantity", "unit", "meaning"), quantities))
    text.append(f"## `summary.csv`\n\n{_prose(SUMMARY)}.")
    arrays = (_entry(name, ["array", unit and f"in {unit}"], meaning) for name, (unit, meaning) in FIELDS.items())
    text.append("## `scans.npz`\n\n" + "\n\n".join(arrays))
    text.append(f"## `scene.geojson`\n\n{_prose(columns.SCENE)}")
    return "\n\n".join(text)


def _column(column: columns.Column) -> str:
    return _entry(
        column.name,
        [WORDS.get(column.type, column.type), column.unit and f"in {column.unit}"],
        _capital(column.meaning),
    )


def events() -> str:
    text = []
    for kind in EVENT_KINDS.values():
        words = f" `what`: {', '.join(f'`{word}`' for word in kind.words)}." if kind.words else ""
        text.append(f"`{kind.name}`\n: {_prose(_capital(kind.meaning))}.{words}")
    return "\n\n".join(text)


def metrics_of_runs() -> str:
    groups = {
        "Of every member": metrics.OF_MEMBERS,
        "Of followers": metrics.OF_FOLLOWERS,
        "Of platoons and the run": metrics.OF_GROUPS,
        "Of strings": metrics.OF_STRINGS,
        "Of runs with obstacles": metrics.OF_OBSTACLES,
        "Of trips: the scopes `traffic`, `everybody` and `equipped`": metrics.OF_TRAFFIC,
    }
    return "\n\n".join(f"## {name}\n\n" + "\n\n".join(map(_metric, rows)) for name, rows in groups.items())


def _metric(metric: metrics.Metric) -> str:
    over = f"platoons and the run: `{metrics.name_over(metric.name, metric.over)}`" if metric.over else ""
    unit = f"in {metric.unit}" if metric.unit else "a number"
    return _entry(metric.name, [unit, over], _capital(metric.meaning))


# ---- command line, shipped files


def commands() -> str:
    return "\n\n".join(_commands(command_line, "platoontraffic"))


def _commands(app: typer.Typer, path: str) -> Iterator[str]:
    for command in app.registered_commands:
        yield _command(f"{path} {command.name}", command.callback)
    for group in app.registered_groups:
        yield from _commands(group.typer_instance, f"{path} {group.name}")


def _command(name: str, function: Callable) -> str:
    hints, usage, entries = typing.get_type_hints(function, include_extras=True), [name], []
    for one in inspect.signature(function).parameters.values():
        (info,) = hints[one.name].__metadata__
        kind = hints[one.name].__origin__
        if isinstance(info, ArgumentInfo):
            value = info.metavar or one.name.upper()
            usage.append(value if one.default is one.empty or value.startswith("[") else f"[{value}]")
            entries.append(f"`{value}`\n: {_prose(info.help)}")
            continue
        names = [one for one in (info.default, *info.param_decls) if isinstance(one, str)]
        options = ", ".join(names or [f"--{one.name.replace('_', '-')}"])
        value = "" if kind is bool else f" {info.metavar or _value_of(kind)}"
        default = "" if one.default in (None, False) else f". Default: `{one.default}`"
        entries.append(f"`{options}{value}`\n: {_prose(info.help)}{default}")
    usage.append("[OPTIONS]")
    return "\n\n".join((f"## `{name}`", f"```text\n{' '.join(usage)}\n```", _prose(inspect.getdoc(function)), *entries))


def _value_of(kind: Any) -> str:
    """What stands for a value of this type in a usage line."""
    words = {int: "N", float: "NUMBER", Path: "PATH"}
    return next((words[one] for one in (kind, *typing.get_args(kind)) if one in words), "TEXT")


def shipped_files() -> str:
    text = ["## Scenarios", _table(("name", "what happens"), _titles(shipped.scenarios()))]
    text += ["## Studies", _table(("name", "what is varied"), _titles(shipped.studies()))]
    return "\n\n".join(text)


def _titles(files: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    return ((f"`{name}`", _prose(title(file))) for name, file in files.items())


# ---- Python


def instant() -> str:
    """The fields of an instant, and of what it consists of."""
    parts = {
        "instant": Instant,
        "instant.traffic": TrafficSnapshot,
        "instant.fleet.motion": Motion,
        "instant.measures": Measures,
        "instant.events[i]": Event,
    }
    text = []
    for name, kind in parts.items():
        first = inspect.getdoc(kind).partition("\n\n")[0]
        text += [f"### `{name}`", _prose(first), _table(("field", "meaning"), _commented(kind))]
    return "\n\n".join(text)


def _commented(kind: type) -> Iterator[tuple[str, str]]:
    """Fields of a class and the comments on them in its source."""
    above: list[str] = []
    for line in inspect.getsource(kind).splitlines():
        if line.startswith("    # "):
            above.append(line.strip(" #"))
        elif field := re.fullmatch(r"    (\w+): .*?(?:  # (.*))?", line):
            yield f"`{field[1]}`", _prose(" ".join((*above, field[2] or "")).strip())
            above = []


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = tuple(head)
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


PARTS: Mapping[str, Callable[[], str]] = {
    "scenario": lambda: keys_of_files(Spec, "scenario"),
    "study": lambda: keys_of_files(StudyFile, "study"),
    "laws": laws,
    "lidars": lidars,
    "odometry": odometry,
    "vehicles": vehicles,
    "tables": tables_of_results,
    "events": events,
    "metrics": metrics_of_runs,
    "commands": commands,
    "shipped": shipped_files,
    "instant": instant,
}


# ---- Sphinx


def _replaced(app: Sphinx, name: str, source: list[str]) -> None:
    source[0] = MARK.sub(lambda mark: PARTS[mark[1]](), source[0])


def _always(app: Sphinx, env: Any, added: set, changed: set, removed: set) -> list[str]:
    """Pages with such parts are made anew at every build."""
    return [name for name in env.found_docs if MARK.search(Path(env.doc2path(name)).read_text(encoding="utf-8"))]


def _docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """A docstring's first paragraph is prose; what follows has columns of its own, and is shown as it is."""
    first, _, rest = "\n".join(lines).partition("\n\n")
    prose = re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", first.replace("*", r"\*").replace("|", r"\|"))
    rest = rest.strip("\n")
    lines[:] = prose.splitlines()
    if rest:
        lines += ["", ".. code-block:: text", "", *textwrap.indent(rest, "   ").splitlines(), ""]


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", _replaced)
    app.connect("env-get-outdated", _always)
    app.connect("autodoc-process-docstring", _docstring)
    return {"parallel_read_safe": True}
