"""The gains of a law in words and as JSON schema: for the manual, and for editors of scenario files."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
import tokenize
import typing
import warnings
from dataclasses import is_dataclass
from io import StringIO
from typing import Any

from platoontraffic.controllers.gains import Keys, _model_of, keys_of

UNITS = {  # by the end of a key; longer ones first
    "per_s2": "1/s2", "per_s": "1/s", "mps3": "m/s3", "mps2": "m/s2", "mps": "m/s", "radps": "rad/s", "rad": "rad",
    "deg": "deg", "hz": "Hz", "m": "m", "s": "s",
}  # fmt: skip


def schema_of(kind: type, refers: str = "#/$defs/{model}") -> dict[str, Any]:
    """JSON schema of the gains of a law; each key has its unit and meaning as its description.

    refers: pattern of references to the tables of gains inside it, which are in `$defs`
    """
    with warnings.catch_warnings(action="ignore"):  # an empty table has no JSON
        schema = _model_of(kind).model_json_schema(ref_template=refers)
    tables = schema.get("$defs", {})
    for table in (schema, *tables.values()):
        table.pop("description", None)  # pydantic's own
    _describe(kind, schema, tables)
    return schema


def _describe(kind: type, schema: dict[str, Any], tables: dict[str, Any]) -> None:
    hints, meanings = typing.get_type_hints(kind), meanings_of(kind)
    for name, key in keys_of(kind).items():
        schema["properties"][key]["description"] = ": ".join(filter(None, (in_words(key), meanings.get(name, ""))))
        if hints[name] is Keys:
            schema["properties"][key]["type"] = "object"
        if is_dataclass(hints[name]):
            _describe(hints[name], tables[hints[name].__name__], tables)


def in_words(key: str) -> str:
    """`time_headway_s` as Time headway [s]"""
    for ending, unit in UNITS.items():
        if key.endswith(f"_{ending}"):
            key, unit = key.removesuffix(f"_{ending}"), f" [{unit}]"
            break
    else:
        unit = ""
    text = key.replace("_", " ")
    return f"{text[:1].upper()}{text[1:]}{unit}"


def meanings_of(kind: type) -> dict[str, str]:
    """The meaning that the docstring lists for each field (`name   meaning`), or the comment beside or above it."""
    found = {}
    for one in reversed(kind.__mro__[:-1]):
        listed = re.findall(r"^(\w+) {2,}(\S.*(?:\n {4,}\S.*)*)", inspect.cleandoc(one.__doc__ or ""), re.MULTILINE)
        found |= {name: " ".join(text.split()) for name, text in listed if name in one.__dict__}
        try:
            source = textwrap.dedent(inspect.getsource(one))
        except (OSError, TypeError):
            continue
        lines = source.splitlines()
        beside = {
            token.start[0]: token.string.lstrip("# ")
            for token in tokenize.generate_tokens(StringIO(source).readline)
            if token.type == tokenize.COMMENT and "noqa" not in token.string
        }
        for node in ast.parse(source).body[0].body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                above = node.lineno - 1
                while lines[above - 1].lstrip().startswith("#"):
                    above -= 1
                places = range(above + 1, node.end_lineno + 1)
                if words := " ".join(beside[place] for place in places if place in beside):
                    found[node.target.id] = words
    return found
