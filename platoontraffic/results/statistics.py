"""statistics.csv: each member's values of each quantity over all steps of a run, however often it was recorded.

Most quantities are columns of trajectories.csv. Where that has a row for every step, `from_trajectories` computes the
same from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from platoontraffic.observation.statistics import Statistics
from platoontraffic.vehicles.bicycle import VALID_LATERAL
from platoontraffic.world.events import ENOUGH_BEAMS, EXPOSED
from platoontraffic.world.fleet import Member


class Quantity(NamedTuple):
    """A quantity that every member has a value of in every step, or in some."""

    name: str  # that of a column of trajectories.csv, if it is one
    unit: str
    field: str  # in `statistics_kernel.VALUES`
    meaning: str = ""  # "": as in trajectories.csv


QUANTITIES = (
    Quantity("speed_mps", "m/s", "speed"),
    Quantity("accel_mps2", "m/s2", "acceleration"),
    Quantity("jerk_mps3", "m/s3", "jerk"),
    Quantity("lateral_accel_mps2", "m/s2", "lateral_acceleration"),
    Quantity(
        "lateral_accel_beyond",
        "",
        "beyond_valid",
        f"1 where |lateral_accel_mps2| is above {VALID_LATERAL:g} m/s2, to which the model of a car is valid, else 0",
    ),
    Quantity("centre_speed_mps", "m/s", "centre_speed", "distance that the centre moved in the step, over its length"),
    Quantity("turning_radps", "rad/s", "turning", "change of turned_rad in the step, over its length"),
    Quantity("gap_m", "m", "gap"),
    Quantity("gap_error_m", "m", "gap_error"),
    Quantity("time_gap_s", "s", "time_gap"),
    Quantity("closing_mps", "m/s", "closing"),
    Quantity("ttc_s", "s", "time_to_collision"),
    Quantity("ttc_shortfall_s", "s", "shortfall", f"{EXPOSED:g} s - ttc_s where that is positive, else none"),
    Quantity("drac_mps2", "m/s2", "needed_braking"),
    Quantity("occluded_share", "", "occluded"),
    Quantity(
        "beams_enough",
        "",
        "beams_enough",
        f"1 where beams_on_predecessor is {ENOUGH_BEAMS} or more, 0 where it is less",
    ),
    Quantity("cross_track_m", "m", "cross_track"),
    Quantity("clearance_m", "m", "clearance"),
    Quantity("contact_in_s", "s", "contact_in"),
    Quantity(
        "message_age_s",
        "s",
        "message_age",
        "age of the newest message of its predecessor that has arrived; none without a channel. It is not in "
        "trajectories.csv",
    ),
    Quantity(
        "message_lost",
        "",
        "message_lost",
        "1 for a message of its predecessor that is lost, 0 for one that is not, at the steps in which one is sent",
    ),
)


class Row(NamedTuple):
    """One row of statistics.csv."""

    platoon_id: str
    place: int
    vehicle_id: str
    quantity: str
    time_s: float  # number of steps with a value, times the step
    mean: float
    rms: float
    min: float
    max: float

    @property
    def integral(self) -> float:
        """Over time; 0 if there was no value."""
        return self.mean * self.time_s if self.time_s else 0.0

    @property
    def largest(self) -> float:
        """Greatest absolute value."""
        return max(-self.min, self.max)


NOTHING = Row("", 0, "", "", 0.0, math.nan, math.nan, math.nan, math.nan)  # of a quantity that never had a value


def rows(statistics: Statistics, members: Sequence[Member], dt: float) -> Iterator[Row]:
    """By platoon and place.

    members : all of the run, by their number
    dt      : length of a step [s]
    """
    for number, m in sorted(enumerate(members), key=lambda one: (one[1].platoon, one[1].place)):
        of_member = statistics.of(number)
        for quantity in QUANTITIES:
            if found := of_member.get(quantity.field):
                yield Row(m.platoon, m.place, m.id, quantity.name, found.steps * dt, *found[1:])


def from_trajectories(trajectories: pd.DataFrame) -> pd.DataFrame:
    """The table, if trajectories.csv has a row for every step; of the recorded instants, if not."""
    times = np.unique(trajectories.time_s)
    dt = float(np.diff(times).min()) if len(times) > 1 else 0.0
    found = []
    for member, own in trajectories.groupby(["platoon_id", "place", "vehicle_id"]):
        for name, values in _values(own).items():
            if values.notna().any():
                found.append(of_values(values, dt, (*member, name)))
    return pd.DataFrame(found, columns=Row._fields)


def of_values(values: pd.Series, dt: float = 0.0, of: tuple[str, int, str, str] = NOTHING[:4]) -> Row:
    """Statistics of values, NaN where there is none.

    dt : time for which each of them stands [s]
    of : the first four fields of the row
    """
    there = values.dropna()
    rms = float(np.sqrt((there**2).mean()))
    return Row(*of, len(there) * dt, there.mean(), rms, there.min(), there.max())


def by_vehicle(statistics: pd.DataFrame) -> dict[str, dict[str, Row]]:
    """Vehicle -> quantity -> row of the table."""
    found: dict[str, dict[str, Row]] = {}
    for row in statistics.itertuples(index=False):
        found.setdefault(row.vehicle_id, {})[row.quantity] = Row(*row)
    return found


def _values(own: pd.DataFrame) -> dict[str, pd.Series]:
    """Values of each quantity by the rows of one member."""
    step = own.time_s.diff()
    derived = {
        "lateral_accel_beyond": (own.lateral_accel_mps2.abs() > VALID_LATERAL).astype(float),
        "centre_speed_mps": np.hypot(own.x_m.diff(), own.y_m.diff()) / step,
        "turning_radps": own.turned_rad.diff() / step,
        "ttc_shortfall_s": (EXPOSED - own.ttc_s)[own.ttc_s < EXPOSED],
        "beams_enough": (own.beams_on_predecessor.dropna() >= ENOUGH_BEAMS).astype(float),
    }
    derived |= {name: pd.Series(dtype=float) for name in ("message_age_s", "message_lost")}  # are not recorded
    return {one.name: derived[one.name] if one.name in derived else own[one.name] for one in QUANTITIES}
