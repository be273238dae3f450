"""All obstacles of a run, from instant to instant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from platoontraffic.world.fleet import Fleet
from platoontraffic.world.obstacles.plans import TIME_ROUNDING, CutInState, Plan
from platoontraffic.world.traffic import TrafficSnapshot


class Obstacles:
    """The plans of all obstacles and their states; call `move` in every step."""

    def __init__(self, plans: Sequence[Plan], fleet: Fleet, time: float = 0.0) -> None:
        self.plans = tuple(plans)
        self._states = [plan.moved(None, time, None, fleet, 0.0) for plan in plans]
        self.bodies = self._bodies(time)

    def move(self, before: TrafficSnapshot, fleet: Fleet, dt: float) -> None:
        """Advance to the next instant.

        before : all traffic at the present instant, obstacles included
        fleet  : the members at the next instant
        """
        if not self.plans:
            return
        time = round(before.time + dt, 6)
        steps = zip(self.plans, self._states, strict=True)
        self._states = [plan.moved(state, time, before, fleet, dt) for plan, state in steps]
        self.bodies = self._bodies(time)

    def given_up(self) -> dict[str, str]:
        """Cut-ins that do not take place: id -> reason."""
        steps = zip(self.plans, self._states, strict=True)
        return {plan.id: state.given_up for plan, state in steps if isinstance(state, CutInState) and state.given_up}

    def _bodies(self, time: float) -> TrafficSnapshot:
        present = []
        for plan, state in zip(self.plans, self._states, strict=True):
            in_time = plan.since - TIME_ROUNDING <= time < plan.until - TIME_ROUNDING
            if in_time and (pose := plan.pose(state, time)):
                present.append((plan, pose))
        poses = np.array([pose for _, pose in present], dtype=float).reshape(-1, 4).T
        sizes = np.array([(plan.length, plan.width) for plan, _ in present], dtype=float).reshape(-1, 2).T
        return TrafficSnapshot(time, tuple(plan.id for plan, _ in present), *poses, *sizes)
