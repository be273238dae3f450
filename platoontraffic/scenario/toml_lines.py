"""Which line of a TOML file a key stands on, which tomllib does not tell."""

from __future__ import annotations

import re
import tomllib

_KEY = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:"[^"]*"|'[^']*'|[\w-]+))*)\s*=""")
_TABLE = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]")

Path = tuple[str | int, ...]


def key_lines(text: str) -> dict[Path, int]:
    """Line number (from 1) by key path, e.g. ("platoon", 0, "leader", "law").

    Keys inside an inline table or array are on the line of the key that holds it. The text must be valid TOML.
    """
    lines: dict[Path, int] = {}
    table: Path = ()
    counts: dict[Path, int] = {}  # tables seen so far in each array of tables
    open_value = ""  # a value that goes on over several lines
    for number, line in enumerate(text.splitlines(), start=1):
        if open_value:
            open_value = "" if _complete(open_value + "\n" + line) else open_value + "\n" + line
        elif header := _TABLE.match(line):
            table = _resolve(_names(header[2]), counts)
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines[(*table, *_names(key[1]))] = number
            if not _complete(line[key.end() :]):
                open_value = line[key.end() :]
    return lines


def line_of(lines: dict[Path, int], path: Path) -> int | None:
    """The line of the key, or of the nearest table or key around it; None when nothing is known."""
    while path:
        if path in lines:
            return lines[path]
        path = path[:-1]
    return None


def _names(dotted: str) -> Path:
    return tuple(part.strip().strip("\"'") for part in re.findall(r"\"[^\"]*\"|'[^']*'|[^.]+", dotted))


def _resolve(names: Path, counts: dict[Path, int]) -> Path:
    """A header inside an array of tables belongs to its newest table."""
    path: Path = ()
    for i, name in enumerate(names):
        path = (*path, name)
        if path in counts and i < len(names) - 1:
            path = (*path, counts[path])
    return path


def _complete(value: str) -> bool:
    try:
        tomllib.loads(f"key = {value}")
    except tomllib.TOMLDecodeError:
        return False
    return True
