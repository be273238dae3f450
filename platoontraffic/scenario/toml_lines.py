"""TOML files with the line of each key, which tomllib does not tell."""

from __future__ import annotations

import pathlib
import re
import tomllib
from typing import Any

from platoontraffic.errors import InputError

_KEY = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:"[^"]*"|'[^']*'|[\w-]+))*)\s*=""")
_TABLE = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]")
_TOKEN = re.compile(r"""(?P<long>\"{3}|'{3})|"(?:\\.|[^"\\])*"|'[^']*'|\#.*|(?P<open>[\[{])|(?P<close>[\]}])""")
_DEEP = re.compile(r"(?<![\w.-])(?:[\w-]+\s*\.\s*){100}")  # tomllib takes minutes for a key of many thousand parts
_INTEGER = "has an integer of more than 64 bits; must have fewer"
_NESTED = "tables or lists are nested too deeply"

Path = tuple[str | int, ...]  # of a key, e.g. ("platoon", 0, "leader", "law")


def read_toml(file: str | pathlib.Path) -> tuple[dict[str, Any], dict[Path, int]]:
    """The table in a TOML file, and the lines of its keys. raises: InputError if it cannot be read"""
    try:
        raw = pathlib.Path(file).read_bytes()
        text = raw.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
        table = loads(text)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}:{line}: byte 0x{raw[error.start]:02x}: is not UTF-8; TOML must be") from error
    except tomllib.TOMLDecodeError as error:
        at = re.search(r"\(at line (\d+)", str(error))  # or at the end of the document
        line = at[1] if at else text.count("\n") + 1
        raise InputError(f"{file}:{line}: not valid TOML: {str(error).split(' (at')[0]}") from error
    except ValueError as error:  # sound TOML, but beyond all use
        place = _place_of_longest_number(text) if str(error) == _INTEGER else ""
        raise InputError(f"{file}{place}: {error}") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    return table, key_lines(text)


def loads(text: str) -> dict[str, Any]:
    """The table in a TOML document. raises: TOMLDecodeError, ValueError (sound TOML, but beyond all use)"""
    if _DEEP.search(text):
        raise ValueError(_NESTED)
    try:
        table = tomllib.loads(text)
        _check_integers(table)
    except RecursionError:
        raise ValueError(_NESTED) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # Python refuses to read or write integers of some thousand digits
        raise ValueError(_INTEGER) from None
    return table


def _place_of_longest_number(text: str) -> str:
    """`:line: key`."""
    longest = max(re.finditer(r"[0-9a-fA-F_]+", text), key=lambda number: len(number[0]))
    line = text.count("\n", 0, longest.start()) + 1
    lines = key_lines(text)
    path = max((path for path in lines if lines[path] <= line), key=lambda path: lines[path], default=())
    return f":{line}: {'.'.join(map(str, path))}"


def _check_integers(value: Any) -> None:
    """raises: ValueError"""
    if isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            _check_integers(inner)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError


def key_lines(text: str) -> dict[Path, int]:
    """Line number (from 1) by path of the key.

    Keys inside an inline table or array are on the line of the key that holds it. The text must be valid TOML.
    """
    lines: dict[Path, int] = {}
    table: Path = ()
    counts: dict[Path, int] = {}  # index of the newest table in each array of tables
    open_value = _WHOLE  # of a value that goes on over several lines
    for number, line in enumerate(text.split("\n"), start=1):
        if open_value != _WHOLE:
            open_value = _after(line, open_value)
        elif header := _TABLE.match(line):
            table = _with_indices(_names(header[2]), counts)
            if header[1] == "[[":
                lines.setdefault(table, number)
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines[(*table, *_names(key[1]))] = number
            open_value = _after(line[key.end() :], _WHOLE)
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


_WHOLE = "", 0  # quotes of the string that is open, number of brackets that are open


def _after(line: str, was: tuple[str, int]) -> tuple[str, int]:
    """What is open after a line of a value, from what was before it."""
    quotes, depth = was
    at = 0
    while at < len(line):
        if quotes:
            end = re.compile(r"(?:\\.|[^\\])*?\"{3}" if quotes == '"""' else "(?s:.*?)'{3}").match(line, at)
            if not end:
                break
            quotes, at = "", end.end()
        elif token := _TOKEN.search(line, at):
            depth += bool(token["open"]) - bool(token["close"])
            quotes, at = token["long"] or "", token.end()
        else:
            break
    return quotes, depth
