"""Reading what a run left."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

# The tables of a run, and the columns without which nothing can be made of them.
NEEDED = {
    "trajectories": ("time_s", "platoon_id", "vehicle_id", "place", "x_m", "y_m", "heading_rad", "gap_m"),
    "events": ("time_s", "kind", "vehicle_id", "x_m", "y_m"),
    "metrics": ("scope", "vehicle_id", "metric", "value"),
}


class ResultsError(ValueError):
    """A folder that is not, or not wholly, a finished run; one line."""


@dataclass(frozen=True)
class Results:
    """The tables of one run, and the scene it drove in.

    scene: kind ("road", "middle", "walls") -> list of lines, each a list of [x, y] in metres
    """

    folder: Path
    trajectories: pd.DataFrame
    events: pd.DataFrame
    metrics: pd.DataFrame
    scene: dict[str, list[list[list[float]]]]


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
    tables = {}
    for name, file in files.items():
        try:
            tables[name] = pd.read_csv(file)
        except ValueError as error:  # pandas' errors of parsing, and of decoding
            raise ResultsError(f"{file}: cannot be read: {' '.join(str(error).split())}") from error
        if missing := set(NEEDED[name]) - set(tables[name].columns):
            raise ResultsError(f"{file}: columns are missing: {', '.join(sorted(missing))}")
    try:
        scene = json.loads((folder / "scene.geojson").read_text(encoding="utf-8"))
        shapes = {f["properties"]["kind"]: _lines(f["geometry"]) for f in scene["features"]}
    except (ValueError, TypeError, KeyError) as error:
        raise ResultsError(f"{folder / 'scene.geojson'}: is not the scene of a run: {error}") from error
    return Results(folder, **tables, scene=shapes)


def _lines(geometry: dict) -> list[list[list[float]]]:
    """A GeoJSON geometry as lines; of polygons, their rings."""
    coordinates = geometry["coordinates"]
    if geometry["type"] == "MultiPolygon":
        return [ring for polygon in coordinates for ring in polygon]
    return coordinates
