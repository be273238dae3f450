"""The table `equip`: a share of the traffic that becomes members."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from platoontraffic.scenario.base import Fraction, Identifier, NotNegative, Positive, Table, Text, filled_in
from platoontraffic.scenario.defaults import usual
from platoontraffic.scenario.driver_tables import Driver
from platoontraffic.vehicles.catalogue import VEHICLES, VehicleModel

MODEL = VEHICLES["car"]  # of the vehicle on which a driver's keys are checked; each member has the size of its own
A_DAY = 86_400.0  # [s]; a run that is to end with its demand may last so long


class Equip(Table):
    """A share of SUMO's vehicles that become members, at the place and time at which SUMO inserts them.

    Each keeps its id, its route, its size, its lane and its speed. It is chosen by a hash of the seed and its id, so
    that a larger share contains a smaller one. Vehicles that are on the road at the end of the warm-up stay SUMO's, and
    so do vehicles of other classes than cars, vans and trucks, those with stops, and those on a route that the members
    cannot drive.
    """

    model_config = filled_in("follower")

    id: Identifier = "equip"
    """Id of the table, which stands for the platoon of its members in all tables of results."""
    share: Fraction
    """Share of the vehicles that become members; 0: none does."""
    types: list[Text] = Field([])
    """Ids of the vehicle types that the share is of. Default: all."""
    classes: list[Text] = Field([])
    """SUMO's vehicle classes that the share is of, such as "passenger". Default: all that can become members."""
    edges: list[Text] = Field([])
    """Edges on which the vehicles depart that the share is of. Default: all."""
    begin_s: NotNegative = 0.0
    """Departures from this time on [s]."""
    end_s: Positive | None = None
    """Departures before this time [s]. Default: all until the end."""
    follower: Driver
    """Law of the members, by name or as a table. Default: "tracking" with policy = "obey" and on_loss = "drive"."""
    stuck: Literal["wait", "remove", "sumo_drives"] = "wait"
    """Remedy for a member that has stood for `stuck_after_s`: none, it is removed, or SUMO drives it from then on."""
    stuck_after_s: Annotated[float, Field(ge=10, le=86_400)] = 300.0
    """Time at a standstill after which a member is stuck [s]."""

    @model_validator(mode="before")
    @classmethod
    def usual_driver(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        driver, named = usual(MODEL).drivers["follower"], table.get("follower")
        if named is None:
            return {**table, "follower": dict(driver)}
        return {**table, "follower": {**driver, **named}} if isinstance(named, dict) and "law" not in named else table

    @model_validator(mode="after")
    def ends_after_its_begin(self) -> Equip:
        if self.end_s is not None and self.end_s <= self.begin_s:
            raise ValueError(f"end_s {self.end_s:g}; must be after begin_s = {self.begin_s:g}")
        return self

    @property
    def leader(self) -> None:
        """None: all its members drive by the law of followers."""

    @property
    def size(self) -> int:
        """Of each of its platoons."""
        return 1

    def model(self, place: int) -> VehicleModel:
        """The vehicle that its keys are checked with."""
        return MODEL
