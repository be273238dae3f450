"""The table of a scenario for environments, in which members learn: `platoontraffic.environments`."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from platoontraffic.scenario.base import Finite, Names, Positive, Table


class Learn(Table):
    """What a member that learns observes and commands, what it is rewarded for, and what differs between episodes."""

    vehicle: str | None = None
    """Id of the member that learns, where one learns. Default: the first one with the law "external", or else the first
    follower."""
    observation: Literal["dict", "scan", "group"] = "dict"
    """Observation: "dict" has the whole scan, own speed and own yaw rate; "scan" and "group" are the vectors that the
    law "policy" has as inputs."""
    sectors: Annotated[int, Field(ge=1, le=10_000)] = 24
    """Number of sectors of the observation "scan"."""
    command: Literal["twist", "drive"] | None = None
    """Action: "twist" is forward speed and yaw rate, "drive" acceleration and curvature. Default: "twist" for robots,
    "drive" for cars, vans and trucks."""
    episode_s: Positive | None = None
    """Time from its first decision after which an episode is truncated [s]. Default: when the run would end."""
    ends: Names = Field(["collision", "off_road"])
    """Kinds of events of the member that terminate an episode. It also ends when the member leaves the road."""
    reward: dict[str, Finite] = Field(
        {"gap_error_m": -1.0, "cross_track_m": -5.0, "jerk_mps3": -0.001, "beams_enough": 0.5, "collision": -10.0}
    )
    """Weights of the reward's terms, which are added up. A quantity of statistics.csv gives its absolute value times
    the time for which it lasts [s]; a kind of event gives 1 for each event of the member."""
    parents: Annotated[int, Field(ge=1, le=1000)] = 2
    """Number of simulations that warm up, each with a seed of its own; each episode begins as a copy of one of them."""
    draw: dict[str, Any] = Field({})
    """Keys of the scenario that are drawn for each episode, each from a range { from = 1, to = 2 } or a list of values.
    Keys of `sumo` are drawn for each of the `parents`."""

    @field_validator("draw")
    @classmethod
    def ranges_or_lists(cls, draw: dict[str, Any]) -> dict[str, Any]:
        for key, values in draw.items():
            range_ = isinstance(values, dict) and set(values) == {"from", "to"}
            if range_:
                ends = values["from"], values["to"]
                if not all(type(end) in (int, float) and math.isfinite(end) for end in ends) or not ends[0] <= ends[1]:
                    raise ValueError(f"{key}: {values}: must have finite numbers, `from` up to `to`")
            elif not (isinstance(values, list) and values):
                raise ValueError(f"{key}: {values!r}: must be a range {{ from = 1, to = 2 }} or a list of values")
        return draw
