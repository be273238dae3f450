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

    `agents` are the members on the road that have not come to an end. Where platoons depart at different times, an
    episode begins when the first members that learn have departed. Others become agents when they depart: a step has
    their first observations beside those of the agents that acted. If no agent is left while others still wait to
    depart, the step goes on until the next one has departed, or the episode ends. A member that never departs never
    becomes an agent.

    All else as of `follower.Follower`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "platoontraffic_platoon_v0", "render_modes": ["rgb_array"]
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
        self._seats = Seats(scenario, changes, vehicles, True)
        self.metadata = {**self.metadata, "render_fps": round(1 / self._seats.facts.interval)}
        self._random: np.random.Generator | None = None
        self.possible_agents = list(self._seats.names)
        self._row = {name: row for row, name in enumerate(self.possible_agents)}
        self.agents: list[str] = []
        self.observation_spaces, self.action_spaces = self._seats.observations, self._seats.actions

    def observation_space(self, agent: str) -> Space:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict, dict]:
        if seed is not None or self._random is None:
            self._random, _ = seeding.np_random(seed)
        seats = self._seats
        seats.begin(self._random)
        self.agents = list(seats.departed)
        seen = {name: seats.observation(self._row[name]) for name in self.agents}
        return seen, {name: seats.info(self._row[name], False) for name in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """raises: ValueError (actions of other agents than those that are left, or an action is wrong), RuntimeError"""
        if not self.agents:
            raise RuntimeError("no agent is left: reset() begins an episode")
        if set(actions) != set(self.agents):
            raise ValueError(f"actions for {sorted(actions)}; must be for {self.agents}")
        seats = self._seats
        seats.step(actions)
        given = self._given([*self.agents, *seats.departed])
        while not self.agents and seats.waiting and not seats.frame.ended:
            seats.step({})
            for known, new in zip(given, self._given(seats.departed), strict=True):
                known.update(new)
        return given

    def _given(self, names: list[str]) -> tuple[dict, dict, dict, dict, dict]:
        """What a step returns of some members; those of them that have not come to an end are the agents."""
        seats, given = self._seats, ({}, {}, {}, {}, {})
        for name in names:
            row = self._row[name]
            terminated = seats.terminated(row)
            truncated = not terminated and bool(seats.frame.ended)
            info = seats.info(row, terminated or truncated)
            values = seats.observation(row), seats.reward(row), terminated, truncated, info
            for of_all, value in zip(given, values, strict=True):
                of_all[name] = value
        self.agents = [name for name in names if not (given[2][name] or given[3][name])]
        return given

    def render(self) -> np.ndarray | None:
        return self._seats.pixels() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        self._seats.close()
