"""`[[obstacle]]` tables, one class a kind.

`world.obstacles` moves the obstacles, and checks there what needs the road to be checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from platoontraffic.scenario.base import (
    Angle,
    Finite,
    Fraction,
    LaneIndex,
    Names,
    NotNegative,
    Positive,
    Size,
    Speed,
    Table,
    Text,
)

Side = Literal["left", "right"]
Point = Annotated[list[float | int], Field(min_length=2, max_length=2)]  # x, y [m]


class Place(Table):
    """A place on a lane."""

    edge: str
    """Edge."""
    lane: LaneIndex = 0
    """Index of the lane, 0 outermost."""
    position_m: Finite
    """Position of the obstacle's front along the lane [m]."""
    lateral_m: Finite = 0.0
    """Offset of its centre to the left of the lane's centre line [m]."""


class _Obstacle(Table):
    id: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")] | None = None
    """Id of the obstacle. Default: its kind and its number among those of that kind: car.0, car.1 and so on."""

    @field_validator("id")
    @classmethod
    def not_taken(cls, name: str | None) -> str | None:
        if name == "wall" or (name or "").startswith("person."):
            raise ValueError(f"{name!r}: is reserved for walls and SUMO's pedestrians; must be another id")
        return name


class _Vehicle(_Obstacle):
    rate_mps2: Positive = 4.0
    """Deceleration when it brakes [m/s2]."""
    last_speed_mps: Speed = 0.0
    """Speed to which it brakes [m/s]."""
    length_m: Size = 4.74
    """Length [m]."""
    width_m: Size = 1.76
    """Width [m]."""


class Car(_Vehicle):
    """A car that stands, or drives along its lane at a prescribed speed whatever is ahead of it."""

    kind: Literal["car"]
    """Kind of the obstacle."""
    start: Place
    """Where it appears."""
    time_s: NotNegative = 0.0
    """Time at which it appears [s]."""
    lasts_s: Positive | None = None
    """Time until it disappears again [s]. Default: it stays."""
    speed_mps: Speed = 0.0
    """Its speed until it brakes [m/s]; 0: it stands."""
    route: Names = Field([])
    """Edges to drive, which contain the start edge. Without `route` and `to` it goes straight on."""
    to: Text | None = None
    """Last edge of its route, reached by the fastest path. Default: the route is `route`, or straight on."""
    brakes_at_s: NotNegative | None = None
    """Time at which it begins to brake [s]. Default: it does not brake."""

    @model_validator(mode="after")
    def sound(self) -> Car:
        if self.route and self.to is not None:
            raise ValueError("has both `route` and `to`; must have one or the other")
        if self.brakes_at_s is not None and self.last_speed_mps > self.speed_mps:
            raise ValueError(f"brakes from {self.speed_mps:g} to {self.last_speed_mps:g} m/s; must brake to less")
        if self.brakes_at_s is not None and self.brakes_at_s < self.time_s:
            raise ValueError(f"brakes at {self.brakes_at_s:g} s, before it appears at {self.time_s:g} s; must be later")
        return self


class CutIn(_Vehicle):
    """A human driver that changes lanes into the gap between a member and its predecessor."""

    kind: Literal["cut_in"]
    """Kind of the obstacle."""
    ahead_of: str
    """Id of the follower; it drives into the gap ahead of that one."""
    time_s: NotNegative
    """Time at which its lane change begins [s]."""
    beside_s: NotNegative = 3.0
    """Time for which it drives beside the gap before the lane change [s]."""
    share: Fraction = 0.5
    """Place of its middle in the gap when the lane change begins; 0: at the follower, 1: at the predecessor."""
    relative_mps: Annotated[float, Field(ge=-50, le=50)] = 0.0
    """Its speed relative to the gap when the lane change begins [m/s]."""
    side: Side = "left"
    """Side from which it comes."""
    from_m: Annotated[float, Field(gt=0, le=50)] | None = None
    """Lateral distance from which it comes [m]. Default: the width of the lane on which the platoon starts."""
    takes_s: Positive = 3.0
    """Duration of a lane change [s]."""
    brakes_after_s: NotNegative | None = None
    """Time after time_s at which it begins to brake [s]. Default: it does not brake by itself."""
    leaves_after_s: Positive | None = None
    """Time after time_s at which it begins to change back to where it came from [s]. Default: it stays."""

    @model_validator(mode="after")
    def changes_lanes_wholly(self) -> CutIn:
        if self.leaves_after_s is not None and self.leaves_after_s < self.takes_s:
            raise ValueError(
                f"leaves {self.leaves_after_s:g} s after it began a lane change that takes {self.takes_s:g} s; "
                "must be no sooner than its end"
            )
        return self


class When(Table):
    """A member that comes near."""

    member: str
    """Id of the member."""
    within_m: Positive
    """Distance along the member's route, from its front to the crossing point, at which the pedestrian steps out
    [m]."""


class Pedestrian(_Obstacle):
    """A pedestrian that stands at a kerb, and then crosses the road."""

    kind: Literal["pedestrian"]
    """Kind of the obstacle."""
    edge: str
    """Edge that it crosses."""
    lane: LaneIndex = 0
    """Index of the lane that `position_m` is measured along, 0 outermost."""
    position_m: Finite
    """Where it crosses, along the lane [m]."""
    side: Side = "right"
    """Side on which it stands first."""
    speed_mps: Annotated[float, Field(gt=0, le=15)] = 1.4
    """Walking speed [m/s]."""
    time_s: NotNegative | None = None
    """Time at which it steps out [s]. Default: none; either `time_s` or `when` must be given."""
    when: When | None = None
    """Approach of a member at which it steps out. Default: none; either `time_s` or `when` must be given."""
    length_m: Size = 0.3
    """Size in its direction of walking [m]."""
    width_m: Size = 0.5
    """Size across its direction of walking [m]."""

    @model_validator(mode="after")
    def one_of_both(self) -> Pedestrian:
        if (self.time_s is None) == (self.when is None):
            raise ValueError("must have either `time_s` or `when`")
        return self


class Box(_Obstacle):
    """An object that lies on the road."""

    kind: Literal["box"]
    """Kind of the obstacle."""
    start: Place | None = None
    """Where it lies. Default: none; either `start`, or `x_m` and `y_m`, must be given."""
    x_m: Finite | None = None
    """Position of its centre, to the east [m]. Default: none; either `start`, or `x_m` and `y_m`, must be given."""
    y_m: Finite | None = None
    """Position of its centre, to the north [m]. Default: none; either `start`, or `x_m` and `y_m`, must be given."""
    heading_deg: Angle = 0.0
    """Its direction, counter-clockwise from the lane's (with `start`) or from east [deg]."""
    time_s: NotNegative = 0.0
    """Time at which it appears [s]."""
    lasts_s: Positive | None = None
    """Time until it disappears again [s]. Default: it stays."""
    length_m: Size = 0.6
    """Length [m]."""
    width_m: Size = 0.6
    """Width [m]."""

    @model_validator(mode="after")
    def one_of_both(self) -> Box:
        placed = self.start is not None, self.x_m is not None, self.y_m is not None
        if placed not in ((True, False, False), (False, True, True)):
            raise ValueError("must have either `start`, or `x_m` and `y_m`")
        return self


class Robot(_Obstacle):
    """Another robot of the lab, which drives along a path of its own."""

    kind: Literal["robot"]
    """Kind of the obstacle."""
    path_m: Annotated[list[Point], Field(min_length=2)]
    """Points [x, y] of its path [m]."""
    speed_mps: Annotated[float, Field(gt=0, le=100)] = 0.1
    """Its speed [m/s]."""
    loop: bool = False
    """Whether it drives from the last point to the first one and round again; if not, it drives to and fro."""
    time_s: NotNegative = 0.0
    """Time at which it appears [s]."""
    length_m: Size = 0.20
    """Length [m]."""
    width_m: Size = 0.15
    """Width [m]."""


KINDS: dict[str, type[_Obstacle]] = {
    "car": Car,
    "cut_in": CutIn,
    "pedestrian": Pedestrian,
    "box": Box,
    "robot": Robot,
}
Obstacle = Annotated[Car | CutIn | Pedestrian | Box | Robot, Field(discriminator="kind")]


def name_of(obstacles: Sequence[Any], i: int) -> str:
    """Id of an obstacle: the given one, or its kind and its number among those of that kind."""
    own = obstacles[i]
    return own.id or f"{own.kind}.{sum(other.kind == own.kind for other in obstacles[:i])}"
