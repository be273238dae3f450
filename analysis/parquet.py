"""Tables as Parquet, beside the CSV files that they are made of.

Not for a process that has imported libsumo: both bring their own copy of Arrow.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Set
from pathlib import Path

import pyarrow as pa
from pyarrow import csv, parquet

from platoontraffic.analysis.reading import ResultsError, inside
from platoontraffic.analysis.results import load_batch, load_run, resources
from platoontraffic.analysis.writing import replacing

TYPES = {"number": pa.float64(), "integer": pa.int64(), "string": pa.string()}  # others are guessed


def export(folder: Path | str) -> list[Path]:
    """Write every table of a run; for a batch, each table of all its runs as one file. Returns the files.

    raises: ResultsError, OSError (a file cannot be written)
    """
    folder = Path(folder)
    with warnings.catch_warnings(action="ignore"):  # about runs of a batch that are not done; the files say which are
        results = load_batch(folder) if (folder / "study.toml").is_file() else load_run(folder)
    try:
        files = [_write(folder / f"{name}.parquet", [_table(folder, name)]) for name in resources(folder)]
        if (folder / "study.toml").is_file() and len(results.summary):
            # Not every run has every table: what is counted or recorded may be varied.
            tables = {run: resources(inside(folder, run)) for run in results.summary.id}
            names = dict.fromkeys(name for of_run in tables.values() for name in of_run if name != "summary")
            for name in names:
                runs = {run for run, of_run in tables.items() if name in of_run}
                files.append(_write(folder / f"{name}.parquet", _of_runs(folder, name, runs)))
    except pa.ArrowException as error:
        raise ResultsError(f"{folder}: {' '.join(str(error).split())}") from error
    return files


def _of_runs(folder: Path, name: str, ids: Set[str]) -> Iterator[pa.Table]:
    """The table of each of some runs that are done, with id, seed and varied values before its own columns."""
    runs = _table(folder, "runs")
    points = runs.drop_columns(["status", "error", "wall_s"])
    for i in range(runs.num_rows):
        if (run := points["id"][i].as_py()) in ids:
            table = _table(inside(folder, run), name)
            same = [pa.repeat(column[i], table.num_rows) for column in points.columns]
            yield pa.table([*same, *table.columns], schema=pa.schema([*points.schema, *table.schema]))


def _table(folder: Path, name: str) -> pa.Table:
    fields = resources(folder)[name]
    types = {f["name"]: TYPES[f["type"]] for f in fields if f["type"] in TYPES}
    options = csv.ConvertOptions(column_types=types, null_values=[""], strings_can_be_null=False)
    parsing = csv.ParseOptions(newlines_in_values=True)
    file = inside(folder, f"{name}.csv")
    try:
        table = csv.read_csv(file, parse_options=parsing, convert_options=options)
    except OSError as error:
        raise ResultsError(f"{file}: cannot be read: {error.strerror or error}") from error
    units = {f["name"]: f["unit"] for f in fields}
    described = [f.with_metadata({"unit": units.get(f.name, "")}) for f in table.schema]
    return table.cast(pa.schema(described))


def _write(file: Path, tables: Iterator[pa.Table] | list[pa.Table]) -> Path:
    with replacing(file) as new, contextlib.ExitStack() as stack:
        writer = None
        for table in tables:
            writer = writer or stack.enter_context(parquet.ParquetWriter(new, table.schema))
            writer.write_table(table)
    return file
