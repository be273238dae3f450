"""A run that one can watch: sumo-gui, spoken to through traci, in the place of the SUMO in this process."""

from __future__ import annotations

import contextlib
import io
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import shapely

from platoontraffic.lidar import ScanBatch
from platoontraffic.sumo.drawing import Shape, scanned, shapes
from platoontraffic.sumo.programs import home_of, need_display, no_display, program
from platoontraffic.world.fleet import Fleet, Member

VIEW = "View #0"  # SUMO's name of its first one
AROUND = 0.6  # times the longer of a platoon's length and its sight: half of what the view shows at the start
LEADER, FOLLOWER, BUILDING = (0, 114, 178), (230, 159, 0), (205, 200, 190)  # red, green, blue
SEEN = 0.01  # SUMO draws between steps: so long it does nothing else. Its option is in ms for a simulated second [s]
RETRY = 0.1  # until sumo-gui has read its network and listens [s]
PATIENCE = 10.0  # with a SUMO that is to end [s]

# What is not said here is as in SUMO's standard view. Its markings and lights are as large as those of cars, always.
SMALL = 2.0  # vehicles that are shorter, and their roads, are shown without [m]
SETTINGS = """<viewsettings>
    <scheme name="platoontraffic">
        <background backgroundColor="232,236,226" showGrid="0"/>
        <edges laneEdgeMode="0" laneShowBorders="{marked}" showLinkDecals="{marked}" showLinkRules="{marked}">
            <colorScheme name="uniform"><entry color="110,112,116" name="road"/></colorScheme>
        </edges>
        <vehicles vehicleMode="0" vehicleQuality="2" showBlinker="{marked}" vehicle_minSize="0"/>
        <junctions junctionMode="0">
            <colorScheme name="uniform"><entry color="110,112,116"/></colorScheme>
        </junctions>
        <polys poly_minSize="0"/>
    </scheme>
</viewsettings>
"""


class Window:
    """Has the functions of the module libsumo, and can stand in for it; they go to a sumo-gui of its own.

    members   : that the run ever has
    buildings : that are shown
    pace      : times real time, at most
    """

    def __init__(self, members: Sequence[Member], buildings: shapely.Geometry | None, pace: float = 1.0) -> None:
        """raises: MissingError"""
        self._marked, self._buildings = all(m.model.length >= SMALL for m in members), buildings
        self._program, self._pace = program("sumo-gui"), pace
        need_display("sumo-gui")
        self._ranges: dict[str, np.ndarray] = {}  # of each member's last scan
        self._drawn: dict[str, Shape] = {}
        self._coloured: set[str] = set()

    def __getattr__(self, name: str) -> Any:
        return getattr(_traci(), name)

    @property
    def constants(self) -> ModuleType:
        return _traci().tc

    def start(self, options: Sequence[str]) -> None:
        """sumo-gui with SUMO's options.

        raises: TraCIException (it refuses them), MissingError (no display), KeyboardInterrupt (it was closed)
        """
        traci = _traci()
        self._folder = tempfile.TemporaryDirectory(prefix="platoontraffic-")
        self._words = Path(self._folder.name, "words")
        self._words.touch()
        settings, said = Path(self._folder.name, "view.xml"), Path(self._folder.name, "stderr")
        settings.write_text(SETTINGS.format(marked=int(self._marked)), encoding="utf-8")
        step = float(options[options.index("--step-length") + 1])
        self._lasts, self._shown = step / self._pace, time.monotonic()
        with socket.create_server(("localhost", 0)) as free:
            port = str(free.getsockname()[1])
        options = [*options[1:], "--start", "--quit-on-end", "--delay", f"{1000 * SEEN / step:g}"]
        options += ["--gui-settings-file", settings, "--window-size", "1200,720"]
        options += ["--error-log", self._words, "--remote-port", port]
        with said.open("wb") as file:
            self._sumo = subprocess.Popen(
                [self._program, *options],
                env=home_of(self._program),
                stdout=file,
                stderr=file,
                start_new_session=True,  # Ctrl-C is for this process, which then ends SUMO
            )
        try:
            with redirect_stdout(io.StringIO()):  # traci counts its tries there
                traci.connect(int(port), sys.maxsize, "localhost", self._sumo, RETRY, label=port)
            traci.switch(port)
            traci.getVersion()  # which comes when all files have been read
        except BaseException as error:
            no_window = "unable to open display" in said.read_text(errors="replace")
            closed = isinstance(error, Exception) and self._was_closed()
            self._end()
            if no_window:
                raise no_display("sumo-gui") from None
            if closed:
                raise KeyboardInterrupt("the window was closed") from None
            if isinstance(error, traci.FatalTraCIError):
                raise traci.TraCIException(str(error)) from error
            raise

    def simulationStep(self, until: float = 0.0) -> None:
        """raises: KeyboardInterrupt where somebody has closed the window"""
        traci = _traci()
        try:
            traci.simulationStep(until)
        except traci.FatalTraCIError:
            if self._was_closed():
                raise KeyboardInterrupt("the window was closed") from None
            raise

    def _was_closed(self) -> bool:
        """Whether SUMO, which says no more, has ended without a complaint: nobody else has asked it to."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self._sumo.wait(PATIENCE) == 0 and "Error:" not in self._words.read_text(errors="replace")
        return False

    def close(self) -> None:
        watchdog = threading.Timer(PATIENCE, self._sumo.kill)
        watchdog.start()
        with contextlib.suppress(Exception):  # interrupted between question and answer, traci may raise anything
            _traci().close(wait=False)
            self._sumo.wait()
        watchdog.cancel()
        self._end()

    def _end(self) -> None:
        if self._sumo.poll() is None:
            self._sumo.kill()
            self._sumo.wait()
        os.write(2, self._words.read_bytes())  # where SUMO in this process says it
        self._folder.cleanup()

    def show(self, fleet: Fleet, scans: Sequence[ScanBatch | None]) -> None:
        """Draw what members see, from where they are to be at the end of the coming step: then SUMO shows it."""
        self._ranges |= scanned(fleet, scans)
        drawn = shapes(fleet, self._ranges)
        polygon = _traci().polygon
        for name in self._drawn.keys() - drawn.keys():
            polygon.remove(name, self._drawn[name].layer)
        for name, shape in drawn.items():
            corners = shape.corners.tolist()
            if name in self._drawn:
                polygon.setShape(name, corners)
            else:
                polygon.add(name, corners, shape.colour, fill=True, layer=shape.layer)
        if not self._coloured and len(fleet):
            self._begin(fleet)
        for member in fleet.members:
            if member.id not in self._coloured:
                _traci().vehicle.setColor(member.id, FOLLOWER if member.place else LEADER)
                self._coloured.add(member.id)
        self._drawn = drawn
        time.sleep(max(self._shown + self._lasts - time.monotonic(), 0.0))
        self._shown = time.monotonic()

    def _begin(self, fleet: Fleet) -> None:
        """Show the buildings, and follow the middle of the first platoon."""
        rows = [i for i, m in enumerate(fleet.members) if m.platoon == fleet.members[0].platoon]
        x, y = fleet.motion.x[rows], fleet.motion.y[rows]
        sight = max(fleet.members[i].lidar.range_max for i in rows)
        half = AROUND * max(np.hypot(np.ptp(x), np.ptp(y)), sight)
        middle = rows[len(rows) // 2]
        x, y = fleet.motion.x[middle], fleet.motion.y[middle]
        gui = _traci().gui
        gui.setSchema(VIEW, "platoontraffic")
        gui.setBoundary(VIEW, x - half, y - half, x + half, y + half)
        gui.trackVehicle(VIEW, fleet.members[middle].id)
        for i, building in enumerate(shapely.get_parts(self._buildings)):  # none of None
            outline = list(building.exterior.coords)
            _traci().polygon.add(f"platoontraffic.building.{i}", outline, BUILDING, fill=True)


def _traci() -> ModuleType:
    """Not the package: where it was imported by libsumo, it is that under another name."""
    import traci.main

    return traci.main
