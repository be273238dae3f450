"""Reading what a run left."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

# The tables of a run, and the columns without which nothing can be made of them.
NEEDED = {
    "trajectories": ("time_s", "platoon_id", "vehicle_id", "place", "x_m", "y_m", "heading_rad", "gap_m"),
    "events": ("time_s", "kind", "vehicle_id", "x_m", "y_m"),
    "metrics": ("scope", "vehicle_id", "metric", "value"),
}
# Those that a run may be without.
OPTIONAL = {
    "traffic": ("time_s", "vehicle_id", "x_m", "y_m", "heading_rad", "speed_mps"),
    "vehicles": ("vehicle_id", "length_m", "width_m", "laser_x_m", "laser_y_m", "laser_yaw_rad"),
}
# A vehicle may be called 12, or NA.
TEXTS = ("platoon_id", "vehicle_id", "other_id", "target_id", "edge_id", "lane_id", "kind", "detail", "scope", "metric")


class ResultsError(ValueError):
    """A folder that is not, or not wholly, a finished run; one line."""


@dataclass(frozen=True, eq=False)
class Scans:
    """What lasers measured, s scans of v vehicles; the columns of scans.npz, where they are described."""

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

    def __len__(self) -> int:
        return len(self.time_s)

    def ranges(self, i: int) -> np.ndarray:
        """Of scan i, (samples,) [m]."""
        return self.ranges_m[self.offset[i] : self.offset[i + 1]]


@dataclass(frozen=True)
class Results:
    """The tables of one run, and the scene it drove in.

    scene: kind ("road", "junctions", "lanes", "middle", "walls", "buildings") -> list of lines, each a list of [x, y]
           in metres; areas are their rings

    Read when they are asked for, and None where the run is without:

    traffic  : vehicles of no platoon
    vehicles : sizes, and where lasers sit
    scans    : what these measured
    """

    folder: Path
    trajectories: pd.DataFrame
    events: pd.DataFrame
    metrics: pd.DataFrame
    scene: dict[str, list[list[list[float]]]]

    @cached_property
    def traffic(self) -> pd.DataFrame | None:
        return self._optional("traffic")

    @cached_property
    def vehicles(self) -> pd.DataFrame | None:
        return self._optional("vehicles")

    @cached_property
    def scans(self) -> Scans | None:
        file = self.folder / "scans.npz"
        if not file.is_file():
            return None
        try:
            with np.load(file, allow_pickle=False) as archive:
                return Scans(**{field.name: archive[field.name] for field in fields(Scans)})
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise ResultsError(f"{file}: cannot be read: {' '.join(str(error).split())}") from error

    def _optional(self, name: str) -> pd.DataFrame | None:
        file = self.folder / f"{name}.csv"
        return _table(file, OPTIONAL[name]) if file.is_file() else None


def load(folder: Path | str) -> Results:
    """raises: ResultsError naming what is missing"""
    folder = Path(folder)
    if not folder.is_dir():
        raise ResultsError(f"{folder}: {'a file, not the folder of a run' if folder.exists() else 'no such folder'}")
    if not (folder / "DONE").is_file():
        what = "an unfinished run" if (folder / "trajectories.csv").is_file() else "not the folder of a run"
        raise ResultsError(f"{folder}: {what}: there is no DONE")
    files = {name: folder / f"{name}.csv" for name in NEEDED}
    for file in (*files.values(), folder / "scene.geojson"):
        if not file.is_file():
            raise ResultsError(f"{folder}: {file.name} is missing")
    tables = {name: _table(file, NEEDED[name]) for name, file in files.items()}
    try:
        scene = json.loads((folder / "scene.geojson").read_text(encoding="utf-8"))
        shapes = {f["properties"]["kind"]: _lines(f["geometry"]) for f in scene["features"]}
    except (ValueError, TypeError, KeyError) as error:
        raise ResultsError(f"{folder / 'scene.geojson'}: is not the scene of a run: {error}") from error
    return Results(folder, **tables, scene=shapes)


def _table(file: Path, needed: tuple[str, ...]) -> pd.DataFrame:
    try:
        table = pd.read_csv(file, dtype=dict.fromkeys(TEXTS, str), keep_default_na=False, na_values=[""])
    except (OSError, ValueError) as error:  # pandas' errors of parsing and of decoding are ValueErrors
        raise ResultsError(f"{file}: cannot be read: {' '.join(str(error).split())}") from error
    if missing := set(needed) - set(table.columns):
        raise ResultsError(f"{file}: columns are missing: {', '.join(sorted(missing))}")
    return table


def _lines(geometry: dict) -> list[list[list[float]]]:
    """A GeoJSON geometry as lines; of areas, their rings."""
    coordinates = geometry["coordinates"]
    if geometry["type"] == "MultiPolygon":
        return [ring for polygon in coordinates for ring in polygon]
    return coordinates
