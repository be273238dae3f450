"""Overrides: keys of a scenario that are set on the command line or by a study, `platoon.size=3`."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from platoontraffic.errors import InputError
from platoontraffic.scenario.driver_tables import SHORT
from platoontraffic.scenario.faults import KeyPath, dotted
from platoontraffic.scenario.toml_lines import loads

TEXTS = frozenset({"edge", "to", "id", "name", "title", "net", "config"})  # keys of texts that may look like a number
_NUMBER = re.compile(r"[+-]?(\d+\.|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)  # .2 and 5., which TOML does not have


class Change(NamedTuple):
    """A key that differs from the file, and where the change is given."""

    key: str  # dotted; a key of `platoon` without a number is set in every platoon
    value: Any
    place: str  # `argument 2`, or `file:line`
    text: str  # as it was written

    @classmethod
    def parse(cls, argument: str, number: int) -> Change:
        """The change that an argument `key=value` asks for. number: of the argument, from 1. raises: InputError"""
        key, equals, text = argument.partition("=")
        if not equals or not all(key.split(".")):
            raise InputError(f"argument {number}: {argument!r}: must be key=value")
        try:
            return cls(key, _value(key, text), f"argument {number}", argument)
        except ValueError as error:
            raise InputError(f"argument {number}: {argument!r}: {error}") from error

    def fault(self, what: str) -> InputError:
        return InputError(f"{self.place}: {self.text!r}: {what}")


def check_once(changes: Iterable[Change]) -> None:
    """raises: InputError where two arguments set the same key, of which one would be lost"""
    first: dict[str, Change] = {}
    for change in changes:
        if (before := first.setdefault(change.key, change)) is not change:
            raise change.fault(f"the same key as {before.place}, {before.text!r}; must be given once")


def leaves(table: Mapping[str, Any], path: KeyPath) -> Iterator[tuple[str, KeyPath, Any]]:
    """(dotted key, path in the file, value) of every value in tables inside one another; a range is a value."""
    for name, value in table.items():
        if isinstance(value, dict) and "from" not in value:
            for key, inner, leaf in leaves(value, (*path, name)):
                yield f"{name}.{key}", inner, leaf
        else:
            yield name, (*path, name), value


def _value(key: str, text: str) -> Any:
    """A TOML value, or the text itself: a bare word is a string, and an edge may have a number for a name.

    raises: ValueError
    """
    if "\n" in text:
        return text
    is_text = key.rpartition(".")[2] in TEXTS
    try:
        value = loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return float(text) if _NUMBER.fullmatch(text) and not is_text else text
    return text if is_text and not isinstance(value, str) else value


def branch_of(at: float, changes: Sequence[Change]) -> list[Change]:
    """The changes of the key `branch` by which these happen at a time [s]."""
    time = Change("branch.at_s", float(at), "--branch-at", str(at))
    return [time, *(change._replace(key=f"branch.then.{change.key}") for change in changes)]


def apply(change: Change, table: dict) -> list[KeyPath]:
    """Make a change in the table of a scenario file.

    returns : paths of the keys that are now set; several where the change holds for all tables of an array
    raises  : InputError where the key leads through something that is not a table
    """
    *names, last = change.key.split(".")
    nodes: list[tuple[Any, KeyPath]] = [(table, ())]
    for name in names:
        nodes = [inner for node, path in nodes for inner in _children(node, path, name, change)]
    paths = []
    for node, at in nodes:
        for item, path in _tables(node, at):
            if not isinstance(item, dict):
                raise change.fault(f"{dotted(path)} is not a table")
            item[last] = copy.deepcopy(change.value)
            paths.append((*path, last))
    return paths


def _children(node: Any, path: KeyPath, name: str, change: Change) -> list[tuple[Any, KeyPath]]:
    """The nodes that a name leads to from a node; from an array of tables without a number, one child of each table."""
    if isinstance(node, list) and name.lstrip("-").isdecimal():
        return [_item(node, path, name, change)]
    if isinstance(node, list):
        return [child for item, at in _tables(node, path) for child in _children(item, at, name, change)]
    if not isinstance(node, dict):
        raise change.fault(f"{dotted(path)} is not a table")
    if isinstance(node.get(name), str) and name in SHORT:
        node[name] = {SHORT[name]: node[name]}
    return [(node.setdefault(name, {}), (*path, name))]


def _item(node: list, path: KeyPath, name: str, change: Change) -> tuple[Any, KeyPath]:
    if not name.isdecimal():
        raise change.fault("tables are numbered from 0")
    if len(name) > 9 or int(name) >= len(node):
        raise change.fault(f"there are {len(node)}, numbered from 0")
    return node[int(name)], (*path, int(name))


def _tables(node: Any, path: KeyPath) -> list[tuple[Any, KeyPath]]:
    """The tables of an array with their paths, or the node itself."""
    return [(item, (*path, i)) for i, item in enumerate(node)] if isinstance(node, list) else [(node, path)]
