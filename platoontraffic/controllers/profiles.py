"""Speed profiles of a leader: speeds over time."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np


def sinusoid(t: np.ndarray, amplitude: float, frequency: float) -> np.ndarray:
    """amplitude sin(2 pi frequency t) [m/s]; t [s], (n,)."""
    return amplitude * np.sin(2 * np.pi * frequency * t)


def chirp(t: np.ndarray, amplitude: float, first: float, last: float, duration: float) -> np.ndarray:
    """A sinusoid with a frequency that changes linearly from first to last [Hz] within the duration [s]; then 0.

    amplitude sin(2 pi (first + (last - first) / duration t / 2) t)
    """
    turns = (first + (last - first) / duration * t / 2) * t
    return np.where(t <= duration, amplitude * np.sin(2 * np.pi * turns), 0.0)


def braking(t: np.ndarray, change: np.ndarray, rate: float) -> np.ndarray:
    """A ramp from 0 to a change of speed, of either sign [m/s], at a constant rate [m/s2]; t [s], (n,)."""
    return np.sign(change) * np.minimum(rate * t, np.abs(change))


def through_lags(speed: Callable, time: np.ndarray, dt: float, lags: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Command that makes a drive line drive a profile [m/s2], (n,): a + T a', with its acceleration a.

    speed : of the profile at times (n,) [m/s]
    dt    : for which the command holds [s]
    lags  : T of the drive, where that is positive, and of the brakes, where it is not [s], (n,)
    """
    before, now, next_, after = (speed(time + k * dt) for k in (-1, 0, 1, 2))
    acceleration, jerk = (next_ - now) / dt, ((after - next_) - (now - before)) / (2 * dt * dt)
    by_drive, by_brakes = (acceleration + lag * jerk for lag in lags)
    return np.where(by_drive > 0, by_drive, np.minimum(by_brakes, 0.0))


@dataclass(frozen=True, eq=False)
class Trace:
    """A speed over time, such as a drive cycle: linear between the given times, constant before and after them."""

    time: np.ndarray  # [s], (k,)
    speed: np.ndarray  # [m/s], (k,)

    def at(self, time: np.ndarray) -> np.ndarray:
        """Speed [m/s] at times (n,)."""
        return np.interp(time, self.time, self.speed)

    @classmethod
    def read(cls, file: Path) -> Trace:
        """The trace in a CSV file with columns time_s and speed_mps, or in one of OpenACC's.

        OpenACC (M. Makridis et al., "OpenACC. An open database of car-following experiments to study the properties of
        commercial ACC systems", Transportation Research Part C 125, 2021): after some lines about the experiment the
        columns Time [s] and Speed1 to SpeedN [m/s] of N cars, and others. The trace is that of the first car, from the
        first row on.

        raises: ValueError with one line that says what is wrong, and where
        """
        try:
            with file.open(encoding="utf-8-sig", newline="") as lines:
                rows = list(csv.reader(lines))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            what = getattr(error, "strerror", None) or error
            raise ValueError(f"{file}: cannot be read: {what}; {_ALLOWED}") from None
        table = np.array(_samples(file, rows)).reshape(-1, 2).T
        if not table.size:
            raise ValueError(f"{file}: has no rows; {_ALLOWED}")
        if not np.isfinite(table).all() or (table[1] < 0).any() or (np.diff(table[0]) <= 0).any():
            raise ValueError(f"{file}: times must grow from row to row, and speeds be 0 or more")
        return cls(*table)


_ALLOWED = "must be a CSV file with columns time_s and speed_mps, or with Time and Speed1, as of OpenACC"
_OPENACC = "Time", "Speed1"
_PREAMBLE = 20  # most lines before the columns of a file of OpenACC


def _samples(file: Path, rows: Sequence[Sequence[str]]) -> list[tuple[float, float]]:
    """Time [s] and speed [m/s] of every row.

    raises: ValueError with file, line and what is wrong
    """
    head = next((i for i, row in enumerate(rows[:_PREAMBLE]) if {*_OPENACC} <= {*row}), 0)
    found = rows[head] if rows else ()
    names = _OPENACC if {*_OPENACC} <= {*found} else ("time_s", "speed_mps")
    if missing := {*names} - {*found}:
        raise ValueError(f"{file}: has no column {' and '.join(sorted(missing))}; {_ALLOWED}")
    columns = [found.index(name) for name in names]
    samples = []
    for number, row in enumerate(rows[head + 1 :], start=head + 2):
        if not row:
            continue
        values = [row[k] if k < len(row) else None for k in columns]
        try:
            samples.append((float(values[0]), float(values[1])))
        except (TypeError, ValueError):
            what = ", ".join(f"{name} {value!r}" for name, value in zip(names, values, strict=True))
            raise ValueError(f"{file}:{number}: {what}; must be numbers") from None
    begin = samples[0][0] if names == _OPENACC and samples else 0.0
    return [(time - begin, speed) for time, speed in samples]
