"""Breakdowns of members, from a set time on and perhaps for a while: tables `[[breakdown]]` of a scenario.

A vehicle with a broken drive rolls to a stand where it is steered to, and stays there. A broken laser loses every beam;
a law can tell this from an empty road, since it gets NaN.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from platoontraffic.scenario import Breakdown
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet


class Breakdowns:
    """The breakdowns of a scenario: call `due` in every step; `blind` and `brakes` then give their effects."""

    def __init__(self, breakdowns: Sequence[Breakdown]) -> None:
        self._breakdowns = breakdowns
        self._since: dict[Breakdown, float] = {}  # start of those in effect [s]

    def replace(self, breakdowns: Sequence[Breakdown]) -> None:
        """Others from now on; those that have begun must be among them."""
        self._breakdowns = breakdowns

    def due(self, fleet: Fleet, time: float) -> list[Noted]:
        """Breakdowns and repairs that are due by `time`; a member has no breakdown before it is on the road."""
        row_of = {m.id: i for i, m in enumerate(fleet.members)} if self._breakdowns else {}
        noted = []
        for one in self._breakdowns:
            row, began = row_of.get(one.vehicle), self._since.get(one)
            lasts = one.time_s - 1e-6 < time < one.time_s + (one.lasts_s or np.inf) - 1e-6
            if row is None:
                self._since.pop(one, None)
            elif lasts and began is None:
                self._since[one] = time
                noted.append(Noted(row, "breaks_down", one.what, what=one.what))
            elif began is not None and not lasts:
                del self._since[one]
                noted.append(Noted(row, "repaired", one.what, time - began, what=one.what))
        return noted

    def blind(self, fleet: Fleet) -> np.ndarray | None:
        """Members whose lasers are broken, (n,) bool; None: there are none."""
        if not self._since:
            return None
        broken = {one.vehicle for one in self._since if one.what == "laser"}
        return np.array([m.id in broken for m in fleet.members]) if broken else None

    def brakes(self, fleet: Fleet) -> np.ndarray | None:
        """Coasting deceleration of members with a broken drive [m/s2], (n,), NaN for the rest; None: there are none."""
        if not self._since:
            return None
        rates = {one.vehicle: one.rate_mps2 for one in self._since if one.what == "drive"}
        return np.array([rates.get(m.id, np.nan) for m in fleet.members]) if rates else None
