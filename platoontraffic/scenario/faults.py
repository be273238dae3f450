"""Errors of pydantic as faults of one line, `key: what; what is allowed`, in the words of a scenario file."""

from __future__ import annotations

import typing
from collections.abc import Collection
from typing import Any, NamedTuple

from pydantic import BaseModel

from platoontraffic.errors import did_you_mean, shortened
from platoontraffic.scenario.base import NAME
from platoontraffic.scenario.defaults import VEHICLE
from platoontraffic.scenario.driver_tables import SHORT
from platoontraffic.scenario.obstacle_tables import KINDS

VALUE = 200  # longest value that a fault repeats whole [characters]

KeyPath = tuple[str | int, ...]  # e.g. ("platoon", 0, "leader", "law")


class Fault(NamedTuple):
    """The fault of a key's value, and what is allowed."""

    path: KeyPath
    what: str


def dotted(path: KeyPath) -> str:
    return ".".join(map(str, path))


def fault_of(error: dict, model: type[BaseModel]) -> str:
    """`key: what; what is allowed`. model: the table that pydantic has validated"""
    return f"{dotted(fault_path(error))}: {what_of(error, model)}"


def fault_path(error: dict) -> KeyPath:
    """The path of the key in the file: pydantic puts the kind of an obstacle between its number and its key."""
    path = error["loc"]
    if path[:1] != ("obstacle",):
        return path
    if error["type"].startswith("union_tag"):
        return (*path, "kind")
    return (*path[:2], *path[3:]) if len(path) > 2 and path[2] in KINDS else path


def what_of(error: dict, model: type[BaseModel], beside: Collection[str] = ()) -> str:
    """`what; what is allowed`, without the key.

    beside: keys of the same table that are not of the model
    """
    path, kind, value = error["loc"], error["type"], error["input"]
    if kind == "union_tag_invalid":
        tag = error["ctx"]["tag"]
        return f"{tag!r}: not known{did_you_mean(tag, KINDS)}"
    if kind == "union_tag_not_found":
        return f"missing; known: {', '.join(sorted(KINDS))}"
    if kind == "extra_forbidden" and len(path) > 1 and path[-1] in _known_keys(model, ()):
        return f"unknown key; did you mean {path[-1]!r}, outside all tables?"
    if kind == "extra_forbidden":
        known = _known_keys(model, path[:-1]) + list(beside if len(path) == 1 else ())
        return f"unknown key{did_you_mean(str(path[-1]), known)}"
    if kind == "missing" and path[-1] in ("leader", "follower") and "vehicle" not in value:
        return f'missing: a {VEHICLE} has no default {path[-1]}; for a road: vehicle = "car"'
    if kind == "missing" and path == ("sumo",):
        return "missing: must name the road; platoons alone go with a SUMO configuration: run CFG --platoon FILE"
    if kind == "missing":
        return "missing"
    if kind == "list_type" and isinstance(value, dict):
        return f"must be a list of tables: there is none here to change, or [[{path[-1]}]] was meant"
    what = error["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        what = "should be a table, or a name" if path[-1] in SHORT else "should be a table"
    if kind == "string_pattern_mismatch" and error["ctx"]["pattern"] == NAME:
        what = "must be of letters A to Z, digits, _ and - only"
    return what if isinstance(value, dict | BaseModel) else f"{shortened(repr(value), VALUE)}: {what}"


def _known_keys(model: type[BaseModel], path: KeyPath) -> list[str]:
    """Keys of the table at a path, from the table `model` on."""
    if path[:1] == ("obstacle",) and len(path) > 2 and path[2] in KINDS:
        model, path = KINDS[path[2]], path[3:]
    names = iter([name for name in path if isinstance(name, str)])
    for name in names:
        annotation = model.model_fields[name].annotation
        if typing.get_origin(annotation) is dict:
            next(names, None)  # a name that the file has chosen
        model = _innermost(annotation)
    return [field.alias or name for name, field in model.model_fields.items()]


def _innermost(annotation: Any) -> Any:
    """The table T of an annotation such as `list[T] | None`, or `dict[str, T]`."""
    while arguments := typing.get_args(annotation):
        annotation = arguments[-1 if typing.get_origin(annotation) is dict else 0]
    return annotation
