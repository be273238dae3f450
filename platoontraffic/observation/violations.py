"""Red lights run and give-way violations, from the state of the stop line at which a member entered a junction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.ground import GIVES_WAY, RED, Entry

OVER, STANDS = 1.0, 0.1  # a member that comes to a stand [m/s] so close behind the line [m] gives way there


class _Entered(NamedTuple):
    """Where a member was when it entered a junction without a gap."""

    lane: str  # that it left
    x: float  # [m]
    y: float


class Violations:
    """Finds them step by step.

    A red light is run where the light is red in the step of the entry; after yellow it is no violation. A member fails
    to yield where it has to give way, a vehicle with priority comes before it is across, and it drives on: one that
    stops with its bumper a little over the line lets that vehicle pass.
    """

    def __init__(self) -> None:
        self._entered: dict[str, _Entered] = {}

    def observe(self, entries: Iterable[Entry], fleet: Fleet) -> Iterator[Noted]:
        """Violations of this step, of members that entered junctions in it and before."""
        motion = fleet.motion
        for entry in entries:
            name, row = fleet.ids[entry.row], entry.row
            self._entered.pop(name, None)
            if entry.signal == RED:
                yield Noted(row, "red_light", entry.lane)
            elif entry.signal == GIVES_WAY and not entry.has_gap:
                self._entered[name] = _Entered(entry.lane, float(motion.x[row]), float(motion.y[row]))
        if not self._entered:
            return
        rows = {name: row for row, name in enumerate(fleet.ids) if name in self._entered}
        for name, (lane, x, y) in list(self._entered.items()):
            row = rows.get(name)
            drives_on = row is not None and math.hypot(motion.x[row] - x, motion.y[row] - y) > OVER
            if drives_on:
                yield Noted(row, "failed_to_yield", lane)
            if drives_on or row is None or motion.speed[row] < STANDS:
                del self._entered[name]
