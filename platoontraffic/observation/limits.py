"""What members brake for: what their laws say, and the bodies that their beams met there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from platoontraffic.controllers import BRAKES_FOR
from platoontraffic.controllers.calls import ask
from platoontraffic.lidar import ScanBatch
from platoontraffic.observation.step import Step
from platoontraffic.vehicles.records import some
from platoontraffic.world.events import Event


class Limits:
    """Arrays (N,) of all members of the run, by their number; each as of the member's last scan."""

    def __init__(self, n: int) -> None:
        self.known = np.zeros(n, dtype=bool)  # the law says what it brakes for
        self._reason = np.zeros(n, dtype=int)  # an index of BRAKES_FOR
        self._body = np.full(n, "", dtype=object)  # that it brakes for: id of a vehicle or person, WALL, or ""
        self._any_body = False
        self._creeps, self._any_creeps = np.zeros(n, dtype=bool), False

    def observe(self, step: Step, scans: Sequence[ScanBatch | None]) -> Iterator[Event]:
        """creeps

        scans: one a group of the fleet, None where it has used none in this step
        """
        for group, scan, seen in zip(step.fleet.groups, scans, step.seen, strict=True):
            known = scan is not None and scan.hits is not None and group.memory is not None
            limit = ask(group.law, group.law.braking_for, group.memory) if known else None
            if limit is None:
                continue
            number, model = step.fleet.number[group.rows], scan.model
            self.known[number], self._reason[number] = True, limit.reason
            met = ~np.isnan(limit.bearing)
            if self._any_body or some(met):
                self._body[number] = ""
                for k in met.nonzero()[0].tolist():
                    beam = round((limit.bearing[k] - model.angle_min) / model.angle_increment)
                    hit = scan.hits[k, min(max(beam, 0), model.samples - 1)]
                    self._body[number[k]] = seen.traffic.surfaces[hit]
                self._any_body = any(self._body.tolist())
            if not self._any_creeps and not some(limit.creeps):
                continue
            for k in (limit.creeps & ~self._creeps[number]).nonzero()[0]:
                body = self._body[number[k]]
                yield step.event("creeps", group.rows[k], body, detail=f"past {body}" if body else "")
            self._creeps[number] = limit.creeps
            self._any_creeps = bool(some(self._creeps))

    def reason(self, number: int) -> str:
        """A word of BRAKES_FOR."""
        return BRAKES_FOR[self._reason[number]]

    def body(self, number: int) -> str:
        return self._body[number]
