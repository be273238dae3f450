"""Members from the traffic that are stuck, and what is done about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from platoontraffic.scenario import Equip
from platoontraffic.world.events import Noted
from platoontraffic.world.fleet import Fleet

STANDS = 0.1  # speed below which a member stands [m/s]


class Stuck:
    """Finds members that have stood for the time that their table `equip` names."""

    def __init__(self, tables: Sequence[Equip]) -> None:
        self._tables = {table.id: table for table in tables}
        self._since: dict[str, float] = {}  # time since which a member stands [s]
        self._noted: set[str] = set()

    def observe(self, fleet: Fleet, time: float) -> tuple[list[Noted], dict[str, str]]:
        """Events of members that are stuck from now on, and the remedy of each that has one, by id."""
        if not self._tables:
            return [], {}
        stands = np.flatnonzero(np.abs(fleet.motion.speed) < STANDS)
        self._since = {fleet.ids[i]: self._since.get(fleet.ids[i], time) for i in stands}
        self._noted &= self._since.keys()
        events, remedies = [], {}
        for i in stands.tolist():
            member, since = fleet.members[i], self._since[fleet.ids[i]]
            table = self._tables.get(member.equip)
            if table is None or member.id in self._noted or time - since < table.stuck_after_s - 1e-6:
                continue
            self._noted.add(member.id)
            events.append(Noted(i, "stuck", f"since {since:.3f} s", what=table.stuck))
            if table.stuck != "wait":
                remedies[member.id] = table.stuck
        return events, remedies
