"""Speeds over time: what a leader is asked to drive."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np


def sinusoid(t: np.ndarray, amplitude: float, frequency: float) -> np.ndarray:
    """amplitude sin(2 pi frequency t)."""
    return amplitude * np.sin(2 * np.pi * frequency * t)


def chirp(t: np.ndarray, amplitude: float, first: float, last: float, lasts: float) -> np.ndarray:
    """A sinusoid whose frequency grows linearly from the first to the last while it lasts; then 0."""
    turns = (first + (last - first) / lasts * t / 2) * t
    return np.where(t <= lasts, amplitude * np.sin(2 * np.pi * turns), 0.0)


def braking(t: np.ndarray, height: np.ndarray, rate: float) -> np.ndarray:
    """To the height at a constant rate, whichever way."""
    return np.sign(height) * np.minimum(rate * t, np.abs(height))


@dataclass(frozen=True, eq=False)
class Trace:
    """A speed over time, such as a drive cycle: linear between known times, at the ends kept."""

    time: np.ndarray  # [s], (k,)
    speed: np.ndarray  # [m/s], (k,)

    def at(self, time: np.ndarray) -> np.ndarray:
        """Speed [m/s] at times (n,)."""
        return np.interp(time, self.time, self.speed)

    @classmethod
    def read(cls, file: Path) -> Trace:
        """Of a CSV file with columns time_s and speed_mps.

        raises: ValueError with one line that says where and what is wrong
        """
        wanted = "must be a CSV file with columns time_s and speed_mps"
        try:
            with file.open(encoding="utf-8-sig", newline="") as lines:
                rows = csv.DictReader(lines)
                if missing := {"time_s", "speed_mps"} - set(rows.fieldnames or ()):
                    raise ValueError(f"{file}: has no column {' and '.join(sorted(missing))}; {wanted}")
                values = []
                for row in rows:
                    try:
                        values.append((float(row["time_s"]), float(row["speed_mps"])))
                    except (TypeError, ValueError):
                        what = f"time_s {row['time_s']!r}, speed_mps {row['speed_mps']!r}; must be numbers"
                        raise ValueError(f"{file}:{rows.line_num}: {what}") from None
        except (OSError, UnicodeDecodeError) as error:
            raise ValueError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}; {wanted}") from None
        table = np.array(values).reshape(-1, 2).T
        if not table.size:
            raise ValueError(f"{file}: has no rows; {wanted}")
        if not np.isfinite(table).all() or (table[1] < 0).any() or (np.diff(table[0]) <= 0).any():
            raise ValueError(f"{file}: times must grow from row to row, and speeds be 0 or more")
        return cls(*table)
