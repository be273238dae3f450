"""Members that stand, or slowly come to a stand, before a body."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers import BRAKES_FOR
from platoontraffic.controllers.calls import ask
from platoontraffic.vehicles.records import some
from platoontraffic.world.fleet import Fleet

STANDS = 0.1  # speed below which a vehicle stands [m/s]
OBSTACLE, PREDECESSOR = (BRAKES_FOR.index(word) for word in ("obstacle", "predecessor"))


class Standing(NamedTuple):
    """A member that stands or is slow, with a law that brakes for a body."""

    row: int
    group: int  # of those with its law
    k: int  # its row in the group
    reason: int  # an index of BRAKES_FOR
    creeps: bool


def before_bodies(fleet: Fleet, slower_than: float = STANDS) -> Iterator[Standing]:
    """Members that brake for a body and are slower than that [m/s]."""
    remember = [(number, group) for number, group in enumerate(fleet.groups) if group.memory is not None]
    if not remember or not some(slow := np.abs(fleet.motion.speed) < slower_than):
        return
    for number, group in remember:
        limit = ask(group.law, group.law.braking_for, group.memory)
        if limit is None:
            continue
        before_body = (limit.reason == OBSTACLE) | (limit.reason == PREDECESSOR)
        for k in (slow[group.rows] & before_body).nonzero()[0].tolist():
            yield Standing(int(group.rows[k]), number, k, int(limit.reason[k]), bool(limit.creeps[k]))
