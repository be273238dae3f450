"""Red lights run and give-way violations, from the state of the stop line at which a member entered a junction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from platoontraffic.world.events import Noted
from platoontraffic.world.ground import GIVES_WAY, RED, Entry


def violations(entries: Iterable[Entry]) -> Iterator[Noted]:
    """A red light is run where the light is red in the step of the entry; after yellow it is no violation.

    A member fails to yield where it has to give way, and a vehicle with priority comes before it is across.
    """
    for entry in entries:
        if entry.signal == RED:
            yield Noted(entry.row, "red_light", entry.lane)
        elif entry.signal == GIVES_WAY and not entry.has_gap:
            yield Noted(entry.row, "failed_to_yield", entry.lane)
