"""TOML files with the line of each key, which tomllib does not tell."""

from __future__ import annotations

import pathlib
import re
import tomllib
from typing import Any

from platoontraffic.errors import InputError

_KEY = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:"[^"]*"|'[^']*'|[\w-]+))*)\s*=""")
_TABLE = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]")

Path = tuple[str | int, ...]  # of a key, e.g. ("platoon", 0, "leader", "law")


def read_toml(file: str | pathlib.Path) -> tuple[dict[str, Any], dict[Path, int]]:
    """The table in a TOML file, and the lines of its keys. raises: InputError if it cannot be read"""
    try:
        text = pathlib.Path(file).read_text(encoding="utf-8-sig")
        return tomllib.loads(text), key_lines(text)
    except tomllib.TOMLDecodeError as error:
        at = re.search(r"\(at line (\d+)", str(error))  # or at the end of the document
        line = at[1] if at else text.count("\n") + 1
        raise InputError(f"{file}:{line}: not valid TOML: {str(error).split(' (at')[0]}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def key_lines(text: str) -> dict[Path, int]:
    """Line number (from 1) by path of the key.

    Keys inside an inline table or array are on the line of the key that holds it. The text must be valid TOML.
    """
    lines: dict[Path, int] = {}
    table: Path = ()
    counts: dict[Path, int] = {}  # index of the newest table in each array of tables
    open_value = ""  # a value that goes on over several lines
    for number, line in enumerate(text.splitlines(), start=1):
        if open_value:
            open_value = "" if _is_complete(open_value + "\n" + line) else open_value + "\n" + line
        elif header := _TABLE.match(line):
            table = _with_indices(_names(header[2]), counts)
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines[(*table, *_names(key[1]))] = number
            if not _is_complete(line[key.end() :]):
                open_value = line[key.end() :]
    return lines


def line_of(lines: dict[Path, int], path: Path) -> int | None:
    """The line of the key, or of the nearest table or key around it; None if there is none."""
    while path:
        if path in lines:
            return lines[path]
        path = path[:-1]
    return None


def _names(dotted: str) -> Path:
    return tuple(part.strip().strip("\"'") for part in re.findall(r"\"[^\"]*\"|'[^']*'|[^.]+", dotted))


def _with_indices(names: Path, counts: dict[Path, int]) -> Path:
    """The path of a header: inside an array of tables it belongs to the array's newest table."""
    path: Path = ()
    for i, name in enumerate(names):
        path = (*path, name)
        if path in counts and i < len(names) - 1:
            path = (*path, counts[path])
    return path


def _is_complete(value: str) -> bool:
    try:
        tomllib.loads(f"key = {value}")
    except tomllib.TOMLDecodeError:
        return False
    return True
