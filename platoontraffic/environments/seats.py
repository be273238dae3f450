"""What the two kinds of environment share: the seats of the members that learn, filled from frames."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

from platoontraffic.environments import spaces
from platoontraffic.episodes.episodes import FIELDS, Frame, Source, draw
from platoontraffic.episodes.here import Here, need_sumo
from platoontraffic.episodes.parents import Parents, Plan


class Seats:
    """Members that learn, in episodes that are copies of parents in SUMO, or that need no SUMO and no process."""

    def __init__(self, scenario: str | Path, changes: Sequence[str], vehicles: Sequence[str], all_: bool) -> None:
        for name, given in (("changes", changes), ("vehicles", vehicles)):
            if isinstance(given, str):
                raise ValueError(f"{name} = {given!r}; must be a list of texts")
        # It is read for each episode for which something is drawn, wherever the process is then.
        scenario = os.path.abspath(scenario) if os.path.exists(scenario) else str(scenario)
        source = Source(scenario, tuple(changes), tuple(vehicles), all_)
        self._episodes = Parents(source) if need_sumo(source) else Here(source)
        self.facts = self._episodes.facts
        self._seats = {seat.id: seat for seat in self.facts.seats}
        self.names = list(self._seats)
        self.actions = {seat.id: spaces.action_space(self.facts, seat) for seat in self.facts.seats}
        self.observations = {seat.id: spaces.observation_space(self.facts, seat) for seat in self.facts.seats}
        self._ends = frozenset(self.facts.learn.ends)
        self._terms = [f"reward_{name}" for name in self.facts.learn.reward]
        self._picture: Any = None
        self.frame: Frame | None = None
        self.waiting: list[str] = []  # members that learn and have not yet departed
        self.departed: list[str] = []  # those that have departed since the last decision
        self._next: Plan | None = None  # episode of a reset without a seed
        self._prepares = self._closed = False

    def begin(self, random: np.random.Generator) -> None:
        """A new episode.

        At its first step the next one is made, in the background, unless the last reset was not the one expected.

        raises: RuntimeError (it is closed)
        """
        if self._closed:
            raise RuntimeError("the environment is closed; make a new one")
        self.frame, plan = None, self._drawn(random)
        self._prepares, self._next = self._next in (None, plan), self._drawn(deepcopy(random))
        self.waiting = self.names
        self._receive(self._episodes.begin(plan))

    def _drawn(self, random: np.random.Generator) -> Plan:
        """Parent, seed of the sensors' errors, and the values of `draw`, in this order."""
        learn = self.facts.learn
        number, seed = int(random.integers(learn.parents)), int(random.integers(2**31))
        return Plan(number, seed, {key: draw(random, one) for key, one in learn.draw.items()})

    def step(self, actions: Mapping[str, Any]) -> None:
        """raises: ValueError (an action is wrong; nothing has moved), RuntimeError (there is no episode)"""
        if self.frame is None or self.frame.ended:
            raise RuntimeError("there is no episode, or it has ended: reset() begins one")
        commands = {name: spaces.command_of(self.facts, self._seats[name], one) for name, one in actions.items()}
        frame, self.frame = self.frame, None
        if self._prepares:
            self._prepares = False
            self._episodes.prepare(self._next)
        try:
            frame = self._episodes.call("step", commands)
        except (ValueError, RuntimeError):
            self._episodes.end()
            raise
        self._receive(frame)

    def _receive(self, plain: tuple) -> None:
        self.frame = Frame.received(plain)
        self.departed = []
        if self.waiting:
            here = {name for name, is_here in zip(self.names, self.frame.here, strict=True) if is_here}
            self.departed = [name for name in self.waiting if name in here]
            self.waiting = [name for name in self.waiting if name not in here]

    def observation(self, row: int) -> Any:
        seat = self.facts.seats[row]
        return spaces.observation(self.observations[seat.id], seat, self.frame, row)

    def reward(self, row: int) -> float:
        return float(sum(self.frame.terms[row]))

    def terminated(self, row: int) -> bool:
        frame = self.frame
        return not frame.here[row] or frame.ended == "arrived" or not self._ends.isdisjoint(frame.events[row])

    def info(self, row: int, last: bool) -> dict[str, Any]:
        """Time, the quantities that the member has, terms of the reward; at the end its metrics of the episode."""
        frame = self.frame
        info: dict[str, Any] = {"time_s": frame.time, "events": frame.events[row]}
        info |= {name: value for name, value in zip(FIELDS, frame.values[row], strict=True) if value == value}
        info |= zip(self._terms, frame.terms[row], strict=False)  # at the beginning there are none
        if last:
            info["metrics"] = self._episodes.call("metrics")[row]
        return info

    def pixels(self) -> np.ndarray:
        if self._picture is None:
            from platoontraffic.environments.map_picture import MapPicture

            self._picture = MapPicture(self._episodes.call("scene"))
        bodies, members, learners = self._episodes.call("bodies")
        return self._picture.pixels(bodies, members, learners)

    def spent(self) -> float:
        return self._episodes.call("spent")

    def close(self) -> None:
        self.frame, self._closed = None, True
        self._episodes.close()
