"""What happened to the vehicles of a run, by its tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import dropwhile, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.analysis.results import load_run
from platoontraffic.controllers import CLOSED_BY
from platoontraffic.prove.trips import Trip
from platoontraffic.results.metrics import CAUSED_BY_OTHER, CAUSED_BY_ROAD
from platoontraffic.road.gap_acceptance import STANDING
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.network import CHANGING, Line, Network
from platoontraffic.world.events import STANDSTILL_AFTER
from platoontraffic.world.traffic import PERSON

NO_REASON = "no reason"
BEHIND = "behind: behind "  # begin of the reason of one in a queue
LIGHT, RIGHT_OF_WAY, LANE_CHANGE, NO_ROOM, _, _, LETTING_IN = (f"held: held by {one}" for one in CLOSED_BY[1:])
LONG = 60.0  # a longer standstill needs to be explained [s]


class Stand(NamedTuple):
    """A standstill of more than STANDSTILL_AFTER."""

    vehicle: str
    lasts: float  # [s]
    why: str  # NO_REASON, or a word of the event `standstill` and its text
    lane: str  # "" beside the road
    queue: str = ""  # edge beyond the junction before or inside which it waits for room; "" if for another reason
    onto: str = ""  # lane on which it waits for room to change to it; likewise
    unregulated: bool = False  # it waits for a gap where nobody has to give way, and SUMO's cars look out for nobody
    one_red: bool = False  # it waits at a light; but for less than STANDSTILL_AFTER while that may be closed
    begins: float = 0.0  # [s]

    @property
    def ends(self) -> float:
        """[s]"""
        return self.begins + self.lasts

    @property
    def behind(self) -> str:
        """Vehicle behind which it stands; "" if it stands for another reason."""
        return self.why.removeprefix(BEHIND) if self.why.startswith(BEHIND) else ""

    def is_in_queue_of(self, other: Stand) -> bool:
        """Whether it stands behind the other one's vehicle, and for most of its time while that one does."""
        return self.behind == other.vehicle and self.is_with(other)

    def lets_in_beside(self, other: Stand) -> bool:
        """Whether it lets a vehicle in while the other one stands on its edge: that one may be it, or before it."""
        return self.why == LETTING_IN and edge_of(self.lane) == edge_of(other.lane) and self.is_with(other)

    def is_with(self, other: Stand) -> bool:
        """Whether the other one stands as well for most of the time of this one."""
        return min(self.ends, other.ends) - max(self.begins, other.begins) > self.lasts / 2


class Incident(NamedTuple):
    """A contact that was caused, a red light that was run, or a failure to yield."""

    time: float  # [s]
    kind: str  # of the event
    vehicle: str
    other: str  # vehicle or wall that was touched
    edge: str
    detail: str


class Ride(NamedTuple):
    """What happened to the vehicles of one run."""

    vehicles: int
    arrivals: tuple[float, ...]  # [s], of those that arrived
    delay: float  # mean delay of those against the speed limits [s]; NaN: none arrived
    hours: float  # on the road, all together [h]
    contacts: int
    caused: int  # contacts but for those of which a vehicle that is no member is the cause, and `by_road`
    red_lights: int
    failures_to_yield: int
    splits: int
    stands: tuple[Stand, ...]
    incidents: tuple[Incident, ...]
    long_on: tuple[str, ...] = ()  # lanes on which vehicles of the traffic stood longer than LONG, if it was recorded
    by_road: int = 0  # contacts where lanes of two directions overlap, of vehicles in the middles of these

    @property
    def last_arrival(self) -> float:
        """[s]; inf if one has not arrived."""
        return max(self.arrivals) if len(self.arrivals) == self.vehicles else math.inf

    @property
    def longest_stand(self) -> Stand:
        return max(self.stands, key=lambda stand: stand.lasts, default=Stand("", 0.0, "", ""))


def ride(folder: Path, trips: Mapping[str, Trip], network: Network) -> Ride:
    """What the tables of a finished run say.

    trips: of each vehicle, by id
    """
    found = load_run(folder)
    events, metrics = found.events, found.metrics
    run = metrics[metrics.scope == "run"].set_index("metric").value
    end = float(events.time_s.max())
    departed = events[events.kind == "departed"].set_index("vehicle_id").time_s
    arrived = events[events.kind == "arrived"].set_index("vehicle_id").time_s
    gone = arrived.reindex(departed.index).fillna(end)
    delays = [at - trips[name].free_time(math.inf) for name, at in arrived.items()]
    return Ride(
        vehicles=len(trips),
        arrivals=tuple(arrived.tolist()),
        delay=float(np.mean(delays)) if delays else math.nan,
        hours=float((gone - departed).sum()) / 3600,
        contacts=int(run["collisions"]),
        caused=int(run["collisions_caused"]),
        red_lights=int(run["red_lights"]),
        failures_to_yield=int(run["failures_to_yield"]),
        splits=int((events.kind == "split").sum()),
        stands=tuple(_stands(events, end, arrived, network, trips)),
        incidents=tuple(_incidents(events, set(departed.index))),
        by_road=int(((events.kind == "collision") & events.what.isin(CAUSED_BY_ROAD)).sum()),
        long_on=() if found.traffic is None else _long_on(found.traffic, network),
    )


def _incidents(events: pd.DataFrame, members: set[str]) -> Iterator[Incident]:
    """As `collisions_caused` of the metrics counts contacts."""
    texts = ["other_id", "edge_id", "what", "detail"]
    found = events[events.kind.isin(["collision", "red_light", "failed_to_yield"])]
    for row in found.assign(**found[texts].fillna("").astype(str)).itertuples():
        by_other = row.what in CAUSED_BY_OTHER and row.other_id not in members
        if row.kind != "collision" or not (by_other or row.what in CAUSED_BY_ROAD):
            detail = row.detail if row.kind != "collision" else row.what.replace("_", " ")
            yield Incident(float(row.time_s), row.kind, row.vehicle_id, row.other_id, row.edge_id, detail)


def _long_on(traffic: pd.DataFrame, network: Network) -> tuple[str, ...]:
    """Lanes on which a vehicle stands for longer than LONG from one row to another."""
    rows = traffic[~traffic.vehicle_id.str.startswith(PERSON)].sort_values(["vehicle_id", "time_s"], kind="stable")
    stands = rows.speed_mps < STANDING
    begins = (stands != stands.shift()) | (rows.vehicle_id != rows.vehicle_id.shift())
    each = rows[stands].groupby(begins.cumsum()[stands])
    first = each.first()[each.time_s.max() - each.time_s.min() > LONG]
    return tuple(sorted({*network.lanes_at(first.x_m, first.y_m)} - {""}))


def _stands(
    events: pd.DataFrame, end: float, arrived: pd.Series, network: Network, trips: Mapping[str, Trip]
) -> Iterator[Stand]:
    """Standstills with their length; one that does not end lasts to the end of the run, or of the vehicle's trip."""
    for vehicle, own in events[events.kind.isin(["standstill", "standstill_end"])].groupby("vehicle_id", sort=False):
        rows = list(own.itertuples())
        for row, after in zip_longest(rows, rows[1:]):
            if row.kind != "standstill":
                continue
            until = float(arrived.get(vehicle, end))
            lasts = until - row.time_s + STANDSTILL_AFTER if after is None else after.duration_s
            (lane,) = network.lanes_at([row.x_m], [row.y_m])
            why, trip = _reason(row), trips[vehicle]
            line = _junction_ahead(lane, trip, with_light=why == LIGHT)
            in_queue = why == NO_ROOM or (line and lane in line.via and why.startswith(BEHIND))
            queue = edge_of(line.onto) if line and in_queue else ""
            onto = _changes_onto(lane, trip) if why == LANE_CHANGE else ""
            unregulated = bool(line) and why == RIGHT_OF_WAY and not network.unregulated.isdisjoint(line.via)
            closed = network.longest_closed.get((line.light, line.index), 0.0) if line and why == LIGHT else 0.0
            one_red = closed > 0 and lasts < closed + STANDSTILL_AFTER
            begins = float(row.time_s) - STANDSTILL_AFTER
            yield Stand(str(vehicle), float(lasts), why, lane, queue, onto, unregulated, one_red, begins)


def _junction_ahead(lane: str, trip: Trip, with_light: bool) -> Line | None:
    """The line of the next junction on a trip, or of the one inside which a lane is; None where there is none.

    with_light: of the next one with a light; it may lie behind another one and a short edge
    """
    junctions = (line for line in trip.lines if line.state != CHANGING)
    ahead = dropwhile(lambda one: not (lane in one.via or edge_of(lane) == edge_of(one.lane)), junctions)
    return next((one for one in ahead if one.light or not with_light), None)


def _changes_onto(lane: str, trip: Trip) -> str:
    """Lane to which a vehicle on a lane changes, or will, by its trip: "" if that is not known.

    The trip changes on the edge of that lane, or on the next one: the middle of a body may be on the lane before that
    of its front. Beside the lanes of the trip, as after a change that had no room, it changes to these.
    """
    ahead = list(dropwhile(lambda one: lane not in (one.lane, *one.via), trip.lines))
    if ahead:
        return next((one.onto for one in ahead[:2] if one.state == CHANGING), "")
    edge, junctions = edge_of(lane), (line for line in trip.lines if line.state != CHANGING)
    beside = next((one for one in junctions if edge in map(edge_of, (one.lane, *one.via))), None)
    if beside is None:
        return ""
    return beside.lane if edge == edge_of(beside.lane) else beside.onto


def _reason(row: Any) -> str:
    what = row.what if isinstance(row.what, str) and row.what else NO_REASON
    text = str(row.detail).partition(", ")[2]
    return f"{what}: {text}" if text else what


def reasons(stands: Sequence[Stand]) -> Counter[str]:
    """The number of standstills by the first word of their reason."""
    return Counter(stand.why.partition(":")[0] for stand in stands)
