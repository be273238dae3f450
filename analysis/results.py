"""Reading what a run left."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

TABLES = ("trajectories", "events", "metrics")


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
        raise ResultsError(f"{folder}: no such folder")
    if not (folder / "DONE").is_file():
        what = "an unfinished run" if (folder / "trajectories.csv").is_file() else "not the folder of a run"
        raise ResultsError(f"{folder}: {what}: there is no DONE")
    files = {name: folder / f"{name}.csv" for name in TABLES}
    for file in (*files.values(), folder / "scene.geojson"):
        if not file.is_file():
            raise ResultsError(f"{folder}: {file.name} is missing")
    tables = {name: pd.read_csv(file) for name, file in files.items()}
    scene = json.loads((folder / "scene.geojson").read_text(encoding="utf-8"))
    shapes = {f["properties"]["kind"]: _lines(f["geometry"]) for f in scene["features"]}
    return Results(folder, **tables, scene=shapes)


def _lines(geometry: dict) -> list[list[list[float]]]:
    """A GeoJSON geometry as lines; of polygons, their rings."""
    coordinates = geometry["coordinates"]
    if geometry["type"] == "MultiPolygon":
        return [ring for polygon in coordinates for ring in polygon]
    return coordinates
