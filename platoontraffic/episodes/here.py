"""Episodes that need no SUMO, in this process: robots in a lab, whatever the shape of its rooms."""

from __future__ import annotations

from typing import Any

from platoontraffic import scenario as scenarios
from platoontraffic.episodes.episodes import Episodes, Source, unheard
from platoontraffic.episodes.parents import Plan
from platoontraffic.scenario import Learn, Scenario

OF_SUMO = ("sumo", "equip")  # tables of what SUMO does ...
MAY_NEED_SUMO = ("law", "time_s", "route", "to", "loop")  # ... and ends of the keys of what can make a member need it


def need_sumo(source: Source) -> bool:
    """Whether the episodes of a scenario need SUMO. raises: InputError"""
    scenario = scenarios.load(source.scenario, source.changes)
    drawn = (key.split(".") for key in (scenario.spec.learn or Learn()).draw)
    may = any(key[0] in OF_SUMO or key[-1] in MAY_NEED_SUMO for key in drawn)
    return may or _has_traffic(scenario) or _uses_roads(scenario)


def _has_traffic(scenario: Scenario) -> bool:
    return bool(scenario.configuration or scenario.route_files or scenario.additional_of_sumo or scenario.spec.equip)


def _uses_roads(scenario: Scenario) -> bool:
    """Whether a member has a route, waits for room at its departure, heeds stop lines, or is driven by SUMO."""
    platoons, laws = scenario.spec.platoon, scenario.laws.values()
    routes = any(platoon.route or platoon.to or platoon.loop or platoon.start.time_s for platoon in platoons)
    return routes or any(law.native or "signals" in law.needs for law in laws)


class Here:
    """Episodes in this process, one after the other; as `Parents`, but there is nothing to warm up."""

    def __init__(self, source: Source) -> None:
        """raises: InputError"""
        self._episodes = Episodes(source)
        self._goes_on = False
        self.facts = self._episodes.facts(unheard)

    def begin(self, plan: Plan) -> tuple:
        """The first frame of a new episode, as `Frame.plain`; it ends the last one. raises: InputError, RunError"""
        self.end()
        self._episodes.chosen(plan.seed, plan.values)
        self._goes_on = True
        return self._episodes.begin(unheard)

    def prepare(self, plan: Plan) -> None:
        """Nothing: an episode is made when it begins."""

    def call(self, name: str, *arguments: Any) -> Any:
        """The result of a method of the episode. raises: RuntimeError (there is none), what the method raises"""
        if not self._goes_on:
            raise RuntimeError("there is no episode: reset() begins one")
        return getattr(self._episodes, name)(unheard, *arguments)

    def end(self) -> None:
        """End the episode."""
        self._goes_on = False
        self._episodes.end()

    def close(self) -> None:
        self.end()
