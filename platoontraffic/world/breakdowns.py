"""What of members breaks down, from a time on and perhaps for a while, as scenario files say it: `[[breakdown]]`.

Of a broken drive a vehicle rolls to a stand where it is steered to, and stands. Of a broken laser every beam is lost,
which a law can tell from an empty road: it gets NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from platoontraffic.lidar import ScanBatch
from platoontraffic.scenario import Breakdown
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet


class Breakdowns:
    """Follows those of a scenario: `watch` in every step, then `seen` and `brakes` tell what they do."""

    def __init__(self, given: Sequence[Breakdown]) -> None:
        self._given = given
        self._since: dict[Breakdown, float] = {}  # of those that there are now

    def watch(self, fleet: Fleet, time: float) -> list[Noted]:
        """What has broken down by now, or works again. Who is not on the road has no breakdown, until it comes."""
        row_of = {m.id: i for i, m in enumerate(fleet.members)} if self._given else {}
        noted = []
        for one in self._given:
            row, began = row_of.get(one.vehicle), self._since.get(one)
            lasts = one.time_s - 1e-6 < time < one.time_s + (one.lasts_s or np.inf) - 1e-6
            if row is None:
                self._since.pop(one, None)
            elif lasts and began is None:
                self._since[one] = time
                noted.append(Noted(row, "breaks_down", one.what))
            elif began is not None and not lasts:
                del self._since[one]
                noted.append(Noted(row, "repaired", one.what, time - began))
        return noted

    def seen(self, scans: list[ScanBatch | None], fleet: Fleet) -> list[ScanBatch | None]:
        """The scans, of which nothing is left where a laser is broken."""
        broken = {one.vehicle for one in self._since if one.what == "laser"}
        if not broken:
            return scans
        lost = np.array([m.id in broken for m in fleet.members])
        return [
            scan and replace(scan, ranges=np.where(lost[group.rows, None], np.nan, scan.ranges))
            for group, scan in zip(fleet.groups, scans, strict=True)
        ]

    def brakes(self, fleet: Fleet) -> np.ndarray | None:
        """What those roll to a stand with whose drive is broken [m/s2], (n,), NaN of others; None: nobody's is."""
        rates = {one.vehicle: one.rate_mps2 for one in self._since if one.what == "drive"}
        return np.array([rates.get(m.id, np.nan) for m in fleet.members]) if rates else None
