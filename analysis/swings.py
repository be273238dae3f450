"""Growth of a disturbance along a platoon, at one frequency or as a norm, and over frequencies."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pandas as pd

from platoontraffic.analysis.limits import LEVEL
from platoontraffic.analysis.results import ResultsError
from platoontraffic.analysis.tables import Names, columns_of, groups, summarise, tidy

STILL = 1e-3  # least swing of a leader for amplification to be defined [m/s]
CLEAR = 3.0  # least amplitude of a member's swing, in amplitudes of its noise [1]
NEIGHBOURS = np.array([-5, -4, -3, -2, 2, 3, 4, 5])  # frequencies of noise: so many periods of the window away


def amplification(
    trajectories: pd.DataFrame,
    frequency: float | str | None = None,
    norm: Literal["l2", "linf"] = "l2",
    window: tuple[float, float] | None = None,
) -> pd.DataFrame:
    """Swing of each member's speed, divided by that of its leader; above 1 the string amplifies it.

    trajectories : of a run, or of a batch with id and varied values before `time_s`
    frequency    : of the leader's swing [Hz], or the column that has it; amplitudes at it are fitted together with mean
                   and linear trend
    norm         : without a frequency: root mean square, or maximum, of the deviation from the linear trend. Only for
                   leaders that swing all the time: a start from rest or a stop outweighs all else in it (the metrics
                   accel_gain_l2 and accel_gain_linf of a run have no such fault)
    window       : period that is used [s]; default: all instants that leader and member have in common
    returns      : the columns before `time_s`, platoon_id, vehicle_id, place, amplification (1 for leaders), and with a
                   frequency signal_to_noise: amplitude over the root mean square of those at eight neighbouring
                   frequencies. NaN where the leader swings by less than 1 mm/s, or leader or member not by three times
                   its noise: a ratio would be one of noise

    Means of ratios are geometric: `summarise(table, "amplification", "place", geometric=True)`; the row of the last
    place is head to tail, with its interval.

    raises: ResultsError
    """
    if norm not in ("l2", "linf"):
        raise ResultsError(f"norm = {norm!r}: must be 'l2' or 'linf'")
    if isinstance(frequency, str):
        columns_of(trajectories, frequency)
    elif frequency is not None and not frequency > 0:
        raise ResultsError(f"frequency = {frequency}: must be positive")
    columns_of(trajectories, ["time_s", "platoon_id", "vehicle_id", "place", "speed_mps"])
    of_run = list(trajectories.columns[: trajectories.columns.get_loc("time_s")])
    rows = trajectories
    if window is not None:
        rows = rows[rows.time_s.between(*window)]
    rows = rows.dropna(subset="speed_mps")
    if rows.empty:
        raise ResultsError(f"amplification: no rows{f' within {window} s' if window else ''}")
    table = []
    for point, platoon in groups(rows, [*of_run, "platoon_id"]):
        leader = platoon[platoon.place == 0].set_index("time_s").speed_mps
        if leader.empty:
            raise ResultsError(f"amplification: platoon {point[-1]}: its leader is not in the table")
        at = float(platoon[frequency].iloc[0]) if isinstance(frequency, str) else frequency
        for (place, vehicle), own in platoon.groupby(["place", "vehicle_id"]):
            own = own.set_index("time_s").speed_mps
            times = own.index.intersection(leader.index)
            found = [_swing(times.to_numpy(), speed[times].to_numpy(), at, norm) for speed in (leader, own)]
            (first, clear), (swing, clarity) = found
            ratio = swing / first if first > STILL and min(clear, clarity) >= CLEAR else math.nan
            table.append((*point, vehicle, place, ratio, clarity))
    made = tidy(table, [*of_run, "platoon_id", "vehicle_id", "place", "amplification", "signal_to_noise"], trajectories)
    return made if frequency is not None else made.drop(columns="signal_to_noise")


def peak(table: pd.DataFrame, frequency: str, by: Names = "place", *, level: float = LEVEL) -> pd.DataFrame:
    """Greatest amplification over frequency: the row of `summarise` with the greatest geometric mean.

    table     : of `amplification`, of runs at several frequencies
    frequency : the column that has them
    returns   : a row a combination of `by`; the level of its interval is corrected for the number of frequencies

    raises: ResultsError
    """
    by = columns_of(table, by)
    corrected = 1 - (1 - level) / table[frequency].nunique()
    of_all = summarise(table, "amplification", [*by, frequency], geometric=True, level=corrected).dropna(subset="mean")
    if of_all.empty:
        raise ResultsError("peak: no amplification is above the noise")
    return tidy(
        [tuple(of_all.loc[rows["mean"].idxmax()]) for _, rows in groups(of_all, by)], list(of_all.columns), table
    )


def _swing(time: np.ndarray, speed: np.ndarray, frequency: float | None, norm: str) -> tuple[float, float]:
    """Amplitude of a speed [m/s], and its ratio to that of the noise; NaN for too few instants."""
    trend = [np.ones_like(time), time - time.mean() if len(time) else time]
    if len(time) <= len(trend) + (2 if frequency is not None else 0):
        return math.nan, math.nan
    if frequency is None:
        rest = _without(trend, speed)[0]
        return float(np.sqrt((rest**2).mean()) if norm == "l2" else np.abs(rest).max()), math.inf
    rest, factors = _without([*trend, *_waves(time, frequency)], speed)
    beside = frequency + NEIGHBOURS / (time[-1] - time[0])
    noise = [np.hypot(*_without(_waves(time, f), rest)[1]) for f in beside[beside > 0]]
    amplitude, level = np.hypot(*factors[2:]), math.sqrt(np.mean(np.square(noise))) if noise else 0.0
    return float(amplitude), float(amplitude / level) if level > 0 else math.inf


def _waves(time: np.ndarray, frequency: float) -> list[np.ndarray]:
    phase = 2 * np.pi * frequency * time
    return [np.cos(phase), np.sin(phase)]


def _without(parts: list[np.ndarray], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is left of the values without these parts, and the factor of each part."""
    base = np.stack(parts, axis=1)
    factors, *_ = np.linalg.lstsq(base, values, rcond=None)
    return values - base @ factors, factors
