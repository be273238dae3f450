"""Reading the folder of a run or a batch."""

from __future__ import annotations

import io
import json
import shlex
import warnings
import zipfile
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from platoontraffic.analysis.reading import ResultsError, inside, not_utf8, read_table

# The tables that every run has, and the columns that figures and tables need.
NEEDED = {
    "trajectories": ("time_s", "platoon_id", "vehicle_id", "place", "x_m", "y_m", "heading_rad", "gap_m"),
    "events": ("time_s", "kind", "vehicle_id", "x_m", "y_m"),
    "metrics": ("scope", "vehicle_id", "metric", "value"),
}
# The tables that a run may lack.
OPTIONAL = {
    "traffic": ("time_s", "vehicle_id", "x_m", "y_m", "heading_rad", "speed_mps"),
    "statistics": ("vehicle_id", "quantity", "time_s", "mean", "rms", "min", "max"),
    "vehicles": ("vehicle_id", "length_m", "width_m", "laser_x_m", "laser_y_m", "laser_yaw_rad"),
}
TOGETHER = 50_000_000  # text of small files that is parsed at once [characters]


@dataclass(frozen=True, eq=False)
class Scans:
    """Measurements of lasers, s scans of v vehicles: the arrays of scans.npz, described in datapackage.json."""

    time_s: np.ndarray
    vehicle: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    heading_rad: np.ndarray
    offset: np.ndarray
    ranges_m: np.ndarray
    vehicle_id: np.ndarray
    angle_min_rad: np.ndarray
    angle_max_rad: np.ndarray
    samples: np.ndarray
    range_min_m: np.ndarray
    range_max_m: np.ndarray
    rate_hz: np.ndarray
    mount_x_m: np.ndarray
    mount_y_m: np.ndarray
    mount_yaw_rad: np.ndarray
    laser: np.ndarray | None = None  # names; None in files of version 0.1, where each vehicle has one
    delay_s: np.ndarray | None = None  # None in files of version 0.1, where none has one
    sweep_time_s: np.ndarray | None = None  # None in files of version 0.1
    path_offset: np.ndarray | None = None  # None where no law remembers a path
    path_m: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        """What it is in short, for notebooks."""
        when = f", {self.time_s.min():g} to {self.time_s.max():g} s" if len(self) else ""
        return f"<{len(self)} scans of {len(self.vehicle_id)} lasers{when}>"

    @property
    def following(self) -> np.ndarray:
        """Which lasers are those by which their members follow, (v,) bool."""
        return np.ones(len(self.vehicle_id), bool) if self.laser is None else self.laser == "lidar"

    def ranges(self, i: int) -> np.ndarray:
        """Ranges of scan i, (samples,) [m]."""
        return self.ranges_m[self.offset[i] : self.offset[i + 1]]


@dataclass(frozen=True)
class Results:
    """The tables of one run, and the scene it drove in.

    Tables of an unfinished run end where writing ended, without units. It has metrics only if one of a plug-in failed.

    scene: kind ("road", "junctions", "lanes", "middle", "walls", "buildings", "signals") -> list of lines, each a
           list of [x, y] in metres; areas are their rings

    Read on first access, and None if the run has no such file:

    traffic    : background vehicles
    statistics : of each member's measured values over all steps
    vehicles   : sizes, and positions of lasers
    scans      : measurements of the lasers
    """

    folder: Path
    trajectories: pd.DataFrame
    events: pd.DataFrame
    metrics: pd.DataFrame
    scene: dict[str, list[list[list[float]]]]
    finished: bool = True

    def __repr__(self) -> str:
        """What it is in short, for notebooks."""
        rows, members = len(self.trajectories), self.trajectories.vehicle_id.nunique()
        unfinished = "" if self.finished else ", unfinished"
        return f"<Results of {self.folder}: {rows} rows of {members} members, {len(self.events)} events{unfinished}>"

    @cached_property
    def traffic(self) -> pd.DataFrame | None:
        return self._optional("traffic")

    @cached_property
    def statistics(self) -> pd.DataFrame | None:
        return self._optional("statistics")

    @cached_property
    def vehicles(self) -> pd.DataFrame | None:
        return self._optional("vehicles")

    @cached_property
    def scans(self) -> Scans | None:
        file = inside(self.folder, "scans.npz")
        if not file.is_file():
            return None
        try:
            with np.load(file, allow_pickle=False) as archive:
                there = [field for field in fields(Scans) if field.name in archive or field.default is MISSING]
                return Scans(**{field.name: archive[field.name] for field in there})
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise ResultsError(f"{file}: cannot be read: {' '.join(str(error).split())}") from error

    def _optional(self, name: str) -> pd.DataFrame | None:
        file = inside(self.folder, f"{name}.csv")
        if not file.is_file():
            return None
        if not self.finished:
            return _read_so_far(file, OPTIONAL[name])
        return _read(file, OPTIONAL[name], resources(self.folder).get(name, []))


@dataclass(frozen=True)
class Batch:
    """The runs of a study.

    Tables carry the units of their columns, as `table.attrs["units"]`, and the summary the names of those that count
    events, as `table.attrs["counts"]`.
    """

    folder: Path
    runs: pd.DataFrame  # a row a run: id, status, seed, varied values, error, wall_s
    summary: pd.DataFrame  # a row a run that is done: id, seed, varied values, metrics
    varied: list[str]  # the columns that the study varies

    @property
    def missing(self) -> pd.DataFrame:
        """The runs that are not done."""
        return self.runs[self.runs.status != "done"]

    def table(self, name: str) -> pd.DataFrame:
        """A table of all runs that are done, such as "trajectories", with id, seed and varied values as first columns.

        Runs that do not have it, such as one that counts no passages, are left out.

        raises: ResultsError
        """
        if not len(self.summary):
            raise ResultsError(f"{self.folder}: no run is done")
        folders = [inside(self.folder, run) for run in self.summary.id]
        have = [not folder.is_dir() or name in resources(folder) for folder in folders]
        summary = self.summary[have] if any(have) else self.summary
        files = [self._file(run_id, name) for run_id in summary.id]
        table, rows = _read_all(files)
        if missing := set(NEEDED.get(name, ())) - set(table.columns):
            raise ResultsError(f"{self.folder}: {name}.csv: columns are missing: {', '.join(sorted(missing))}")
        fields = resources(inside(self.folder, summary.id.iloc[0])).get(name, [])
        _check_numbers(table, fields, files, rows)
        points = summary[["id", "seed", *self.varied]]
        points = points.loc[points.index.repeat(rows)].reset_index(drop=True)
        joined = pd.concat([points, table], axis=1)
        joined.attrs["units"] = {f["name"]: f["unit"] for f in fields}
        return joined

    def _file(self, run_id: str, name: str) -> Path:
        file = inside(self.folder, f"{run_id}/{name}.csv")
        if file.is_file():
            return file
        if not file.parent.is_dir():
            raise ResultsError(f"{file.parent}: is missing, though runs.csv has it as done")
        there = ", ".join(sorted(f.stem for f in file.parent.glob("*.csv")))
        raise ResultsError(f"{file}: is missing; there are {there}")


def load(folder: Path | str) -> Results | Batch:
    """The results of a run or of a batch. Warns (UserWarning) if the run is unfinished, or if the batch lacks runs.

    raises: ResultsError naming what is wrong or missing
    """
    folder = Path(folder)
    if (folder / "study.toml").is_file():
        return load_batch(folder)
    results = load_so_far(folder)
    if not results.finished:
        until = f"its tables end at {results.trajectories.time_s.max():g} s"
        without = ", and it has no metrics" if results.metrics.empty else ""
        warnings.warn(f"{folder}: an unfinished run: {until}{without}", stacklevel=2)
    return results


def load_batch(folder: Path) -> Batch:
    """raises: ResultsError"""
    for name in ("runs.csv", "summary.csv", "datapackage.json"):
        if not (folder / name).is_file():
            raise ResultsError(f"{folder}: {name} is missing; `platoontraffic batch` with its study writes it")
    needed = ("id", "seed")
    tables = resources(folder)
    texts = {name: [f["name"] for f in fields if f.get("type") == "string"] for name, fields in tables.items()}
    runs = read_table(inside(folder, "runs.csv"), (*needed, "status", "error"), texts.get("runs", ()))
    runs = runs.astype({"error": "str"})
    summary = read_table(inside(folder, "summary.csv"), needed, texts.get("summary", ()))
    runs, summary = _with_new_runs(folder, runs, summary)
    units = _units(tables)
    runs.attrs["units"], summary.attrs["units"] = units.get("runs", {}), units.get("summary", {})
    of_summary = tables.get("summary", [])
    summary.attrs["counts"] = [field["name"] for field in of_summary if field.get("statistic") == "count"]
    varied = [name for name in runs.columns if name not in ("id", "status", "seed", "error", "wall_s")]
    batch = Batch(folder, runs, summary, varied)
    if len(batch.missing):
        kinds = ", ".join(f"{n} {kind}" for kind, n in batch.missing.status.value_counts().items())
        warnings.warn(f"{folder}: {len(batch.missing)} of {len(runs)} runs are missing: {kinds}", stacklevel=3)
    return batch


def _with_new_runs(folder: Path, runs: pd.DataFrame, summary: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables with the runs that a running batch has finished since it wrote them."""
    new = [i for i in runs.index[runs.status != "done"] if (inside(folder, f"{runs.id[i]}/DONE")).is_file()]
    if not new:
        return runs, summary
    runs = runs.copy()
    runs.loc[new, ["status", "error"]] = "done", ""
    known = [name for name in runs.columns if name not in ("status", "error", "wall_s")]
    rows = []
    for i in new:
        row = read_table(inside(folder, f"{runs.id[i]}/summary.csv")).iloc[0].to_dict()
        rows.append({name: value for name, value in row.items() if "." not in name} | runs.loc[i, known].to_dict())
    metrics = [name for name in summary.columns if name not in known]
    if not metrics:  # the first runs
        metrics = [name for name in rows[0] if name not in known and pd.api.types.is_number(rows[0][name])]
    found = pd.DataFrame(rows).reindex(columns=[*known, *metrics])
    return runs, pd.concat([summary, found], ignore_index=True) if len(summary) else found


def load_so_far(folder: Path) -> Results:
    """The results of a run, as far as they were written if it is unfinished. raises: ResultsError"""
    if (folder / "DONE").is_file() or not (folder / "trajectories.csv").is_file():
        return load_run(folder)
    files = {name: inside(folder, f"{name}.csv") for name in NEEDED}
    none = {"metrics": pd.DataFrame(columns=NEEDED["metrics"])} if not files["metrics"].is_file() else {}
    tables = {name: _read_so_far(file, NEEDED[name]) for name, file in files.items() if name not in none} | none
    if tables["trajectories"].empty:
        raise ResultsError(f"{folder}: an unfinished run, of which nothing was recorded")
    return Results(folder, **tables, scene=_scene(folder), finished=False)


def _read_so_far(file: Path, needed: Sequence[str]) -> pd.DataFrame:
    """The whole lines of a table: the last one of a run that was killed may be cut. raises: ResultsError"""
    try:
        text = file.read_text(encoding="utf-8")
        return read_table(io.StringIO(text[: text.rfind("\n") + 1]), needed)
    except (OSError, ValueError) as error:
        raise ResultsError(f"{file}: cannot be read: is damaged, or nothing is written to it yet") from error


def load_run(folder: Path) -> Results:
    """The results of a finished run. raises: ResultsError"""
    if not folder.is_dir():
        raise ResultsError(f"{folder}: {'a file, not the folder of a run' if folder.exists() else 'no such folder'}")
    if not (folder / "DONE").is_file():
        if not (folder / "trajectories.csv").is_file():
            batch = "the folder of a batch, " if (folder / "study.toml").is_file() else ""
            inner = min((one.parent for depth in ("*", "*/*") for one in folder.glob(f"{depth}/DONE")), default=None)
            known = f"; a run in it is {inner}" if inner else ": a finished run has a file DONE"
            raise ResultsError(f"{folder}: {batch}not the folder of a run{known}")
        complete = f"`platoontraffic run {shlex.quote(str(folder / 'config.toml'))}` repeats it"
        raise ResultsError(f"{folder}: an unfinished run; {complete}, and `plot` draws what there is")
    for file in (
        *(inside(folder, f"{name}.csv") for name in NEEDED),
        inside(folder, "scene.geojson"),
        folder / "datapackage.json",
    ):
        if not file.is_file():
            raise ResultsError(f"{folder}: {file.name} is missing")
    described = resources(folder)
    units = _units(described)
    tables = {}
    for name, needed in NEEDED.items():
        tables[name] = _read(inside(folder, f"{name}.csv"), needed, described.get(name, []))
        tables[name].attrs["units"] = units.get(name, {})
    return Results(folder, **tables, scene=_scene(folder))


def _scene(folder: Path) -> dict[str, list[list[list[float]]]]:
    """raises: ResultsError"""
    file = inside(folder, "scene.geojson")
    try:
        return shapes_of(json.loads(file.read_text(encoding="utf-8")))
    except OSError as error:
        raise ResultsError(f"{file}: {error.strerror}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise ResultsError(f"{file}: is not the scene of a run: {error}") from error


def shapes_of(scene: dict) -> dict[str, list[list[list[float]]]]:
    """Kind -> lines, as `Results.scene`, from GeoJSON."""
    return {f["properties"]["kind"]: _lines(f["geometry"]) for f in scene["features"]}


def resources(folder: Path) -> dict[str, list[dict[str, str]]]:
    """Table -> its columns (name, type, unit, description), from datapackage.json.

    raises: ResultsError, also if a file has another size than the run wrote
    """
    file = inside(folder, "datapackage.json")
    try:
        package = json.loads(file.read_text(encoding="utf-8"))
        tables = {r["name"]: r.get("schema", {}).get("fields", []) for r in package["resources"] if "format" in r}
        sizes = {r["path"]: r["bytes"] for r in package["resources"] if "bytes" in r}  # none before version 0.4.5
    except OSError as error:
        raise ResultsError(f"{file}: {error.strerror}") from error
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ResultsError(f"{file}: is not the data package of results: {error}") from error
    for name, size in sizes.items():
        described = inside(folder, name)
        if described.is_file() and (found := described.stat().st_size) != size:
            raise ResultsError(f"{described}: damaged or changed: it has {found} bytes; the run wrote {size}")
    return tables


def _read(file: Path, needed: Sequence[str], described: list[dict[str, str]]) -> pd.DataFrame:
    """described: its columns, as from `resources`. raises: ResultsError"""
    table = read_table(file, needed)
    _check_numbers(table, described, [file], [len(table)])
    return table


def _check_numbers(
    table: pd.DataFrame, described: list[dict[str, str]], files: Sequence[Path], rows: Sequence[int]
) -> None:
    """files, rows: of which the table is made. raises: ResultsError if a cell of a column of numbers is none"""
    for field in described:
        name = field["name"]
        if field["type"] not in ("number", "integer") or name not in table or not len(table):
            continue
        if not pd.api.types.is_numeric_dtype(table[name]):
            wrong = np.flatnonzero(pd.to_numeric(table[name], errors="coerce").isna() & table[name].notna())[0]
            ends = np.cumsum(rows)
            file = int(np.searchsorted(ends, wrong, side="right"))
            row = wrong - ends[file] + rows[file] + 1
            raise ResultsError(f"{files[file]}: row {row}: {name}: {table[name].iloc[wrong]!r} is no number")


def _units(tables: dict[str, list[dict[str, str]]]) -> dict[str, dict[str, str]]:
    """tables: of `resources`"""
    return {name: {f["name"]: f["unit"] for f in fields} for name, fields in tables.items()}


def _read_all(files: Sequence[Path]) -> tuple[pd.DataFrame, list[int]]:
    """One table of many files, and the number of rows of each."""
    parts: list[pd.DataFrame] = []
    rows: list[int] = []
    texts: list[str] = []  # parsing small files one by one takes five times as long
    header, size = "", 0

    def parse() -> None:
        nonlocal size
        if texts:
            parts.append(read_table(io.StringIO(header + "".join(texts))))
            texts.clear()
            size = 0

    for file in files:
        try:
            text = file.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise not_utf8(file) from error
        first, _, body = text.partition("\n")
        if first + "\n" != header or size > TOGETHER:
            parse()
            header = first + "\n"
        if '"' in body or (body and not body.endswith("\n")):  # perhaps a line feed in a cell
            parse()
            parts.append(read_table(file))
            rows.append(len(parts[-1]))
        else:
            texts.append(body)
            rows.append(body.count("\n"))
            size += len(body)
    parse()
    return pd.concat(parts, ignore_index=True), rows


def _lines(geometry: dict) -> list[list[list[float]]]:
    """A GeoJSON geometry as lines; areas as their rings."""
    coordinates = geometry["coordinates"]
    if geometry["type"] == "MultiPolygon":
        return [ring for polygon in coordinates for ring in polygon]
    return coordinates
