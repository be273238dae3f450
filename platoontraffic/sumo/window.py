"""A run to watch: sumo-gui in place of the SUMO in this process."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from platoontraffic.lidar import ScanBatch
from platoontraffic.sumo.drawing import Shape, scanned, shapes
from platoontraffic.sumo.programs import need_display, no_display
from platoontraffic.sumo.remote import RemoteSumo
from platoontraffic.world.fleet import Fleet, Member

VIEW = "View #0"  # SUMO's name of its first one
VIEW_SHARE = 0.6  # half of the first view's width, in units of the platoon's length or its sight, whichever is longer
LEADER, FOLLOWER, BUILDING = (0, 114, 178), (230, 159, 0), (205, 200, 190)  # red, green, blue
DRAWING_TIME = 0.01  # between steps SUMO does nothing but draw for this long [s]

SMALL = 2.0  # vehicles shorter than this, and their roads, are shown without markings and lights [m]
# SUMO's standard view where nothing is said. Its markings and lights have the size of a car's, whatever the vehicle's.
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


class Window(RemoteSumo):
    """A `Client`: its functions go to a sumo-gui of its own.

    members   : all members of the run
    buildings : to show
    pace      : fastest simulation, in units of real time
    """

    def __init__(self, members: Sequence[Member], buildings: shapely.Geometry | None, pace: float = 1.0) -> None:
        """raises: MissingError (eclipse-sumo is not installed, or there is no display)"""
        super().__init__("sumo-gui")
        need_display("sumo-gui")
        self._marked, self._buildings = all(m.model.length >= SMALL for m in members), buildings
        self._pace = pace
        self._ranges: dict[str, np.ndarray] = {}  # of each member's last scan
        self._drawn: dict[str, Shape] = {}
        self._coloured: set[str] = set()

    def start(self, options: Sequence[str]) -> None:
        """raises: TraCIException (it refuses the options), MissingError (no display), KeyboardInterrupt (closed)"""
        self._lasts, self._shown = _step_of(options) / self._pace, time.monotonic()
        super().start(options)

    def _more_options(self, options: Sequence[str]) -> Sequence[Any]:
        settings = Path(self._folder.name, "view.xml")
        settings.write_text(SETTINGS.format(marked=int(self._marked)), encoding="utf-8")
        delay = 1000 * DRAWING_TIME / _step_of(options)  # [ms] a simulated second
        shown = ["--start", "--quit-on-end", "--delay", f"{delay:g}", "--window-size", "1200,720"]
        return [*shown, "--gui-settings-file", settings]

    def _why_not_started(self, error: BaseException) -> BaseException:
        if "unable to open display" in self._stderr.read_text(encoding="utf-8", errors="replace"):
            return no_display("sumo-gui")
        if isinstance(error, Exception) and self._was_closed():
            return KeyboardInterrupt("the window was closed")
        return super()._why_not_started(error)

    def simulationStep(self, until: float = 0.0) -> None:
        """raises: KeyboardInterrupt (the window was closed)"""
        try:
            super().simulationStep(until)
        except self.FatalTraCIError:
            if self._was_closed():
                raise KeyboardInterrupt("the window was closed") from None
            raise

    def _was_closed(self) -> bool:
        """Whether a SUMO that answers no more has ended without an error message: only its user can have closed it."""
        return self._exit_code() == 0 and "Error:" not in self._words.read_text(encoding="utf-8", errors="replace")

    def show(self, fleet: Fleet, scans: Sequence[ScanBatch | None]) -> None:
        """Draw scans and targets at the poses of the end of the coming step, when SUMO shows them; wait for `pace`."""
        self._ranges |= scanned(fleet, scans)
        drawn = shapes(fleet, self._ranges)
        polygon = self.polygon
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
                self.vehicle.setColor(member.id, FOLLOWER if member.place else LEADER)
                self._coloured.add(member.id)
        self._drawn = drawn
        time.sleep(max(self._shown + self._lasts - time.monotonic(), 0.0))
        self._shown = time.monotonic()

    def _begin(self, fleet: Fleet) -> None:
        """Show the buildings, and let the view follow the middle member of the first platoon."""
        rows = [i for i, m in enumerate(fleet.members) if m.platoon == fleet.members[0].platoon]
        x, y = fleet.motion.x[rows], fleet.motion.y[rows]
        sight = max(fleet.members[i].lidar.range_max for i in rows)
        half = VIEW_SHARE * max(np.hypot(np.ptp(x), np.ptp(y)), sight)
        middle = rows[len(rows) // 2]
        x, y = fleet.motion.x[middle], fleet.motion.y[middle]
        gui = self.gui
        gui.setSchema(VIEW, "platoontraffic")
        gui.setBoundary(VIEW, x - half, y - half, x + half, y + half)
        gui.trackVehicle(VIEW, fleet.members[middle].id)
        for i, building in enumerate(shapely.get_parts(self._buildings)):  # none of None
            outline = list(building.exterior.coords)
            self.polygon.add(f"platoontraffic.building.{i}", outline, BUILDING, fill=True)


def _step_of(options: Sequence[str]) -> float:
    """Step in SUMO's options [s]."""
    return float(options[options.index("--step-length") + 1])
