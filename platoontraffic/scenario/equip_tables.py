"""The table `equip`: a share of the traffic that becomes members."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from platoontraffic.scenario.base import Fraction, Identifier, Listed, NotNegative, Positive, Table, Text, filled_in
from platoontraffic.scenario.defaults import usual
from platoontraffic.scenario.driver_tables import Driver
from platoontraffic.vehicles.catalogue import VEHICLES, VehicleModel

MODEL = VEHICLES["car"]  # of the vehicle on which a driver's keys are checked; each member has the size of its own
KEEPS_UP = 1.05  # times the speed at which its leader drives on a free road, a follower may drive to catch up
BY_ITSELF = {"keeps_to": "route"}  # of a member that follows any vehicle ahead
USUAL_SIZE, USUAL_WINDOW = 5, 30.0  # of a platoon; time that vehicles wait for others [s]
# The vehicle of the catalogue that a vehicle class of SUMO's drives like; vehicles of other classes stay SUMO's.
VEHICLE_OF = {
    **dict.fromkeys(("passenger", "private", "hov", "taxi", "evehicle", "custom1", "custom2"), "car"),
    "delivery": "van",
    "truck": "truck",
}
A_DAY = 86_400.0  # [s]; a run that is to end with its demand may last so long


class Equip(Table):
    """A share of SUMO's vehicles that become members, at the place and time at which SUMO inserts them.

    By themselves (mode "single") they follow whatever is ahead. In mode "platoons", vehicles that start at the same
    place within `window_s`, with a common beginning of their routes, wait for each other and are one platoon until
    their routes part; a follower then drives as fast as the driver ahead of it would, if that is faster. A vehicle
    without others is a platoon of one.

    Each keeps its id, its route, its size, its lane and its speed. It is chosen by a hash of the seed and its id, so
    that a larger share contains a smaller one. Where several tables fit a vehicle, their shares add up, in their order:
    what is above 1 is left out. Vehicles that are on the road at the end of the warm-up stay SUMO's, and
    so do vehicles of other classes than cars, vans and trucks, those with stops, and those on a route that the members
    cannot drive.
    """

    model_config = filled_in("follower")

    id: Identifier = "equip"
    """Id of the table. In all tables of results it stands for the platoon of the members that are in none; the platoons
    are ID.0, ID.1 and so on."""
    share: Fraction
    """Share of the vehicles that become members; 0: none does."""
    types: Annotated[list[Text], Listed] = Field([])
    """Only vehicles of these types: ids of vehicle types, not of distributions. Default: all."""
    classes: Annotated[list[Literal[tuple(VEHICLE_OF)]], Listed] = Field([])
    """Only vehicles of these of SUMO's vehicle classes. Default: all that can become members."""
    edges: Annotated[list[Text], Listed] = Field([])
    """Only vehicles that depart on these edges. Default: on all."""
    begin_s: NotNegative = 0.0
    """Departures from this time on, by the clock of the run [s]: its time 0 is two steps after SUMO's begin and the
    warm-up."""
    end_s: Positive | None = None
    """Departures before this time [s]. Default: all until the end."""
    mode: Literal["single", "platoons"] = "single"
    """Whether the members are by themselves or form platoons."""
    size: Annotated[int, Field(ge=2, le=100)] | None = None
    """Mode platoons: vehicles of a platoon, at most. Default: 5."""
    window_s: NotNegative | None = None
    """Mode platoons: longest time that a vehicle waits for others [s]. Default: 30."""
    leader: Driver | None = None
    """Mode platoons: law of the leaders, by name or as a table. Default: "path"."""
    follower: Driver
    """Law of all other members, by name or as a table. Default: "tracking" with policy = "obey" and
    on_loss = "drive"; in mode single with keeps_to = "route", in mode platoons with alone.speed_factor = 1.05, so that
    it catches up."""
    stuck: Literal["wait", "remove", "sumo_drives"] = "wait"
    """Remedy for a member that has stood for `stuck_after_s`: none, it is removed, or SUMO drives it from then on."""
    stuck_after_s: Annotated[float, Field(ge=10, le=86_400)] = 300.0
    """Time at a standstill after which a member is stuck [s]."""

    @model_validator(mode="before")
    @classmethod
    def usual_values(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        given = dict(table)
        if table.get("mode") == "platoons":
            given = {"size": USUAL_SIZE, "window_s": USUAL_WINDOW, **given}
        for role in ("leader", "follower") if table.get("mode") == "platoons" else ("follower",):
            driver, named = dict(usual(MODEL).drivers[role]), table.get(role)
            if role == "follower":
                driver |= {"alone": {"speed_factor": KEEPS_UP}} if table.get("mode") == "platoons" else BY_ITSELF
            if named is None:
                given[role] = driver
            elif isinstance(named, dict) and "law" not in named:
                given[role] = {**driver, **named}
        return given

    @model_validator(mode="after")
    def keys_of_its_mode(self) -> Equip:
        if self.mode == "single" and (
            given := [k for k in ("size", "window_s", "leader") if getattr(self, k) is not None]
        ):
            raise ValueError(f'`{given[0]}` goes with mode = "platoons"; must be left out')
        return self

    @model_validator(mode="after")
    def ends_after_its_begin(self) -> Equip:
        if self.end_s is not None and self.end_s <= self.begin_s:
            raise ValueError(f"end_s {self.end_s:g}; must be after begin_s = {self.begin_s:g}")
        return self

    def model(self, place: int) -> VehicleModel:
        """The vehicle that its keys are checked with."""
        return MODEL
