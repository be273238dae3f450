"""An observer of vehicles that are placed step by step: no SUMO, no laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers import Target
from platoontraffic.lidar import PRESETS, Mount
from platoontraffic.observation.observer import Measures, Observer
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.catalogue import FleetModel
from platoontraffic.vehicles.motion import Motion
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import EVENT_KINDS, Event
from platoontraffic.world.fleet import Group, Member, Radio
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support.bench import NO_WALLS, batch_of, constant, platoon

CAR = CARS["car"]
LENGTH = CAR.length
ROAD = SimpleNamespace(
    drivable=shapely.box(-100, -5, 1000, 5),
    right_of_middle=lambda x, y, heading: np.nan * x,
    left_hand=False,
    is_on_lanes=lambda edge, body: False,
    lane_headed=lambda x, y, heading: None,
    keeps_to_a_lane=lambda x, y, heading, body: False,
)
NO_HIT = -2


def cars(followers: int = 1) -> list[Member]:
    """A leader and followers, whose lasers are at their front bumpers."""
    lidar = replace(PRESETS["car-follower"], mount=Mount(LENGTH / 2))
    return platoon(constant(0.0), constant(1.0), followers, model=CAR, eye=lidar)


class Seen(NamedTuple):
    """What the observer made of one step."""

    events: list[Event]
    measures: Measures

    @property
    def kinds(self) -> list[tuple[str, str]]:
        """Kind and vehicle of each event."""
        return [(e.kind, e.vehicle) for e in self.events]


class Observed:
    """Members whose motion is given step by step, among further cars that stand."""

    def __init__(self, members: Sequence[Member], road=ROAD) -> None:
        self.members = members
        self.observer = Observer(members, road, Contacts(NO_WALLS, {m.id for m in members}))

    def at(
        self,
        time: float,
        number: Sequence[int] | None = None,
        hits=None,
        others=(),
        bearing=0.0,
        signals=None,
        noted=(),
        **motion,
    ) -> Seen:
        """Observe one step.

        number : of the members on the road, (n,); by default all
        hits   : rows of the snapshot that the beams of the last member met, (k,); None: it has not scanned
        others : (x, y), or (x, y, heading), of further cars, rows n, n + 1, ...; without a heading they head east
        bearing: of every member's target
        motion : fields of `Motion`, one number or (n,); by default 0
        """
        number = np.arange(len(self.members)) if number is None else np.array(number, dtype=int)
        fleet, scans = self._fleet(number, bearing, motion), ()
        if hits is not None:
            fleet, scans = _scanned(fleet, np.array([hits]))
        roads = [(f"edge{i}", f"edge{i}_0") for i in number]
        events = self.observer.observe(_snapshot(time, fleet, others), fleet, scans, roads, signals, noted)
        for event in events:
            assert event.what in ("", *EVENT_KINDS[event.kind].words), event
        return Seen(events, self.observer.measure(fleet))

    def _fleet(self, number: np.ndarray, bearing: float, motion: dict) -> _Fleet:
        n, members = len(number), tuple(self.members[i] for i in number)
        values = {name: np.zeros(n) for name in Motion.__dataclass_fields__}
        values |= {name: np.broadcast_to(np.asarray(value, dtype=float), n).copy() for name, value in motion.items()}
        row_of = {(m.platoon, m.place): i for i, m in enumerate(members)}
        return _Fleet(
            members=members,
            number=number,
            groups=(),
            native=np.zeros(n, dtype=bool),
            model=FleetModel.of([m.model for m in members]),
            predecessor=np.array([row_of.get((m.platoon, m.place - 1), -1) for m in members], dtype=int),
            motion=Motion(**values),
            target=Target(np.full(n, np.nan), np.full(n, bearing)),
        )


class _Fleet(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.members)

    @property
    def radio(self) -> Radio:
        return Radio.silent(len(self))


def _scanned(fleet: _Fleet, hits: np.ndarray) -> tuple[_Fleet, tuple]:
    """The fleet with a group of its last member, and the scan of that, hits (1, k)."""
    last = fleet.members[-1]
    lidar = replace(last.lidar, samples=hits.shape[1])
    hits = hits.astype(np.int32)
    hits.setflags(write=False)
    scan = replace(batch_of(np.where(hits == NO_HIT, np.inf, 1.0).astype(np.float32), lidar), hits=hits)
    group = Group(last.law, lidar, np.array([len(fleet) - 1]), 1)
    return _Fleet(**(vars(fleet) | {"groups": (group,)})), (scan,)


def _snapshot(time: float, fleet: _Fleet, others: Sequence[tuple[float, ...]]) -> TrafficSnapshot:
    motion, rest = fleet.motion, np.ones(len(others))
    x, y, heading = np.array([(*other, 0.0)[:3] for other in others], dtype=float).reshape(-1, 3).T
    return TrafficSnapshot(
        time,
        (*(m.id for m in fleet.members), *(f"other.{i}" for i in range(len(others)))),
        np.concatenate([motion.x, x]),
        np.concatenate([motion.y, y]),
        np.concatenate([motion.heading, heading]),
        np.concatenate([motion.speed, 0 * rest]),
        np.concatenate([fleet.model.length, LENGTH * rest]),
        np.concatenate([fleet.model.width, 1.8 * rest]),
    )
