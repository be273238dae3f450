"""The folder of a run while it is written: tables of tidy CSV that are there whole, or not at all.

Rows are written during the run, into a folder beside the final one that is renamed when all is complete. A run that is
interrupted or fails keeps its rows, in a folder with a name that ends in `.unfinished`.
"""

from __future__ import annotations

import contextlib
import errno
import fnmatch
import glob
import itertools
import json
import os
import secrets
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import pandas as pd

from platoontraffic.analysis.reading import read_table
from platoontraffic.errors import InputError, RunError, kind_of
from platoontraffic.observation.instant import Instant
from platoontraffic.results import csv_text
from platoontraffic.results.columns import EVENTS, PASSAGES, TRAFFIC, TRAJECTORIES, VEHICLES, Column
from platoontraffic.results.own_copies import take_own_copies
from platoontraffic.results.scans import ScanRecorder
from platoontraffic.scenario.tables import Record
from platoontraffic.world.events import CAUSES, Event
from platoontraffic.world.fleet import Member

DONE = "DONE"
UNFINISHED = ".unfinished"
# Files that commands make of results, beside them.
MADE_OF_RESULTS = (
    *(f"{page}{file}" for page in ("report", "comparison") for file in (".html", "-*.png", "-*.svg")),
    "replay.html", "plot.*", "plot-*", "fcd.xml", "rosbag", "*.parquet",
)  # fmt: skip
SAFE_EVERY = 10.0  # interval of simulated time at which rows are flushed to disk [s]


class Clocks(NamedTuple):
    """Recording interval of each table [steps]; None: the run has no such table."""

    trajectories: int = 1
    traffic: int | None = None
    scans: int | None = None
    passages: bool = False
    flush: int = 400

    @classmethod
    def of(cls, record: Record, dt: float) -> Clocks:
        intervals = record.every_s, record.traffic_every_s, record.scans_every_s, SAFE_EVERY
        *tables, flush = (every and round(every / dt) for every in intervals)
        return cls(*tables, bool(record.passages), flush)


EVERY_STEP = Clocks()


def check_place(folder: Path) -> None:
    """Check that results can be written into a folder, which may not exist yet. raises: InputError, RunError"""
    whole = folder.absolute()
    there = next((one for one in (whole, *whole.parents) if os.path.lexists(one)), whole)
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        number = errno.EACCES if there.is_dir() else errno.ENOTDIR
        raise _not_written(folder, OSError(number, os.strerror(number)))


def _not_written(folder: Path, error: OSError) -> InputError | RunError:
    return kind_of(error)(f"{folder}: results cannot be written: {error.strerror}")


class Recorder:
    """The folder of a run while it is written."""

    def __init__(self, folder: Path, clocks: Clocks = EVERY_STEP) -> None:
        """folder: the final one; it must not exist yet"""
        self._goes_to(folder)
        self.moved: Path | None = None  # what was in the place of the results, and was not of a run
        self._clocks = clocks
        self._members: tuple[Member, ...] = ()  # those that _order is of
        self._order: list[int] = []  # rows of the fleet by platoon and place
        self._background: dict[str, tuple[float, float]] = {}  # length and width of each vehicle in traffic.csv
        try:
            self.folder.mkdir(parents=True)
            self._trajectories = self._open("trajectories.csv", TRAJECTORIES)
            self._events = self._open("events.csv", EVENTS)
            self._traffic = self._open("traffic.csv", TRAFFIC) if clocks.traffic else None
            self._passages = self._open("passages.csv", PASSAGES) if clocks.passages else None
            self._scans = ScanRecorder(self.folder) if clocks.scans else None
        except OSError as error:
            raise _not_written(folder.parent, error) from error

    def _goes_to(self, folder: Path) -> None:
        self._final = folder
        # No process id: in a container it is the same each time, and a folder may be left by a process that was killed.
        self.folder = folder.with_name(f"{folder.name}.{secrets.token_hex(4)}.partial")
        self._made = [parent for parent in self.folder.parents if not parent.exists()]  # innermost first

    def goes_on_in(self, folder: Path) -> None:
        """In a fork of the process: go on in a folder of its own, with copies of all that was recorded. raises: OSError

        folder: the final one; it must not exist yet
        """
        before = self.folder
        self._goes_to(folder)
        try:
            take_own_copies(before, self.folder)
        except OSError:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise
        if self._scans:
            self._scans.folder = self.folder

    def record(self, now: Instant) -> None:
        """Add to every table the rows of this instant, each table by its own clock; to be called in every step."""
        self.note(now.events)
        if now.step % self._clocks.trajectories == 0:
            self._trajectories.write(csv_text.lines_at(now, TRAJECTORIES, self._rows_in_order(now)))
        if self._traffic and now.whole:
            self._traffic.write(csv_text.lines_at(now, TRAFFIC))
            self._remember_sizes(now)
        if self._passages:
            self._passages.write(csv_text.lines(now.passages, PASSAGES))
        if self._scans:
            self._scans.record(now, self._clocks.scans)
        if now.step % self._clocks.flush == 0:
            self.flush()

    def note(self, events: Iterable[Event]) -> None:
        """Add events of one instant, causes before what they cause."""
        causes_first = sorted(events, key=lambda e: (e.time, e.kind not in CAUSES, *e[1:9]))
        self._events.write(csv_text.lines(causes_first, EVENTS))

    def flush(self) -> None:
        """Hand all rows to the system, so that they survive if the process is killed."""
        for file in (*self._files(), *([self._scans] if self._scans else [])):
            file.flush()

    def write(self, name: str, text: str) -> None:
        """Write a further file of the run."""
        (self.folder / name).write_text(text, encoding="utf-8", newline="\n")

    def write_json(self, name: str, content: Any) -> None:
        self.write(name, as_json(content))

    def write_table(self, name: str, rows: Iterable[tuple], columns: Sequence[Column]) -> None:
        with self._open(name, columns) as file:
            file.write(csv_text.lines(rows, columns))

    def write_vehicles(self, members: Iterable[Member]) -> None:
        """vehicles.csv: all members that the run ever has, then the others of traffic.csv by their first rows."""
        rows: list[tuple] = []
        for m in sorted(members, key=lambda m: (m.platoon, m.place)):
            mount = m.lidar.mount
            laser = (None,) * 3 if m.law.native else (mount.x, mount.y, mount.yaw)
            axles = m.model.axle, getattr(m.model, "wheelbase", None)
            rows.append((m.id, m.platoon, m.place, m.model.length, m.model.width, *laser, *axles))
        ours = {m.id for m in members}
        others = ((vehicle, size) for vehicle, size in self._background.items() if vehicle not in ours)
        rows += [(vehicle, "", None, *size, *(None,) * 5) for vehicle, size in others]
        self.write_table("vehicles.csv", rows, VEHICLES)

    def read_table(self, name: str, text_type: type = str) -> pd.DataFrame:
        """A table of this run that is complete; see `close_tables`. text_type: as in `read_table` of the analysis"""
        return read_table(self.folder / f"{name}.csv", text_type=text_type)

    def close_tables(self) -> None:
        for file in self._files():
            file.close()
        if self._scans:
            self._scans.close()

    def finish(self, replace: bool) -> Path:
        """Mark the folder as complete and rename it to the final one, which is returned.

        Where an equal run has finished in the meantime, one of the two stays; replace: this one. Anything else in its
        place that is not of a run is moved: see `moved`.
        """
        self.write(DONE, "")
        if os.path.lexists(self._final) and (replace or not is_done(self._final)):
            self._clear_place()
        try:
            self.folder.rename(self._final)
        except OSError:
            if not is_done(self._final):
                raise
            shutil.rmtree(self.folder)
        shutil.rmtree(self._unfinished, ignore_errors=True)
        return self._final

    def keep_unfinished(self) -> Path:
        """Keep the rows in a folder beside the final one, which is returned."""
        with contextlib.suppress(OSError):  # a full disk does not take the last rows either
            self.close_tables()
        kept = self._unfinished
        shutil.rmtree(kept, ignore_errors=True)
        return self.folder.rename(kept)

    @property
    def _unfinished(self) -> Path:
        """The folder of an equal run that was interrupted, or failed."""
        return self._final.with_name(self._final.name + UNFINISHED)

    def discard(self) -> None:
        """Remove the folder, and those above it that were made for it and are empty."""
        self.close_tables()
        shutil.rmtree(self.folder)
        for made in self._made:
            with contextlib.suppress(OSError):  # another run has put something there
                made.rmdir()

    def _clear_place(self) -> None:
        """Remove what is in the place of the results if all of it is of an equal run; else move it."""
        own = [*map(glob.escape, os.listdir(self.folder)), *MADE_OF_RESULTS]
        if not self._final.is_symlink() and self._final.is_dir():
            there = os.listdir(self._final)
            if all(any(fnmatch.fnmatchcase(name, pattern) for pattern in own) for name in there):
                old = self.folder.with_name(f"{self._final.name}.{secrets.token_hex(4)}.partial")
                shutil.rmtree(self._final.rename(old), ignore_errors=True)
                return
        numbers = itertools.count(2)
        self.moved = self._final.with_name(f"{self._final.name}.earlier")
        while os.path.lexists(self.moved):
            self.moved = self._final.with_name(f"{self._final.name}.earlier-{next(numbers)}")
        self._final.rename(self.moved)

    def _rows_in_order(self, now: Instant) -> list[int]:
        """Rows of the fleet by platoon and place, whatever their order in the fleet."""
        members = now.fleet.members
        if members is not self._members:
            self._members = members
            self._order = sorted(range(len(members)), key=lambda i: (members[i].platoon, members[i].place))
        return self._order

    def _remember_sizes(self, now: Instant) -> None:
        traffic = now.whole
        for i, vehicle in enumerate(traffic.ids[len(now.fleet) :], start=len(now.fleet)):
            if vehicle not in self._background:
                self._background[vehicle] = float(traffic.length[i]), float(traffic.width[i])

    def _files(self) -> list[TextIO]:
        return [file for file in (self._trajectories, self._events, self._traffic, self._passages) if file]

    def _open(self, name: str, columns: Sequence[Column]) -> TextIO:
        file = (self.folder / name).open("w", encoding="utf-8", newline="\n")
        file.write(csv_text.header(columns))
        return file


def is_done(folder: Path) -> bool:
    return (folder / DONE).is_file()


def as_json(content: Any) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"
