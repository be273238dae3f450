"""Tables of a scenario file, as pydantic models.

Keys carry their unit, and the string below a key is its description in the JSON schema (`platoontraffic schema`).
What needs more than one table to be checked is in `checks`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from platoontraffic.scenario.base import (
    Finite,
    Fraction,
    Identifier,
    LaneIndex,
    Listed,
    Names,
    NotNegative,
    Positive,
    Speed,
    Table,
    Text,
    filled_in,
)
from platoontraffic.scenario.defaults import usual, usual_step, usual_walls, vehicles_in, with_drivers
from platoontraffic.scenario.driver_tables import Driver
from platoontraffic.scenario.equip_tables import Equip
from platoontraffic.scenario.learn_table import Learn
from platoontraffic.scenario.obstacle_tables import Obstacle
from platoontraffic.scenario.vehicle_tables import Vehicle
from platoontraffic.vehicles.catalogue import VehicleModel


class Sumo(Table):
    """The road network and the background traffic."""

    net: Text | None = None
    """Name of a shipped network, or a .net.xml file. Default: none; either `net` or `config` must be given."""
    config: Text | None = None
    """A SUMO configuration (.sumocfg), which names the network, the routes and further files.
    Default: none; either `net` or `config` must be given."""
    routes: Names = Field([])
    """Route files of background traffic."""
    additional: Names = Field([])
    """Additional files for SUMO. Their polygons of type wall, obstacle or building stop lidar beams and vehicles."""
    traffic: bool = True
    """Whether a shipped network brings its own routes and bus stops. Its polygons are always used."""
    demand: Annotated[float, Field(gt=0, le=100)] | None = None
    """Factor on the number of vehicles in the route files, on top of a configuration's `scale`. Default: 1."""
    warm_up_s: Annotated[float, Field(ge=0, le=86_400)] = 0.0
    """Time for which background traffic drives before the first platoon is inserted [s]."""
    lane_change_s: Annotated[float, Field(ge=0, le=60)] | None = None
    """Time that a SUMO-driven vehicle takes to change lanes [s]. Default: that of the configuration, or else 3 where
    SUMO drives a leader, or else 0."""

    @model_validator(mode="after")
    def one_of_both(self) -> Sumo:
        if (self.net is None) == (self.config is None):
            raise ValueError("must have either `net` or `config`")
        return self


class SceneTable(Table):
    """What the lidars see besides vehicles, and how scans are computed."""

    model_config = filled_in("walls")

    walls: Literal["outline", "none"]
    """Where walls stand: along the outline of the drivable area, or nowhere. Default: "none" where all vehicles are
    cars, vans or trucks, whose roads have kerbs, and otherwise "outline"."""
    lidar_engine: Literal["raster", "numpy", "pymunk", "shapely"] = "raster"
    """Engine that computes the scans: "raster" is compiled and fast, the others are slow references."""


class Run(Table):
    """The step of the simulation, and when the run ends."""

    model_config = filled_in("step_s")

    step_s: Positive
    """Step of the simulation [s]; whole milliseconds. Default: the step-length of a SUMO configuration, if the
    following is a multiple of it; or else 0.1 where all vehicles are cars, vans or trucks with lasers of at most 10 Hz,
    and otherwise 0.025."""
    duration_s: Positive
    """Simulated time at which the run ends [s]; a multiple of step_s. Required, unless a SUMO configuration that is
    run as a scenario names its end."""
    laps: Positive | None = None
    """Number of full turns after which the run ends early, as soon as every member has completed them.
    Default: the run does not end early."""
    ends_at_contact: bool = False
    """Whether the run ends early at the first contact of a member with a vehicle, an obstacle or a wall."""

    @field_validator("step_s")
    @classmethod
    def whole_milliseconds(cls, step: float) -> float:
        if step < 0.001 or abs(step * 1000 - round(step * 1000)) > 1e-9:
            raise ValueError("must be whole milliseconds, SUMO's unit of time, and one or more")
        return step


class Record(Table):
    """Which tables a run leaves, and their sampling intervals."""

    every_s: Positive = 0.1
    """Interval between the rows of a member in trajectories.csv [s]. statistics.csv sees every step."""
    traffic_every_s: Positive | None = None
    """Interval between the rows of a background vehicle in traffic.csv [s]. Default: the table is not written."""
    scans_every_s: Positive | None = None
    """Interval between the recorded scans in scans.npz [s]. Default: the file is not written."""
    sumo: Annotated[list[Literal["trips", "summary", "edges", "signals"]], Listed] = Field([])
    """SUMO's own tables to write, as sumo_trips.csv, sumo_summary.csv, sumo_edges.csv and sumo_signals.csv (states of
    traffic lights)."""
    sumo_every_s: Positive = 60.0
    """Interval between the rows of sumo_summary.csv, and length of the intervals of sumo_edges.csv [s]."""
    passages: Names = Field([])
    """Edges at whose ends all vehicles that pass are recorded, in passages.csv, as a detector would."""
    metrics: Names = Field([])
    """Metrics beside the tool's own: names of installed ones, or module:Class from a file beside the scenario."""


class Start(Table):
    """Where, when and how fast a platoon starts."""

    time_s: NotNegative = 0.0
    """Departure time [s]. A platoon that departs later than 0 waits until there is room."""
    speed_mps: Speed = 0.0
    """Speed of all members at the start [m/s]."""
    edge: str
    """Edge on which the leader starts."""
    lane: LaneIndex = 0
    """Index of the lane, 0 the outermost: the rightmost, on left-hand roads the leftmost."""
    position_m: Finite
    """Position of the leader's front bumper along the lane [m]."""
    lateral_m: Finite = 0.0
    """Offset of all members to the left of the lane's centre line [m]."""


class Platoon(Table):
    """A leader and its followers."""

    model_config = filled_in("leader")

    id: Identifier = "platoon"
    """Id of the platoon; its members are ID.0 (the leader), ID.1 and so on."""
    size: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number of members, the leader included. Default: the number of `vehicles`, or else 1."""
    vehicle: Vehicle = Vehicle()
    """Vehicle of all members, by name or as a table."""
    vehicles: Annotated[list[Vehicle], Field(min_length=1), Listed] | None = None
    """Vehicle of each member, the leader's first, by name or as a table; all of them cars, vans and trucks, or all
    robots. Default: `vehicle` for all members. `size` may then be left out."""
    start: Start
    """Where, when and how fast the platoon starts."""
    gap_m: Positive | None = None
    """Gap between members at the start, bumper to bumper [m]. Default: 0.5 for robots, 2.5 for cars."""
    route: Names = Field([])
    """Edges to drive. For laws that need a route; they take `route` or `to`."""
    to: Text | None = None
    """Last edge of the route, reached by the fastest path. Default: the route is `route`, if that is given."""
    loop: bool = False
    """Whether the route begins again at its end."""
    leader: Driver
    """Law of the leader, by name or as a table. Default: for cars, vans and trucks "path"; required for robots."""
    follower: Driver | None = None
    """Law of the followers, by name or as a table. Default: none for a size of 1; or else, for cars, vans and trucks
    "tracking" with policy = "obey" and on_loss = "drive"; required for robots."""

    @model_validator(mode="before")
    @classmethod
    def drivers_by_vehicle(cls, table: Any) -> Any:
        return with_drivers(table)

    @field_validator("id")
    @classmethod
    def not_taken(cls, name: str) -> str:
        if name == "person":
            raise ValueError("'person': its members would have the ids of SUMO's pedestrians; must be another id")
        return name

    @model_validator(mode="before")
    @classmethod
    def one_or_all(cls, table: Any) -> Any:
        if isinstance(table, dict) and "vehicle" in table and "vehicles" in table:
            raise ValueError("has `vehicle` beside `vehicles`; must have one or the other")
        return table

    @model_validator(mode="after")
    def one_vehicle_each(self) -> Platoon:
        if self.vehicles is None:
            return self
        if len(self.vehicles) != self.size:
            raise ValueError(f"has {len(self.vehicles)} `vehicles` for a size of {self.size}; must have as many")
        if len({type(vehicle.model()) for vehicle in self.vehicles}) > 1:
            raise ValueError("`vehicles` has robots beside cars; must have vehicles of one class")
        return self

    def model(self, place: int) -> VehicleModel:
        """The vehicle at a place, 0 the leader's."""
        return (self.vehicles[place] if self.vehicles else self.vehicle).model()

    def behind_leader(self, place: int) -> float:
        """Distance of a member's front bumper from the leader's at the start [m]."""
        if self.vehicles is None:
            return place * (self.vehicle.model().length + self.gap_m)
        return sum(vehicle.model().length + self.gap_m for vehicle in self.vehicles[:place])

    @model_validator(mode="after")
    def gap_by_vehicle(self) -> Platoon:
        gap = usual(self.model(0)).gap if self.gap_m is None else self.gap_m
        return self.model_copy(update={"gap_m": gap})

    @model_validator(mode="after")
    def followers_have_a_law(self) -> Platoon:
        if self.to is not None and (self.route or self.loop):
            raise ValueError("has `to` beside `route` or `loop`; must have one or the other")
        if self.size > 1 and self.follower is None:
            raise ValueError("a platoon of two members or more must have a [platoon.follower]")
        return self


class Manoeuvre(Table):
    """An order that a member receives at a set time."""

    kind: Literal["split", "join", "leave"]
    """Order: split off and lead, join the vehicle `behind`, or leave on another route."""
    vehicle: str
    """Id of the member that receives the order."""
    time_s: NotNegative
    """Time at which it receives the order [s]."""
    behind: str | None = None
    """Kind join: id of the member that becomes its predecessor. Default: none; required to join, and only then."""
    route: Names = Field([])
    """Kind leave: edges of its new route, which contains the edge on which its platoon starts."""
    to: Text | None = None
    """Kind leave: last edge of its new route, reached by the fastest path. Default: the new route is `route`."""

    @model_validator(mode="after")
    def keys_of_its_kind(self) -> Manoeuvre:
        if (self.kind == "join") != (self.behind is not None):
            raise ValueError("`behind` must be given to join, and only then")
        if (self.kind == "leave") != bool(self.route or self.to) or (self.route and self.to):
            raise ValueError("either `route` or `to` must be given to leave, and only then")
        return self


class Breakdown(Table):
    """A failure of a member's drive or laser."""

    vehicle: str
    """Id of the member."""
    what: Literal["drive", "laser"]
    """Part that fails: without its drive a member coasts to a stop in its lane, without its laser it loses every
    beam."""
    time_s: NotNegative
    """Time of the failure [s]."""
    lasts_s: Positive | None = None
    """Time until the part works again [s]. Default: it does not work again."""
    rate_mps2: Annotated[float, Field(gt=0, le=10)] = 2.0
    """Deceleration of a member without its drive [m/s2]."""

    def begins_before_end_of(self, other: Breakdown) -> bool:
        return other.lasts_s is None or self.time_s <= other.time_s + other.lasts_s


class Blackout(Table):
    """A time in which messages are lost."""

    time_s: NotNegative
    """Begin [s]."""
    lasts_s: Positive
    """Duration [s]."""
    sender: str | None = None
    """Id of the member whose messages are lost. Default: those of all."""
    receiver: str | None = None
    """Id of the member that does not receive them. Default: none does."""


class Channel(Table):
    """Messages from each member to its follower, and from the leader to all followers, where laws need them."""

    rate_hz: Positive = 10.0
    """Messages per second of each member [Hz]; the interval must be a multiple of run.step_s."""
    latency_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Least time from sending to use: a message is used in the first step that begins this long after it was sent, or
    later [s]."""
    jitter_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Greatest further time, uniform from 0, independent for each message and receiver [s]. A message that a newer one
    has overtaken is dropped."""
    loss: Fraction = 0.0
    """Probability that a message is lost, independent for each message and receiver."""
    burst_loss: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of the messages that are lost in bursts besides."""
    burst_length: Annotated[float, Field(ge=1, le=1e6)] = 5.0
    """Mean number of messages in a burst."""
    range_m: Positive | None = None
    """Distance between two vehicles' centres beyond which messages are lost [m]. Default: none."""
    blocked_by_buildings: bool = False
    """Whether messages are lost where a building or obstacle stands between the two vehicles' centres."""
    lost_after_s: Positive | None = None
    """Age of the newest message from which on the radio counts as lost [s]. Default: that at which the next one but
    one is due at the latest."""
    blackout: list[Blackout] = Field([])
    """Times in which messages are lost, one [[channel.blackout]] table each."""

    @model_validator(mode="after")
    def bursts_are_possible(self) -> Channel:
        if self.burst_begins > 1:
            least = self.burst_loss / (1 - self.burst_loss)
            raise ValueError(f"burst_length {self.burst_length:g} for a burst_loss of {self.burst_loss:g}; must be at "
                             f"least {least:g}")  # fmt: skip
        return self

    @property
    def burst_begins(self) -> float:
        """Probability that a burst begins with a message."""
        return self.burst_loss / (self.burst_length * (1 - self.burst_loss))

    @property
    def silence_s(self) -> float:
        """Age of the newest message above which the radio counts as lost [s]."""
        return self.lost_after_s or 2 / self.rate_hz + self.latency_s + self.jitter_s


class Branch(Table):
    """Keys that change at a set time. The run until then is that of the scenario without this table."""

    at_s: NotNegative
    """Time of the change [s]; a multiple of run.step_s. What is decided at this time is still decided as before."""
    then: Annotated[dict[str, Any], Field(min_length=1)]
    """Keys of leaders, followers and breakdowns with their new values, dotted or as tables inside one another. A law
    of another class begins without memory."""


class Spec(Table):
    """A scenario file."""

    model_config = filled_in("scene")

    name: Identifier = "scenario"
    """Name of the scenario, and of the folder of its results. If not given: the file's name, or for `run.sumocfg`,
    `sumo.sumocfg`, `osm.sumocfg`, `config.sumocfg` and `simulation.sumocfg` the name of their folder."""
    title: str = ""
    """One line that says what happens."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of everything random: background traffic, and errors of lidars and odometry."""
    sumo: Sumo
    """The road network and the background traffic."""
    scene: SceneTable
    """What the lidars see besides vehicles, and how scans are computed."""
    run: Run
    """The step of the simulation, and when the run ends."""
    record: Record = Record()
    """Which tables the run leaves, and their sampling intervals."""
    platoon: list[Platoon] = Field([])
    """The platoons, one [[platoon]] table each. Required, unless there is an [[equip]] table."""
    equip: list[Equip] = Field([])
    """Shares of the traffic that become members, one [[equip]] table each."""
    obstacle: list[Obstacle] = Field([])
    """Bodies that get in the way, one [[obstacle]] table each."""
    manoeuvre: list[Manoeuvre] = Field([])
    """Orders to members, one [[manoeuvre]] table each."""
    breakdown: list[Breakdown] = Field([])
    """Failures of members, one [[breakdown]] table each."""
    channel: Channel | None = None
    """Messages between members. Default: there are none."""
    branch: Branch | None = None
    """Keys that change at a set time. Default: none does."""
    learn: Learn | None = None
    """For environments, in which members learn; runs do not use it. Default: that of the table's defaults."""

    @property
    def groups(self) -> list[Platoon | Equip]:
        """Tables of members: the platoons, then the shares of the traffic."""
        return [*self.platoon, *self.equip]

    def key_of(self, group: int) -> tuple[str, int]:
        """The key of one of `groups`."""
        platoons = len(self.platoon)
        return ("platoon", group) if group < platoons else ("equip", group - platoons)

    @model_validator(mode="after")
    def has_members(self) -> Spec:
        if not self.groups:
            raise ValueError("has no members; must have a [[platoon]] or an [[equip]] table")
        return self

    @model_validator(mode="before")
    @classmethod
    def by_vehicles(cls, table: Any) -> Any:
        """Fill in the defaults that depend on the vehicles."""
        if not isinstance(table, dict):
            return table
        vehicles = vehicles_in(table)
        defaults = {"scene": {"walls": usual_walls(vehicles)}}
        if "run" in table:
            defaults["run"] = {"step_s": usual_step(vehicles)}
        if table.get("equip"):
            # Of hundreds of members a row each step would be gigabytes; the question is what they do to all trips.
            defaults["record"] = {"every_s": 1.0, "sumo": ["trips"]}
        given = {key: table.get(key, {}) for key in defaults}
        return table | {key: defaults[key] | own for key, own in given.items() if isinstance(own, dict)}
