"""A run as SUMO's floating car data, for SUMO's own tools: traceExporter.py, plotXMLAttributes.py.

The instants at which all traffic is recorded, where it is: members, and the vehicles, pedestrians and obstacles of
traffic.csv. Angles are degrees clockwise from north; positions are those of the middle of the front bumper.
"""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pandas as pd

from platoontraffic.analysis.results import Results, ResultsError, load_run
from platoontraffic.analysis.writing import replacing
from platoontraffic.sumo.frame import front_of, sumo_angle
from platoontraffic.world.traffic import PERSON

NAME = "fcd.xml"
HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" \
xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">
"""


def export(folder: Path) -> list[Path]:
    """Write the file of a finished run; returns it.

    raises: ResultsError, OSError (it cannot be written)
    """
    results = load_run(Path(folder))
    file = results.folder / NAME
    rows = _rows(results)
    with replacing(file) as new, new.open("w", encoding="utf-8", newline="\n") as xml:
        xml.write(HEAD)
        for time, vehicles in rows.groupby("time_s"):
            xml.write(f'    <timestep time="{time:.3f}">\n')
            xml.writelines(vehicles.line)
            xml.write("    </timestep>\n")
        xml.write("</fcd-export>\n")
    return [file]


def _rows(results: Results) -> pd.DataFrame:
    """A row a vehicle and instant: time_s, and its line of XML."""
    if results.vehicles is None:
        raise ResultsError(f"{results.folder}: vehicles.csv is missing; it is needed for the lengths of the vehicles")
    tables = [one for one in (results.trajectories, results.traffic) if one is not None and len(one)]
    if not tables:
        return pd.DataFrame({"time_s": [], "line": []})
    rows = pd.concat(tables, ignore_index=True)
    if len(tables) > 1:
        rows = rows[rows.time_s.isin(tables[1].time_s)].reset_index(drop=True)
    known = results.vehicles.drop_duplicates("vehicle_id").set_index("vehicle_id")
    length = known.length_m.reindex(rows.vehicle_id).to_numpy()
    if np.isnan(length).any():
        raise ResultsError(f"{results.folder}: vehicles.csv: has no {rows.vehicle_id[np.isnan(length)].iloc[0]}")
    x, y = front_of(rows.x_m, rows.y_m, rows.heading_rad, length)
    names = {name: _element(name) for name in rows.vehicle_id.unique()}
    lanes = rows.lane_id.fillna("") if "lane_id" in rows else pd.Series("", index=rows.index)
    on = {lane: f" lane={quoteattr(lane)}" if lane else "" for lane in lanes.unique()}
    columns = zip(rows.vehicle_id, x, y, sumo_angle(rows.heading_rad), rows.speed_mps.abs(), lanes, strict=True)
    one = '        <%s x="%.6f" y="%.6f" angle="%.6f" speed="%.6f"%s/>\n'
    lines = [one % (names[name], *motion, on[lane]) for name, *motion, lane in columns]
    return pd.DataFrame({"time_s": rows.time_s, "line": lines})


def _element(name: str) -> str:
    """Begin of the element of a vehicle, or of one of SUMO's pedestrians."""
    if name.startswith(PERSON):
        return f"person id={quoteattr(name.removeprefix(PERSON))}"
    return f"vehicle id={quoteattr(name)}"
