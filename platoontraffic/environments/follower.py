"""One follower of a platoon learns; the other members drive by their laws. An environment for Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np

from platoontraffic.environments.seats import Seats


class Follower(gymnasium.Env):
    """`gymnasium.make("platoontraffic/Follower-v0", scenario="paper_loop")`.

    Spaces, reward, ends, parents and what is drawn for each episode are those of the scenario's table `[learn]`, or
    its defaults. An episode is a copy of a simulation that has warmed up: `reset(seed=...)` gives the same episode,
    byte for byte, in any process. Background traffic is that of one of the parents.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(
        self,
        scenario: str | Path = "paper_loop",
        changes: Sequence[str] = (),
        vehicle: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """
        scenario : a file, or the name of a shipped scenario
        changes  : of its keys: `key=value`
        vehicle  : the member that learns, in place of that of the scenario

        raises: InputError with one line for every fault found, MissingError (this system has no fork), ValueError,
                RunError (a member cannot be inserted)
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r}; must be None or 'rgb_array'")
        self.render_mode = render_mode
        self._seats = Seats(scenario, changes, (vehicle,) if vehicle else (), False)
        self.metadata = {**self.metadata, "render_fps": round(1 / self._seats.facts.interval)}
        (name,) = self._seats.names
        self.vehicle = name
        self.action_space, self.observation_space = self._seats.actions[name], self._seats.observations[name]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._seats.begin(self.np_random)
        return self._seats.observation(0), self._seats.info(0, False)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """raises: ValueError (the action has another shape, or is not finite), RuntimeError (there is no episode)"""
        seats = self._seats
        seats.step({self.vehicle: action})
        terminated = seats.terminated(0)
        truncated = not terminated and bool(seats.frame.ended)
        info = seats.info(0, terminated or truncated)
        return seats.observation(0), seats.reward(0), terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """The map around the members, (480, 640, 3) uint8."""
        return self._seats.pixels() if self.render_mode == "rgb_array" else None

    def spent(self) -> float:
        """CPU time of the process of SUMO and the episode [s], 0 where it has none; `bench env` counts it."""
        return self._seats.spent()

    def close(self) -> None:
        self._seats.close()
