"""What a run leaves behind: a folder of tidy CSV that is there whole, or not at all.

Rows are written while the run goes, into a folder beside that is renamed when all is complete. A run that is
interrupted or fails keeps what it has, in a folder whose name ends in `.unfinished`.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np

from platoontraffic.errors import RunError
from platoontraffic.world.events import Event
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.observation.observer import Measures
from platoontraffic.results.scans import ScanRecorder
from platoontraffic.results.scans import resource as scans_resource
from platoontraffic.world.traffic import TrafficSnapshot

DONE = "DONE"
UNFINISHED = ".unfinished"


class Column(NamedTuple):
    name: str
    type: str
    unit: str
    meaning: str
    format: str = "%s"


def _number(name: str, unit: str, meaning: str, format: str = "%.6f") -> Column:
    return Column(name, "number", unit, meaning, format)


def _text(name: str, meaning: str) -> Column:
    return Column(name, "string", "", meaning)


TRAJECTORIES = (
    _number("time_s", "s", "since the platoons were placed", "%.3f"),
    _text("platoon_id", "platoon"),
    _text("vehicle_id", "member"),
    Column("place", "integer", "", "0 leads, 1 follows it, and so on", "%d"),
    _number("x_m", "m", "centre of the footprint, east"),
    _number("y_m", "m", "centre of the footprint, north"),
    _number("heading_rad", "rad", "counter-clockwise from east, in (-pi, pi]"),
    _number("turned_rad", "rad", "change of heading since the start, not wrapped"),
    _number("speed_mps", "m/s", "forward speed of the driven axle's middle"),
    _number("accel_mps2", "m/s2", "change of that speed: over the last step, or of cars at this instant"),
    _number("jerk_mps3", "m/s3", "change of accel_mps2 over the last step"),
    _number("yaw_rate_radps", "rad/s", "turn to the left"),
    _number("gap_m", "m", "front bumper to predecessor's rear bumper, along the path that the predecessor drove"),
    _number("gap_error_m", "m", "gap minus the gap that the law wants at this speed; empty if it names none"),
    _number("time_gap_s", "s", "gap over own speed; empty at a standstill"),
    _number("closing_mps", "m/s", "own speed minus the predecessor's"),
    _number("ttc_s", "s", "time to collision: gap over closing speed; empty unless that is above 1 mm/s"),
    _number("drac_mps2", "m/s2", "braking that avoids a collision: closing^2 / (2 gap); 0 when not closing"),
    Column("beams_on_predecessor", "integer", "", "returns of the last scan that lie on it", "%.0f"),
    _number("occluded_share", "", "1 minus those over the beams on it were it alone; lost returns count as occluded"),
    _number("off_road_m", "m", "driven axle outside the drivable area; 0 on it"),
    _number("seen_gap_m", "m", "distance of what the law takes for its predecessor, from the front bumper"),
    _number("seen_bearing_rad", "rad", "its bearing from the laser, to the left"),
    _text("target_id", "whom those returns belong to: a vehicle, 'wall', or empty when the law sees none"),
    _number("cross_track_m", "m", "driven axle to the left of the path that the predecessor's drove"),
    _number("right_of_middle_m", "m", "centre to the right of the road's middle line; empty inside intersections"),
    _text("edge_id", "SUMO's edge, or junction"),
    _text("lane_id", "SUMO's lane; empty off the road"),
)

TRAFFIC = (
    _number("time_s", "s", "since the platoons were placed", "%.3f"),
    _text("vehicle_id", "a vehicle of no platoon"),
    _number("x_m", "m", "centre of the footprint, east"),
    _number("y_m", "m", "centre of the footprint, north"),
    _number("heading_rad", "rad", "counter-clockwise from east, in (-pi, pi]"),
    _number("speed_mps", "m/s", "forward speed"),
)

VEHICLES = (
    _text("vehicle_id", "a member, or with traffic.csv a vehicle of no platoon"),
    _text("platoon_id", "platoon; empty for a vehicle of none"),
    Column("place", "integer", "", "in its platoon; empty for a vehicle of none", "%d"),
    _number("length_m", "m", "footprint"),
    _number("width_m", "m", "footprint"),
    _number("laser_x_m", "m", "laser ahead of the centre; empty for a vehicle that SUMO drives"),
    _number("laser_y_m", "m", "laser to the left of the centre"),
    _number("laser_yaw_rad", "rad", "laser's forward direction, from the vehicle's"),
)

EVENTS = (
    _number("time_s", "s", "since the platoons were placed", "%.3f"),
    _text("kind", "see the kinds below"),
    _text("vehicle_id", "whom it happened to"),
    _text("other_id", "with whom, or 'wall'"),
    _number("x_m", "m", "where: the vehicle's centre, east"),
    _number("y_m", "m", "where: the vehicle's centre, north"),
    _text("edge_id", "SUMO's edge, or junction"),
    _number(
        "duration_s",
        "s",
        "of what ended with this event: loss of lock, split, standstill, waiting, time off the road",
        "%.3f",
    ),
    _text("detail", "cause"),
    _text("what", "cause or kind in one word; the words are listed with the kinds"),
    Column("done", "integer", "", "of an order: 1 carried out, 0 rejected", "%d"),
)

ENCOUNTERS = (
    _number("time_s", "s", "when it got in the member's way: its body over the strip that the member's drives", "%.3f"),
    _text("kind", "of the obstacle: cut_in or pedestrian"),
    _text("obstacle_id", "who got in the way"),
    _text("vehicle_id", "member in whose way it is"),
    _text("behind_id", "member behind whom a car came in; empty for a pedestrian"),
    _number("gap_m", "m", "then, from the front bumper along the way; negative: beside it"),
    _number("time_gap_s", "s", "gap over the member's speed"),
    _number("speed_mps", "m/s", "the member's"),
    _number("obstacle_speed_mps", "m/s", "the obstacle's"),
    _number("braking_mps2", "m/s2", "that just avoids contact, after the member's reaction; empty if none does"),
    Column("avoidable", "integer", "", "1: by the member's hardest braking, after its reaction", "%d"),
    _number("gap_min_m", "m", "least distance of the two bodies within 10 s"),
    _number("ttc_min_s", "s", "least time to collision while it is in the way, within 10 s; empty if never closing"),
    Column("contact", "integer", "", "1: a member touched it within 10 s", "%d"),
)

METRICS = (
    _text("scope", "'vehicle', 'platoon' or 'run'"),
    _text("platoon_id", "platoon; empty for a run"),
    _text("vehicle_id", "member; empty for a platoon or a run"),
    _text("metric", "see the metrics below"),
    _number("value", "", "value", "%.9g"),
    _text("unit", "unit of the value; empty for counts and shares"),
)

SCENE = "drivable area, junctions, borders of lanes, middle lines, walls and buildings [m]"

SMALLER = " (times length / 4.74 m, if shorter than 2 m)"

CAUSES = {"departed", "obstacle", "told", "breaks_down", "repaired"}  # of what else happens at the same instant

KINDS = {
    "departed": "is on the road from now on",
    "arrived": "is on the road no more; where it was last",
    "locked": "the law takes its true predecessor for the first time",
    "lock_lost": "the law no longer takes its true predecessor for it; detail says why",
    "lock_regained": "it does again, after duration_s",
    "wrong_target": "it takes something else, and is not split off: who is follows whoever is there",
    "split": "is split off: for 2 s its law has not taken its predecessor (other_id) for it, or the gap has been more "
    "than twice what the law wants and 15 m above that; detail says why",
    "rejoined": "is not so any more, duration_s after that began",
    "told": "begins a manoeuvre, in detail, or why it cannot; other_id: behind whom. Until it has joined it counts as "
    "split off",
    "held": "stands or crawls before a line that is closed to it; detail: by a light, right of way, no room behind the "
    "junction or, before a lane change, those beside; of those whose law is told",
    "released": "it is open again, or behind it, after duration_s",
    "red_light": "enters a junction from a lane, in detail, whose light is red; not of those whom SUMO drives",
    "failed_to_yield": "the same where it should give way to somebody who comes before it is across",
    "breaks_down": "its drive or its laser, in detail, fails: it rolls to a stand, or sees nothing any more",
    "repaired": "that works again, after duration_s",
    "standstill": "has stood still for more than 10 s; detail: since when, and held by what or behind whom",
    "standstill_end": "moves again, after duration_s",
    "collision": "touches another vehicle or a wall; once for every episode; detail: who struck whom",
    "near_miss": f"gap falls below 0.5 m{SMALLER}, without contact; once for every episode",
    "emergency_brake": "brakes harder than 4.5 m/s2, if 2 m long or longer; once for every episode",
    "off_road": f"its driven axle is more than 0.3 m{SMALLER} outside the drivable area; detail: how far",
    "on_road": "no more so, after duration_s",
    "obstacle": "is on the road from now on; detail: its kind, size and speed",
    "obstacle_gone": "is on the road no more",
    "cut_in": "other_id has come between it and its predecessor; detail: gap, headway, whether contact can be avoided",
    "no_cut_in": "other_id did not come over; detail says why",
    "steps_out": "pedestrian other_id has stepped into its way; detail: distance, whether contact can be avoided",
    "never_departed": "its platoon was due, and waited for room until the run ended",
    "end": "the run ended; detail says why",
}


class Recorder:
    """The folder of a run while it is written."""

    def __init__(self, folder: Path, *, traffic: bool = False, scans: bool = False) -> None:
        """folder: the final one, it must not be there yet; whether there are to be a traffic.csv and a scans.npz."""
        self._final = folder
        self.folder = folder.with_name(f"{folder.name}.{os.getpid()}.partial")
        missing = (parent for parent in self.folder.parents if not parent.exists())
        self._made = list(missing)  # innermost first
        self._members: tuple[Member, ...] = ()  # of whom the next two are
        self._names: list[tuple[str, int, str]] = []
        self._order: list[int] = []
        self._others: dict[str, tuple[float, float]] = {}  # length and width of those in traffic.csv
        try:
            self.folder.mkdir(parents=True)
            self._trajectories = self._open("trajectories.csv", TRAJECTORIES)
            self._events = self._open("events.csv", EVENTS)
            self._traffic = self._open("traffic.csv", TRAFFIC) if traffic else None
            self.scans = ScanRecorder(self.folder) if scans else None
        except OSError as error:
            raise RunError(f"{folder.parent}: results cannot be written: {error.strerror}") from error

    def record(self, traffic: TrafficSnapshot, fleet: Fleet, measures: Measures, roads: list[tuple[str, str]]) -> None:
        """One row a member, ordered by platoon and place whatever the order of the fleet."""
        motion, n = fleet.motion, len(fleet)
        if fleet.members is not self._members:
            self._members = fleet.members
            self._names = [(m.platoon, m.place, m.id) for m in fleet.members]
            self._order = sorted(range(n), key=self._names.__getitem__)
        platoon, place, vehicle = zip(*self._names, strict=True) if n else ((), (), ())
        values = {
            "time_s": np.full(n, traffic.time),
            "platoon_id": platoon,
            "vehicle_id": vehicle,
            "place": place,
            "x_m": traffic.x[:n],
            "y_m": traffic.y[:n],
            "heading_rad": traffic.heading[:n],
            "turned_rad": motion.turned,
            "speed_mps": motion.speed,
            "accel_mps2": motion.acceleration,
            "jerk_mps3": measures.jerk,
            "yaw_rate_radps": motion.yaw_rate,
            "gap_m": measures.gap,
            "gap_error_m": measures.gap_error,
            "time_gap_s": measures.time_gap,
            "closing_mps": measures.closing,
            "ttc_s": measures.time_to_collision,
            "drac_mps2": measures.needed_braking,
            "beams_on_predecessor": measures.beams,
            "occluded_share": measures.occluded,
            "off_road_m": measures.off_road,
            "seen_gap_m": measures.seen_gap,
            "seen_bearing_rad": measures.seen_bearing,
            "target_id": measures.target,
            "cross_track_m": measures.cross_track,
            "right_of_middle_m": measures.right_of_middle,
            "edge_id": [edge for edge, _ in roads],
            "lane_id": [lane for _, lane in roads],
        }
        self._trajectories.write(_table(values, TRAJECTORIES, self._order))

    def record_traffic(self, traffic: TrafficSnapshot, n: int) -> None:
        """One row a vehicle of no platoon: those behind the first n of the snapshot."""
        values = {
            "time_s": np.full(len(traffic.ids) - n, traffic.time),
            "vehicle_id": traffic.ids[n:],
            "x_m": traffic.x[n:],
            "y_m": traffic.y[n:],
            "heading_rad": traffic.heading[n:],
            "speed_mps": traffic.speed[n:],
        }
        self._traffic.write(_table(values, TRAFFIC))
        for i, vehicle in enumerate(traffic.ids[n:], start=n):
            if vehicle not in self._others:
                self._others[vehicle] = float(traffic.length[i]), float(traffic.width[i])

    def note(self, events: Iterable[Event]) -> None:
        causes_first = sorted(events, key=lambda e: (e.time, e.kind not in CAUSES, *e[1:]))
        self._events.write(_lines(causes_first, EVENTS))

    def flush(self) -> None:
        """What was written is safe even if the process is killed."""
        for file in (*self._files(), *([self.scans] if self.scans else [])):
            file.flush()

    def write(self, name: str, text: str) -> None:
        """A further file of the run."""
        (self.folder / name).write_text(text, encoding="utf-8", newline="\n")

    def write_vehicles(self, members: Iterable[Member]) -> None:
        """Who they were: all members that the run ever had, then those of traffic.csv by their first row."""
        rows: list[tuple] = []
        for m in sorted(members, key=lambda m: (m.platoon, m.place)):
            mount = m.lidar.mount
            laser = (None,) * 3 if m.law.native else (mount.x, mount.y, mount.yaw)
            rows.append((m.id, m.platoon, m.place, m.model.length, m.model.width, *laser))
        rows += [(vehicle, "", None, *size, None, None, None) for vehicle, size in self._others.items()]
        self.write_table("vehicles.csv", rows, VEHICLES)

    def write_table(self, name: str, rows: Iterable[tuple], columns: tuple[Column, ...]) -> None:
        with self._open(name, columns) as file:
            file.write(_lines(rows, columns))

    def close_tables(self) -> None:
        for file in self._files():
            file.close()
        if self.scans:
            self.scans.close()

    def finish(self, replace: bool) -> Path:
        """Mark as complete and put in place; where an equal run has been finished meanwhile, one of them stays."""
        self.write(DONE, "")
        if self._final.exists() and (replace or not is_done(self._final)):
            shutil.rmtree(self._final, ignore_errors=True)
        try:
            self.folder.rename(self._final)
        except OSError:
            if not is_done(self._final):
                raise
            shutil.rmtree(self.folder)
        return self._final

    def keep_unfinished(self) -> Path:
        """Put what there is beside the place of a finished run."""
        with contextlib.suppress(OSError):  # a full disk takes no last rows either
            self.close_tables()
        kept = self._final.with_name(self._final.name + UNFINISHED)
        shutil.rmtree(kept, ignore_errors=True)
        return self.folder.rename(kept)

    def discard(self) -> None:
        self.close_tables()
        shutil.rmtree(self.folder)
        for made in self._made:
            with contextlib.suppress(OSError):  # somebody else has put something there
                made.rmdir()

    def _files(self) -> list[TextIO]:
        return [file for file in (self._trajectories, self._events, self._traffic) if file]

    def _open(self, name: str, columns: tuple[Column, ...]) -> TextIO:
        file = (self.folder / name).open("w", encoding="utf-8", newline="\n")
        file.write(",".join(c.name for c in columns) + "\n")
        return file


def is_done(folder: Path) -> bool:
    return (folder / DONE).is_file()


def datapackage(
    name: str, title: str, *, traffic: bool = False, scans: bool = False, encounters: bool = False
) -> dict[str, Any]:
    """Frictionless data package: every table's columns with unit and meaning; of some, whether there are any."""
    tables = {"trajectories": TRAJECTORIES, "events": EVENTS, "metrics": METRICS, "vehicles": VEHICLES}
    if traffic:
        tables["traffic"] = TRAFFIC
    if encounters:
        tables["encounters"] = ENCOUNTERS
    resources = []
    for table, columns in tables.items():
        schema = {"fields": [c._asdict() for c in columns], "missingValues": [""]}
        for field in schema["fields"]:
            del field["format"]
            field["description"] = field.pop("meaning")
        resources.append({"name": table, "path": f"{table}.csv", "format": "csv", "schema": schema})
    resources[1]["kinds"] = KINDS
    resources.append(
        {
            "name": "summary",
            "path": "summary.csv",
            "format": "csv",
            "description": "one row: the run, its varied values, and every metric as <metric>_<unit>",
        }
    )
    resources.append({"name": "scene", "path": "scene.geojson", "description": SCENE})
    if scans:
        resources.append(scans_resource())
    return {"name": name.lower(), "title": title or name, "resources": resources}


def as_json(table: Any) -> str:
    return json.dumps(table, indent=2, ensure_ascii=False) + "\n"


def _table(values: Mapping[str, Sequence], columns: tuple[Column, ...], order: Sequence[int] | None = None) -> str:
    """Lines of a table that is given by columns (n,): what `_lines` writes, ten times as fast.

    All numbers are formatted at once, into a text that has a %s for each string; then come the strings, which may well
    contain what stands for no number.
    """
    numbers = np.array([values[c.name] for c in columns if c.type != "string"], dtype=float).T
    strings = np.array([values[c.name] for c in columns if c.type == "string"], dtype=object).T
    if order is not None:
        numbers, strings = numbers[order], strings[order]
    line = ",".join("%%s" if c.type == "string" else c.format for c in columns) + "\n"
    text = (line * len(numbers)) % tuple(numbers.ravel().tolist())
    text = text.replace("nan", "").replace("-0.000000", "0.000000")
    texts = strings.ravel().tolist()
    if _needs_quotes("".join(texts)):
        texts = [_quoted(text) for text in texts]
    return text % tuple(texts)


def _lines(rows: Iterable[tuple], columns: tuple[Column, ...]) -> str:
    return "".join(",".join(_field(v, c) for v, c in zip(row, columns, strict=True)) + "\n" for row in rows)


def _field(value: Any, column: Column) -> str:
    if column.type == "string":
        return _quoted(value)
    if value is None or (isinstance(value, float | np.floating) and np.isnan(value)):
        return ""
    text = column.format % value
    # -0.000000 and 0.000000 are one number: which of them comes out must not depend on the order of additions.
    return text.removeprefix("-") if float(text) == 0 else text


def _quoted(value: str) -> str:
    return f'"{value.replace(chr(34), chr(34) * 2)}"' if _needs_quotes(value) else value


def _needs_quotes(value: str) -> bool:
    return "," in value or '"' in value or "\n" in value
