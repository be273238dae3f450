"""The ground that members drive on: SUMO's world, or bare ground without roads and background traffic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from types import TracebackType
from typing import NamedTuple, Protocol, Self

import numpy as np

from platoontraffic.controllers import Signals
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.passages import Passage
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.trips import Trip

RED, YELLOW, PRIORITY, GIVES_WAY = "red", "yellow", "priority", "gives way"


class Entry(NamedTuple):
    """A member has entered a junction in the last step."""

    row: int  # of the member in the fleet
    lane: str  # that it left
    signal: str  # of its stop line when it entered: RED, YELLOW, PRIORITY or GIVES_WAY
    has_gap: bool  # no vehicle with priority comes before it is across; known where it gives way, else True


class Ground(Protocol):
    """A context manager: it is opened, members are deployed, and then it advances one step after the other.

    In each step `hold` and `place` say where obstacles and moved members are at its end, and `advance` makes it.
    """

    @property
    def waiting(self) -> Sequence[Fleet]:
        """Platoons that have not yet departed."""

    @property
    def expects_more(self) -> bool:
        """There may be further members, from the traffic."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def deploy(self, fleet: Fleet, later: Sequence[Fleet] = ()) -> Fleet:
        """Put members to their start poses; this is time 0.

        later : platoons that `advance` adds at their times of departure
        """

    def refit(self, members: Mapping[str, Member]) -> None:
        """Platoons that wait depart with the laws and sensors of these members, by id."""

    def snapshot(self, fleet: Fleet, reach: float = np.inf) -> TrafficSnapshot:
        """Vehicles and people at this instant: members as the fleet has them, then background traffic, then obstacles.

        reach: distance from a member's centre beyond which background traffic may be left out [m], if it comes to the
               same place as no member within `CONTACT_HORIZON`
        """

    def hold(self, obstacles: TrafficSnapshot, routes: Mapping[str, tuple[str, ...]]) -> None:
        """Obstacles at the end of the coming step, or now before the first.

        routes: edges, by obstacle that background traffic shall see, that it means to drive; there may be none
        """

    def place(self, fleet: Fleet, brakes: np.ndarray | None = None, passed: Set[str] = frozenset()) -> None:
        """Poses of moved members at the end of the coming step.

        brakes: deceleration of members with a failed drive, (n,), NaN: sound [m/s2]; SUMO-driven ones are slowed by it
        passed: bodies that members drive round; vehicles of the traffic that stand there stay
        """

    def advance(self, fleet: Fleet) -> Fleet:
        """One step: the fleet after it, without members that have arrived, with platoons that have departed."""

    def without(self, fleet: Fleet, stuck: Mapping[str, str]) -> Fleet:
        """The fleet without members that are stuck.

        stuck: whether each is removed, "remove", or goes on as a vehicle of the traffic, "sumo_drives"
        """

    @property
    def gridlocked(self) -> bool:
        """Nobody on the road moves any more; asked only with members from the traffic."""

    @property
    def trips(self) -> list[Trip]:
        """Trips of members from the traffic."""

    def roads(self, fleet: Fleet) -> list[tuple[str, str]]:
        """Edge and lane of each member after the last step; the lane is "" off the road."""

    def signals(self, fleet: Fleet) -> Signals | None:
        """State of the next stop line of each member with a law that needs it; None if no law does."""

    def entries(self, fleet: Fleet) -> list[Entry]:
        """Members that entered a junction in the last step; SUMO-driven ones are left out."""

    def passages(self, fleet: Fleet) -> list[Passage]:
        """Vehicles that passed the end of a counted edge in the last step."""


class BareGround:
    """Ground without SUMO: no roads, no background traffic. Steps are `step` seconds long.

    A platoon departs when it is due, whether there is room or not.
    """

    def __init__(self, step: float) -> None:
        self._step, self._steps = step, 0
        self._later: list[Fleet] = []  # platoons that depart later, the next one first
        self._obstacles: TrafficSnapshot | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    @property
    def time(self) -> float:
        """Since the members were deployed [s]."""
        return round(self._steps * self._step, 6)

    @property
    def waiting(self) -> Sequence[Fleet]:
        return self._later

    @property
    def expects_more(self) -> bool:
        return False

    @property
    def gridlocked(self) -> bool:
        return False

    @property
    def trips(self) -> list[Trip]:
        return []

    def deploy(self, fleet: Fleet, later: Sequence[Fleet] = ()) -> Fleet:
        """raises: ValueError (a member is SUMO-driven: nothing would move it)"""
        native = [some.members[i].id for some in (fleet, *later) for i in np.flatnonzero(some.native)]
        if native:
            raise ValueError(f"{', '.join(native)}: only SUMO can drive it; on bare ground it must have another law")
        self._steps = 0
        self._later = sorted(later, key=lambda platoon: platoon.members[0].departs)
        return fleet

    def refit(self, members: Mapping[str, Member]) -> None:
        self._later = [platoon.refitted(members, self._step) for platoon in self._later]

    def snapshot(self, fleet: Fleet, reach: float = np.inf) -> TrafficSnapshot:
        """The members, then the obstacles; all, whatever the reach."""
        traffic = members_at(fleet, self.time)
        return traffic.with_others(self._obstacles) if self._obstacles and self._obstacles.ids else traffic

    def hold(self, obstacles: TrafficSnapshot, routes: Mapping[str, tuple[str, ...]]) -> None:
        self._obstacles = obstacles

    def place(self, fleet: Fleet, brakes: np.ndarray | None = None, passed: Set[str] = frozenset()) -> None:
        """Nothing: the fleet has its poses."""

    def without(self, fleet: Fleet, stuck: Mapping[str, str]) -> Fleet:
        return fleet.without(set(stuck))

    def advance(self, fleet: Fleet) -> Fleet:
        self._steps += 1
        fleet = fleet.without(with_their_followers(fleet, fleet.arrived()))
        for platoon in departs_by(self._later, self.time, self._step):
            self._later.remove(platoon)
            fleet = fleet.joined(platoon)
        return fleet

    def roads(self, fleet: Fleet) -> list[tuple[str, str]]:
        return [("", "")] * len(fleet)

    def signals(self, fleet: Fleet) -> None:
        return None

    def entries(self, fleet: Fleet) -> list[Entry]:
        return []

    def passages(self, fleet: Fleet) -> list[Passage]:
        return []


def members_at(fleet: Fleet, time: float) -> TrafficSnapshot:
    """The members alone."""
    motion, model = fleet.motion, fleet.model
    return TrafficSnapshot(time, fleet.ids, motion.x, motion.y, motion.heading, motion.speed, model.length, model.width)


def with_their_followers(fleet: Fleet, gone: set[str]) -> set[str]:
    """Members that have left the road, and those that leave with them: their followers that know no route."""
    if not gone:
        return gone
    heads = fleet.heads().tolist()
    return gone | {
        member.id
        for member, head in zip(fleet.members, heads, strict=True)
        if fleet.members[head].id in gone and not member.arrives_alone
    }


def departs_by(later: Sequence[Fleet], time: float, step: float) -> list[Fleet]:
    """Platoons with a time of departure up to `time`, or nearer to it than to the step after."""
    return [platoon for platoon in later if platoon.members[0].departs < time + step / 2]
