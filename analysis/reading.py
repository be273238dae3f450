"""Files in the folder of a run or a batch: tables that are read as what they are, paths that stay in the folder."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

# Columns that are text in every table: the id of a vehicle may be 12, or NA. A test compares with all tables.
TEXTS = (
    "id", "platoon_id", "vehicle_id", "other_id", "target_id", "closest_id", "obstacle_id", "behind_id", "edge_id",
    "lane_id", "kind", "detail", "what", "scope", "metric", "unit", "type", "status", "error", "scenario", "signal_id",
    "state",
)  # fmt: skip


class ResultsError(ValueError):
    """A folder is no finished run, or a file in it is missing or damaged; the message is one line."""


def read_table(
    file: Path | io.StringIO, needed: Sequence[str] = (), texts: Iterable[str] = (), text_type: type = str
) -> pd.DataFrame:
    """A table of results. A cell is missing only if it is empty: `NA` and `nan` are texts.

    needed    : columns that it must have
    texts     : columns that are text, beside TEXTS
    text_type : of their values in pandas; object: short tables are cut into parts in two thirds of the time

    raises: ResultsError
    """
    try:
        types = dict.fromkeys((*TEXTS, *texts), text_type)
        table = pd.read_csv(file, dtype=types, keep_default_na=False, na_values=[""])
    except UnicodeDecodeError as error:
        raise not_utf8(file) from error
    except (OSError, ValueError) as error:  # pandas' errors of parsing are ValueErrors
        raise ResultsError(f"{file}: cannot be read: {' '.join(str(error).split())}") from error
    if missing := set(needed) - set(table.columns):
        raise ResultsError(f"{file}: columns are missing: {', '.join(sorted(missing))}")
    return table


def not_utf8(file: Path) -> ResultsError:
    """The error that names the first line of a file that is not UTF-8; what a decoder says counts from within it."""
    with file.open("rb") as lines:
        for number, line in enumerate(lines, start=1):
            try:
                line.decode()
            except UnicodeDecodeError as error:
                return ResultsError(f"{file}:{number}: byte 0x{line[error.start]:02x}: is not UTF-8")
    return ResultsError(f"{file}: is not UTF-8")


def inside(folder: Path, name: str) -> Path:
    """Path of a file in the folder of results, which may come from a stranger. The file need not exist.

    raises: ResultsError if the name leads out of the folder, or is that of a link that does
    """
    file = folder / name
    try:
        resolved, own = file.resolve(), folder.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a ring of links, a NUL
        raise ResultsError(f"{folder}: {name!r}: cannot be read: {error}") from error
    if own not in resolved.parents:
        raise ResultsError(f"{folder}: {name!r}: leads out of the folder; results are read from their folder only")
    return file
