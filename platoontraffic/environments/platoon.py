"""All followers of a scenario learn, or those with the law "external". An environment for PettingZoo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Space
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from platoontraffic.environments.seats import Seats


class Platoon(ParallelEnv):
    """Agents are members, by their ids. A member that has come to an end stands still for the rest of the episode.

    All else as of `follower.Follower`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "platoontraffic_platoon_v0", "render_modes": ["rgb_array"], "render_fps": 10
    }  # fmt: skip

    def __init__(
        self,
        scenario: str | Path = "paper_loop",
        changes: Sequence[str] = (),
        vehicles: Sequence[str] = (),
        render_mode: str | None = None,
    ) -> None:
        """Arguments and errors as of `follower.Follower`. vehicles: the members that learn; (): see above"""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r}; must be None or 'rgb_array'")
        self.render_mode = render_mode
        self._seats = Seats(scenario, changes, tuple(vehicles), True)
        self._random: np.random.Generator | None = None
        self.possible_agents = list(self._seats.names)
        self.agents: list[str] = []
        self.observation_spaces, self.action_spaces = self._seats.observations, self._seats.actions

    def observation_space(self, agent: str) -> Space:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict, dict]:
        if seed is not None or self._random is None:
            self._random, _ = seeding.np_random(seed)
        self._seats.begin(self._random)
        self.agents = list(self.possible_agents)
        return self._of_agents(self._seats.observation), self._of_agents(lambda row: self._seats.info(row, False))

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """raises: ValueError (actions of other agents than those that are left, or an action is wrong), RuntimeError"""
        if self.agents and set(actions) != set(self.agents):
            raise ValueError(f"actions for {sorted(actions)}; must be for {self.agents}")
        seats = self._seats
        seats.step(actions)
        terminated = self._of_agents(seats.terminated)
        truncated = {name: not end and bool(seats.frame.ended) for name, end in terminated.items()}
        ends = {name: terminated[name] or truncated[name] for name in terminated}
        given = (
            self._of_agents(seats.observation), self._of_agents(seats.reward), terminated, truncated,
            self._of_agents(lambda row: seats.info(row, ends[self.possible_agents[row]])),
        )  # fmt: skip
        self.agents = [name for name in self.agents if not (terminated[name] or truncated[name])]
        return given

    def render(self) -> np.ndarray | None:
        return self._seats.pixels() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        self._seats.close()

    def _of_agents(self, of: Any) -> dict[str, Any]:
        return {name: of(self.possible_agents.index(name)) for name in self.agents}
