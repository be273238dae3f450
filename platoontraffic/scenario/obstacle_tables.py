"""What gets in the way, as scenario files say it: `[[obstacle]]` tables, one class a kind.

What they do is in `obstacles`, and what needs the road to be checked is checked there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from platoontraffic.errors import did_you_mean

Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0, le=100)]
Time = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Speed = Annotated[float, Field(ge=0, le=100)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Side = Literal["left", "right"]
Text = Annotated[str, Field(min_length=1)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Place(_Table):
    edge: str
    lane: Annotated[int, Field(ge=0)] = 0
    position_m: Number  # of its front, from the lane's start
    lateral_m: Number = 0.0  # to the left of the lane's centre line


class _Obstacle(_Table):
    id: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")] | None = None  # default: its kind and number

    @field_validator("id")
    @classmethod
    def not_taken(cls, name: str | None) -> str | None:
        if name == "wall" or (name or "").startswith("person."):
            raise ValueError(f"{name!r}: is what walls, or SUMO's pedestrians, are called")
        return name


class _Vehicle(_Obstacle):
    rate_mps2: Length = 4.0  # of its braking
    last_speed_mps: Speed = 0.0  # that it brakes to
    length_m: Size = 4.74
    width_m: Size = 1.76


class Car(_Vehicle):
    """One that stands, or drives as it is told, whoever is ahead of it."""

    kind: Literal["car"]
    start: Place
    time_s: Time = 0.0
    lasts_s: Length | None = None  # then it is gone; default: it stays
    speed_mps: Speed = 0.0
    route: list[str] = []  # edges
    to: Text | None = None  # or where the fastest way leads; default: straight on
    brakes_at_s: Time | None = None

    @model_validator(mode="after")
    def sound(self) -> Car:
        if self.route and self.to is not None:
            raise ValueError("has a route and `to`; must have one or the other")
        if self.brakes_at_s is not None and self.last_speed_mps > self.speed_mps:
            raise ValueError(f"brakes to {self.last_speed_mps:g} m/s from {self.speed_mps:g}; must be less")
        if self.brakes_at_s is not None and self.brakes_at_s < self.time_s:
            raise ValueError(f"brakes at {self.brakes_at_s:g} s, before it is there, at {self.time_s:g} s")
        return self


class CutIn(_Vehicle):
    """A human who comes between a member and its predecessor."""

    kind: Literal["cut_in"]
    ahead_of: str  # a member that is no leader
    time_s: Time  # when it begins to come over
    beside_s: Time = 3.0  # so long before it is there, beside the gap
    share: Share = 0.5  # of the gap, from the follower's front, where its middle is then
    relative_mps: Annotated[float, Field(ge=-50, le=50)] = 0.0  # its speed then, over that of the gap
    side: Side = "left"
    from_m: Length | None = None  # default: the width of the platoon's first lane
    takes_s: Length = 3.0  # to come over
    brakes_after_s: Time | None = None  # after time_s
    leaves_after_s: Length | None = None  # after time_s, to where it came from; default: it stays


class When(_Table):
    member: str
    within_m: Length  # from its front to the crossing point, along its route


class Pedestrian(_Obstacle):
    """Stands at a kerb, and crosses the road."""

    kind: Literal["pedestrian"]
    edge: str
    lane: Annotated[int, Field(ge=0)] = 0
    position_m: Number
    side: Side = "right"
    speed_mps: Annotated[float, Field(gt=0, le=15)] = 1.4
    time_s: Time | None = None
    when: When | None = None  # instead of a time
    length_m: Size = 0.3
    width_m: Size = 0.5

    @model_validator(mode="after")
    def one_of_both(self) -> Pedestrian:
        if (self.time_s is None) == (self.when is None):
            raise ValueError("must have time_s or `when`, one of both")
        return self


class Box(_Obstacle):
    """An object that lies there."""

    kind: Literal["box"]
    start: Place | None = None
    x_m: Number | None = None  # of its middle, instead of a place on a lane
    y_m: Number | None = None
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0  # counter-clockwise: from the lane's, or from east
    time_s: Time = 0.0
    lasts_s: Length | None = None
    length_m: Size = 0.6
    width_m: Size = 0.6

    @model_validator(mode="after")
    def one_of_both(self) -> Box:
        if (self.start is None) != (self.x_m is not None and self.y_m is not None) or (self.x_m is None) != (
            self.y_m is None
        ):
            raise ValueError("must have `start`, or x_m and y_m, one of both")
        return self


class Robot(_Obstacle):
    """Another robot of the lab, on a path of its own."""

    kind: Literal["robot"]
    path_m: Annotated[list[Annotated[list[float | int], Field(min_length=2, max_length=2)]], Field(min_length=2)]
    speed_mps: Annotated[float, Field(gt=0, le=100)] = 0.1
    loop: bool = False  # from the last point back to the first; else to and fro
    time_s: Time = 0.0
    length_m: Size = 0.20
    width_m: Size = 0.15


KINDS: dict[str, type[_Obstacle]] = {
    "car": Car,
    "cut_in": CutIn,
    "pedestrian": Pedestrian,
    "box": Box,
    "robot": Robot,
}
Obstacle = Annotated[Car | CutIn | Pedestrian | Box | Robot, Field(discriminator="kind")]


def name_of(obstacles: Sequence[Any], i: int) -> str:
    """Its id: the given one, or its kind and how many of that kind are before it."""
    own = obstacles[i]
    return own.id or f"{own.kind}.{sum(other.kind == own.kind for other in obstacles[:i])}"


def located(error: dict) -> tuple[tuple, type[BaseModel] | None, str]:
    """Of pydantic's error in an obstacle: its path without the kind, the table's class, and what to say of a kind."""
    path = error["loc"]
    if error["type"] == "union_tag_invalid":
        return (*path, "kind"), None, f"{error['ctx']['tag']!r}: not known{did_you_mean(error['ctx']['tag'], KINDS)}"
    if error["type"] == "union_tag_not_found":
        return (*path, "kind"), None, f"missing; known: {', '.join(sorted(KINDS))}"
    if len(path) > 2 and path[2] in KINDS:
        return (*path[:2], *path[3:]), KINDS[path[2]], ""
    return path, None, ""


def check(obstacles: Sequence[Any], sizes: dict[str, int], end: float, fault: Callable[[tuple, str], None]) -> None:
    """Say of each what cannot be, by the platoons' sizes (by id) and the time at which the run ends."""
    members = [f"{platoon}.{place}" for platoon, size in sizes.items() for place in range(size)]
    names = [name_of(obstacles, i) for i in range(len(obstacles))]
    for i, (own, name) in enumerate(zip(obstacles, names, strict=True)):
        at = ("obstacle", i)
        if name in names[:i]:
            fault((*at, "id"), f"{name!r}: obstacle.{names.index(name)} has this id too; must be another")
        if name in members:
            fault((*at, "id"), f"{name!r}: is a member of a platoon; give the obstacle another id")
        for key in ("time_s", "brakes_at_s"):
            time = getattr(own, key, None)
            if time is not None and time >= end:
                fault((*at, key), f"{time:g}: must be before the end, {end:g}")
        who, path = "", ()
        if isinstance(own, CutIn):
            who, path = own.ahead_of, (*at, "ahead_of")
            if who in members and who.rpartition(".")[2] == "0":
                followers = [name for name in members if not name.endswith(".0")]
                fault(path, f"{who!r}: leads, there is no gap before it; must be a follower{_some(followers)}")
        elif isinstance(own, Pedestrian) and own.when:
            who, path = own.when.member, (*at, "when", "member")
        if who and who not in members:
            fault(path, f"{who!r}: no member{did_you_mean(who, members)}")


def _some(names: Sequence[str]) -> str:
    return f": {', '.join(names[:8])}" if names else ""
