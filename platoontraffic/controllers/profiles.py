"""Speed profiles of a leader: speeds over time."""

from __future__ import annotations

import csv
from collections.abc import Callable
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
        """The trace in a CSV file with columns time_s and speed_mps.

        raises: ValueError with one line that says what is wrong, and where
        """
        try:
            with file.open(encoding="utf-8-sig", newline="") as lines:
                table = np.array(_samples(file, csv.DictReader(lines))).reshape(-1, 2).T
        except (OSError, UnicodeDecodeError) as error:
            what = getattr(error, "strerror", None) or error
            raise ValueError(f"{file}: cannot be read: {what}; {_ALLOWED}") from None
        if not table.size:
            raise ValueError(f"{file}: has no rows; {_ALLOWED}")
        if not np.isfinite(table).all() or (table[1] < 0).any() or (np.diff(table[0]) <= 0).any():
            raise ValueError(f"{file}: times must grow from row to row, and speeds be 0 or more")
        return cls(*table)


_ALLOWED = "must be a CSV file with columns time_s and speed_mps"


def _samples(file: Path, rows: csv.DictReader) -> list[tuple[float, float]]:
    """Time [s] and speed [m/s] of every row.

    raises: ValueError with file, line and what is wrong
    """
    if missing := {"time_s", "speed_mps"} - set(rows.fieldnames or ()):
        raise ValueError(f"{file}: has no column {' and '.join(sorted(missing))}; {_ALLOWED}")
    samples = []
    for row in rows:
        try:
            samples.append((float(row["time_s"]), float(row["speed_mps"])))
        except (TypeError, ValueError):
            what = f"time_s {row['time_s']!r}, speed_mps {row['speed_mps']!r}; must be numbers"
            raise ValueError(f"{file}:{rows.line_num}: {what}") from None
    return samples
